"""Drawings: what they show is what is stored."""

import itertools

import numpy as np
import pytest

import jaxvis
from experiments.drawings import Settings, draw_levels, levels, pixels_of, run, tiled
from experiments.output import Output
from jaxvis.compare.setting import prepare
from jaxvis.methods.distance_field.build import Vertices
from jaxvis.methods.distance_field.maps import adaptive_maps


def test_tiles_hold_every_cell_of_the_layer_and_nothing_else():
    scene = jaxvis.load_scene("box-on-plane")
    field = jaxvis.VisibilityField(samples=2000, cell=1.0).precompute(scene, progress=False)
    columns, heights, rows = np.unravel_index(field.keys, field.grid.shape)
    side = field.texels().shape[1]
    height = int(np.bincount(heights).argmax())
    drawn = tiled(field, height)
    for row in range(field.grid.shape[2]):
        for column in range(field.grid.shape[0]):
            tile = drawn[row * side : (row + 1) * side, column * side : (column + 1) * side]
            (found,) = np.nonzero((columns == column) & (heights == height) & (rows == row))
            assert (len(found) == 0) == bool((tile == -1).all())
            if len(found):
                np.testing.assert_array_equal(tile[::-1].T, field.texels()[found[0]])


def test_levels_are_those_of_the_maps():
    scene = jaxvis.load_scene("sphere-on-plane")
    vertices = Vertices.of(scene)
    distance = np.linalg.norm(vertices.samples.positions[:, [0, 2]], axis=1)
    vertex = int(np.argmin(np.abs(distance - 1.5) + np.abs(vertices.samples.positions[:, 1])))
    found = levels(vertices, vertex, 64)
    assert [len(level.seen) for level in found] == [16, 32, 64]
    assert found[0].traced.all()
    assert 0.0 < found[-1].traced.mean() < 1.0
    whole = adaptive_maps(scene.tracer, vertices.views(np.asarray([vertex])), 64)
    np.testing.assert_array_equal(found[-1].seen, whole.maps[0])
    assert sum(np.count_nonzero(level.traced) for level in found) == whole.rays
    for coarse, fine in itertools.pairwise(found):
        inherited = coarse.seen.repeat(2, 0).repeat(2, 1)
        np.testing.assert_array_equal(fine.seen[~fine.traced], inherited[~fine.traced])
    draw_levels(found, np.zeros((64, 64), np.float32), "levels")


def test_samples_are_drawn_where_the_picture_shows_them():
    scene = jaxvis.load_scene("sphere-on-plane")
    stage = prepare(scene, jaxvis.load_environment("uniform"), (48, 36))
    position = np.asarray(stage.surface.position).reshape(36, 48, 3)
    row, column = (int(k[len(k) // 2]) for k in np.nonzero(stage.covered))
    far = position[row, column] + 1e3
    at = pixels_of(stage, np.stack([position[row, column], far]))
    np.testing.assert_array_equal(at, [[column, row]])


def test_a_height_outside_the_scene_is_one_line():
    with pytest.raises(ValueError, match="--height must be from 0 to 1"):
        run(Settings(height=1.5), Output())
