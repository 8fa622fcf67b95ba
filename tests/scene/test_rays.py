"""Rays against closed forms, whatever the threads, the angle and the distance from the origin."""

import numpy as np
import pytest

from jaxvis.scene import rays
from jaxvis.scene.rays import RayTracer, offset_origins


def square(height=0.0, half=1.0):
    """Two triangles in the plane y = height, facing up."""
    x = half * np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]], np.float32)
    return x + [0, height, 0], np.array([[0, 2, 1], [0, 3, 2]])


def sphere(subdivisions=3):
    """Unit icosphere."""
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=subdivisions)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def random_directions(count, seed=0):
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return (vectors / np.linalg.norm(vectors, axis=1, keepdims=True)).astype(np.float32)


def test_closest_hit_says_triangle_barycentrics_and_distance():
    tracer = RayTracer(*square())
    origins = np.array([[0.25, 2.0, -0.5], [0.0, 2.0, 5.0]], np.float32)
    down = np.array([[0, -1, 0], [0, -1, 0]], np.float32)
    hits = tracer.closest_hit(origins, down)
    positions, triangles = square()
    point = hits.barycentrics[0] @ positions[triangles[hits.triangle[0]]]
    np.testing.assert_allclose(point, [0.25, 0.0, -0.5], atol=1e-6)
    assert hits.distance[0] == pytest.approx(2.0)
    assert hits.triangle[1] == -1
    assert np.isinf(hits.distance[1])
    assert np.all(hits.barycentrics[1] == 0.0)


def test_occluded_respects_the_distance_limit_and_leaves_it_alone():
    tracer = RayTracer(*square())
    origins = np.full((3, 3), [0.1, 2.0, 0.2], np.float32)
    down = np.full((3, 3), [0, -1, 0], np.float32)
    limits = np.array([1.9, 2.1, np.inf], np.float32)
    before = limits.copy()
    assert tracer.occluded(origins, down, limits).tolist() == [False, True, True]
    np.testing.assert_array_equal(limits, before)


def test_any_number_of_threads_gives_the_same_bits():
    positions, triangles = sphere()
    count = 3 * rays.BLOCK + 17
    directions = random_directions(count)
    origins = (1.5 * random_directions(count, seed=1)).astype(np.float32)
    answers = [
        (tracer.closest_hit(origins, directions), tracer.occluded(origins, directions))
        for tracer in (RayTracer(positions, triangles, threads=n) for n in (1, 2, 5))
    ]
    for hits, occluded in answers[1:]:
        for one, other in zip(hits, answers[0][0], strict=True):
            np.testing.assert_array_equal(one, other)
        np.testing.assert_array_equal(occluded, answers[0][1])
    np.testing.assert_array_equal(answers[0][1], answers[0][0].triangle >= 0)


def test_visible_traces_active_rays_only():
    positions, triangles = sphere()
    tracer = RayTracer(positions, triangles)
    rng = np.random.default_rng(3)
    origins = 1.2 * random_directions(700)
    directions = random_directions(700 * 64, seed=2).reshape(700, 64, 3)
    active = rng.random((700, 64)) < 0.3
    before = tracer.rays_traced
    visible = tracer.visible(origins, list(np.moveaxis(directions, -1, 0)), active)
    assert tracer.rays_traced - before == active.sum()
    every = tracer.occluded(np.repeat(origins, 64, axis=0), directions.reshape(-1, 3))
    np.testing.assert_array_equal(visible, active & ~every.reshape(700, 64))
    assert 0.2 < (visible.sum() / active.sum()) < 0.8


def test_visible_rays_may_end_before_what_they_would_meet():
    positions, triangles = sphere()
    tracer = RayTracer(positions, triangles)
    origins = 1.2 * random_directions(300)
    directions = random_directions(300 * 64, seed=2).reshape(300, 64, 3)
    components = list(np.moveaxis(directions, -1, 0))
    active = np.random.default_rng(3).random((300, 64)) < 0.5
    starts = np.repeat(origins, 64, axis=0)
    distance = tracer.closest_hit(starts, directions.reshape(-1, 3)).distance.reshape(300, 64)
    assert np.isfinite(distance[active]).mean() > 0.2
    limits = np.where(np.isfinite(distance), distance, np.float32(1.0))
    for factor in (np.float32(0.999), np.float32(1.001)):
        given = factor * limits
        kept = given.copy()
        visible = tracer.visible(origins, components, active, given)
        expected = active & (distance > given)
        np.testing.assert_array_equal(visible, expected)
        np.testing.assert_array_equal(given, kept)
    assert visible.sum() < active.sum()


@pytest.mark.parametrize("shift", [0.0, 1e3, 1e6])
@pytest.mark.parametrize("size", [1e-3, 1.0, 1e4])
def test_grazing_rays_do_not_hit_the_surface_that_they_leave(shift, size):
    """On a convex body every ray above the tangent plane is free, even one 1e-4 rad above it.

    Far away, centred coordinates are what the scene traces in (tests/scene/test_build.py); here the
    body is centred and scaled, and ``shift`` is a second body, far off, that widens the scene.
    """
    positions, triangles = sphere()
    far = np.array([shift + 5.0, 0.0, 0.0])
    both = np.concatenate([positions, positions + far]) * size
    tracer = RayTracer(both, np.concatenate([triangles, triangles + len(positions)]))
    corners = (positions[triangles] * size).astype(np.float32)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    weights = np.random.default_rng(0).dirichlet([1, 1, 1], len(triangles)).astype(np.float32)
    points = np.einsum("tk,tkc->tc", weights, corners)
    tangents = np.cross(normals, random_directions(len(normals)))
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    away = tangents[:, 0] < 0.0  # from the second body
    origins = offset_origins(points, normals)
    for elevation in (1e-4, 1e-2):
        directions = (tangents + elevation * normals).astype(np.float32)
        assert not tracer.occluded(origins[away], directions[away]).any()
    inward = (tangents - 0.1 * normals).astype(np.float32)
    assert tracer.occluded(origins[away], inward[away]).all()


def test_offset_is_small_and_on_the_side_of_the_normal():
    positions = np.array([[3.0, -100.0, 20.0], [0.0, 0.0, 0.0]], np.float32)
    normals = np.array([[0, 1, 0], [1, 0, 0]], np.float32)
    moved = offset_origins(positions, normals) - positions
    assert 0.0 < moved[0, 1] < 2e-5 * 100.0
    assert moved[0, 0] == moved[0, 2] == 0.0
    assert moved[1, 0] > 0.0


def test_no_rays_is_no_error():
    tracer = RayTracer(*square())
    empty = np.empty((0, 3), np.float32)
    assert tracer.occluded(empty, empty).shape == (0,)
    assert tracer.closest_hit(empty, empty).triangle.shape == (0,)
    with pytest.raises(ValueError, match="threads must be at least 1"):
        RayTracer(*square(), threads=0)
