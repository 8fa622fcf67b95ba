"""Finding equal rows and shared edges in large integer and float arrays (host)."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Integer, Num


def equal_rows(
    *columns: Num[np.ndarray, "rows"],
) -> tuple[Integer[np.ndarray, "distinct"], Integer[np.ndarray, "rows"]]:
    """Numbers the distinct rows of a table given by its columns, in the order they first appear.

    Returns:
        (first, ids): the first row of each kind, and the number of each row's kind. Zeros of both
        signs are equal.
    """
    ids = np.zeros(len(columns[0]), np.int64)
    for column in columns:
        values, codes = np.unique(column, return_inverse=True)
        # Renumbering after each column keeps the combined key far from overflow.
        _, ids = np.unique(ids * max(len(values), 1) + codes, return_inverse=True)
    _, first = np.unique(ids, return_index=True)
    order = np.argsort(first, kind="stable")
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    return first[order], rank[ids]


class EdgeSides(NamedTuple):
    """The 3 sides of every triangle, sorted by the undirected edge that they lie on.

    Side k of triangle t, from corner k to corner k + 1, stands as 3 t + k in ``side``; ``edge``
    numbers the undirected edges and is non-decreasing.
    """

    side: Integer[np.ndarray, "sides"]
    edge: Integer[np.ndarray, "sides"]

    @property
    def count(self) -> Integer[np.ndarray, "edges"]:
        """How many triangles meet at each edge: 2 everywhere on a closed manifold."""
        return np.bincount(self.edge)


def edge_sides(triangles: Integer[np.ndarray, "triangles 3"]) -> EdgeSides:
    """The sides of triangles (given by welded position numbers), grouped by edge."""
    start = triangles.reshape(-1).astype(np.int64)
    end = np.roll(triangles, -1, axis=1).reshape(-1)
    key = np.minimum(start, end) * (int(triangles.max(initial=0)) + 1) + np.maximum(start, end)
    side = np.argsort(key, kind="stable")
    key = key[side]
    edge = np.cumsum(np.diff(key, prepend=key[:1]) != 0)
    return EdgeSides(side, edge)
