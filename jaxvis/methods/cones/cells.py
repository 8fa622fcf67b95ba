"""Paper 003's own march (section VI): fitting cubes, and heights searched cell by cell inside them.

Cubes are axis-aligned. What a cube shares with the 2D lightmap is a rectangle R of the ground plan;
the search cuts it into cells, each with the height and the radiance of its centre.
"""

from typing import Literal, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxvis.methods.cones.heights import LARGEST, Plan, corners
from jaxvis.methods.cones.ranges import PowerSums, hsat, hsat_range, pyramid, pyramid_range

Fit = Literal["clean", "paper"]
Accumulation = Literal["clean", "paper"]
Ranges = Literal["pyramid", "hsat"]

Lanes = Float[Array, "*lanes"]
Vector = tuple[Lanes, Lanes, Lanes]

CELLS = 3
"""Along each side of R."""

PARALLEL = 0.999
"""Largest component of a unit vector that counts as parallel to an axis."""

MARGIN = 0.02
"""By which power means keep heights from 0 and from 1, where they are of no use."""

NEARER = 1e-3
"""Of a cube's side: cells of one row, as seen along the cone, do not hide one another."""


class Cube(NamedTuple):
    """Axis-aligned."""

    centre: Vector
    side: Lanes


def fitting_cube(
    start: Vector, toward: Vector, distance: Lanes, half_angle: Array | float, fit: Fit
) -> Cube:
    """The sample space of a cone's next step (eqs. 10 and 11).

    (10): as wide as the square that is inscribed in the cone's section at ``distance``, from there
    on. (11): both ends of a body diagonal touch the cone, the nearer one at ``distance``. Of the
    four diagonals the one most perpendicular to the cone is taken, which the paper leaves open: the
    one nearest to its axis gives no cube for half of all directions.

    Args:
        start: apex of the cone; x, y, z.
        toward: unit direction of its axis.
        distance: along the axis, from the apex.
        half_angle: half of the cone's full angle (radians); below 0.95 for (11).
        fit: ``"clean"``: (10) for all cones; ``"paper"``: (11), and (10) for those parallel to an
            axis.
    """
    diameter = 2.0 * distance * jnp.tan(half_angle)
    side = diameter / jnp.sqrt(2.0)
    ahead = distance + 0.5 * side
    x, y, z = toward
    straight = tuple(s + ahead * v for s, v in zip(start, toward, strict=True))
    if fit == "clean":
        return Cube(straight, side)  # pyright: ignore
    # Diagonals but for their signs: (+-1, +-1, 1) / sqrt 3.
    least, first, second = jnp.full_like(x, jnp.inf), jnp.ones_like(x), jnp.ones_like(x)
    for a, b in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)):
        cosine = (a * x + b * y + z) / jnp.sqrt(3.0)
        closer = jnp.abs(cosine) < jnp.abs(least)
        least = jnp.where(closer, cosine, least)
        first, second = jnp.where(closer, a, first), jnp.where(closer, b, second)
    sign = jnp.where(least < 0.0, -1.0, 1.0) / jnp.sqrt(3.0)
    diagonal = first * sign, second * sign, sign
    cosine = jnp.abs(least)
    sine = jnp.sqrt(1.0 - cosine * cosine)
    near = 0.5 * diameter / sine
    crossing = distance + cosine * near
    # sin(theta_1 - theta / 2)
    opening = sine * jnp.cos(half_angle) - cosine * jnp.sin(half_angle)
    far = crossing * jnp.sin(half_angle) / opening
    shift = 0.5 * (far - near)
    slanted = tuple(
        s + crossing * v + shift * f for s, v, f in zip(start, toward, diagonal, strict=True)
    )
    parallel = jnp.maximum(jnp.abs(x), jnp.maximum(jnp.abs(y), jnp.abs(z))) > PARALLEL
    centre = tuple(jnp.where(parallel, a, b) for a, b in zip(straight, slanted, strict=True))
    return Cube(centre, jnp.where(parallel, side, (near + far) / jnp.sqrt(3.0)))  # pyright: ignore


