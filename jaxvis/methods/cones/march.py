"""Marching along cones through 3D and 2D lightmaps (paper 003, section VI)."""

from dataclasses import dataclass
from functools import partial
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxvis.methods.cones.cells import (
    Accumulation,
    Cube,
    Fit,
    Lanes,
    Vector,
    fitting_cube,
    footprint,
    may_meet,
    occlusion,
    search,
)
from jaxvis.methods.cones.cones import cone_set, upright_frame
from jaxvis.methods.cones.heights import Plan
from jaxvis.methods.cones.horizon import SLICES, Slices, above, clear_of, rise_to, slices_of
from jaxvis.methods.cones.light import Sky
from jaxvis.methods.cones.ranges import PowerSums
from jaxvis.methods.cones.volume import Channels, Grid, sample_volume
from jaxvis.methods.traced import components
from jaxvis.sphere import latlong

Stepping = Literal["cubes", "half"]
Search = Literal["horizon", "cells"]

OPAQUE = 0.99

SPENT = 0.02
"""Share of a cone that is still clear, below which the search by cells leaves it alone."""

TINY = 0.25
"""Half of the diagonal of what a cube has in the voxels' box, in voxels of its level: smaller parts
are left out."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Lightmaps:
    """What cones meet: voxels, a height field, or both. Colours are of exitant radiance; without
    any the surfaces are black."""

    grid: Grid | None
    volume: Channels
    """Red, green, blue (premultiplied) and opacity, or opacity alone."""
    plan: Plan | None
    heights: Array | None
    """16-bit, all levels."""
    colours: tuple[Array, ...]
    """Red, green and blue of the height field, all levels, or none."""
    ranges: Array | PowerSums | None = None
    """Of the heights, where they are searched by cells."""
    azimuth: Array | np.float32 = np.float32(0.0)  # noqa: RUF009
    """At which rings of cones begin (radians)."""

    @property
    def nbytes(self) -> int:
        """Bytes of all tables."""
        return sum(int(leaf.nbytes) for leaf in jax.tree.leaves(self))


@dataclass(frozen=True)
class March:
    """How cones advance."""

    stepping: Stepping
    """``"cubes"``: fitting cubes that touch one another (eq. 10); ``"half"``: half of the cone's
    width, as voxel cone tracing does."""
    cones: int
    steps: int
    near: int = 0
    """Steps before these, up to the size of a voxel."""
    search: Search = "horizon"
    """What rises above horizons along three azimuths, or the paper's search of cells in cubes."""
    fit: Fit = "clean"
    """Of the cubes."""
    accumulation: Accumulation = "clean"
    """Of what is found in cells."""


class Points(NamedTuple):
    """Where cones start."""

    position: Float[Array, "points 3"]
    normal: Float[Array, "points 3"]
    away: Float[Array, "points"]
    """How far from the surface, along its normal."""
    first: Float[Array, "points"]
    """Distance along the cone at which it begins."""
    apart: Float[Array, "points"]
    """Distance up to which voxels are left out: those of the point's own surface."""


