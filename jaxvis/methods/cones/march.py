"""Marching along cones through 3D and 2D lightmaps (paper 003, section VI)."""

from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxvis.methods.cones.cones import cone_set, upright_frame
from jaxvis.methods.cones.heights import LARGEST, Plan, corners
from jaxvis.methods.cones.light import Sky
from jaxvis.methods.cones.volume import Channels, Grid, sample_volume

Stepping = Literal["cubes", "half"]

Lanes = Float[Array, "lanes"]
Vector = tuple[Lanes, Lanes, Lanes]

SLICES = (-2.0 / 3.0, 0.0, 2.0 / 3.0)
"""Azimuths across a cone in which horizons are followed, in half widths."""

OPAQUE = 0.99


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
    """Steps before these through the height field alone, up to the size of a voxel."""


class Points(NamedTuple):
    """Where cones start."""

    position: Float[Array, "points 3"]
    normal: Float[Array, "points 3"]
    away: Float[Array, "points"]
    """How far from the surface, along its normal."""
    first: Float[Array, "points"]
    """Distance along the cone at which it begins."""


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
    tangent, bitangent = upright_frame(points.normal)
    begin = (start[:, 0], start[:, 1], start[:, 2])

    def one(total: Float[Array, "points 3"], cone: tuple[Array, Array]) -> tuple[Array, None]:
        local, weight = cone
        axis = local[0] * tangent + local[1] * bitangent + local[2] * points.normal
        toward = (axis[:, 0], axis[:, 1], axis[:, 2])
        gathered, clear, above = _one_cone(maps, begin, toward, points.first, 0.5 * aperture, march)
        beyond = clear[:, None] * sky.through(axis, above)
        colour = jnp.stack(gathered, axis=-1) + beyond
        return total + weight * colour, None

    axes = jnp.asarray(cones.axes, jnp.float32), jnp.asarray(cones.weights, jnp.float32)
    total, _ = jax.lax.scan(one, jnp.zeros_like(start), axes)
    return total


class State(NamedTuple):
    """Of a cone on its way."""

    distance: Lanes
    clear: Lanes
    """Share that the voxels let through."""
    covered: tuple[Lanes, ...]
    """Share of each slice that is below the horizon."""
    colour: Vector


def _one_cone(
    maps: Lightmaps, begin: Vector, toward: Vector, first: Lanes, half: Array | float, march: March
) -> tuple[Vector, Lanes, Lanes]:
    """(radiance gathered, share of the cone that the voxels let through, share of it that is above
    the height field)."""
    zero = jnp.zeros_like(first)
    slices = None if maps.plan is None else _slices(toward, half)
    state = State(first, zero + 1.0, (zero,) * len(SLICES), (zero, zero, zero))

    def step(state: State, _: None) -> tuple[State, None]:
        return _advance(maps, begin, toward, half, march, slices, state), None

    if march.near and maps.grid is not None:
        voxel, flat = maps.grid.voxel, replace(maps, grid=None)

        def near(state: State, _: None) -> tuple[State, None]:
            after = _advance(flat, begin, toward, half, march, slices, state)
            before = state.distance < voxel
            return jax.tree.map(lambda a, b: jnp.where(before, a, b), after, state), None

        state, _ = jax.lax.scan(jax.checkpoint(near), state, None, length=march.near)  # pyright: ignore
    state, _ = jax.lax.scan(jax.checkpoint(step), state, None, length=march.steps)  # pyright: ignore
    if slices is None:
        return state.colour, state.clear, zero + 1.0
    return state.colour, state.clear, _above(slices, state.covered)


def _advance(
    maps: Lightmaps,
    begin: Vector,
    toward: Vector,
    half: Array | float,
    march: March,
    slices: "Slices | None",
    state: State,
) -> State:
    wide = 2.0 * jnp.tan(half)
    if march.stepping == "cubes":
        # The cube's cross-section is inscribed in the cone's base (eq. 10).
        side = state.distance * wide / jnp.sqrt(2.0)
        centre, length = state.distance + 0.5 * side, side
    else:
        side = state.distance * wide
        if maps.grid is not None:
            side = jnp.maximum(side, maps.grid.voxel)
        centre, length = state.distance, 0.5 * side
    clear, covered, colour = state.clear, state.covered, state.colour
    above = 1.0 if slices is None else _above(slices, covered)
    if maps.grid is not None:
        middle = tuple(b + centre * d for b, d in zip(begin, toward, strict=True))
        found, opacity = _in_cube(maps.grid, maps.volume, middle, toward, side, length)
        colour = tuple(c + clear * above * f for c, f in zip(colour, found, strict=True))  # pyright: ignore
        clear = clear * (1.0 - opacity)
    if slices is not None:
        covered, seen = _over_heights(maps, begin, slices, state.distance, length, half, covered)
        colour = tuple(c + clear * s for c, s in zip(colour, seen, strict=True))  # pyright: ignore
    return State(state.distance + length, clear, covered, colour)  # pyright: ignore