def occlusion_by_areas(h1: Lanes, area1: Lanes, h2: Lanes, area2: Lanes) -> Lanes:
    """Occlusion of a step, from what two successive sample spaces hold (eq. 16), from 0 to 1.

    Args:
        h1: mean height in the one before.
        area1: occluded area of the cone's section there.
        h2: mean height in this one.
        area2: occluded area of its section.
    """
    whole = h2 * area2
    ratio = (whole - h1 * area1) / jnp.where(whole > 0.0, whole, 1.0)
    return jnp.where(whole > 0.0, jnp.clip(ratio, 0.0, 1.0), 0.0)


def occlusion(coverage: Lanes, side: Lanes, distance: Lanes, accumulation: Accumulation) -> Lanes:
    """Occlusion of a step through a cube.

    Args:
        coverage: share of R's cells that the cone meets.
        side: of the cube.
        distance: at which it begins.
        accumulation: ``"paper"``: coverage x side / (distance + side), which is (17) read as the
            length of this sample space over that of the cone; ``"clean"``: the coverage.
    """
    return coverage * side / (distance + side) if accumulation == "paper" else coverage


def range_table(heights: Array, plan: Plan, ranges: Ranges) -> Array | PowerSums:
    """What :func:`may_meet` asks.

    Args:
        heights: 16-bit, all levels.
        plan: where they are.
        ranges: ``"pyramid"``: exact bounds; ``"hsat"``: the paper's tables (host).
    """
    n = plan.resolution
    base = (heights[: n * n].astype(jnp.float32) / LARGEST).reshape(n, n)
    return pyramid(base) if ranges == "pyramid" else hsat(MARGIN + (1.0 - 2.0 * MARGIN) * base)


class Rectangle(NamedTuple):
    """Of the ground plan, in texels from its corner. Empty where high is not above low."""

    low: tuple[Lanes, Lanes]
    """x, z."""
    high: tuple[Lanes, Lanes]

    @property
    def there(self) -> Bool[Array, "*lanes"]:
        """Whether it has an area."""
        return (self.high[0] > self.low[0]) & (self.high[1] > self.low[1])


def footprint(plan: Plan, cube: Cube) -> Rectangle:
    """R: what lies straight below a cube or above it (eq. 12)."""
    ends = []
    for sign in (-0.5, 0.5):
        places = (
            (cube.centre[axis] + sign * cube.side - plan.low[axis]) / plan.texel for axis in (0, 2)
        )
        ends.append(tuple(jnp.clip(place, 0.0, plan.resolution) for place in places))
    return Rectangle(*ends)


def may_meet(
    table: Array | PowerSums, plan: Plan, rectangle: Rectangle, cube: Cube
) -> Bool[Array, "*lanes"]:
    """Whether some height over R may reach a cube's bottom: if not, its search is skipped.

    Certain with a pyramid; power means may miss some (see :mod:`jaxvis.methods.cones.ranges`).
    """
    # The tables' rows are along z, those of the lightmap along x: swapped rather than turned.
    low, high = rectangle.low[::-1], rectangle.high[::-1]
    if isinstance(table, PowerSums):
        _, highest = hsat_range(table, low, high)
        highest = (highest - MARGIN) / (1.0 - 2.0 * MARGIN)
    else:
        _, highest = pyramid_range(table, plan.resolution, low, high)
    bottom = cube.centre[1] - 0.5 * cube.side
    return rectangle.there & (plan.low[1] + plan.rise * highest >= bottom)


class Found(NamedTuple):
    """By a search in a cube."""

    coverage: Lanes
    """Share of R's cells that the cone meets and that none nearer hides."""
    colour: tuple[Lanes, ...]
    """Mean radiance of those among them that face the start, 0 without any."""