@partial(jax.jit, static_argnames="march")
def cone_radiosity(
    maps: Lightmaps,
    sky: Sky,
    points: Points,
    aperture: Float[Array, ""] | float,
    march: March,
) -> Float[Array, "points 3"]:
    """Irradiance by cones: their weights x what each one gathers, and the sky where it leaves
    (eq. 4 without albedo / pi).

    Args:
        maps: what the cones meet.
        sky: the environment, averaged over a cone about each direction.
        points: where cones start.
        aperture: full angle of the cones (radians).
        march: how they advance.
    """
    cones = cone_set(march.cones)
    start = points.position + points.normal * points.away[:, None]
    tangent, bitangent = upright_frame(points.normal, maps.azimuth)
    begin, upright = components(start), components(points.normal)

    axes = jnp.asarray(cones.axes, jnp.float32), jnp.asarray(cones.weights, jnp.float32)

    def axis_of(local: Array) -> Float[Array, "points 3"]:
        return local[0] * tangent + local[1] * bitangent + local[2] * points.normal

    def free(total: Totals, cone: tuple[Array, Array]) -> tuple[Totals, None]:
        axis = axis_of(cone[0])
        upper, lower = sky.over(axis)
        return Totals(total.upper + cone[1] * upper, total.lower + cone[1] * lower, 0.0), None

    def one(total: Totals, cone: tuple[Array, Array]) -> tuple[Totals, None]:
        axis, weight = axis_of(cone[0]), cone[1]
        gathered, clear, shares = _one_cone(
            maps, begin, components(axis), upright, points, 0.5 * aperture, march
        )
        upper, lower = (
            weight * (clear * share)[:, None] * part
            for share, part in zip(shares, sky.over(axis), strict=True)
        )
        surfaces = weight * jnp.stack(gathered, axis=-1)
        return Totals(total.upper + upper, total.lower + lower, total.surfaces + surfaces), None

    none = jnp.zeros_like(start)
    unblocked, _ = jax.lax.scan(free, Totals(none, none, 0.0), axes)
    total, _ = jax.lax.scan(one, Totals(none, none, none), axes)
    # Cones overlap, reach below the tangent plane, and weigh all that is in them alike: what they
    # would make of a free sky tells how much too bright or too dark that is.
    exact = (latlong.bilinear(part, points.normal) for part in (sky.from_above, sky.from_below))
    upper, lower = (
        of * jnp.where(alone > 0.0, whole / jnp.maximum(alone, 1e-12), 0.0)
        for of, alone, whole in zip(total[:2], unblocked[:2], exact, strict=True)
    )
    return upper + lower + total.surfaces


class Totals(NamedTuple):
    """Irradiance: from the sky above and below the horizon, and from surfaces."""

    upper: Float[Array, "points 3"]
    lower: Float[Array, "points 3"]
    surfaces: Float[Array, "points 3"] | float


class State(NamedTuple):
    """Of a cone on its way."""

    distance: Lanes
    clear: Lanes
    """Share that the voxels let through."""
    covered: tuple[Lanes, ...]
    """Share of each slice that is below the horizon."""
    colour: Vector


def _one_cone(
    maps: Lightmaps,
    begin: Vector,
    toward: Vector,
    normal: Vector,
    points: Points,
    half: Array | float,
    march: March,
) -> tuple[Vector, Lanes, tuple[Lanes, Lanes]]:
    """(radiance gathered, share of the cone that the voxels let through, shares of its parts above
    and below elevation 0 that the height field does)."""
    zero = jnp.zeros_like(points.first)
    follow = maps.plan is not None and march.search == "horizon"
    slices = slices_of(toward, normal, half) if follow else None
    state = State(points.first, zero + 1.0, (zero,) * len(SLICES), (zero, zero, zero))

    def step(state: State, _: None) -> tuple[State, None]:
        return _advance(maps, begin, toward, half, march, slices, points.apart, state), None

    if march.near and maps.grid is not None:
        voxel = maps.grid.voxel

        def near(state: State, _: None) -> tuple[State, None]:
            before, (after, _) = state.distance < voxel, step(state, _)
            return jax.tree.map(lambda a, b: jnp.where(before, a, b), after, state), None

        state, _ = jax.lax.scan(jax.checkpoint(near), state, None, length=march.near)  # pyright: ignore
    state, _ = jax.lax.scan(jax.checkpoint(step), state, None, length=march.steps)  # pyright: ignore
    if slices is None:
        return state.colour, state.clear, (zero + 1.0, zero + 1.0)
    return state.colour, state.clear, clear_of(slices, state.covered)


def _advance(
    maps: Lightmaps,
    begin: Vector,
    toward: Vector,
    half: Array | float,
    march: March,
    slices: Slices | None,
    apart: Lanes,
    state: State,
) -> State:
    if march.stepping == "cubes":
        cube = fitting_cube(begin, toward, state.distance, half, march.fit)
        length = cube.side
    else:
        side = 2.0 * state.distance * jnp.tan(half)
        if maps.grid is not None:
            side = jnp.maximum(side, maps.grid.voxel)
        ahead = (b + state.distance * d for b, d in zip(begin, toward, strict=True))
        cube, length = Cube(tuple(ahead), side), 0.5 * side  # pyright: ignore
    clear, covered, colour = state.clear, state.covered, state.colour
    seen_over = 1.0 if slices is None else above(slices, covered)
    if maps.grid is not None:
        found, opacity = _in_cube(
            maps.grid, maps.volume, cube, toward, length, state.distance >= apart
        )
        colour = tuple(c + clear * seen_over * f for c, f in zip(colour, found, strict=True))  # pyright: ignore
        clear = clear * (1.0 - opacity)
    if slices is not None:
        assert maps.plan is not None
        assert maps.heights is not None
        covered, seen = rise_to(
            maps.plan,
            maps.heights,
            maps.colours,
            begin,
            slices,
            state.distance,
            length,
            half,
            covered,
        )
        colour = tuple(c + clear * s for c, s in zip(colour, seen, strict=True))  # pyright: ignore
    elif maps.plan is not None:
        seen, share = _over_cells(maps, begin, toward, half, cube, march, state.distance, clear)
        colour = tuple(c + clear * s for c, s in zip(colour, seen, strict=True))  # pyright: ignore
        clear = clear * (1.0 - share)
    return State(state.distance + length, clear, covered, colour)  # pyright: ignore


