"""Lathe, rings and grids against areas and volumes in closed form."""

from itertools import pairwise

import numpy as np
import pytest

from jaxvis.scene.builtin.mesh import fan, grid, grid_normals, join, rectangle, weld
from jaxvis.scene.builtin.shapes import (
    box,
    cell_count,
    ground,
    lathe,
    rectangle_sweep,
    sphere,
    torus,
)
from tests.scene.builtin_checks import is_closed, least_alignment, volume

RING = [(1.0, 0.0), (1.0, 2.0), (0.0, 2.0), (0.0, 0.0), (1.0, 0.0)]


def area(mesh):
    a, b, c = np.moveaxis(mesh.positions[mesh.triangles], 1, 0)
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=-1).sum()


@pytest.mark.parametrize(
    ("mesh", "expected"),
    [
        (sphere(2.0, 48), 4.0 / 3.0 * np.pi * 8.0),
        (torus(2.0, 0.5, 96, 48), 2.0 * np.pi**2 * 2.0 * 0.25),
        (box((2.0, 3.0, 4.0), 0.7), 24.0),
        (box((4.0, 1.0, 1.5), 10.0), 6.0),
        (
            rectangle_sweep(3.0, 2.0, RING, 0.9),
            2.0 * (8.0 * 6.0 - 6.0 * 4.0),
        ),
    ],
    ids=["sphere", "torus", "box", "flat box", "ring"],
)
def test_closed_shapes(mesh, expected):
    welded = weld(mesh)
    assert is_closed(welded)
    assert volume(welded) == pytest.approx(expected, rel=5e-3)
    assert least_alignment(welded) > 0.9
    assert np.allclose(np.linalg.norm(welded.normals, axis=-1), 1.0)


def test_moves_keep_the_front_in_front():
    solid = box((1.0, 2.0, 3.0), 0.5)
    for turned in (solid.moved((5.0, 6.0, 7.0), 3), solid.mirrored(), solid.moved((0, 0, 1), -1)):
        assert volume(turned) == pytest.approx(6.0)
        assert least_alignment(turned) > 0.999
    quarter = rectangle((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (1, 1)).moved(
        (0, 0, 0), 1
    )
    # Quarter turns carry +z to +x.
    assert np.allclose(quarter.normals, [1.0, 0.0, 0.0])
    assert np.allclose(quarter.positions[:, 0], 1.0)
    assert np.array_equal(solid.moved((0, 0, 0), 4).positions, solid.positions)


def test_ground_and_fan_face_the_way_they_say():
    floor = ground(4.0, 3)
    assert len(floor.triangles) == 18
    assert area(floor) == pytest.approx(16.0)
    assert least_alignment(floor) == pytest.approx(1.0)
    assert np.allclose(floor.normals, [0.0, 1.0, 0.0])
    square = np.array([[1, 0, 1], [1, 0, -1], [-1, 0, -1], [-1, 0, 1], [1, 0, 1]], float)
    for normal in ((0.0, 1.0, 0.0), (0.0, -2.0, 0.0)):
        cap = fan((0.0, 0.0, 0.0), square, normal)
        assert len(cap.triangles) == 4
        assert least_alignment(cap) == pytest.approx(1.0)


def test_grids_leave_collapsed_triangles_out_and_cut_the_shorter_diagonal():
    points = np.array([[[0, 0, 0], [0, 0, 0]], [[-1, 1, 0], [1, 1, 0]]], float)
    front = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
    assert len(grid(points, front).triangles) == 1
    skewed = np.array([[[0, 0, 0], [2, 0, 0]], [[3, 1, 0], [5, 1, 0]]], float)
    edges = {
        frozenset(pair) for t in grid(skewed, front).triangles for pair in pairwise(t[[0, 1, 2, 0]])
    }
    assert frozenset((1, 2)) in edges
    assert frozenset((0, 3)) not in edges


def test_grid_normals_of_a_saddle():
    x, y = np.meshgrid(np.linspace(-1, 1, 41), np.linspace(-1, 1, 41))
    saddle = np.stack([x, y, x * y], axis=-1)
    expected = np.stack([-y, -x, np.ones_like(x)], axis=-1)
    expected /= np.linalg.norm(expected, axis=-1, keepdims=True)
    assert np.allclose(grid_normals(saddle), expected, atol=1e-9)


def test_lathe_fronts_are_right_of_the_profile():
    up = lathe(np.array([[1.0, 0.0], [1.0, 2.0]]), 32)
    down = lathe(np.array([[1.0, 2.0], [1.0, 0.0]]), 32)
    assert np.all(np.sum(up.positions * up.normals, axis=-1) > 0.9)
    assert np.all(np.sum(down.positions * down.normals, axis=-1) < -0.9)
    assert least_alignment(up) > 0.99
    assert least_alignment(down) > 0.99


def test_welding_doubles_vertices_at_creases_only():
    assert len(weld(box((1.0, 1.0, 1.0), 5.0)).positions) == 4 * 4 + 2 * (4 + 1)
    assert len(weld(sphere(1.0, 8)).positions) == 7 * 16 + 2
    two = join([ground(2.0, 2), ground(2.0, 2).moved((2.0, 0.0, 0.0))])
    assert len(two.positions) == 18
    assert len(weld(two).positions) == 15


def test_cell_count():
    assert [cell_count(length, 0.5) for length in (0.1, 0.5, 0.51, 2.0)] == [1, 1, 2, 4]
