"""Cells by hand, words and back, files."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.cache import save_arrays
from jaxvis.methods.traced import RayVisibility
from jaxvis.methods.visibility_field.field import FieldVisibility, packed, unpacked
from jaxvis.methods.visibility_field.grid import Grid, cell_of
from jaxvis.methods.visibility_field.lookup import BUCKET_BITS, Lookup, row_of
from jaxvis.scene.builtin import builtin_scene

SCENE = builtin_scene("sphere-on-plane", rows=6, cells=2)


def some_field(size=5, count=9, seed=0):
    grid = Grid.covering(SCENE.positions, 2.0)
    rng = np.random.default_rng(seed)
    keys = np.sort(rng.choice(grid.cells, count, replace=False)).astype(np.int32)
    texels = rng.integers(0, 4, (count, size, size)).astype(np.uint8)
    visible, occluded = (((texels & bit) > 0).sum(axis=(1, 2)).astype(np.int32) for bit in (1, 2))
    rays = RayVisibility.of(SCENE)
    return FieldVisibility(grid, keys, packed(texels), visible, occluded, rays, size), texels


@pytest.mark.parametrize("edge", [0.3, 1.0, 7.0, 100.0])
def test_the_grid_covers_the_scene_with_room_around(edge):
    grid = Grid.covering(SCENE.positions, edge)
    low, high = SCENE.positions.min(axis=0), SCENE.positions.max(axis=0)
    end = grid.origin + np.array(grid.shape) * grid.edge
    assert np.all(low - grid.origin >= 0.6 * edge)
    assert np.all(end - high >= 0.3 * edge)
    assert np.all(end - high <= 2.4 * edge)
    assert grid.cells == np.prod(grid.shape)
    assert cell_of(grid, SCENE.positions).min() >= 0


def test_points_on_round_coordinates_do_not_lie_in_faces_of_cells():
    scene = builtin_scene("plane")
    grid = Grid.covering(scene.positions, 1.0)
    place = (scene.positions - grid.origin) / grid.edge
    assert np.abs(place - np.rint(place)).min() > 0.1


def test_cells_by_hand_in_numpy_and_jitted():
    grid = Grid(np.array([-1.0, 0.0, 2.0], np.float32), np.array(0.5, np.float32), (4, 3, 2))
    points = np.array(
        [[-0.9, 0.1, 2.1], [0.9, 1.4, 2.9], [-0.4, 0.6, 2.6], [-1.1, 0.1, 2.1], [1.1, 0.1, 2.1],
         [0.0, 1.6, 2.1], [0.0, 0.1, 3.1], [0.0, -0.1, 2.1]], np.float32
    )  # fmt: skip
    expected = [0, 4 * 3 * 2 - 1, (1 * 3 + 1) * 2 + 1, -1, -1, -1, -1, -1]
    assert cell_of(grid, points).tolist() == expected
    assert cell_of(grid, jnp.asarray(points)).tolist() == expected


@pytest.mark.parametrize("edge", [0.0, -1.0, np.nan, np.inf])
def test_cells_must_have_a_size(edge):
    with pytest.raises(ValueError, match="must be a positive length"):
        Grid.covering(SCENE.positions, edge)


def test_cells_must_be_countable():
    with pytest.raises(ValueError, match="more than can be numbered"):
        Grid.covering(SCENE.positions, 1e-4)


@pytest.mark.parametrize("size", [1, 5, 18, 33])
def test_words_hold_two_bits_a_texel(size):
    texels = np.random.default_rng(size).integers(0, 4, (7, size, size)).astype(np.uint8)
    words = packed(texels)
    assert words.dtype == np.uint32
    assert words.shape == (7, -(-size * size // 16))
    np.testing.assert_array_equal(unpacked(words, size), texels)
    for texel in (0, size * size // 2, size * size - 1):
        bits = (words[:, texel // 16] >> np.uint32(2 * (texel % 16))) & 3
        np.testing.assert_array_equal(bits, texels.reshape(7, -1)[:, texel])


def test_rows_of_cells():
    field, _ = some_field()
    cells = jnp.arange(-1, field.grid.cells)
    expected = np.full(len(cells), -1)
    expected[field.keys + 1] = np.arange(len(field.keys))
    np.testing.assert_array_equal(row_of(Lookup.of(field.keys, field.grid.cells), cells), expected)


def test_a_field_survives_the_disk(tmp_path):
    field, texels = some_field()
    field.save(tmp_path / "field.npz")
    loaded = FieldVisibility.load(tmp_path / "field.npz")
    assert (loaded.size, loaded.grid.shape) == (field.size, field.grid.shape)
    for name in ("keys", "words", "visible", "occluded"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(field, name))
    np.testing.assert_array_equal(loaded.grid.origin, field.grid.origin)
    assert loaded.grid.edge == field.grid.edge
    np.testing.assert_array_equal(loaded.texels(), texels)
    up = np.array([[0, 1, 0]], np.float32)
    assert loaded.tracer.occluded(-5.0 * up, up).tolist() == [True]
    assert loaded.nbytes == field.nbytes
    assert [entry.name for entry in tmp_path.iterdir()] == ["field.npz"]


def test_other_files_are_refused(tmp_path):
    path = tmp_path / "other.npz"
    with pytest.raises(FileNotFoundError):
        FieldVisibility.load(path)
    save_arrays(path, "something", {"keys": np.zeros(3)})
    with pytest.raises(ValueError, match="holds 'something'"):
        FieldVisibility.load(path)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(ValueError, match="damaged"):
        FieldVisibility.load(path)


def test_bytes_are_those_of_the_arrays():
    field, _ = some_field(size=18)
    count = len(field.keys)
    assert field.nbytes == count * (4 + 4 * 21 + 4 + 4) + 16
    assert field.dense_bytes == field.grid.cells * 400


@pytest.mark.parametrize("cells", [1, 7, 2**BUCKET_BITS, 2**BUCKET_BITS + 1, 40 * 2**BUCKET_BITS])
def test_rows_are_found_in_grids_of_every_size(cells):
    rng = np.random.default_rng(cells)
    keys = np.unique(rng.integers(0, cells, min(cells, 5000))).astype(np.int32)
    asked = np.concatenate([keys, rng.integers(0, cells, 5000), [0, cells - 1, -1]])
    asked = asked.astype(np.int32)
    place = np.minimum(np.searchsorted(keys, asked), len(keys) - 1)
    expected = np.where(keys[place] == asked, place, -1)
    found = row_of(Lookup.of(keys, cells), jnp.asarray(asked))
    np.testing.assert_array_equal(found, expected)
