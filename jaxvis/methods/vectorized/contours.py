"""Boundaries of the free directions in a visibility map: marching squares as a permutation (host).

Every grid edge between a free and a blocked node is one contour point. Walking with the free
region on the left, each point has one successor, so that the points of all maps together are a
permutation; its cycles are the loops.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int

from jaxvis.methods.vectorized.hemisphere_map import Samples, grid
from jaxvis.scene import RayTracer


class Contours(NamedTuple):
    """Closed loops of contour points, each loop's points in walking order, one after the other.

    ``free`` and ``blocked`` are the nodes at the ends of the grid edge that the loop crosses.
    """

    sample: Int[np.ndarray, "points"]
    free: Int[np.ndarray, "points"]
    blocked: Int[np.ndarray, "points"]
    starts: Int[np.ndarray, "loops"]
    lengths: Int[np.ndarray, "loops"]


def trace_contours(
    tracer: RayTracer, samples: Samples, free: Bool[np.ndarray, "samples rows columns"]
) -> Contours:
    """The boundaries of the free regions, counter-clockwise about them seen from outside.

    Where the nodes of a cell alternate, its centre is traced: free regions meet only if it is free.
    """
    joined = _joined_cells(tracer, samples, free)
    side = free.shape[-1]
    left, right = _crossed_edges(free)
    successor = _successors(free.reshape(-1), joined.reshape(-1), left, right, side)
    order, starts, lengths = cycles(successor)
    left, right = left.take(order), right.take(order)
    sample, node = np.divmod(left, side * side)
    return Contours(sample, node, right - sample * side * side, starts, lengths)


def _joined_cells(
    tracer: RayTracer, samples: Samples, free: Bool[np.ndarray, "samples rows columns"]
) -> Bool[np.ndarray, "samples rows columns"]:
    """Cells (by their first node) with alternating nodes and a free centre."""
    a, b, c, d = free[:, :-1, :-1], free[:, :-1, 1:], free[:, 1:, :-1], free[:, 1:, 1:]
    sample, row, column = np.nonzero((a == d) & (b == c) & (a != b))
    side = free.shape[-1]
    nodes = grid(side - 1).reshape(side, side, 2)
    centre = 0.5 * (nodes[row, column] + nodes[row + 1, column + 1])
    blocked = tracer.occluded(
        samples.origins.take(sample, axis=0), samples.directions(sample, centre)
    )
    inside = np.sum(centre * centre, axis=-1) < 1.0
    joined = np.zeros(free.shape, bool)
    joined[sample, row, column] = inside & ~blocked
    return joined


def _crossed_edges(
    free: Bool[np.ndarray, "samples rows columns"],
) -> tuple[Int[np.ndarray, "points"], Int[np.ndarray, "points"]]:
    """Flat indices of the free and of the blocked node of every crossed edge, sample by sample."""
    side = free.shape[-1]
    flat = free.reshape(-1)
    # Rows and maps end with blocked nodes outside the disc, so that no edge is crossed where the
    # flat index wraps.
    right = np.flatnonzero(flat[:-1] != flat[1:])
    up = np.flatnonzero(flat[:-side] != flat[side:])
    first = np.concatenate([right, up])
    second = np.concatenate([right + 1, up + side])
    order = np.argsort(first, kind="stable")
    first, second = first.take(order), second.take(order)
    forwards = flat.take(first)
    return np.where(forwards, first, second), np.where(forwards, second, first)


def _successors(
    free: Bool[np.ndarray, "nodes"],
    joined: Bool[np.ndarray, "nodes"],
    left: Int[np.ndarray, "points"],
    right: Int[np.ndarray, "points"],
    side: int,
) -> Int[np.ndarray, "points"]:
    """The point that follows each, through the cell ahead."""
    # The walk is a quarter turn to the left of the step from the free to the blocked node.
    across = right - left
    ahead = np.select([across == 1, across == -1, across == side], [side, -side, -1], 1)
    far_left, far_right = left + ahead, right + ahead
    corner = np.minimum(np.minimum(left, right), np.minimum(far_left, far_right))
    left_free, right_free = free.take(far_left), free.take(far_right)
    turn_right = right_free & (left_free | joined.take(corner))
    straight = left_free & ~right_free
    next_left = np.where(turn_right, far_right, np.where(straight, far_left, left))
    next_right = np.where(turn_right, right, np.where(straight, far_right, far_left))
    place = np.zeros(2 * len(free), np.int32)
    place[_edge(left, right)] = np.arange(len(left), dtype=np.int32)
    return place.take(_edge(next_left, next_right))


def _edge(a: Int[np.ndarray, "points"], b: Int[np.ndarray, "points"]) -> Int[np.ndarray, "points"]:
    """A number for the grid edge between two nodes."""
    return 2 * np.minimum(a, b) + (np.abs(a - b) != 1)


def cycles(
    successor: Int[np.ndarray, "points"],
) -> tuple[Int[np.ndarray, "points"], Int[np.ndarray, "cycles"], Int[np.ndarray, "cycles"]]:
    """The cycles of a permutation by pointer doubling.

    Returns:
        (the points cycle by cycle, each from its smallest on, the cycles by their smallest points;
        where each cycle starts in that order; the cycles' lengths)
    """
    count = len(successor)
    label = np.arange(count, dtype=np.int32)
    jump = successor
    while True:
        smaller = np.minimum(label, label.take(jump))
        if np.array_equal(smaller, label):
            break
        label, jump = smaller, jump.take(jump)
    first = np.flatnonzero(label == np.arange(count))
    # Steps to the end of the cycle, the end being the point before its smallest.
    ends = successor == label
    jump = np.where(ends, np.arange(count), successor)
    left = np.where(ends, 0, 1)
    while True:
        more = left.take(jump)
        if not more.any():
            break
        left, jump = left + more, jump.take(jump)
    lengths = left.take(first) + 1
    starts = np.cumsum(lengths) - lengths
    start_of = np.zeros(count, np.int64)
    start_of[first] = starts + lengths - 1
    order = np.empty(count, np.int64)
    order[start_of.take(label) - left] = np.arange(count)
    return order, starts, lengths
