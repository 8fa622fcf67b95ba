"""Where the texels of cubes and angular maps lie."""

import numpy as np
import pytest

from jaxvis.lighting.projections import FACES, Angular, Cube

ZERO = np.zeros(())
EDGE = np.linspace(-1.0, 1.0, 9)


def face(name, right, up):
    right, up = np.broadcast_arrays(np.asarray(right, float), np.asarray(up, float))
    return Cube(4).directions(FACES.index(name), right, up)


@pytest.mark.parametrize(("name", "expected"), [
    ("pz", [0, 0, 1]), ("nz", [0, 0, -1]), ("py", [0, 1, 0]), ("ny", [0, -1, 0]),
    ("px", [-1, 0, 0]), ("nx", [1, 0, 0]),
])  # fmt: skip
def test_face_centres(name, expected):
    np.testing.assert_allclose(face(name, 0.0, 0.0), expected)


@pytest.mark.parametrize("name", FACES)
def test_faces_are_seen_from_inside(name):
    """Right, up and backward are right-handed, as for a camera: not mirrored."""
    centre = face(name, 0.0, 0.0)
    right = face(name, 1e-3, 0.0) - centre
    up = face(name, 0.0, 1e-3) - centre
    assert np.cross(right, up) @ centre < 0.0


@pytest.mark.parametrize(("one", "other"), [
    (("pz", 1.0, EDGE), ("px", -1.0, EDGE)),
    (("px", 1.0, EDGE), ("nz", -1.0, EDGE)),
    (("nz", 1.0, EDGE), ("nx", -1.0, EDGE)),
    (("nx", 1.0, EDGE), ("pz", -1.0, EDGE)),
    (("pz", EDGE, 1.0), ("py", EDGE, -1.0)),
    (("pz", EDGE, -1.0), ("ny", EDGE, 1.0)),
    (("px", EDGE, 1.0), ("py", 1.0, EDGE)),
    (("nx", EDGE, -1.0), ("ny", -1.0, EDGE)),
])  # fmt: skip
def test_neighbours_in_the_cross_share_their_edge(one, other):
    np.testing.assert_allclose(face(*one), face(*other), atol=1e-12)


def test_the_angular_map_is_debevecs_with_its_front_at_plus_z():
    probe = Angular(8)
    np.testing.assert_allclose(probe.directions(0, ZERO, ZERO), [0, 0, 1], atol=1e-12)
    half = np.asarray(0.5)
    np.testing.assert_allclose(probe.directions(0, half, ZERO), [-1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(probe.directions(0, ZERO, half), [0, 1, 0], atol=1e-12)
    for corner in (1.0, -1.0):
        outside = probe.directions(0, np.asarray(corner), np.asarray(0.3))
        np.testing.assert_allclose(outside, [0, 0, -1], atol=1e-12)


def test_angles_grow_linearly_in_the_angular_map():
    radius = np.linspace(0.0, 0.99, 12)
    directions = Angular(8).directions(0, 0.6 * radius, 0.8 * radius)
    angle = np.arctan2(np.hypot(directions[:, 0], directions[:, 1]), directions[:, 2])
    np.testing.assert_allclose(angle, np.pi * radius, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0)


@pytest.mark.parametrize("size", [4, 6, 8, 10, 50, 900])
def test_edges_of_even_angular_maps_have_vertices_at_the_poles(size):
    steps = size * Angular(size).edge_pieces
    assert steps % 4 == 0
