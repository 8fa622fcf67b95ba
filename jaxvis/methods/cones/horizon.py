"""Horizons of a height field across a cone: what rises above them is seen (paper 003, VI-B).

The paper searches the cells of every fitting cube anew (:mod:`jaxvis.methods.cones.cells`). Here a
cone is cut into a few vertical slices, and the horizon of each is followed from the cone's start:
occlusion is that of the height field, at the cone's own resolution.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxvis.methods.cones.heights import LARGEST, Plan, corners

Lanes = Float[Array, "lanes"]
Vector = tuple[Lanes, Lanes, Lanes]

SLICES = (-2.0 / 3.0, 0.0, 2.0 / 3.0)
"""Azimuths across a cone in which horizons are followed, in half widths."""


class Slices(NamedTuple):
    """A cone cut along vertical planes through its start."""

    x: tuple[Lanes, ...]
    """Horizontal unit directions."""
    z: tuple[Lanes, ...]
    low: tuple[Lanes, ...]
    """Sines of the elevations at which each slice begins and ends."""
    high: tuple[Lanes, ...]
    up: Lanes
    """The receiver's normal: its upward component,"""
    along: tuple[Lanes, ...]
    """and that along each slice."""
    weight: tuple[Lanes, ...]
    """Shares of the cone's cosine-weighted solid angle; they add up to 1."""
    reach: Lanes
    """Horizontal distance of the cone's lower edge, per distance along its axis."""


def slices_of(toward: Vector, normal: Vector, half: Array | float) -> Slices:
    """The slices of cones of a half angle about unit directions, for receivers of these normals.

    All slices have the elevations of the middle one: round cones leave gaps between them along the
    horizon, where a height field is.
    """
    x, y, z = toward
    level = jnp.sqrt(jnp.maximum(x * x + z * z, 1e-12))
    forward_x, forward_z = x / level, z / level
    # Half of the azimuths that the cone covers: all where it holds the zenith.
    ratio = jnp.sin(half) / level
    spread = jnp.where(ratio < 1.0, jnp.arcsin(jnp.minimum(ratio, 1.0 - 1e-6)), jnp.pi)
    middle = jnp.arctan2(y, level)
    bottom, top = (
        jnp.sin(jnp.clip(edge, -0.5 * jnp.pi, 0.5 * jnp.pi))
        for edge in (middle - half, middle + half)
    )
    found = []
    for share in SLICES:
        turn = share * spread
        c, s = jnp.cos(turn), jnp.sin(turn)
        right, ahead = forward_x * c - forward_z * s, forward_z * c + forward_x * s
        along = normal[0] * right + normal[2] * ahead
        # Nothing below the tangent plane counts.
        plane = -along / jnp.sqrt(jnp.maximum(along * along + normal[1] * normal[1], 1e-12))
        low = jnp.where(normal[1] > 0.0, jnp.maximum(bottom, plane), bottom)
        found.append((right, ahead, low, jnp.maximum(top, low + 1e-4), along))
    right, ahead, low, high, along = zip(*found, strict=True)
    sizes = [
        jnp.maximum(_received(h, normal[1], a) - _received(w, normal[1], a), 1e-6)
        for w, h, a in zip(low, high, along, strict=True)
    ]
    whole = sum(sizes)
    return Slices(
        right,
        ahead,
        low,
        high,
        normal[1],
        along,
        tuple(size / whole for size in sizes),
        level + jnp.tan(half) * jnp.abs(y),
    )


def _received(sine: Lanes, up: Lanes, along: Lanes) -> Lanes:
    """Integral over elevations, up to the one of this sine, of the cosine to the normal and of the
    solid angle's cos e: of (up sin e + along cos e) cos e."""
    s = jnp.clip(sine, -1.0 + 1e-6, 1.0 - 1e-6)
    return 0.5 * (up * s * s + along * (jnp.arcsin(s) + s * jnp.sqrt(1.0 - s * s)))


def above(slices: Slices, covered: tuple[Lanes, ...]) -> Lanes:
    """Share of a cone that is above its horizons."""
    return 1.0 - sum(w * c for w, c in zip(slices.weight, covered, strict=True))  # pyright: ignore


def clear_of(slices: Slices, covered: tuple[Lanes, ...]) -> tuple[Lanes, Lanes]:
    """What is left, above the horizons, of a cone's part above elevation 0 and of that below."""
    upper = lower = uppers = lowers = jnp.zeros_like(slices.reach)
    for w, c, low, high, along in zip(
        slices.weight, covered, slices.low, slices.high, slices.along, strict=True
    ):
        ends = (jnp.clip(jnp.zeros_like(low), low, high), low, high)
        level, first, last = (_received(e, slices.up, along) for e in ends)
        below = jnp.clip((level - first) / jnp.maximum(last - first, 1e-6), 0.0, 1.0)
        uppers, lowers = uppers + w * (1.0 - below), lowers + w * below
        upper = upper + w * (1.0 - jnp.maximum(c, below))
        lower = lower + w * jnp.maximum(below - c, 0.0)
    over = jnp.where(uppers > 1e-4, upper / jnp.maximum(uppers, 1e-4), 0.0)
    # What an averaged sky still has from below, where a cone has no such part, is the average's.
    return over, jnp.where(lowers > 1e-4, lower / jnp.maximum(lowers, 1e-4), over)


def rise_to(
    plan: Plan,
    heights: Array,
    colours: tuple[Array, ...],
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

    Args:
        plan, heights, colours: the 2D lightmap.
        begin: where the cones start.
        slices: of the cones.
        distance, length: along their axes, before the step and of it.
        half: half of their aperture.
        covered: share of each slice, weighted by the cosine, that is below the horizon before.
    """
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
        rise = plan.low[1] + plan.rise * at.read(heights, 1.0 / LARGEST) - begin[1]
        sine = rise / jnp.sqrt(rise * rise + away * away)
        low, high = slices.low[s], slices.high[s]
        ends = (jnp.clip(sine, low, high), low, high)
        top, first, last = (_received(e, slices.up, slices.along[s]) for e in ends)
        share = jnp.clip((top - first) / jnp.maximum(last - first, 1e-6), 0.0, 1.0)
        more = jnp.maximum(share - result[s], 0.0) * slices.weight[s]
        result[s] = jnp.maximum(result[s], share)
        for c, channel in enumerate(colours):
            colour[c] = colour[c] + more * at.read(channel)
    return tuple(result), (colour[0], colour[1], colour[2])
