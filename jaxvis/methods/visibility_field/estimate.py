"""Radiance of the shaded points from rays that a field has culled."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, UInt8, UInt32

from jaxvis.chunks import map_on_host
from jaxvis.devices import dealer
from jaxvis.methods.estimators import (
    Counts,
    Draw,
    Drawn,
    MonteCarloLight,
    draws,
    weighed,
)
from jaxvis.methods.traced import Components, ShadingPoints, reflected
from jaxvis.methods.visibility_field.brdf_rays import brdf_directions
from jaxvis.methods.visibility_field.cull import ACCEPT, Table, decision_of, locate
from jaxvis.methods.visibility_field.hemisphere import (
    Shifts,
    local_directions,
    mean_radiance,
    turned_frames,
    turns,
    world_directions,
)
from jaxvis.methods.visibility_field.left import Listed, Turned
from jaxvis.methods.visibility_field.stages import RAYS_PER_CHUNK, Block, Rays, traced_blocks
from jaxvis.reflectance import Reflectance
from jaxvis.scene import RayTracer
from jaxvis.sphere import harmonics

WEIGHED_AT_ONCE = 1 << 14
"""Visible rays in one call of the jitted weights: fixed, so that each meets the same machine code
and gives the same bits."""

WEIGHED_TOGETHER = 1 << 17
"""Visible rays that wait until they are weighed: those of whole blocks."""


class Frame(NamedTuple):
    """What the estimators of one frame share. Without a ``table`` every ray is traced.

    ``inverted`` tells which of the table's rows have label 0, for the control variate.
    """

    tracer: RayTracer
    points: ShadingPoints
    columns: int
    table: Table | None = None
    inverted: Bool[Array, "rows"] | None = None
    rays_per_chunk: int = RAYS_PER_CHUNK
    advance: Callable[[int], Any] = lambda points: None

    def blocks(
        self, draw: Callable[[ShadingPoints], Rays], samples: int
    ) -> Iterator[tuple[Block, UInt8[np.ndarray, "points samples"]]]:
        """:func:`~..stages.traced_blocks` of this frame."""
        return traced_blocks(
            self.tracer,
            self.points,
            draw,
            samples,
            rays_per_chunk=self.rays_per_chunk,
            advance=self.advance,
        )


def diffuse(
    frame: Frame,
    coefficients: Float[Array, "9 3"],
    moved: Shifts,
    spp: int,
) -> Float[np.ndarray, "points 3"]:
    """E / pi by cosine-weighted rays under nine harmonics (paper 001, eqs. 9 to 11, Algorithm 2).

    In ``inverted`` cells the unshadowed irradiance is exact, and only what is blocked is sampled
    (eq. 11). Elsewhere the image differs from one without a field by wrong decisions alone.
    """
    local = local_directions(spp)
    columns = jnp.int32(frame.columns)
    draw = partial(cosine_rays, frame.table, local, columns, moved)

    radiance = np.empty((len(frame.points.pixel), 3), np.float32)
    for (first, inside, points, rays), decision in frame.blocks(draw, spp):
        frames = cast(Turned, rays.directions).frames
        mean = mean_radiance(coefficients, frames, local, decision)
        if frame.table is not None and frame.inverted is not None:
            label_0 = jnp.take(frame.inverted, locate(frame.table, points), mode="wrap")
            if jnp.any(label_0):
                every_ray = np.full_like(decision, ACCEPT)
                everything = mean_radiance(coefficients, frames, local, every_ray)
                exact = harmonics.irradiance(coefficients, points.normal) / jnp.pi
                mean = jnp.where(label_0[:, None], exact - (everything - mean), mean)
        radiance[first : first + inside] = np.asarray(mean)[:inside]
    return radiance * np.asarray(frame.points.material.base_colour)


def glossy(
    frame: Frame,
    coefficients: Float[Array, "9 3"],
    moved: Shifts,
    spp: int,
    reflectance: Reflectance,
) -> Float[np.ndarray, "points 3"]:
    """Any reflectance under nine harmonics: rays drawn by the BRDF (paper 001, section 6)."""
    columns = jnp.int32(frame.columns)
    draw = partial(brdf_rays, frame.table, columns, moved, samples=spp, reflectance=reflectance)

    def weigh(points: ShadingPoints, directions: Components, _: Array) -> Float[Array, "rays 3"]:
        return harmonic_weights(
            coefficients, points, directions, samples=spp, reflectance=reflectance
        )

    return _summed(frame, draw, weigh, spp)


def all_frequency(
    frame: Frame,
    light: MonteCarloLight,
    words: UInt32[Array, "2"],
    spp: int,
    reflectance: Reflectance,
) -> Float[np.ndarray, "points 3"]:
    """Multiple importance sampling under the environment itself: half of the rays by its radiance,
    half by the BRDF, with the balance heuristic. Unbiased, given right decisions.
    """
    counts = Counts(environment=(spp + 1) // 2, brdf=spp // 2)

    def weigh(
        points: ShadingPoints, directions: Components, texel: Int[Array, "rows"]
    ) -> Float[Array, "rays 3"]:
        axes = tuple(axis[:, None] for axis in directions)
        drawn = Drawn((axes[0], axes[1], axes[2]), texel[:, None])
        weights = weighed(light, points, drawn, counts=counts, reflectance=reflectance).weights
        return jnp.concatenate(weights, axis=1)

    def decided(draw: Draw, points: ShadingPoints) -> Rays:
        drawn = draw(points)
        decision = decision_of(frame.table, points, drawn.directions)
        return Rays(Listed(drawn.directions), decision, drawn.texel)

    # Each technique takes all points; the bar counts them once.
    quiet = frame._replace(advance=lambda points: None)
    techniques = draws(counts, light, words, reflectance)
    radiance = np.zeros((len(frame.points.pixel), 3), np.float32)
    for which, (draw, samples) in enumerate(zip(techniques, filter(None, counts), strict=True)):
        told = quiet if which else frame
        radiance += _summed(told, partial(decided, draw), weigh, int(samples))
    return radiance


@jax.jit
def cosine_rays(
    table: Table | None,
    local: Float[Array, "samples 3"],
    columns: Int[Array, ""],
    moved: Shifts,
    points: ShadingPoints,
) -> Rays:
    """Cosine-weighted rays of a block, decided, with the frames that turned them."""
    frames = turned_frames(points.normal, turns(points.pixel, columns, moved))
    directions = world_directions(frames, local)
    return Rays(Turned(frames, local), decision_of(table, points, directions))


@partial(jax.jit, static_argnames=("samples", "reflectance"))
def brdf_rays(
    table: Table | None,
    columns: Int[Array, ""],
    moved: Shifts,
    points: ShadingPoints,
    *,
    samples: int,
    reflectance: Reflectance,
) -> Rays:
    """Rays of a block by the BRDF, decided."""
    turn = turns(points.pixel, columns, moved)
    directions = brdf_directions(points, turn, samples=samples, reflectance=reflectance)
    return Rays(Listed(directions), decision_of(table, points, directions))


@partial(jax.jit, static_argnames=("samples", "reflectance"))
def harmonic_weights(
    coefficients: Float[Array, "9 3"],
    points: ShadingPoints,
    directions: Components,
    *,
    samples: int,
    reflectance: Reflectance,
) -> Float[Array, "rays 3"]:
    """BRDF x cosine x radiance / (density x rays), a ray a point."""
    axes = tuple(axis[:, None] for axis in directions)
    value, density = reflected(points, (axes[0], axes[1], axes[2]), reflectance=reflectance)
    over = jnp.where(density > 0.0, 1.0 / jnp.where(density > 0.0, samples * density, 1.0), 0.0)
    radiance = harmonics.reconstruct(coefficients, jnp.stack(directions, axis=-1))
    return value[:, 0] * over * radiance


Weigh = Callable[[ShadingPoints, Components, Int[Array, "rows"]], Float[Array, "rays 3"]]
"""(each ray's point, its direction, its texel) -> what it adds to the radiance."""


def _summed(
    frame: Frame, draw: Callable[[ShadingPoints], Rays], weigh: Weigh, samples: int
) -> Float[np.ndarray, "points 3"]:
    """Sum of the weights of the rays that reach the sky. Only these are weighed."""
    radiance = np.zeros((len(frame.points.pixel), 3), np.float32)
    waiting: list[Lit] = []
    for (first, inside, _, rays), decision in frame.blocks(draw, samples):
        waiting.append(_lit(first, rays, decision[:inside]))
        if sum(len(lit.point) for lit in waiting) >= WEIGHED_TOGETHER:
            _add(radiance, frame.points, waiting, weigh)
            waiting = []
    _add(radiance, frame.points, waiting, weigh)
    return radiance


class Lit(NamedTuple):
    """Rays that reach the sky: point after point, whole points only (host)."""

    point: Int[np.ndarray, "rays"]
    x: Float[np.ndarray, "rays"]
    y: Float[np.ndarray, "rays"]
    z: Float[np.ndarray, "rays"]
    texel: Int[np.ndarray, "rays"]


def _lit(first: int, rays: Rays, decision: UInt8[np.ndarray, "points samples"]) -> Lit:
    """Those of a block whose points begin with ``first``."""
    flat = np.flatnonzero(decision == ACCEPT)
    axes = cast(Listed, rays.directions).directions
    x, y, z = (np.asarray(axis).reshape(-1).take(flat) for axis in axes)
    if rays.texel is None:
        texel = np.zeros(len(flat), np.int32)
    else:
        texel = np.asarray(rays.texel).reshape(-1).take(flat)
    return Lit((first + flat // decision.shape[1]).astype(np.int32), x, y, z, texel)


def _add(
    radiance: Float[np.ndarray, "points 3"],
    points: ShadingPoints,
    waiting: list[Lit],
    weigh: Weigh,
) -> None:
    """Weighs rays, :data:`WEIGHED_AT_ONCE` a call, and adds them to their points."""
    count = sum(len(lit.point) for lit in waiting)
    if not count:
        return
    rays = Lit(*(np.concatenate(arrays) for arrays in zip(*waiting, strict=True)))
    padded = Lit(*(np.pad(array, (0, -count % WEIGHED_AT_ONCE), "edge") for array in rays))
    weights, deal = [], dealer()
    for block, start in enumerate(range(0, len(padded.point), WEIGHED_AT_ONCE)):
        part = Lit(*(array[start : start + WEIGHED_AT_ONCE] for array in padded))
        with deal(block):
            axes = (jnp.asarray(part.x), jnp.asarray(part.y), jnp.asarray(part.z))
            weights.append(weigh(_taken(points, part.point), axes, jnp.asarray(part.texel)))
    begins = np.flatnonzero(np.diff(rays.point, prepend=-1))
    sums = np.add.reduceat(np.concatenate(weights)[:count], begins, axis=0)
    radiance[rays.point[begins]] += sums


def _taken(points: ShadingPoints, chosen: Int[np.ndarray, "rays"]) -> ShadingPoints:
    """The point of each ray."""
    return map_on_host(lambda leaf: leaf.take(chosen, axis=0), points)
