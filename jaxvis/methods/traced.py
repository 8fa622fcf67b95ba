"""Shading by traced rays, in stages: jitted array code around host ray tracing (DESIGN §1).

A jitted stage proposes rays and what each would contribute if nothing blocks it; the rays that
could contribute are compacted and traced on the host; a jitted stage adds up those that got
through.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from os import PathLike
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float, Int

from jaxvis.cache import load_arrays, save_arrays
from jaxvis.chunks import block_of
from jaxvis.devices import dealer, device_count
from jaxvis.reflectance import MaterialValues, Reflectance
from jaxvis.scene import RayTracer, Scene, Surface
from jaxvis.scene.rays import offset_origins
from jaxvis.sphere.frames import dot

RAYS_PER_BLOCK = 1 << 16
"""Rays in one call of the jitted stages, at most. Fixed, so that each point meets the same machine
code and gives the same bits whatever the chunk, and that no other camera needs other programs."""

POINTS_PER_BLOCK = (1 << 10, 1 << 14)
"""Points in one call, at most: few for images that have no more, so that they are padded less."""

RAYS_PER_CHUNK = 1 << 17
"""Rays that a thread proposes before it traces them, in whole blocks: about 60 bytes each."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class RayVisibility:
    """Visibility that is traced while shading: nothing but the triangles and their Embree tree."""

    positions: Float[Array | np.ndarray, "vertices 3"]
    triangles: Int[Array | np.ndarray, "triangles 3"]
    tracer: RayTracer = field(metadata={"static": True})

    @classmethod
    def of(cls, scene: Scene) -> "RayVisibility":
        return cls(scene.positions, scene.triangles, scene.tracer)

    @property
    def nbytes(self) -> int:
        return int(self.positions.nbytes + self.triangles.nbytes)

    @property
    def rays_traced(self) -> int:
        """Rays traced through it so far."""
        return self.tracer.rays_traced

    def save(self, path: str | PathLike) -> None:
        """Writes an .npz file."""
        arrays = {"positions": self.positions, "triangles": self.triangles}
        save_arrays(path, "ray-visibility", arrays)

    @classmethod
    def load(cls, path: str | PathLike) -> "RayVisibility":
        """Reads what :meth:`save` wrote and rebuilds the Embree tree."""
        arrays, _ = load_arrays(path, "ray-visibility")
        positions, triangles = arrays["positions"], arrays["triangles"]
        return cls(positions, triangles, RayTracer(positions, triangles))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ShadingPoints:
    """The points of a surface that are shaded, as one list.

    ``origin`` is where their rays start, ``pixel`` the index of each in the surface.
    """

    origin: Float[Array, "points 3"]
    normal: Float[Array, "points 3"]
    geometric_normal: Float[Array, "points 3"]
    view: Float[Array, "points 3"]
    material: MaterialValues
    pixel: Int[Array, "points"]

    def per_sample(self) -> tuple[MaterialValues, Array, Array]:
        """Material, normal and view with an axis for the samples, to broadcast over."""
        material = jax.tree.map(lambda leaf: leaf[:, None], self.material)
        return material, self.normal[:, None, :], self.view[:, None, :]


Components = tuple[Float[Array, "*rays"], Float[Array, "*rays"], Float[Array, "*rays"]]
"""Three arrays instead of one with a last axis of three: what XLA vectorises on a CPU."""


class Proposal(NamedTuple):
    """Rays from each point. ``weights`` is what a ray adds to the radiance if it is unoccluded.

    Rays end where their light is, after ``limits``, or leave the scene if there are none.
    ``known`` tells which are unoccluded where that is known: none of them is traced.
    """

    directions: Components
    weights: Components
    active: Bool[Array, "points samples"]
    limits: Float[Array, "points samples"] | None = None
    known: Bool[Array, "points samples"] | None = None


Propose = Callable[[ShadingPoints], Proposal]


def components(vectors: Float[Array, "*rays 3"]) -> Components:
    """The vectors' three components."""
    return vectors[..., 0], vectors[..., 1], vectors[..., 2]


@partial(jax.jit, static_argnames="reflectance")
def reflected(
    points: ShadingPoints, directions: Components, *, reflectance: Reflectance
) -> tuple[Float[Array, "points samples 3"], Float[Array, "points samples"]]:
    """BRDF x cosine and the BRDF's sampling density.

    Jitted apart from what uses them: fused, XLA would evaluate the model once for each channel.
    """
    return reflectance.evaluate_and_pdf(*points.per_sample(), jnp.stack(directions, axis=-1))


def propose(
    directions: Float[Array, "points samples 3"],
    weights: Float[Array, "points samples 3"],
    points: ShadingPoints,
    limits: Float[Array, "points samples"] | None = None,
) -> Proposal:
    """Keeps the rays that can contribute: above the triangle's plane and of non-zero weight.

    A ray below the plane of its own triangle is blocked by that triangle, whatever the shading
    normal says.
    """
    above = dot(points.geometric_normal[:, None, :], directions) > 0.0
    active = above & (jnp.max(weights, axis=-1) > 0.0)
    return Proposal(components(directions), components(weights), active, limits)


