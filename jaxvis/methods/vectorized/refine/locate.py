"""From a place in a scene's triangle to the small triangle in which it lies (host).

A bisection divides a triangle (a, x, y) from its corner a to the midpoint m of the opposite edge,
in (a, x, m) and (a, m, y). A forest holds the bisections of all triangles, one tree a triangle.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Int8, Int32

LEAF = np.int8(-1)


class Forest(NamedTuple):
    """Bisected triangles: the whole ones first, then pairs of halves."""

    splits: Int8[np.ndarray, "nodes"]
    """From which corner each is divided: 0, 1, 2, or -1 where it is not."""
    children: Int32[np.ndarray, "nodes"]
    """The first half; the second comes next. Of triangles that are not divided, their number."""

    @staticmethod
    def whole(count: int) -> "Forest":
        """``count`` triangles that are not divided."""
        return Forest(np.full(count, LEAF), np.arange(count, dtype=np.int32))

    @property
    def roots(self) -> int:
        """How many triangles were whole."""
        return len(self.splits) - 2 * int(np.count_nonzero(self.splits != LEAF))


def locate(
    forest: Forest,
    triangle: Int32[np.ndarray, "points"],
    barycentrics: Float32[np.ndarray, "points 3"],
) -> tuple[Int32[np.ndarray, "points"], Float32[np.ndarray, "points 3"]]:
    """The small triangle of each point, and its barycentrics there: non-negative, with sum 1.

    Points on an edge between two belong to either.

    Args:
        forest: the bisections.
        triangle: the whole triangle of each point.
        barycentrics: in it.
    """
    weights = np.maximum(barycentrics, np.float32(0.0))
    weights /= np.maximum(weights.sum(axis=-1, keepdims=True), np.float32(1e-30))
    node = triangle.astype(np.int32)
    point = np.flatnonzero(forest.splits.take(node) != LEAF)
    at, inside = node.take(point), weights.take(point, axis=0)
    while len(point):
        at, inside = _descended(forest, at, inside)
        done = forest.splits.take(at) == LEAF
        node[point[done]], weights[point[done]] = at[done], inside[done]
        point, at, inside = point[~done], at[~done], inside[~done]
    return forest.children.take(node), weights


def _descended(
    forest: Forest, node: Int32[np.ndarray, "points"], weights: Float32[np.ndarray, "points 3"]
) -> tuple[Int32[np.ndarray, "points"], Float32[np.ndarray, "points 3"]]:
    """The half of each divided triangle in which a point lies, and its barycentrics there.

    a wa + x wx + y wy = a wa + x (wx - wy) + m 2 wy = a wa + m 2 wx + y (wy - wx), with m the
    midpoint of x and y.
    """
    corner, flat = forest.splits.take(node).astype(np.intp), weights.reshape(-1)
    row = 3 * np.arange(len(node))
    x, y = (flat.take(row + (corner + k) % 3) for k in (1, 2))
    second = y > x
    halves = np.empty_like(weights)
    halves[:, 0] = flat.take(row + corner)
    halves[:, 1] = np.where(second, 2.0 * x, x - y)
    halves[:, 2] = np.where(second, y - x, 2.0 * y)
    return forest.children.take(node) + second, halves
