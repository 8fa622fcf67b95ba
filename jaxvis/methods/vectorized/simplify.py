"""Fewer contour points at the least error, all loops of all samples at once (host).

After Visvalingam and Whyatt (1993): a point costs the area by which its removal changes the
polygon. Here points are removed in rounds, in each those that are cheaper than both neighbours and
than a limit that rises from round to round, so that the order is nearly that of the cost while a
round is a few array operations.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

HORIZON_WEIGHT = 0.1
"""Least weight of an area near the horizon, whose cosine is 0: shading points beside the sample see
it under another normal."""

LONGEST_STEP = 2.5
"""Radians of longitude that an edge may span; from pi on it lies on the other side of the pole."""

GROWTH = 1.5
"""Factor between the limits of one round and the next."""


class Rings(NamedTuple):
    """Closed loops of points, each loop's points one after the other."""

    local: Float[np.ndarray, "points 3"]
    """Unit directions, the sample's normal along z."""
    longitude: Float[np.ndarray, "points"]
    """Of the world direction, radians."""
    height: Float[np.ndarray, "points"]
    """Cosine of the world direction's colatitude."""
    sample: Int[np.ndarray, "points"]
    loop: Int[np.ndarray, "points"]
    index: Int[np.ndarray, "points"]
    """Among the points given."""
    rank: Int[np.ndarray, "points"]
    """Among the sample's points given, so that a sample does not depend on the others."""

    def take(self, kept: Bool[np.ndarray, "points"]) -> "Rings":
        """Some of the points."""
        return Rings(*(np.compress(kept, field, axis=0) for field in self))


def simplify(
    local: Float[np.ndarray, "points 3"],
    world: Float[np.ndarray, "points 3"],
    sample: Int[np.ndarray, "points"],
    loop: Int[np.ndarray, "points"],
    budgets: Int[np.ndarray, "samples"],
    *,
    tolerance: float,
    fewest: int = 4,
) -> Int[np.ndarray, "kept"]:
    """Which points to keep: as few as the tolerance allows, and no more than the budgets.

    The cost of a point is the larger of two areas, weighted by the cosine with the normal: that of
    the plane triangle with its neighbours, and that of the triangle in (longitude, cosine of the
    colatitude), in which the integration over lat-long maps takes edges for chords. (The plane
    triangle, unlike the spherical one, is not zero along a great circle; that keeps edges short
    enough for the trapezoidal rule, which errs with their length.) A point whose removal would let
    an edge pass a pole on the other side stays.

    Args:
        local: unit directions, the sample's normal along z.
        world: the same in the world.
        sample: whose points they are, ascending.
        loop: number of the loop, ascending; a loop's points are consecutive and closed.
        budgets: most points of each sample over all its loops.
        tolerance: steradians that a point may cost to go although the budget would allow it.
        fewest: points of a loop that are not reduced further, unless they lie in one place.

    Raises:
        ValueError: a budget is less than ``fewest`` times the loops of its sample.
    """
    count = len(budgets)
    loops_of = np.bincount(sample[np.diff(loop, prepend=-1) > 0], minlength=count)
    if np.any(loops_of * fewest > budgets):
        raise ValueError(
            f"a budget of {budgets[loops_of * fewest > budgets].min()} vectors is too small for "
            f"loops of {fewest} each; raise vectors"
        )
    rings = Rings(
        local.astype(np.float64),
        np.arctan2(world[:, 0], -world[:, 2]).astype(np.float64),
        world[:, 1].astype(np.float64),
        sample,
        loop,
        np.arange(len(local)),
        np.arange(len(local)) - np.searchsorted(sample, sample),
    )
    limits = np.full(count, max(tolerance, 1e-9))
    growing = np.zeros(count, bool)
    finished = []
    while len(rings.index):
        excess = np.bincount(rings.sample, minlength=count) - budgets
        chosen = _cheapest(rings, limits, np.where(growing, excess, len(local)), fewest)
        idle = np.bincount(rings.sample[chosen], minlength=count) == 0
        done = (excess <= 0) & (idle | growing)
        growing |= idle & (excess > 0)
        limits = np.where(growing, GROWTH * limits, limits)
        resting = done.take(rings.sample)
        finished.append(rings.index[resting])
        keep = ~resting
        keep[chosen] = False
        rings = rings.take(keep)
    return np.sort(np.concatenate([np.zeros(0, np.int64), *finished]))


