"""The construction of correspondences: hand-made cases, invariants, an exact oracle."""

import itertools

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxvis.methods.vectorized.correspondence.build import Settings, build_correspondence
from jaxvis.methods.vectorized.correspondence.candidates import (
    Layout,
    hull_facets,
    layout,
    rgb_tripoints,
    tripoint_distance,
)
from jaxvis.methods.vectorized.correspondence.fill import fill_faces
from jaxvis.methods.vectorized.correspondence.invariants import check_lists, check_shared
from jaxvis.methods.vectorized.correspondence.links import slot_in_cyclic_order
from jaxvis.methods.vectorized.correspondence.selection import neighbours
from jaxvis.methods.vectorized.polygons import VisibilityPolygons

CAPACITY = 32


def circle(count: int, *, turn: float = 0.0, height: float = 0.5) -> np.ndarray:
    """Directions at infinity round the pole, [4, count]."""
    angle = 2.0 * np.pi * (np.arange(count) + turn) / count
    radius = np.sqrt(1.0 - height**2)
    x, z = radius * np.cos(angle), -radius * np.sin(angle)
    return np.stack([x, np.full(count, height), z, np.zeros(count)]).astype(np.float32)


def mesh_of(
    outlines: list[np.ndarray],
    positions: np.ndarray,
    triangles: np.ndarray,
    capacity: int = CAPACITY,
) -> VisibilityPolygons:
    vectors = np.stack([np.pad(o, ((0, 0), (0, capacity - o.shape[1])), "edge") for o in outlines])
    count = len(outlines)
    normals = np.tile(np.array([0.0, 1.0, 0.0], np.float32), (count, 1))
    return VisibilityPolygons(
        vectors=jnp.asarray(vectors),
        counts=jnp.asarray([o.shape[1] for o in outlines], jnp.int32),
        positions=jnp.asarray(positions, jnp.float32),
        normals=jnp.asarray(normals),
        triangles=jnp.asarray(triangles, jnp.int32),
        backs=jnp.zeros((0, 3), jnp.int32),
        buried=jnp.zeros(count, bool),
    )


