"""Path maps: where the rays of a surface leave the scene (Bashford-Rogers et al. 2014; paper 000,
section IV-D).
"""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, UInt32

from jaxvis.chunks import block_of, map_on_host
from jaxvis.methods.estimators import draw_brdf, random_numbers
from jaxvis.methods.traced import (
    Components,
    Proposal,
    Propose,
    ShadingPoints,
    block_points,
    propose,
    reflected,
)
from jaxvis.reflectance import Reflectance
from jaxvis.reflectance.model import luminance
from jaxvis.scene import RayTracer
from jaxvis.sphere import latlong

RAYS_PER_BLOCK = 1 << 14
"""Rays of a pre-pass that a thread traces at once."""


def path_map(
    tracer: RayTracer,
    points: ShadingPoints,
    words: UInt32[Array, "2"],
    paths: int,
    shape: tuple[int, int],
    *,
    reflectance: Reflectance,
) -> Float[np.ndarray, "rows columns"]:
    """What free rays from the points, drawn by the BRDF, carry through each cell (host, float64).

    Of the sum over ``paths`` rays, each cell of a lat-long map of this ``shape`` gets the
    throughput (luminance of BRDF x cosine / density) of those that leave through it. In expectation
    that is the integral over the cell of BRDF x cosine x visibility, summed over where paths start:
    their contribution under light of luminance 1.
    """
    total = np.zeros(shape[0] * shape[1])
    count = len(points.pixel)
    if count == 0:
        return total.reshape(shape)

    def proposed(block: ShadingPoints) -> Proposal:
        return brdf_paths(block, words, 1, reflectance=reflectance)

    for rays, visible in traced(tracer, _starts(points, paths), proposed, 1):
        cells = np.asarray(cells_of(rays, shape=shape))
        total += np.bincount(cells[visible], np.asarray(_carried(rays))[visible], len(total))
    return total.reshape(shape)


def directional_distribution(
    carried: Float[np.ndarray, "rows columns"], floor: float
) -> Float[np.ndarray, "rows columns"]:
    """The path map as a density per steradian of mean 1, blurred (5 x 5, binomial), with a floor.

    ``floor`` is the share that is the same in every direction: estimators that draw from nothing
    else stay unbiased by it. A map of zeros gives 1 everywhere.
    """
    rows, columns = carried.shape
    angles = np.broadcast_to(latlong.row_solid_angles(rows, columns)[:, None], carried.shape)
    density = _blurred(carried) / _blurred(angles)
    mean = np.sum(density * angles) / (4.0 * np.pi)
    if mean == 0.0:
        return np.ones(carried.shape)
    return (1.0 - floor) * density / mean + floor


def brdf_paths(
    points: ShadingPoints, words: UInt32[Array, "2"], samples: int, *, reflectance: Reflectance
) -> Proposal:
    """Rays drawn by the BRDF, weighted by their throughput."""
    numbers = random_numbers(words, points, first=0, samples=samples)
    directions = draw_brdf(points, numbers, reflectance=reflectance)
    value, density = reflected(points, directions, reflectance=reflectance)
    return _throughput(points, directions, value, density)


def traced(
    tracer: RayTracer, points: ShadingPoints, proposed: Propose, samples: int
) -> Iterator[tuple[Proposal, Bool[np.ndarray, "points samples"]]]:
    """The rays of each block of points in turn, ``samples`` a point, and which are not blocked.

    Blocks are padded with points that no ray is traced from.
    """
    count = len(points.pixel)
    block = block_points(count, samples, RAYS_PER_BLOCK)

    def trace(start: int) -> tuple[Proposal, Bool[np.ndarray, "points samples"]]:
        part = block_of(points, start, block)
        rays = proposed(part)
        active = np.array(rays.active)
        active[count - start :] = False
        directions = [np.asarray(axis) for axis in rays.directions]
        return rays, tracer.visible(np.asarray(part.origin), directions, active)

    starts = range(0, count, block)
    for start in starts[:1]:  # compiles, and so goes alone
        yield trace(start)
    with ThreadPoolExecutor(tracer.threads, thread_name_prefix="jaxvis-paths") as pool:
        yield from pool.map(trace, starts[1:])


def _starts(points: ShadingPoints, paths: int) -> ShadingPoints:
    """Points that paths start from, evenly spread; those that start more than one count as often.

    As many whatever the number of points, so that no other camera needs other programs; numbered
    anew, since random numbers belong to pixels.
    """
    count = len(points.pixel)
    index = ((np.arange(paths) + 0.5) * (count / paths)).astype(np.int64)
    some = map_on_host(lambda leaf: leaf.take(index, axis=0), points)
    return replace(some, pixel=jnp.arange(paths))


@jax.jit
def _throughput(
    points: ShadingPoints,
    directions: Components,
    value: Float[Array, "points samples 3"],
    density: Float[Array, "points samples"],
) -> Proposal:
    over = jnp.where(density > 0.0, 1.0 / jnp.where(density > 0.0, density, 1.0), 0.0)
    return propose(jnp.stack(directions, axis=-1), value * over[..., None], points)


@partial(jax.jit, static_argnames="shape")
def cells_of(rays: Proposal, *, shape: tuple[int, int]) -> Int[Array, "points samples"]:
    """The cell (row * columns + column) of a lat-long map that each ray points to."""
    row, column = latlong.texel(jnp.stack(rays.directions, axis=-1), *shape)
    return row * shape[1] + column


@jax.jit
def _carried(rays: Proposal) -> Float[Array, "points samples"]:
    return luminance(jnp.stack(rays.weights, axis=-1))


def _blurred(values: Float[np.ndarray, "rows columns"]) -> Float[np.ndarray, "rows columns"]:
    """Binomial 5 x 5, around the seam and across the poles."""
    columns = values.shape[1]
    for _ in range(2):  # 1 2 1 twice is 1 4 6 4 1
        across = 0.25 * (np.roll(values, 1, axis=1) + np.roll(values, -1, axis=1)) + 0.5 * values
        over_north = np.roll(across[:1], columns // 2, axis=1)
        over_south = np.roll(across[-1:], columns // 2, axis=1)
        tall = np.concatenate([over_north, across, over_south])
        values = 0.25 * (tall[:-2] + tall[2:]) + 0.5 * tall[1:-1]
    return values
