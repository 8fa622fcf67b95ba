"""A frame in stages: decide (jitted), trace what is left (host), add up (jitted).

Array code and ray tracing take turns, each with all cores: side by side they would wait for one
another.
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Array, Int, UInt8

from jaxvis.chunks import block_of
from jaxvis.devices import dealer
from jaxvis.methods.traced import ShadingPoints, block_points
from jaxvis.methods.visibility_field.left import Listed, Turned, settle
from jaxvis.scene import RayTracer

RAYS_PER_BLOCK = 1 << 17
"""Rays in one call of the jitted stages. Fixed, so that each point meets the same machine code and
gives the same bits whatever the chunk."""

RAYS_PER_CHUNK = 1 << 21
"""Rays that are decided before any is traced, in whole blocks: about 20 bytes each."""

RAYS_PER_JOB = 1 << 16
"""Rays among which a thread traces those that are left, before it takes the next."""


class Rays(NamedTuple):
    """A block of rays, decided (:mod:`~jaxvis.methods.visibility_field.cull`).

    ``texel`` is the environment's that each points to, where adding them up needs it.
    """

    directions: Turned | Listed
    decision: UInt8[Array, "points samples"]
    texel: Int[Array, "points samples"] | None = None


class Block(NamedTuple):
    """Points, of which the first ``inside`` count, with their rays."""

    first: int
    inside: int
    points: ShadingPoints
    rays: Rays


Draw = Callable[[ShadingPoints], Rays]


def traced_blocks(
    tracer: RayTracer,
    points: ShadingPoints,
    draw: Draw,
    samples: int,
    *,
    rays_per_chunk: int = RAYS_PER_CHUNK,
    advance: Callable[[int], Any] = lambda points: None,
) -> Iterator[tuple[Block, UInt8[np.ndarray, "points samples"]]]:
    """Blocks of points with their rays' last decisions: ACCEPT for those that reach the sky.

    Args:
        draw: jitted stages that give a block of points ``samples`` rays each.
        rays_per_chunk: bounds memory; results do not depend on it.
        advance: called with the number of points done.
    """
    count = len(points.pixel)
    block = block_points(count, samples, RAYS_PER_BLOCK)
    chunk = max(1, rays_per_chunk // (block * samples)) * block
    deal = dealer()
    with ThreadPoolExecutor(tracer.threads, thread_name_prefix="jaxvis-field") as pool:
        for begin in range(0, count, chunk):
            blocks = []
            for first in range(begin, min(begin + chunk, count), block):
                with deal(first // block):
                    part = block_of(points, first, block)
                    blocks.append(Block(first, min(block, count - first), part, draw(part)))
            yield from zip(blocks, _trace(tracer, pool, blocks), strict=True)
            advance(min(chunk, count - begin))


def _trace(
    tracer: RayTracer, pool: ThreadPoolExecutor, blocks: Sequence[Block]
) -> list[UInt8[np.ndarray, "points samples"]]:
    """The blocks' decisions, with no ray left to trace."""
    settled, jobs = [], []
    for _, inside, points, rays in blocks:
        decision, origins = np.array(rays.decision), np.asarray(points.origin)
        settled.append(decision)
        step = max(1, RAYS_PER_JOB // decision.shape[1])
        for first in range(0, inside, step):
            part = slice(first, min(first + step, inside))
            jobs.append((origins[part], rays.directions, first, decision[part]))
    list(pool.map(lambda job: settle(tracer, *job), jobs))
    return settled
