"""The teapot: Newell's patches, closed, smooth, standing on the plane."""

import os
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from jaxvis.scene.builtin import builtin_scene
from jaxvis.scene.builtin.mesh import Mesh, join, weld
from jaxvis.scene.builtin.teapot import CLEARANCE, evaluate_patch, teapot_mesh
from jaxvis.scene.builtin.teapot_patches import HANDLE, SPOUT, tube_patches, turned_patches
from tests.scene.builtin_checks import is_closed, least_alignment, occluded_share, volume


@pytest.fixture(scope="module")
def pot():
    return teapot_mesh(8)


def all_patches():
    return np.concatenate(
        [
            turned_patches().reshape(-1, 4, 4, 3),
            tube_patches(HANDLE).reshape(-1, 4, 4, 3),
            tube_patches(SPOUT).reshape(-1, 4, 4, 3),
        ]
    )


def test_the_published_patches():
    patches = all_patches()
    assert patches.shape == (32, 4, 4, 3)
    points = np.unique(np.round(patches.reshape(-1, 3), 6) + 0.0, axis=0)
    # The published list has 306 entries, 16 of which repeat others or belong to no patch.
    assert len(points) == 290
    assert np.allclose(points.min(axis=0), [-3.0, -2.0, 0.0])
    assert np.allclose(points.max(axis=0), [3.525, 2.0, 3.15])
    # Some of the published points, from all over the list.
    for point in (
        (1.4, -0.784, 2.4),
        (-0.805, 1.4375, 2.53125),
        (-1.75, -0.98, 1.875),
        (1.12, 2.0, 0.45),
        (-2.65, 0.3, 0.9375),
        (3.1, -0.66, 0.825),
        (3.45, 0.15, 2.5125),
        (-0.45, 0.8, 3.15),
        (0.0, 0.0, 2.85),
        (0.728, -1.3, 2.55),
        (-1.425, 0.798, 0.0),
    ):
        assert np.isclose(points, point).all(axis=-1).any(), point


def test_patch_normals_are_those_of_finite_differences():
    control = all_patches()[25]
    u, v, step = np.array([0.2, 0.7]), np.array([0.1, 0.55, 0.9]), 1e-5
    points, normals = evaluate_patch(control, u, v)
    down = evaluate_patch(control, u + step, v)[0] - points
    around = evaluate_patch(control, u, v + step)[0] - points
    expected = np.cross(around, down)
    expected /= np.linalg.norm(expected, axis=-1, keepdims=True)
    assert np.allclose(normals, expected, atol=1e-4)


def test_neighbouring_patches_are_smooth():
    # Where one profile goes on into the next, the tangent keeps its direction (but at the rim).
    patches = turned_patches()[:, 0]
    for upper, lower in ((0, 1), (2, 3), (3, 4), (4, 5)):
        end = patches[upper, 3] - patches[upper, 2]
        start = patches[lower, 1] - patches[lower, 0]
        cosine = (
            np.sum(end * start, -1) / np.linalg.norm(end, axis=-1) / np.linalg.norm(start, axis=-1)
        )
        assert np.all(cosine > 1.0 - 1e-12)


@pytest.mark.parametrize("subdivisions", [2, 3, 6, 8])
def test_three_closed_surfaces(subdivisions):
    pot = teapot_mesh(subdivisions)
    assert is_closed(pot)
    if subdivisions >= 6:
        assert least_alignment(pot) > 0.1
    pieces = trimesh.Trimesh(pot.positions, pot.triangles, process=False)
    pieces.merge_vertices(merge_norm=True)
    split = pieces.split()
    assert len(split) == 3
    for piece in split:
        assert piece.euler_number == 2
        assert piece.volume > 0.1


def test_a_gap_would_be_found(pot):
    assert not is_closed(Mesh(pot.positions, pot.normals, pot.triangles[1:]))