def search(
    plan: Plan,
    heights: Array,
    colours: tuple[Array, ...],
    begin: Vector,
    toward: Vector,
    half_angle: Array | float,
    cube: Cube,
    rectangle: Rectangle,
) -> Found:
    """The paper's morphology search over R's cells.

    A cell is met if its height reaches the bottom of the cube and the lower edge of the cone at
    that distance. One that is nearer along the cone, and seen under a larger elevation, hides it.
    All pairs are compared: that is the search along the cone without sorting. Radiance is weighted
    by the cosine between the cone and the normal, from height differences at the level; cells
    that face away are culled.

    Args:
        plan: where the heights are.
        heights: 16-bit, all levels; x-major.
        colours: red, green and blue of exitant radiance, all levels, or none.
        begin: apex of the cone; x, y, z.
        toward: unit direction of its axis.
        half_angle: half of the cone's full angle (radians).
        cube: sample space.
        rectangle: its footprint.
    """
    x, y, z = toward
    size = jnp.log2(cube.side / (CELLS * plan.texel))
    level = jnp.clip(jnp.round(size), 0.0, plan.levels - 1.0).astype(jnp.int32)
    shares = (jnp.arange(CELLS) + 0.5) / CELLS
    one, other = (s.reshape(-1, 1) for s in jnp.meshgrid(shares, shares, indexing="ij"))
    places = [
        plan.low[axis] + plan.texel * (low + share * (high - low))
        for axis, share, low, high in zip(
            (0, 2), (one, other), rectangle.low, rectangle.high, strict=True
        )
    ]
    at = corners(plan, places[0], places[1], level)
    step_x, step_z, height = _patch(plan, heights, at.cells, at.weights, level)
    # In units of the start's height and of horizontal distance from it.
    rise, dx, dz = height - begin[1], places[0] - begin[0], places[1] - begin[2]
    away = jnp.sqrt(jnp.maximum(dx * dx + dz * dz, 1e-12 * cube.side * cube.side))
    flat = jnp.sqrt(jnp.maximum(x * x + z * z, 1e-12))
    cosine, sine = jnp.cos(half_angle), jnp.sin(half_angle)
    # Of the lower edge: a cone that holds the nadir has none.
    run, climb = flat * cosine + y * sine, y * cosine - flat * sine
    edge = jnp.where(run > 1e-4, climb / jnp.maximum(run, 1e-4), -jnp.inf) * away
    bottom = cube.centre[1] - 0.5 * cube.side - begin[1]
    elevation = rise / away
    advance = (dx * x + dz * z) / flat
    # [hides, hidden, lanes]; what is behind the start hides nothing.
    nearer = advance[:, None] + NEARER * cube.side < advance[None]
    hides = (advance > 0.0)[:, None] & nearer & (elevation[:, None] > elevation[None])
    met = (rise >= bottom) & (rise >= edge) & ~jnp.any(hides, axis=0)
    # The normal is (-step_x, 1, -step_z), normalised.
    facing = (step_x * x + step_z * z - y) / jnp.sqrt(1.0 + step_x**2 + step_z**2)
    weight = jnp.where(met, jnp.maximum(facing, 0.0), 0.0)
    whole = jnp.sum(weight, axis=0)
    weight = weight / jnp.where(whole > 0.0, whole, 1.0)
    nearest = _nearest(at.cells, at.weights)
    found = tuple(
        jnp.sum(weight * jnp.take(channel, nearest, mode="clip").astype(jnp.float32), axis=0)
        for channel in colours
    )
    return Found(jnp.mean(met.astype(jnp.float32), axis=0), found)


def _patch(
    plan: Plan,
    heights: Array,
    cells: tuple[Array, ...],
    weights: tuple[Array, ...],
    level: Array,
) -> tuple[Array, Array, Array]:
    """Slopes along x and along z, and height, of the bilinear patch between four texels."""
    low, up, right, both = (
        plan.rise / LARGEST * jnp.take(heights, cell, mode="clip").astype(jnp.float32)
        for cell in cells
    )
    a, b, c, d = weights
    texel = plan.texel * jnp.exp2(level.astype(jnp.float32))
    along_x = ((a + c) * (right - low) + (b + d) * (both - up)) / texel
    along_z = ((a + b) * (up - low) + (c + d) * (both - right)) / texel
    return along_x, along_z, plan.low[1] + a * low + b * up + c * right + d * both


def _nearest(cells: tuple[Array, ...], weights: tuple[Array, ...]) -> Array:
    """The texel that counts most."""
    a, b, c, d = cells
    left, below = weights[0] + weights[1] >= 0.5, weights[0] + weights[2] >= 0.5
    return jnp.where(left, jnp.where(below, a, b), jnp.where(below, c, d))