def _in_cube(
    grid: Grid,
    volume: Channels,
    cube: Cube,
    toward: Vector,
    length: Lanes,
    wanted: Bool[Array, "lanes"],
) -> tuple[Vector, Lanes]:
    """Premultiplied radiance and opacity of what the voxels have in a cube (eqs. 12, 15)."""
    extent = grid.resolution * grid.voxel
    centres, volume_share, diagonal = [], 1.0, 0.0
    for axis, m in enumerate(cube.centre):
        low = jnp.maximum(m - 0.5 * cube.side, grid.low[axis])
        high = jnp.minimum(m + 0.5 * cube.side, grid.low[axis] + extent)
        centres.append(0.5 * (low + high))
        # Across the cone, what lies beside the grid is empty; along it, its walls are as opaque.
        share = jnp.clip((high - low) / cube.side, 0.0, 1.0)
        across = 1.0 - toward[axis] * toward[axis]
        volume_share = volume_share * jnp.where(
            share > 0.0, jnp.maximum(share, 1e-6) ** across, 0.0
        )
        diagonal = diagonal + jnp.maximum(high - low, 0.0) ** 2
    size = jnp.maximum(cube.side, grid.voxel)
    inside = wanted & (volume_share > 0.0) & (diagonal > (2.0 * TINY * size) ** 2)

    def look() -> tuple[Vector, Lanes]:
        level = jnp.log2(size / grid.voxel)
        *premultiplied, opacity = sample_volume(grid, volume, tuple(centres), toward, level)
        opacity = jnp.clip(opacity, 0.0, OPAQUE)
        # Opacity of a cube's depth, for the part of it that is passed and that lies in the grid.
        passed = 1.0 - (1.0 - opacity) ** (length / size)
        passed = jnp.where(inside, passed * volume_share, 0.0)
        scale = passed / jnp.maximum(opacity, 1e-4)
        if not premultiplied:
            return _nothing(length)[0], passed
        red, green, blue = premultiplied
        return (red * scale, green * scale, blue * scale), passed

    # Skipped where no cone's cube of a block meets the box: XLA would look it up for all.
    return jax.lax.cond(jnp.any(inside), look, lambda: _nothing(length))


def _nothing(like: Lanes) -> tuple[Vector, Lanes]:
    """Neither radiance nor opacity."""
    zero = jnp.zeros_like(like)
    return (zero, zero, zero), zero


def _over_cells(
    maps: Lightmaps,
    begin: Vector,
    toward: Vector,
    half: Array | float,
    cube: Cube,
    march: March,
    distance: Lanes,
    clear: Lanes,
) -> tuple[Vector, Lanes]:
    """Premultiplied radiance and occlusion of what cells of the height field have in a cube."""
    plan, heights, table = maps.plan, maps.heights, maps.ranges
    assert plan is not None
    assert heights is not None
    assert table is not None
    rectangle = footprint(plan, cube)
    wanted = (clear > SPENT) & may_meet(table, plan, rectangle, cube)

    def look() -> tuple[Vector, Lanes]:
        found = search(plan, heights, maps.colours, begin, toward, half, cube, rectangle)
        share = jnp.where(
            wanted, occlusion(found.coverage, cube.side, distance, march.accumulation), 0.0
        )
        if not maps.colours:
            return _nothing(share)[0], share
        return tuple(share * channel for channel in found.colour), share  # pyright: ignore

    # Skipped where no cone of a block has to search.
    return jax.lax.cond(jnp.any(wanted), look, lambda: _nothing(distance))