def _cheapest(
    rings: Rings,
    limits: Float[np.ndarray, "samples"],
    most: Int[np.ndarray, "samples"],
    fewest: int,
) -> Int[np.ndarray, "chosen"]:
    """Points cheaper than both neighbours and than the limit, at most so many of each sample."""
    first = np.diff(rings.loop, prepend=-1) != 0
    number = np.cumsum(first) - 1
    starts = np.flatnonzero(first)
    lengths = np.diff(starts, append=len(first))
    cost = _costs(rings, starts, lengths)
    before, after = _before(cost, starts, lengths), _after(cost, starts, lengths)
    cheap = (cost < before) & (cost < after) & (cost < limits.take(rings.sample))
    chosen = np.flatnonzero(cheap)
    allowed = _rank(number[chosen], cost[chosen]) < (lengths - fewest)[number[chosen]]
    chosen = chosen[allowed]
    owner = rings.sample[chosen]
    return chosen[_rank(owner, cost[chosen]) < most[owner]]


def _costs(
    rings: Rings, starts: Int[np.ndarray, "loops"], lengths: Int[np.ndarray, "loops"]
) -> Float[np.ndarray, "points"]:
    """What the removal of each point changes, in weighted steradians."""
    x, y, z = rings.local.T
    ux, uy, uz = (_after(c, starts, lengths) - c for c in (x, y, z))
    vx, vy, vz = (_before(c, starts, lengths) - c for c in (x, y, z))
    cx, cy, cz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    triangle = np.sqrt(cx * cx + cy * cy + cz * cz)
    step = _wrap(_after(rings.longitude, starts, lengths) - rings.longitude)
    rise = _after(rings.height, starts, lengths) - rings.height
    last_step, last_rise = (_before(c, starts, lengths) for c in (step, rise))
    chart = np.abs(last_step * rise - step * last_rise)
    around = np.abs(step + last_step) > LONGEST_STEP
    area = 0.5 * np.maximum(triangle, chart) + np.where(around, 100.0, 0.0)
    weight = np.maximum(HORIZON_WEIGHT, z + np.maximum(0.0, np.maximum(uz, vz)))
    # Distinct costs: of points in one place, whose removal is free, every other goes in a round.
    tie = 1e-12 * (1.0 + rings.rank * 0.6180339887498949 % 1.0)
    return weight * area + tie


def _after(
    values: Float[np.ndarray, "points"],
    starts: Int[np.ndarray, "loops"],
    lengths: Int[np.ndarray, "loops"],
) -> Float[np.ndarray, "points"]:
    """The value of the next point of the loop."""
    shifted = np.empty_like(values)
    shifted[:-1] = values[1:]
    shifted[starts + lengths - 1] = values[starts]
    return shifted


def _before(
    values: Float[np.ndarray, "points"],
    starts: Int[np.ndarray, "loops"],
    lengths: Int[np.ndarray, "loops"],
) -> Float[np.ndarray, "points"]:
    """The value of the previous point of the loop."""
    shifted = np.empty_like(values)
    shifted[1:] = values[:-1]
    shifted[starts] = values[starts + lengths - 1]
    return shifted


def _wrap(angle: Float[np.ndarray, "points"]) -> Float[np.ndarray, "points"]:
    """The same angle from -pi to pi."""
    return angle - 2.0 * np.pi * np.rint(angle * (0.5 / np.pi))


def _rank(
    group: Int[np.ndarray, "points"], key: Float[np.ndarray, "points"]
) -> Int[np.ndarray, "points"]:
    """How many points of the same group have a smaller key."""
    order = np.lexsort((key, group))
    sorted_group = group[order]
    first = np.flatnonzero(np.diff(sorted_group, prepend=-1) != 0)
    sizes = np.diff(first, append=len(group))
    rank = np.empty(len(group), np.int64)
    rank[order] = np.arange(len(group)) - np.repeat(first, sizes)
    return rank
