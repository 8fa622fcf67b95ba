"""Areas, places, normals and colours of what lies in voxels, and that nothing is lost."""

import numpy as np
import pytest

from jaxvis.methods.cones import voxelize as module
from jaxvis.methods.cones.volume import Grid
from jaxvis.methods.cones.voxelize import projected_areas, voxelize
from tests.methods.cones.made_scenes import ball, box, flat_ground, heights, paint, scene


def grid_of(made, resolution):
    points = made.positions.astype(np.float64)
    return Grid.around(points.min(axis=0), points.max(axis=0), resolution)


def patches_of(made, resolution):
    grid = grid_of(made, resolution)
    return voxelize(made, np.ones(len(made.triangles), bool), grid), grid


def triangle_areas(made):
    a, b, c = np.moveaxis(made.positions[made.triangles].astype(np.float64), 1, 0)
    return 0.5 * np.cross(b - a, c - a)


BOX = scene(box((0, 0, 0), (1.0, 0.7, 0.43)))
BALL = scene(ball(rows=24))


def test_a_box_shows_each_way_the_areas_of_its_faces():
    patches, grid = patches_of(BOX, 16)
    fronts, backs = projected_areas(patches)
    faces = np.repeat([0.7 * 0.43, 0.43 * 1.0, 1.0 * 0.7], 2)
    square = float(grid.voxel) ** 2
    np.testing.assert_allclose(fronts.sum(axis=0, dtype=float) * square, faces, rtol=1e-5)
    np.testing.assert_allclose(backs.sum(axis=0, dtype=float) * square, faces, rtol=1e-5)
    # Seen towards +x, a box shows the face at its lowest x.
    low = patches.position[fronts[:, 0] > 0.0]
    np.testing.assert_allclose(low[:, 0], BOX.positions[:, 0].min(), atol=1e-5)


@pytest.mark.parametrize("resolution", [4, 16, 64])
def test_areas_centroids_and_directions_are_the_meshs(resolution):
    patches, grid = patches_of(BALL, resolution)
    areas = triangle_areas(BALL)
    sizes = np.linalg.norm(areas, axis=-1)
    area = patches.area.astype(np.float64) * float(grid.voxel) ** 2
    np.testing.assert_allclose(area.sum(), sizes.sum(), rtol=1e-5)
    centroids = BALL.positions[BALL.triangles].astype(np.float64).mean(axis=1)
    np.testing.assert_allclose(area @ patches.position, sizes @ centroids, atol=2e-5)
    # One normal for all that a voxel has on one side: longer shadows, by its bend.
    projected = projected_areas(patches)[0].sum(axis=0, dtype=float) * float(grid.voxel) ** 2
    exact = np.maximum(areas, 0.0).sum(axis=0)[[0, 0, 1, 1, 2, 2]]
    bend = {4: 0.2, 16: 0.02, 64: 0.002}[resolution]
    assert (projected > exact * (1 - 1e-3)).all()
    np.testing.assert_allclose(projected, exact, rtol=bend)


def test_patches_lie_in_their_voxels_and_face_out():
    patches, grid = patches_of(BALL, 16)
    cell = np.stack(np.unravel_index(patches.voxel, (16,) * 3), axis=-1)
    place = (patches.position - grid.low) / float(grid.voxel) - cell
    assert (place > -1e-3).all()
    assert (place < 1 + 1e-3).all()
    np.testing.assert_allclose(np.linalg.norm(patches.normal, axis=-1), 1.0, atol=1e-5)
    outward = patches.position / np.linalg.norm(patches.position, axis=-1, keepdims=True)
    assert (np.sum(outward * patches.normal, axis=-1) > 0.97).all()