def _in_cube(
    grid: Grid,
    volume: Channels,
    middle: tuple[Lanes, ...],
    toward: Vector,
    side: Lanes,
    length: Lanes,
) -> tuple[Vector, Lanes]:
    """Premultiplied radiance and opacity of what the voxels have in a cube (eqs. 12, 15)."""
    extent = grid.resolution * grid.voxel
    centres, volume_share = [], 1.0
    for axis, m in enumerate(middle):
        low = jnp.maximum(m - 0.5 * side, grid.low[axis])
        high = jnp.minimum(m + 0.5 * side, grid.low[axis] + extent)
        centres.append(0.5 * (low + high))
        volume_share = volume_share * jnp.clip((high - low) / side, 0.0, 1.0)
    level = jnp.log2(jnp.maximum(side / grid.voxel, 1.0))
    *premultiplied, opacity = sample_volume(grid, volume, tuple(centres), toward, level)
    opacity = jnp.clip(opacity, 0.0, OPAQUE)
    # Opacity of a cube's depth, for the part of it that is passed and that lies in the grid.
    size = jnp.maximum(side, grid.voxel)
    passed = 1.0 - (1.0 - opacity) ** (length / size)
    passed = jnp.where(volume_share > 0.0, passed * volume_share, 0.0)
    scale = passed / jnp.maximum(opacity, 1e-4)
    if not premultiplied:
        black = jnp.zeros_like(opacity)
        return (black, black, black), passed
    red, green, blue = premultiplied
    return (red * scale, green * scale, blue * scale), passed


class Slices(NamedTuple):
    """A cone cut along vertical planes through its start."""

    x: tuple[Lanes, ...]
    """Horizontal unit directions."""
    z: tuple[Lanes, ...]
    low: tuple[Lanes, ...]
    """Sines of the elevations at which each slice begins and ends."""
    high: tuple[Lanes, ...]
    weight: tuple[Lanes, ...]
    """Shares of the cone's solid angle; they add up to 1."""
    reach: Lanes
    """Horizontal distance of the cone's lower edge, per distance along its axis."""


def _slices(toward: Vector, half: Array | float) -> Slices:
    x, y, z = toward
    level = jnp.sqrt(jnp.maximum(x * x + z * z, 1e-12))
    forward_x, forward_z = x / level, z / level
    # Half of the azimuths that the cone covers: all where it holds the zenith.
    ratio = jnp.sin(half) / level
    spread = jnp.where(ratio < 1.0, jnp.arcsin(jnp.minimum(ratio, 1.0 - 1e-6)), jnp.pi)
    found = []
    for share in SLICES:
        turn = share * spread
        c, s = jnp.cos(turn), jnp.sin(turn)
        # Elevations e of the slice within the cone: y sin e + level c cos e >= cos half.
        across = level * c
        length = jnp.sqrt(y * y + across * across)
        middle = jnp.arctan2(y, across)
        inside = jnp.arccos(jnp.clip(jnp.cos(half) / jnp.maximum(length, 1e-6), -1.0, 1.0 - 1e-6))
        low = jnp.sin(jnp.clip(middle - inside, -0.5 * jnp.pi, 0.5 * jnp.pi))
        high = jnp.sin(jnp.clip(middle + inside, -0.5 * jnp.pi, 0.5 * jnp.pi))
        direction = forward_x * c - forward_z * s, forward_z * c + forward_x * s
        found.append((*direction, low, jnp.maximum(high, low + 1e-4)))
    columns = tuple(zip(*found, strict=True))
    sizes = [high - low for low, high in zip(columns[2], columns[3], strict=True)]
    whole = sum(sizes)
    weight = tuple(size / whole for size in sizes)
    reach = level + jnp.tan(half) * jnp.abs(y)
    return Slices(*columns, weight=weight, reach=reach)  # pyright: ignore


def _above(slices: Slices, covered: tuple[Lanes, ...]) -> Lanes:
    """Share of a cone that is above its horizons."""
    return 1.0 - sum(w * c for w, c in zip(slices.weight, covered, strict=True))  # pyright: ignore


def _over_heights(
    maps: Lightmaps,
    begin: Vector,
    slices: Slices,
    distance: Lanes,
    length: Lanes,
    half: Array | float,
    covered: tuple[Lanes, ...],
) -> tuple[tuple[Lanes, ...], Vector]:
    """Horizons after a step, and the radiance of what rises above those before it.

    What is hidden from the start never rises above the horizon, so back faces are culled and a
    height counts only if no nearer one hides it.
    """
    plan = maps.plan
    assert plan is not None
    assert maps.heights is not None
    growth = (distance + length) / distance
    colour: list[Lanes] = [jnp.zeros_like(distance)] * 3
    result = list(covered)
    away = slices.reach * distance * jnp.sqrt(growth)
    width = away * jnp.minimum(jnp.tan(half), growth - 1.0)
    level = jnp.clip(jnp.round(jnp.log2(width / plan.texel)), 0.0, plan.levels - 1.0)
    for s in range(len(SLICES)):
        at = corners(
            plan,
            begin[0] + away * slices.x[s],
            begin[2] + away * slices.z[s],
            level.astype(jnp.int32),
        )
        rise = plan.low[1] + plan.rise * at.read(maps.heights, 1.0 / LARGEST) - begin[1]
        sine = rise / jnp.sqrt(rise * rise + away * away)
        low, high = slices.low[s], slices.high[s]
        share = jnp.clip((sine - low) / (high - low), 0.0, 1.0)
        more = jnp.maximum(share - result[s], 0.0) * slices.weight[s]
        result[s] = jnp.maximum(result[s], share)
        for c, channel in enumerate(maps.colours):
            colour[c] = colour[c] + more * at.read(channel)
    return tuple(result), (colour[0], colour[1], colour[2])