def shading_points(surface: Surface) -> ShadingPoints:
    """The shaded points of a surface. Gathered on the host: their number is not known before."""
    pixel = np.flatnonzero(np.asarray(surface.mask).reshape(-1))

    def gather(leaf: Array) -> Array:
        if isinstance(leaf, Tracer):  # differentiated, which the host cannot be
            return leaf.reshape(-1, *leaf.shape[2:])[pixel]
        flat = np.asarray(leaf).reshape(-1, *leaf.shape[2:])
        return jax.device_put(flat.take(pixel, axis=0))  # jnp.asarray would compile for the shape

    geometric_normal = gather(surface.geometric_normal)
    origin = offset_origins(np.asarray(gather(surface.position)), np.asarray(geometric_normal))
    return ShadingPoints(
        jax.device_put(origin),
        gather(surface.normal),
        geometric_normal,
        gather(surface.view),
        jax.tree.map(gather, surface.material),
        jax.device_put(pixel.astype(np.int32)),
    )


def trace_and_sum(
    tracer: RayTracer,
    points: ShadingPoints,
    proposals: Sequence[Propose],
    samples: int,
    *,
    rays_per_chunk: int = RAYS_PER_CHUNK,
    advance: Callable[[int], Any] = lambda points: None,
) -> Float[np.ndarray, "points 3"]:
    """Sum over all proposals of the weights of the rays that nothing blocks.

    Args:
        proposals: functions of a block of points, made of jitted stages, each of which gives up to
            ``samples`` rays a point; a point's rays must not depend on the other points.
        rays_per_chunk: how many rays a thread proposes ahead of tracing, rounded to whole blocks:
            bounds memory. Results do not depend on it.
        advance: called with the number of points done.

    Raises:
        ValueError: ``rays_per_chunk`` is less than 1.
    """
    if rays_per_chunk < 1:
        raise ValueError(f"rays_per_chunk must be at least 1, got {rays_per_chunk}")
    count = len(points.pixel)
    radiance = np.zeros((count, 3), np.float32)
    block = block_points(count, samples)
    chunk = max(1, rays_per_chunk // (block * samples)) * block

    deal = dealer()

    def shade_chunk(first: int) -> int:
        with deal(first // chunk):
            return shade_blocks(range(first, min(first + chunk, count), block))

    def shade_blocks(starts: range) -> int:
        blocks = [block_of(points, start, block) for start in starts]
        for propose_rays in proposals:
            proposed = [propose_rays(part) for part in blocks]
            for start, part, rays in zip(starts, blocks, proposed, strict=True):
                inside = min(block, count - start)
                visible = _trace(tracer, part, rays, inside)
                total = np.asarray(_sum(rays.weights, visible))
                radiance[start : start + inside] += total[:inside]
        return starts.stop - starts.start

    # Each thread takes a chunk through all stages, so that none waits for another. The first chunk
    # goes alone: it compiles.
    firsts = iter(range(0, count, chunk))
    for first in islice(firsts, 1):
        advance(shade_chunk(first))
    threads = max(tracer.threads, device_count())
    with ThreadPoolExecutor(threads, thread_name_prefix="jaxvis-shading") as pool:
        for done in pool.map(shade_chunk, firsts):
            advance(done)
    return radiance


def block_points(count: int, samples: int, rays: int = RAYS_PER_BLOCK) -> int:
    """Points in a block of up to ``rays`` rays: a power of two."""
    few, many = POINTS_PER_BLOCK
    allowed = 1 << (max(1, rays // samples).bit_length() - 1)
    return min(few if count <= few else many, allowed)


def _trace(
    tracer: RayTracer, points: ShadingPoints, rays: Proposal, inside: int
) -> Bool[np.ndarray, "points samples"]:
    """Which rays are not blocked; the points after ``inside`` are padding."""
    if rays.known is not None:
        return np.asarray(rays.known)
    active = np.array(rays.active)
    active[inside:] = False
    directions = [np.asarray(axis) for axis in rays.directions]
    limits = None if rays.limits is None else np.asarray(rays.limits)
    return tracer.visible(np.asarray(points.origin), directions, active, limits)


@jax.jit
def _sum(weights: Components, visible: Bool[Array, "points samples"]) -> Float[Array, "points 3"]:
    return jnp.stack([jnp.sum(jnp.where(visible, w, 0.0), axis=1) for w in weights], axis=-1)


def to_image(
    surface: Surface, points: ShadingPoints, radiance: Float[Array | np.ndarray, "points 3"]
) -> Array:
    """The image [height, width, 3] of the radiance of the shaded points."""
    if isinstance(radiance, Tracer):
        flat = jnp.zeros((surface.mask.size, 3)).at[points.pixel].set(radiance)
    else:
        flat = np.zeros((surface.mask.size, 3), np.float32)
        flat[np.asarray(points.pixel)] = radiance
    return surface.to_image(jnp.asarray(flat.reshape(*surface.mask.shape, 3)))
