"""Seams, against outlines with closed forms."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

import jaxvis
from jaxvis.lighting import Environment
from jaxvis.methods.vectorized import VectorizedVisibility
from jaxvis.methods.vectorized.correspondence.seams import (
    differences,
    mean_irradiance,
    sides_of_edges,
)
from jaxvis.methods.vectorized.irradiance import Quadrature
from jaxvis.methods.vectorized.light import polygon_light
from jaxvis.methods.vectorized.mesh import Mesh, inner_edges
from jaxvis.sphere.polygons import Directions, uniform_irradiance
from tests.methods.corresponding_polygons import ANGLE, SIDES, two_triangles

FINE = Quadrature("split", 4, "bilinear")


@pytest.fixture(scope="module")
def sky():
    return polygon_light(Environment(jnp.ones((64, 128, 3))), lookup="bilinear")


def ring_irradiance(angle: float) -> float:
    """Of a uniform sky through a regular polygon on a cone about the normal."""
    turn = 2.0 * np.pi * np.arange(SIDES) / SIDES
    points = (
        np.sin(angle) * np.cos(turn),
        np.sin(angle) * np.sin(turn),
        np.full(SIDES, np.cos(angle)),
    )
    outline = Directions(*(jnp.asarray(p, jnp.float32)[None] for p in points))
    return float(uniform_irradiance(outline, jnp.array([[0.0, 0.0, 1.0]]))[0])


def test_the_shared_edge_is_the_only_inner_one():
    edges = inner_edges(*Mesh.of(two_triangles().polygons)[:2])
    assert edges.tolist() == [[2, 5]]  # opposite the third corners of both


def test_an_edge_of_three_faces_has_no_two_sides():
    polygons = two_triangles().polygons
    third = jnp.array([[1, 0, 2]], jnp.int32)
    three = replace(polygons, triangles=jnp.concatenate([polygons.triangles, third]))
    edges = inner_edges(*Mesh.of(three)[:2]).tolist()
    assert edges == [[1, 6], [0, 7]]  # those that the first and the third share besides


def test_equal_lists_make_no_seam(sky):
    sides = sides_of_edges(two_triangles(), sky, FINE)
    np.testing.assert_allclose(sides, ring_irradiance(ANGLE), rtol=6e-3)
    assert differences(sides).max() < 1e-5


def test_a_shifted_list_makes_the_seam_of_a_narrower_cone(sky):
    sides = sides_of_edges(two_triangles(shift=1), sky, FINE)
    # Midpoints between neighbours of the ring lie on a narrower cone.
    narrow = ring_irradiance(np.arctan(np.tan(ANGLE) * np.cos(np.pi / SIDES)))
    np.testing.assert_allclose(sides[0, 1], narrow, rtol=6e-3)
    expected = ring_irradiance(ANGLE) - narrow
    assert expected > 0.05
    np.testing.assert_allclose(differences(sides), expected, rtol=0.05)


def test_planes_make_seams_where_the_mesh_is_bent(sky):
    for visibility in (two_triangles(fold=1.5), two_triangles(fold=1.5).polygons):
        clipped = differences(sides_of_edges(visibility, sky, FINE))
        free = differences(sides_of_edges(visibility, sky, FINE, clipped=False))
        assert clipped[0] > 0.05
        assert free[0] < 1e-5


def test_a_separate_face_is_integrated_polygon_by_polygon(sky):
    sides = sides_of_edges(two_triangles(separate=True), sky, FINE)
    np.testing.assert_allclose(sides, ring_irradiance(ANGLE), rtol=6e-3)


def test_the_mean_irradiance_of_an_open_plane_is_pi(sky):
    scene = jaxvis.load_scene("plane:cells=2")
    surface = jaxvis.trace_surface(scene, jaxvis.default_camera(scene), (12, 12))
    method = VectorizedVisibility(vectors=32, resolution=32, pieces=4, lookup="bilinear")
    visibility = method.precompute(scene, progress=False)
    assert mean_irradiance(method, visibility, sky, surface) == pytest.approx(np.pi, rel=5e-3)
