import numpy as np
import pytest

from jaxvis.methods.vectorized.refine.bisection import numbered
from jaxvis.methods.vectorized.refine.locate import Forest, locate
from tests.methods.vectorized.refine.ground import random_barycentrics
from tests.methods.vectorized.refine.test_bisection import fan, refined, some


@pytest.fixture(scope="module")
def mesh():
    positions, triangles = fan()
    every, forest, leaves = refined(positions, triangles, some(0.3), 5)
    forest, leaves = numbered(forest, leaves)
    return every, triangles, forest, leaves


def places(positions, corners, barycentrics):
    return np.einsum("pk,pkc->pc", barycentrics.astype(np.float64), positions[corners])


def test_the_small_triangle_has_the_same_place(mesh):
    positions, triangles, forest, leaves = mesh
    triangle = np.random.default_rng(1).integers(0, len(triangles), 4000).astype(np.int32)
    barycentrics = random_barycentrics(4000)
    leaf, inside = locate(forest, triangle, barycentrics)
    np.testing.assert_array_equal(leaves.root[leaf], triangle)
    assert inside.min() >= 0.0
    np.testing.assert_allclose(inside.sum(axis=1), 1.0, atol=1e-6)
    there = places(positions, leaves.corners[leaf], inside)
    here = places(positions, triangles[triangle], barycentrics)
    np.testing.assert_allclose(there, here, atol=1e-5)
    # Negative control: the first part of each triangle is somewhere else.
    first = np.searchsorted(leaves.root, triangle)
    assert np.abs(places(positions, leaves.corners[first], inside) - here).max() > 0.1


def test_it_finds_every_small_triangle_from_its_centroid(mesh):
    positions, triangles, forest, leaves = mesh
    centre = positions[leaves.corners].mean(axis=1)
    a, b, c = np.moveaxis(positions[triangles[leaves.root]], 1, 0)
    basis = np.stack([b - a, c - a], axis=-1)[:, :2]
    two = np.linalg.solve(basis, (centre - a)[:, :2, None])[..., 0]
    barycentrics = np.concatenate([1.0 - two.sum(axis=1, keepdims=True), two], axis=1)
    leaf, inside = locate(forest, leaves.root, barycentrics.astype(np.float32))
    np.testing.assert_array_equal(leaf, np.arange(len(leaf)))
    np.testing.assert_allclose(inside, 1.0 / 3.0, atol=1e-4)


def test_places_on_edges_and_a_little_outside_are_inside(mesh):
    _, _, forest, _ = mesh
    barycentrics = np.array(
        [[1, 0, 0], [0, 0.5, 0.5], [-1e-7, 0.3, 0.7], [1.0000001, -1e-7, 0], [0.25, 0.25, 0.5]],
        np.float32,
    )
    leaf, inside = locate(forest, np.full(5, 3, np.int32), barycentrics)
    assert leaf.min() >= 0
    assert inside.min() >= 0.0
    np.testing.assert_allclose(inside.sum(axis=1), 1.0, atol=1e-6)


def test_what_is_not_divided_stays():
    triangle = np.array([4, 0, 2], np.int32)
    barycentrics = random_barycentrics(3)
    leaf, inside = locate(Forest.whole(5), triangle, barycentrics)
    np.testing.assert_array_equal(leaf, triangle)
    np.testing.assert_allclose(inside, barycentrics, atol=1e-7)


def test_no_points():
    leaf, inside = locate(Forest.whole(5), np.zeros(0, np.int32), np.zeros((0, 3), np.float32))
    assert leaf.shape == (0,)
    assert inside.shape == (0, 3)