def test_one_triangle_across_many_voxels_leaves_no_holes():
    """Two triangles, 62 voxels wide, fill every voxel inside with an area of 1."""
    made = scene(flat_ground(1.0, cells=1))
    patches, _ = patches_of(made, 64)
    cell = np.stack(np.unravel_index(patches.voxel, (64,) * 3), axis=-1)
    inside = (cell[:, [0, 2]] >= 2).all(axis=1) & (cell[:, [0, 2]] <= 61).all(axis=1)
    assert len(np.unique(cell[:, 1])) == 1
    assert inside.sum() == 60 * 60
    assert abs(patches.area[inside].mean() - 1.0) < 1e-3
    # Parts count where their centres lie: an eighth of a voxel's area, or so, either way.
    assert np.abs(patches.area[inside] - 1.0).max() < 0.4
    np.testing.assert_allclose(patches.normal, [[0.0, 1.0, 0.0]] * len(cell), atol=1e-6)


def test_colours_are_averaged_by_area():
    line = np.linspace(0.0, 1.0, 2)
    made = scene(
        heights(lambda x, z: 0.0 * x, line, line),
        heights(lambda x, z: 0.0 * x, 1.0 + 3.0 * line, line),
        materials=(paint(1.0, 0.0, 0.5), paint(0.2, 0.6, 0.0)),
        kinds=(0, 1),
    )
    everything = np.ones(len(made.triangles), bool)
    whole = voxelize(
        made, everything, Grid(np.float32([-5, -5, -5]), np.array(10.0, np.float32), 1)
    )
    assert len(whole.area) == 1
    np.testing.assert_allclose(whole.area, [0.04], rtol=1e-5)
    np.testing.assert_allclose(whole.albedo, [[0.4, 0.45, 0.125]], rtol=1e-5)
    apart, _ = patches_of(made, 64)
    assert (np.abs(apart.albedo - [1.0, 0.0, 0.5]).max(axis=1) < 1e-5).any()
    assert (np.abs(apart.albedo - [0.2, 0.6, 0.0]).max(axis=1) < 1e-5).any()


def test_only_chosen_triangles_count_and_sides_are_those_of_their_material():
    made = scene(
        flat_ground(1.0),
        flat_ground(1.0, y=0.5),
        materials=(paint(), paint(two_sided=True)),
        kinds=(0, 1),
    )
    grid = grid_of(made, 16)
    sheet = made.material_ids == 1
    both = voxelize(made, np.ones(len(sheet), bool), grid)
    upper = both.position[:, 1] > 0.0
    np.testing.assert_array_equal(both.two_sided, upper)
    alone = voxelize(made, sheet, grid)
    assert alone.two_sided.all()
    np.testing.assert_allclose(alone.area, both.area[upper])
    assert len(voxelize(made, np.zeros(len(sheet), bool), grid).area) == 0


def test_fronts_and_backs_of_one_voxel_stay_apart():
    """The two faces of a slab thinner than a voxel do not cancel."""
    made = scene(box((0, 0, 0), (1.0, 0.001, 1.0)))
    patches, grid = patches_of(made, 8)
    fronts, _ = projected_areas(patches)
    square = float(grid.voxel) ** 2
    np.testing.assert_allclose(fronts[:, [2, 3]].sum(axis=0) * square, [1.0, 1.0], rtol=1e-4)


def test_neither_blocks_nor_threads_change_the_result(monkeypatch):
    before, _ = patches_of(BALL, 32)
    monkeypatch.setattr(module, "AT_ONCE", 1000)
    blocks, _ = patches_of(BALL, 32)
    for name, one, other in zip(before._fields, before, blocks, strict=True):
        if name in ("voxel", "two_sided"):
            np.testing.assert_array_equal(one, other)
        else:
            np.testing.assert_allclose(one, other, atol=1e-6, err_msg=name)
    monkeypatch.undo()
    monkeypatch.setattr(module, "core_count", lambda: 1)
    alone, _ = patches_of(BALL, 32)
    for one, other in zip(before, alone, strict=True):
        np.testing.assert_array_equal(one, other)