def test_size_and_symmetry(pot):
    low, high = pot.positions.min(axis=0), pot.positions.max(axis=0)
    assert np.allclose(low, [-3.0, 0.0, -2.0], atol=1e-9)
    assert np.allclose(high, [3.4335, 3.15, 2.0], atol=2e-3)
    assert cKDTree(pot.positions).query(pot.positions * [1, 1, -1])[0].max() < 1e-9
    # The solid of revolution alone, from its profile: pi times the integral of r^2 dz.
    t = np.linspace(0.0, 1.0, 2001)
    solid = 0.0
    for profile in turned_patches()[:, 0]:
        ring, _ = evaluate_patch(profile, t, np.zeros(1))
        radius, height = ring[:, 0, 0], ring[:, 0, 2]
        solid -= np.pi * np.sum(0.5 * (radius[1:] ** 2 + radius[:-1] ** 2) * np.diff(height))
    body = trimesh.Trimesh(teapot_mesh(24).positions, teapot_mesh(24).triangles, process=False)
    body.merge_vertices(merge_norm=True)
    largest = max(piece.volume for piece in body.split())
    assert largest == pytest.approx(solid, rel=0.01)
    assert volume(pot) == pytest.approx(26.0, rel=0.02)


def test_normals_at_the_poles(pot):
    axis = np.linalg.norm(pot.positions[:, [0, 2]], axis=-1) < 1e-9
    assert np.allclose(pot.positions[axis][:, 1], [3.15, 0.0])
    assert np.allclose(pot.normals[axis], [[0, 1, 0], [0, -1, 0]])
    assert np.allclose(np.linalg.norm(pot.normals, axis=-1), 1.0)


def test_vertices_on_smooth_parts_are_shared(pot):
    # Doubled vertices stand along creases alone: the two edges of the gap's floor, the four caps
    # of spout and handle, and where the handle starts on the body.
    distinct = len(np.unique(np.round(pot.positions, 6), axis=0))
    body, tube = 2 + (8 + 8 + 1 + 4 + 8 + 8 + 3) * 32, 17 * 16 + 2
    assert distinct == body + 2 * tube - 1  # the handle's lower end starts on the body
    assert len(pot.positions) - distinct == 2 * 32 + 4 * 16 + 1


def test_scene_stands_on_its_plane():
    scene = builtin_scene("teapot")
    assert 5900 < len(scene.positions) < 6400
    assert {material.two_sided for material in scene.materials} == {False}
    heights = scene.positions[:, 1] + scene.origin[1]
    table = np.unique(scene.triangles[scene.material_ids == 1])
    pot = np.unique(scene.triangles[scene.material_ids == 0])
    assert np.allclose(heights[table], 0.0, atol=1e-6)
    assert heights[pot].min() == pytest.approx(CLEARANCE, abs=1e-6)
    assert len(table) == 65**2
    # Under it is dark, on the knob all of the sky is there, inside is none.
    assert 0.999 < occluded_share(scene, (0.1, 0.0, 0.2)) < 1.0
    assert occluded_share(scene, (0.0, 3.15 + CLEARANCE, 0.0)) == 0.0
    assert occluded_share(scene, (0.0, 1.0, 0.0)) == 1.0


def test_finer_teapots():
    coarse, fine = (builtin_scene("teapot", subdivisions=n, plane_cells=16) for n in (4, 16))
    assert 4.0 < len(fine.triangles) / len(coarse.triangles) < 16.0
    assert len(builtin_scene("teapot", plane_cells=3, plane_size=20.0).triangles) == 3648 + 18


def test_against_a_teapot_from_a_file():
    folder = os.environ.get("JAXVIS_DATA")
    if folder is None or not (Path(folder) / "models/teapot.obj").is_file():
        pytest.skip("JAXVIS_DATA names no folder with models/teapot.obj")
    other = trimesh.load(Path(folder) / "models/teapot.obj", force="mesh")
    ours = teapot_mesh(16).positions
    scale = np.ptp(ours[:, 2]) / np.ptp(other.vertices[:, 2])
    points = (other.vertices - other.bounds[0]) * scale + ours.min(axis=0)
    fine = cKDTree(teapot_mesh(48).positions)
    assert np.quantile(fine.query(points)[0], 0.9) < 0.05


def test_welding_makes_parts_meet_to_the_last_bit():
    pot = teapot_mesh(3)
    shaken = Mesh(pot.positions * (1.0 + 1e-12), pot.normals, pot.triangles)
    both = weld(join([pot, shaken]))
    assert len(both.positions) == len(pot.positions)
    assert np.array_equal(
        both.triangles[: len(pot.triangles)], both.triangles[len(pot.triangles) :]
    )
