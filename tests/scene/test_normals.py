"""Crease normals against a slow oracle, and on meshes with known answers."""

import numpy as np
import pytest
import trimesh

from jaxvis.scene.normals import area_vectors, crease_normals, face_front


def slow_crease_normals(triangles, areas, crease_angle):
    """Walks around each corner, from triangle to neighbour, by a search over shared edges."""
    unit = areas / np.linalg.norm(areas, axis=-1, keepdims=True)
    normals = np.zeros((len(triangles), 3, 3))
    for start in range(len(triangles)):
        for corner in range(3):
            vertex = triangles[start, corner]
            found, queue = {start}, [start]
            while queue:
                here = queue.pop()
                for there in range(len(triangles)):
                    if there in found or vertex not in triangles[there]:
                        continue
                    if _joined(triangles[here], triangles[there], vertex) and np.dot(
                        unit[here], unit[there]
                    ) > np.cos(crease_angle):
                        found.add(there)
                        queue.append(there)
            total = areas[sorted(found)].sum(axis=0)
            normals[start, corner] = total / np.linalg.norm(total)
    return normals


def _joined(a, b, vertex):
    """Whether two triangles share an edge at the vertex, in opposite directions."""
    sides_a = {(a[k], a[(k + 1) % 3]) for k in range(3)}
    sides_b = {(b[(k + 1) % 3], b[k]) for k in range(3)}
    return any(vertex in side for side in sides_a & sides_b)


@pytest.mark.parametrize("angle", [0.0, 0.3, 0.9, 1.7])
def test_against_the_oracle(angle):
    mesh = trimesh.creation.cylinder(1.0, 2.0, sections=9)
    bumps = 0.1 * np.random.default_rng(3).normal(size=mesh.vertices.shape)
    points, triangles = mesh.vertices + bumps, np.asarray(mesh.faces)
    areas = area_vectors(points[triangles])
    np.testing.assert_allclose(
        crease_normals(triangles, areas, angle),
        slow_crease_normals(triangles, areas, angle),
        atol=1e-12,
    )


def roof(half_angle):
    """Two unit squares that meet at an edge along z, each falling by the angle."""
    c, s = np.cos(half_angle), np.sin(half_angle)
    points = np.array(
        [[-c, -s, 0], [-c, -s, 1], [0, 0, 1], [0, 0, 0], [c, -s, 1], [c, -s, 0]], float
    )
    return points, np.array([[0, 1, 2], [0, 2, 3], [3, 2, 4], [3, 4, 5]])


@pytest.mark.parametrize(("half_degrees", "sharp"), [(24.9, False), (25.1, True)])
def test_an_edge_is_sharp_from_the_crease_angle(half_degrees, sharp):
    points, triangles = roof(np.radians(half_degrees))
    areas = area_vectors(points[triangles])
    normals = crease_normals(triangles, areas, np.radians(50.0))
    ridge = normals[1, 2]
    expected = areas[1] / np.linalg.norm(areas[1]) if sharp else None
    if sharp:
        np.testing.assert_allclose(ridge, expected, atol=1e-12)
        assert np.abs(normals[2, 0] - ridge).max() > 0.5
    else:
        np.testing.assert_allclose(normals[2, 0], ridge, atol=1e-12)
        assert ridge[1] > 0.97


def test_a_double_sheet_keeps_its_sides_apart():
    points, triangles = roof(0.1)
    both = np.concatenate([triangles, triangles[:, ::-1]])
    areas = area_vectors(points[both])
    normals = crease_normals(both, areas, 1.0)
    assert np.all(normals[:4, :, 1] > 0.9)
    assert np.all(normals[4:, :, 1] < -0.9)


def test_sheets_that_wind_against_each_other_are_not_smoothed():
    points, triangles = roof(0.0)
    triangles = np.concatenate([triangles[:2], triangles[2:, ::-1]])
    normals = crease_normals(triangles, area_vectors(points[triangles]), 1.0)
    np.testing.assert_allclose(normals[:2, :, 1], 1.0)
    np.testing.assert_allclose(normals[2:, :, 1], -1.0)


def test_many_triangles_at_one_edge_work():
    turns = np.linspace(0.0, np.pi, 12)
    outer = np.stack([np.cos(turns), np.sin(turns), np.zeros(12)], axis=-1)
    points = np.concatenate([[[0.0, 0, 0], [0, 0, 1]], outer])
    triangles = np.stack([np.zeros(12, int), np.ones(12, int), np.arange(2, 14)], axis=-1)
    normals = crease_normals(triangles, area_vectors(points[triangles]), 0.5)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0)


def test_area_vectors_of_collinear_float32_points_are_exactly_zero():
    direction = np.array([0.1, 0.7, 0.3], np.float32)
    line = np.array([0.0, 0.5, 2.0], np.float32)[:, None] * direction
    np.testing.assert_array_equal(area_vectors(line[None]), 0.0)


def test_face_front_counts_what_it_changes():
    up = np.array([[0.0, 0.0, 1.0]])
    normals = np.array([[[0, 0, -1.0], [0, 0.6, -0.8], [0, -0.8, 0.6]]])
    turned, count, replaced = face_front(normals, up)
    assert (count, replaced) == (1, 1)
    np.testing.assert_allclose(turned[0], [[0, 0, 1], [0, -0.6, 0.8], [0, 0, 1]])


def test_sheets_folded_onto_each_other_are_not_smoothed():
    """Both triangles run along their edge the same way: they are no neighbours on a surface."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0.2, 1, 0], [0.7, 1, 0.2]])
    triangles = np.array([[0, 1, 2], [0, 1, 3]])
    areas = area_vectors(points[triangles])
    flat = areas / np.linalg.norm(areas, axis=-1, keepdims=True)
    np.testing.assert_allclose(
        crease_normals(triangles, areas, 1.0), np.repeat(flat[:, None], 3, axis=1), atol=1e-12
    )
