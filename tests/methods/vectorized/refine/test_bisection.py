import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxvis.methods.vectorized.refine.bisection import (
    Leaves,
    bisected,
    closure,
    edges_of,
    numbered,
)
from jaxvis.methods.vectorized.refine.locate import Forest


def whole(triangles):
    every = np.arange(len(triangles), dtype=np.int32)
    return Forest.whole(len(triangles)), Leaves(np.asarray(triangles, np.int32), every, every)


def fan(seed=0):
    """Positions and triangles of an irregular flat mesh, 4 x 4 quads cut either way."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(5.0), np.arange(5.0), indexing="ij")
    positions = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    positions[:, :2] += rng.uniform(-0.3, 0.3, (25, 2))
    triangles = []
    for i in range(4):
        for j in range(4):
            a, b, c, d = 5 * i + j, 5 * i + 5 + j, 5 * i + 6 + j, 5 * i + j + 1
            cut = [[a, b, c], [a, c, d]] if rng.random() < 0.5 else [[a, b, d], [b, c, d]]
            triangles += cut
    return positions, np.array(triangles)


def refined(positions, triangles, choose, passes):
    """After some passes of ``choose(edges, random) -> joints``: (positions, forest, leaves)."""
    forest, leaves = whole(triangles)
    rng = np.random.default_rng(1)
    for _ in range(passes):
        edges = edges_of(leaves, positions)
        marked = closure(edges, choose(edges, rng))
        midpoints = len(positions) + np.arange(len(edges.ends), dtype=np.int32)
        positions = np.concatenate([positions, positions[edges.ends].mean(axis=1)])
        forest, leaves = bisected(forest, leaves, edges, marked, midpoints)
    return positions, forest, leaves


def some(share):
    return lambda edges, rng: rng.random(edges.joint.max() + 1) < share


def areas(positions, corners):
    a, b, c = np.moveaxis(positions[corners], 1, 0)
    return 0.5 * np.cross(b - a, c - a)[:, 2]


def smallest_angle(positions, corners):
    p = positions[corners]
    u, v = np.roll(p, -1, axis=1) - p, np.roll(p, -2, axis=1) - p
    cosine = np.sum(u * v, axis=-1)
    cosine /= np.linalg.norm(u, axis=-1) * np.linalg.norm(v, axis=-1)
    return np.arccos(cosine.clip(-1, 1)).min(axis=1)


def hanging(positions, corners):
    """How many corners lie inside edges (slow)."""
    found = 0
    places = positions[np.unique(corners)]
    start, end = (np.roll(corners, -k, axis=1).reshape(-1) for k in (1, 2))
    for a, b in zip(positions[start], positions[end], strict=True):
        t = (places - a) @ (b - a) / np.sum((b - a) ** 2)
        off = np.linalg.norm(places - a - t[:, None] * (b - a), axis=-1)
        found += np.count_nonzero((off < 1e-9) & (t > 1e-9) & (t < 1 - 1e-9))
    return found


@given(seed=st.integers(0, 1000), share=st.floats(0.01, 0.6))
@settings(max_examples=8, deadline=None)
def test_refined_meshes_conform_and_cover_the_same(seed, share):
    positions, triangles = fan(seed)
    before = areas(positions, triangles)
    angle = smallest_angle(positions, triangles)
    positions, forest, leaves = refined(positions, triangles, some(share), 3)
    after = areas(positions, leaves.corners)
    assert after.min() > 0.0
    np.testing.assert_allclose(np.bincount(leaves.root, after), before, rtol=1e-12)
    assert hanging(positions, leaves.corners) == 0
    # Rivara 1984: at least half the smallest angle of the triangle before.
    assert np.all(smallest_angle(positions, leaves.corners) >= 0.5 * angle[leaves.root] - 1e-9)
    assert forest.roots == len(triangles)


def test_without_closure_vertices_hang():
    """Negative control."""
    positions, triangles = fan()
    forest, leaves = whole(triangles)
    edges = edges_of(leaves, positions)
    rows = np.arange(len(triangles))
    shortest = np.argmin(edges.length[edges.of], axis=1)
    marked = np.zeros(edges.joint.max() + 1, bool)
    marked[edges.joint[edges.of[rows, shortest]][:6]] = True
    assert closure(edges, marked).sum() > marked.sum()
    midpoints = len(positions) + np.arange(len(edges.ends), dtype=np.int32)
    positions = np.concatenate([positions, positions[edges.ends].mean(axis=1)])
    _, leaves = bisected(forest, leaves, edges, marked, midpoints)
    assert hanging(positions, leaves.corners) > 0


def test_one_two_and_three_divided_edges_make_two_three_and_four_parts():
    positions = np.array([[0.0, 0, 0], [3, 0, 0], [0, 2, 0]])
    for count in (1, 2, 3):
        forest, leaves = whole([[0, 1, 2]])
        edges = edges_of(leaves, positions)
        order = np.argsort(-edges.length)
        marked = np.zeros(3, bool)
        marked[edges.joint[order[:count]]] = True
        np.testing.assert_array_equal(closure(edges, marked), marked)
        midpoints = 3 + np.arange(3, dtype=np.int32)
        _, parts = bisected(forest, leaves, edges, marked, midpoints)
        assert len(parts.root) == count + 1


def test_no_marks_no_change():
    positions, triangles = fan()
    _, forest, leaves = refined(positions, triangles, some(0.0), 2)
    np.testing.assert_array_equal(leaves.corners, triangles)
    np.testing.assert_array_equal(forest.children, np.arange(len(triangles)))


def test_edges_between_the_same_places_are_divided_together():
    """Two triangles with vertices of their own along a crease."""
    positions = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0], [1, 0, 0], [0, -1, 0]])
    forest, leaves = whole([[0, 1, 2], [4, 3, 5]])
    edges = edges_of(leaves, positions)
    assert len(edges.ends) == 6
    assert edges.joint.max() + 1 == 5
    crease = edges.joint[(edges.ends == [0, 1]).all(axis=1)]
    marked = np.zeros(5, bool)
    marked[crease] = True
    midpoints = 6 + np.arange(6, dtype=np.int32)
    positions = np.concatenate([positions, positions[edges.ends].mean(axis=1)])
    _, parts = bisected(forest, leaves, edges, closure(edges, marked), midpoints)
    assert np.bincount(parts.root).min() > 1
    assert hanging(positions, parts.corners) == 0


def test_parts_are_numbered_in_the_order_of_the_whole_ones():
    positions, triangles = fan()
    _, forest, leaves = refined(positions, triangles, some(0.3), 3)
    forest, ordered = numbered(forest, leaves)
    assert np.all(np.diff(ordered.root) >= 0)
    np.testing.assert_array_equal(forest.children[ordered.node], np.arange(len(ordered.root)))
