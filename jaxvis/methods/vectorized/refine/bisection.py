"""Triangles divided at the midpoints of their edges without hanging vertices (host).

Where an edge is divided, so is the longest edge of every triangle at it (Rivara 1984): triangles
fall into two, three or four, and their angles stay above a bound. Edges count as the same where
they join the same two places, although the vertices there may differ, as along a crease.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int, Int32

from jaxvis.methods.vectorized.refine.locate import LEAF, Forest
from jaxvis.scene.weld import equal_rows


class Leaves(NamedTuple):
    """Triangles that are not divided further."""

    corners: Int32[np.ndarray, "leaves 3"]
    """Vertices."""
    root: Int32[np.ndarray, "leaves"]
    """The whole triangles of which they are parts."""
    node: Int32[np.ndarray, "leaves"]
    """Where they stand in the forest."""


class Edges(NamedTuple):
    """The edges of triangles. The k-th of a triangle lies opposite its k-th corner."""

    ends: Int32[np.ndarray, "edges 2"]
    """Vertices, the lower number first."""
    length: Float64[np.ndarray, "edges"]
    joint: Int32[np.ndarray, "edges"]
    """The same number for edges between the same two places."""
    of: Int32[np.ndarray, "leaves 3"]
    longest: Int32[np.ndarray, "leaves"]
    """Which of a triangle's three."""


def edges_of(leaves: Leaves, positions: Float64[np.ndarray, "vertices 3"]) -> Edges:
    """The edges of a mesh with vertices at ``positions``."""
    start, end = np.roll(leaves.corners, -1, axis=1), np.roll(leaves.corners, -2, axis=1)
    low, high = np.minimum(start, end).reshape(-1), np.maximum(start, end).reshape(-1)
    keys, of = np.unique(edge_keys(np.stack([low, high], axis=-1)), return_inverse=True)
    of = of.reshape(-1, 3).astype(np.int32)
    ends = np.stack([keys >> 32, keys & 0xFFFFFFFF], axis=-1).astype(np.int32)
    place = equal_rows(*positions.T)[1][ends]
    _, joint = np.unique(edge_keys(np.sort(place, axis=-1).astype(np.int32)), return_inverse=True)
    length = np.linalg.norm(positions[ends[:, 1]] - positions[ends[:, 0]], axis=-1)
    # Ties fall alike in all triangles at an edge.
    rank = np.empty(len(ends), np.int64)
    rank[np.lexsort((joint, length))] = np.arange(len(ends))
    longest = np.argmax(rank[of], axis=-1).astype(np.int32)
    return Edges(ends, length, joint.astype(np.int32), of, longest)


def edge_keys(ends: Int32[np.ndarray, "edges 2"]) -> Int[np.ndarray, "edges"]:
    """One number for each pair, in the pairs' order."""
    return (ends[:, 0].astype(np.int64) << 32) | ends[:, 1]


def closure(edges: Edges, marked: Bool[np.ndarray, "joints"]) -> Bool[np.ndarray, "joints"]:
    """The marked joints, and those that must be divided with them."""
    marked = marked.copy()
    joint = edges.joint[edges.of]
    longest = np.take_along_axis(joint, edges.longest[:, None], axis=1)[:, 0]
    while True:
        lacking = marked[joint].any(axis=1) & ~marked[longest]
        if not lacking.any():
            return marked
        marked[longest[lacking]] = True


def bisected(
    forest: Forest,
    leaves: Leaves,
    edges: Edges,
    marked: Bool[np.ndarray, "joints"],
    midpoints: Int32[np.ndarray, "edges"],
) -> tuple[Forest, Leaves]:
    """The triangles after all marked joints are divided.

    Args:
        forest: of the triangles.
        leaves: the triangles.
        edges: theirs.
        marked: closed under :func:`closure`.
        midpoints: the vertices that divide the edges; those of marked ones are used.
    """
    divided = marked[edges.joint][edges.of]
    midpoint = midpoints[edges.of]
    chosen = np.flatnonzero(divided.any(axis=1))
    corner = edges.longest[chosen]
    around = (corner[:, None] + np.arange(3)) % 3
    across = np.take_along_axis(divided[chosen], around, axis=1)
    middle = np.take_along_axis(midpoint[chosen], around, axis=1)
    kept = np.delete(np.arange(len(leaves.root)), chosen)
    whole = Leaves(*(field[kept] for field in leaves))
    forest, first, second = _bisect(forest, _take(leaves, chosen), corner, middle[:, 0])
    # Of (a, x, y): the half (a, x, m) keeps the edge opposite y, (a, m, y) that opposite x.
    parts = [whole]
    for half, opposite, own in ((first, 2, 2), (second, 1, 1)):
        again = across[:, opposite]
        parts.append(_take(half, np.flatnonzero(~again)))
        chosen = np.flatnonzero(again)
        corner = np.full(len(chosen), own, np.int32)
        forest, *halves = _bisect(forest, _take(half, chosen), corner, middle[chosen, opposite])
        parts += halves
    return forest, Leaves(*(np.concatenate(fields) for fields in zip(*parts, strict=True)))


def _take(leaves: Leaves, chosen: Int[np.ndarray, "chosen"]) -> Leaves:
    return Leaves(*(field[chosen] for field in leaves))


def _bisect(
    forest: Forest,
    leaves: Leaves,
    corner: Int32[np.ndarray, "leaves"],
    midpoint: Int32[np.ndarray, "leaves"],
) -> tuple[Forest, Leaves, Leaves]:
    """(the forest after it, first halves, second halves) of triangles divided from a corner."""
    around = (corner[:, None] + np.arange(3)) % 3
    a, x, y = np.take_along_axis(leaves.corners, around, axis=1).T
    size = len(forest.splits)
    node = (size + 2 * np.arange(len(corner))).astype(np.int32)
    new = np.arange(2 * len(corner), dtype=np.int32)
    splits = np.concatenate([forest.splits, np.full(len(new), LEAF)])
    children = np.concatenate([forest.children, np.zeros_like(new)])
    splits[leaves.node], children[leaves.node] = corner, node
    first = Leaves(np.stack([a, x, midpoint], axis=-1), leaves.root, node)
    second = Leaves(np.stack([a, midpoint, y], axis=-1), leaves.root, node + 1)
    return Forest(splits, children), first, second


def numbered(forest: Forest, leaves: Leaves) -> tuple[Forest, Leaves]:
    """The triangles in the order of the whole ones, and the forest that leads to them."""
    order = np.lexsort((leaves.node, leaves.root))
    leaves = _take(leaves, order)
    children = forest.children.copy()
    children[leaves.node] = np.arange(len(order), dtype=np.int32)
    return Forest(forest.splits, children), leaves