def strip(outlines: list[np.ndarray]) -> VisibilityPolygons:
    """Triangles side by side over as many vertices as there are outlines."""
    count = len(outlines)
    row = np.arange(count)
    positions = np.stack([row // 2, np.zeros(count), -(row % 2)], axis=-1)
    triangles = np.array([[i, i + 1, i + 2] if i % 2 else [i, i + 2, i + 1] for i in row[:-2]])
    return mesh_of(outlines, positions, triangles)


def lists_of(found) -> list[np.ndarray]:
    starts = np.asarray(found.starts)
    return [np.asarray(found.triples)[a:b] for a, b in itertools.pairwise(starts)]


def seen_by(polygons: VisibilityPolygons) -> Layout:
    corners = np.asarray(polygons.triangles)
    centres = np.asarray(polygons.positions, np.float64)[corners].mean(axis=1)
    return layout(np.asarray(polygons.vectors), np.asarray(polygons.counts), corners, centres)


def test_identical_polygons_correspond_entity_by_entity():
    """Coincident sites, which Qhull would drop, are matched with each other."""
    polygons = strip([circle(12)] * 4)
    for triples in lists_of(build_correspondence(polygons, None)):
        assert len(triples) == 12
        assert (triples == triples[:, :1]).all()


def test_turned_polygons_correspond_to_the_nearest():
    """The second starts a third of a turn later: entity j of it is j + 4 of the others."""
    polygons = strip([circle(12), np.roll(circle(12), -4, axis=1), circle(12)])
    (triples,) = lists_of(build_correspondence(polygons, None))
    place = np.asarray(polygons.triangles)[0].tolist().index(1)
    own = triples[:, place]
    other = triples[:, (place + 1) % 3]
    assert ((own + 4) % 12 == other).all()
    assert len(triples) == 12


@pytest.mark.parametrize("construction", ["relaxed", "paper"])
@settings(max_examples=8, deadline=None)
@given(
    counts=st.lists(st.integers(1, CAPACITY), min_size=3, max_size=6),
    seed=st.integers(0, 2**16),
)
def test_lists_visit_everything_in_order(construction, counts, seed):
    """Random polygons, however little they have in common: an empty one, few vectors, many."""
    rng = np.random.default_rng(seed)
    outlines = []
    for count in counts:
        outline = circle(count, turn=rng.random(), height=0.2)
        outline[:3] += 0.4 * rng.standard_normal((3, count)).astype(np.float32)
        outlines.append(outline)
    polygons = strip(outlines)
    found = build_correspondence(polygons, None, Settings(construction=construction))
    for corners, triples in zip(np.asarray(polygons.triangles), lists_of(found), strict=True):
        for k in range(3):
            count = counts[corners[k]]
            assert set(triples[:, k].tolist()) == set(range(count))
            steps = (np.roll(triples[:, k], -1) - triples[:, k]) % count
            assert set(steps.tolist()) <= {0, 1}
            assert steps.sum() == (count if count > 1 else 0)


def test_shared_edges_share_triples():
    """Along an inner edge most pairs of the one face's list are in the other's."""
    rng = np.random.default_rng(3)
    outlines = [circle(28, turn=rng.random(), height=0.5 + 0.03 * rng.random()) for _ in range(4)]
    polygons = strip(outlines)
    first, second = lists_of(build_correspondence(polygons, None))
    a, b = np.asarray(polygons.triangles)
    shared = [v for v in a if v in b]
    pairs = []
    for corners, triples in ((a, first), (b, second)):
        columns = [corners.tolist().index(v) for v in shared]
        pairs.append({tuple(row) for row in triples[:, columns].tolist()})
    assert len(pairs[0] & pairs[1]) >= 0.6 * min(map(len, pairs))


def test_deterministic_for_a_seed():
    rng = np.random.default_rng(5)
    polygons = strip([circle(20, turn=rng.random()) for _ in range(6)])
    one, two = (build_correspondence(polygons, None, Settings(seed=7)) for _ in range(2))
    np.testing.assert_array_equal(one.triples, two.triples)
    np.testing.assert_array_equal(one.evaluated, two.evaluated)


def test_faces_without_neighbours_or_without_polygons():
    """Two triangles apart, and the back of a mesh of which only one triangle has a back."""
    outlines = [circle(10 + i) for i in range(6)]
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 0, -1], [5, 0, 0], [6, 0, 0], [5, 0, -1]])
    polygons = mesh_of(outlines, positions, np.array([[0, 1, 2], [3, 4, 5]]))
    backs = jnp.asarray([[-1, -1, -1], [3, 5, 4]], jnp.int32)
    polygons = VisibilityPolygons(**{**vars(polygons), "backs": backs})
    lengths = [len(triples) for triples in lists_of(build_correspondence(polygons, None))]
    assert len(lengths) == 4
    assert lengths[2] == 0
    assert min(lengths[0], lengths[1], lengths[3]) >= 12


def test_fill_finds_the_cheapest_path():
    """Against all monotone paths of a small lattice."""
    rng = np.random.default_rng(2)
    outlines = [circle(n, turn=rng.random(), height=0.4) for n in (4, 3, 4)]
    polygons = mesh_of(outlines, np.eye(3), np.array([[0, 1, 2]]), capacity=4)
    seen = seen_by(polygons)
    counts = seen.counts[0]
    links = np.zeros((1, 1, 3), np.int16)
    triples, sizes = np.zeros((1, 12, 3), np.int16), np.zeros(1, np.int32)
    one = np.ones(1, np.int32)
    fill_faces(np.arange(1), seen, links, one, np.float32(0.1), triples, sizes)

    def cost(path) -> float:
        u = [seen.directions[0, k, np.asarray(path)[:, k] % counts[k]] for k in range(3)]
        return float((tripoint_distance(*u) + 0.1).sum())

    moves = [m for m in itertools.product((0, 1), repeat=3) if any(m)]
    best = {(0, 0, 0): 0.0}
    for place in itertools.product(*(range(n + 1) for n in counts)):
        if any(place):
            before = [tuple(np.subtract(place, m)) for m in moves]
            best[place] = cost([place]) + min(best.get(b, np.inf) for b in before)
    # The last point of a path is the first again, which the list does not repeat.
    expected = best[tuple(counts)]
    assert cost(triples[0, : sizes[0]]) == pytest.approx(expected, rel=1e-5)


def test_cyclic_order_of_links():
    """Slots of the cyclic interval, worked by hand; sequences of 128."""
    links = np.array([[10, 120, -1], [40, 20, -1], [90, 60, -1]], np.int16)
    counts = np.array([128, 128, 128], np.int32)
    cases = {
        (60, 40): 2,
        (60, 70): -1,
        (20, 125): 1,
        (20, 5): 1,
        (20, 70): -1,
        (3, 100): 0,
        (120, 61): 0,
        (120, 10): -1,
    }
    for (a, b), slot in cases.items():
        triple = np.array([a, b, -1], np.int16)
        assert slot_in_cyclic_order(links, 3, triple, counts) == slot, (a, b)


def test_neighbours_across_borders_and_crowded_edges():
    triangles = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4], [2, 1, 5]])
    keys = np.sort(np.stack([triangles[:, [1, 2]], triangles[:, [2, 0]], triangles[:, [0, 1]]], 1))
    _, edges = np.unique(keys.reshape(-1, 2), axis=0, return_inverse=True)
    around = neighbours(triangles, edges.reshape(-1, 3))
    assert (around.face[:3, 2] == -1).all()  # three faces meet at 0-1
    assert around.face[0, 0] == 3
    assert around.face[3, 2] == 0
    assert triangles[3][around.corners[0, 0]].tolist() == [1, 2]


def test_tripoints_are_voronoi_vertices():
    """No site is nearer to a tripoint's centre than its own three."""
    rng = np.random.default_rng(4)
    polygons = strip([circle(25, turn=rng.random(), height=0.3 + 0.1 * i) for i in range(3)])
    seen = seen_by(polygons)
    found = rgb_tripoints(seen, tangent=None, seed=0)
    sites = np.concatenate([seen.directions[0, k, :25] for k in range(3)]).astype(np.float64)
    assert len(found.triples) > 10
    distances = []
    for triple in found.triples:
        u, v, w = (seen.directions[0, k, triple[k]].astype(np.float64) for k in range(3))
        axis = np.cross(v - u, w - u)
        axis *= np.sign(axis @ u) / np.linalg.norm(axis)
        assert (sites @ axis).max() <= axis @ u + 1e-5
        distances.append(tripoint_distance(u, v, w))
    assert (np.diff(distances) >= -1e-6).all()


def test_tangents_filter_strands_that_run_apart():
    """Two polygons turn the other way: none of their tripoints is left."""
    outlines = [circle(20, turn=0.3 * i, height=0.5 + 0.03 * i) for i in range(3)]
    outlines[1] = outlines[1][:, ::-1].copy()
    seen = seen_by(strip(outlines))
    assert len(rgb_tripoints(seen, tangent=0.3, seed=0).triples) == 0
    assert len(rgb_tripoints(seen, tangent=None, seed=0).triples) > 0


def test_hull_of_a_cap_gets_auxiliary_sites():
    sites = circle(16, height=0.9)[:3].T.astype(np.float64)
    points, facets = hull_facets(sites, np.zeros((40, 3)))
    assert len(points) > len(sites)
    assert facets.max() < len(points)


def test_invariants_catch_what_is_wrong():
    good = np.array([[[0, 0, 0], [1, 1, 1], [2, 2, 2]]])
    counts = np.array([[3, 3, 3]])
    check_lists(good, np.array([3]), counts)
    for bad in (good[:, ::-1], good[:, [0, 2, 2]], good % 2):
        with pytest.raises(AssertionError):
            check_lists(bad, np.array([3]), counts)
    links = np.array([[[1, 1, -1]]])
    check_shared(links, np.array([1]), good, np.array([3]))
    with pytest.raises(AssertionError, match="missing"):
        check_shared(np.array([[[1, 2, -1]]]), np.array([1]), good, np.array([3]))
