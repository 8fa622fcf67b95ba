"""Masks against brute force on the sphere, and the paper's bytes by hand."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.methods.traced import RayVisibility
from jaxvis.methods.visibility_field.field import OCCLUDED, VISIBLE, FieldVisibility, packed
from jaxvis.methods.visibility_field.grid import Grid
from jaxvis.methods.visibility_field.masks import (
    dense,
    dilated,
    half_dilated,
    halved,
    labels,
    merge,
    neighbour_rows,
    texel_of,
    with_neighbours,
)
from jaxvis.scene.builtin import builtin_scene
from jaxvis.sphere import octahedral
from tests.methods.visibility_field.mask_oracle import joined, touching

SIZES = [1, 2, 5, 18]


def random_bits(cells, size, seed=0, density=0.1):
    return np.random.default_rng(seed).random((cells, size * size)) < density


def random_directions(count, seed=0):
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return (vectors / np.linalg.norm(vectors, axis=1, keepdims=True)).astype(np.float32)


def array_texels(directions, size):
    i, j = octahedral.texel(jnp.asarray(directions), size)
    return np.asarray(i * size + j)


def compiled_texels(directions, size):
    return np.array([texel_of(x, y, z, size) for x, y, z in directions])


@pytest.mark.parametrize("size", [1, 5, 18, 33, 255])
def test_texels_are_those_of_array_code(size):
    directions = random_directions(20_000)
    place = (np.asarray(octahedral.encode(jnp.asarray(directions)), np.float64) + 1.0) * size / 2
    # Rounding may put a direction on a texel's border on either side of it.
    clear = np.all(np.abs(place - np.rint(place)) > 1e-4 * size / 18, axis=-1)
    assert clear.mean() > 0.9
    found, expected = compiled_texels(directions, size), array_texels(directions, size)
    np.testing.assert_array_equal(found[clear], expected[clear])
    assert found.min() >= 0
    assert found.max() < size * size


@pytest.mark.parametrize("size", [1, 5, 18, 33])
def test_texels_of_directions_along_axes_and_edges(size):
    steps = np.array([-1.0, 0.0, 1.0], np.float32)
    directions = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
    directions = directions[np.count_nonzero(directions, axis=1) > 0]
    axes = np.count_nonzero(directions, axis=1) == 1
    found, expected = compiled_texels(directions, size), array_texels(directions, size)
    np.testing.assert_array_equal(found[axes], expected[axes])
    # Between axes the coordinates may be rounded on a border: at most one texel apart.
    apart = np.abs(np.stack([found // size - expected // size, found % size - expected % size]))
    assert apart.max() <= 1


def test_merging_enters_each_answer_once():
    rng = np.random.default_rng(0)
    size, samples, rays = 5, 40, 8
    directions = random_directions(samples * rays)
    blocked = rng.random(samples * rays) < 0.5
    rows = rng.integers(0, 6, samples).astype(np.int32)
    seen = np.zeros((7, 2, size * size), np.uint8)
    merge(seen, rows, directions, blocked, size)
    expected = np.zeros_like(seen)
    for ray, (direction, is_blocked) in enumerate(zip(directions, blocked, strict=True)):
        expected[rows[ray // rays], int(is_blocked), texel_of(*direction, size)] = 1
    np.testing.assert_array_equal(seen, expected)
    assert not seen[6].any()


@pytest.mark.parametrize("size", SIZES)
def test_dilation_reaches_the_texels_that_share_a_corner_on_the_sphere(size):
    one_each = np.eye(size * size, dtype=bool)
    np.testing.assert_array_equal(dilated(one_each, size, 1), touching(size))


def test_corners_and_borders_have_their_neighbours_across():
    size = 18
    grown = dilated(np.eye(size * size, dtype=bool), size, 1).reshape(-1, size, size)
    corner, edge, inner = grown[0], grown[4], grown[5 * size + 7]
    ends = np.ix_([0, -1], [0, -1])
    assert corner[ends].all()  # all four meet at -z
    assert corner[0, 1]
    assert corner[1, :2].all()
    assert corner[[0, 16], [16, 0]].all()
    assert corner.sum() == 9
    assert edge.sum() == 9
    assert edge[0, [3, 4, 5, size - 4, size - 5, size - 6]].all()
    assert inner.sum() == 9


def test_dilation_without_the_border_misses_what_it_finds():
    """The control: texels that touch across the map's border are lost if it is not continued."""
    size = 18
    bits = np.eye(size * size, dtype=bool)
    padded = np.pad(bits.reshape(-1, size, size), ((0, 0), (1, 1), (1, 1)))
    windows = np.lib.stride_tricks.sliding_window_view(padded, (3, 3), axis=(1, 2))
    flat = windows.any(axis=(-2, -1)).reshape(-1, size * size)
    lost = dilated(bits, size, 1) & ~flat
    on_border = [k for k in range(size**2) if {0, size - 1} & {k // size, k % size}]
    assert set(np.flatnonzero(lost.any(axis=1))) <= set(on_border)
    # Three each, but two where the map folds in the middle of its edges; corners lose five.
    assert lost.sum() >= 2 * len(on_border)
    assert lost[0].sum() == 5
    assert lost[4].sum() == 3
    assert not np.any(flat & ~dilated(bits, size, 1))


@pytest.mark.parametrize("size", [1, 2, 5, 18])
def test_half_a_texel_reaches_what_lies_within_it(size):
    """A fine texel reaches its own coarse one and those of its four neighbours on the sphere."""
    fine = 2 * size
    grown = half_dilated(np.eye(fine * fine, dtype=bool), size)
    i, j = octahedral.pad_indices(fine)
    for place in range(fine * fine):
        row, column = place // fine + 1, place % fine + 1
        expected = np.zeros((size, size), bool)
        for down, across in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)):
            at = (row + down, column + across)
            expected[i[at] // 2, j[at] // 2] = True
        np.testing.assert_array_equal(grown[place], expected.reshape(-1))
    np.testing.assert_array_equal(
        halved(np.eye(fine * fine, dtype=bool), size) & ~grown, np.zeros_like(grown)
    )


@pytest.mark.parametrize("size", [2, 5, 18])
def test_half_a_texel_is_less_than_a_whole_one(size):
    bits = np.random.default_rng(size).random((20, 4 * size * size)) < 0.05
    coarse = halved(bits, size)
    half, full = half_dilated(bits, size), dilated(coarse, size, 1)
    assert np.all(coarse <= half)
    assert np.all(half <= full)
    assert half.sum() < full.sum()


@pytest.mark.parametrize("size", SIZES)
def test_dilation_repeats_and_keeps_bits_apart(size):
    bits = random_bits(20, size)
    np.testing.assert_array_equal(dilated(bits, size, 0), bits)
    twice = dilated(dilated(bits, size, 1), size, 1)
    np.testing.assert_array_equal(dilated(bits, size, 2), twice)
    other = random_bits(20, size, seed=1)
    both = dilated(bits.astype(np.uint8) + 2 * other.astype(np.uint8), size, 2)
    np.testing.assert_array_equal((both & 1) > 0, twice)
    np.testing.assert_array_equal((both & 2) > 0, dilated(other, size, 2))


def occupied(shape=(4, 5, 3), count=25, seed=0):
    grid = Grid(np.zeros(3, np.float32), np.array(1.0, np.float32), shape)
    keys = np.random.default_rng(seed).choice(grid.cells, count, replace=False)
    return grid, np.sort(keys).astype(np.int32)


def test_neighbours_share_a_face_and_do_not_wrap_around():
    grid, keys = occupied(shape=(2, 2, 3), count=12)
    rows = neighbour_rows(grid, keys)
    x, y, z = np.unravel_index(keys, grid.shape)
    assert rows[0].tolist() == [-1, 6, -1, 3, -1, 1]
    for row, beside in enumerate(rows):
        for other in beside[beside >= 0]:
            assert abs(x[row] - x[other]) + abs(y[row] - y[other]) + abs(z[row] - z[other]) == 1
    # The last cell of a row and the first of the next are apart, though their numbers are not.
    assert rows[2, 5] == -1
    assert rows[3, 4] == -1


@pytest.mark.parametrize("seed", [0, 1])
def test_joining_neighbours_is_brute_force_and_commutes_with_dilation(seed):
    size = 5
    grid, keys = occupied(seed=seed)
    bits = random_bits(len(keys), size, seed)
    expected = joined(grid, keys, bits)
    assert (expected & ~bits).any()
    np.testing.assert_array_equal(with_neighbours(grid, keys, bits), expected)
    np.testing.assert_array_equal(
        dilated(with_neighbours(grid, keys, bits), size, 1),
        with_neighbours(grid, keys, dilated(bits, size, 1)),
    )


def test_labels_by_hand():
    visible, occluded = np.array([10, 100, 162, 0]), np.array([163, 120, 162, 0])
    assert labels(visible, occluded, 18, "paper").tolist() == [True, False, False, False]
    assert labels(visible, occluded, 18, "balanced").tolist() == [True, True, False, False]
    assert labels(visible, occluded, 18, "visible").tolist() == [True] * 4
    in_jax = labels(jnp.asarray(visible), jnp.asarray(occluded), 18, "balanced")
    assert in_jax.tolist() == [True, True, False, False]
    with pytest.raises(ValueError, match="labels must be paper, balanced or visible, got 'four'"):
        labels(visible, occluded, 18, "four")


def small_field(grid, keys, texels):
    scene = builtin_scene("plane", cells=1)
    counts = [((texels & bit) > 0).sum(axis=(1, 2)).astype(np.int32) for bit in (VISIBLE, OCCLUDED)]
    size = texels.shape[1]
    return FieldVisibility(grid, keys, packed(texels), *counts, RayVisibility.of(scene), size)


def test_the_dense_layout_takes_the_papers_bytes_on_its_grid():
    grid = Grid(np.zeros(3, np.float32), np.array(50.0, np.float32), (77, 48, 34))
    keys = np.array([7, grid.cells - 1], np.int32)
    texels = np.zeros((2, 18, 18), np.uint8)
    texels[1] = OCCLUDED
    texels[0, 3, 4], texels[0, 0, 2] = VISIBLE, VISIBLE | OCCLUDED
    field = small_field(grid, keys, texels)
    layout = dense(field)
    assert layout.shape == (77, 48, 34, 20, 20)
    assert layout.nbytes == field.dense_bytes == 77 * 48 * 34 * 400
    assert layout.nbytes / 1024 == pytest.approx(49_088, abs=1)
    first, last = layout[0, 0, 7], layout[-1, -1, -1]
    assert first[4, 5] == 128
    assert first[1, 3] == 128 + 64
    assert first[0, 20 - 1 - 3] == 128 + 64  # the border continues mirrored
    assert np.count_nonzero(first) == 3
    assert np.all(last == 64 + 32)  # more than half is occluded
    assert np.count_nonzero(layout) == 3 + 400


def test_the_dense_layout_labels_whole_cells_and_pads_as_the_sphere_goes_on():
    grid, keys = occupied()
    texels = np.random.default_rng(2).integers(0, 4, (len(keys), 5, 5)).astype(np.uint8)
    field = small_field(grid, keys, texels)
    for rule in ("paper", "balanced", "visible"):
        layout = dense(field, rule).reshape(grid.cells, 7, 7)
        label = labels(np.asarray(field.visible), np.asarray(field.occluded), 5, rule)
        for row, key in enumerate(keys):
            assert np.all((layout[key] & 32) == 32 * label[row])
            padded = octahedral.pad(texels[row])
            np.testing.assert_array_equal((layout[key] & 128) > 0, (padded & VISIBLE) > 0)
            np.testing.assert_array_equal((layout[key] & 64) > 0, (padded & OCCLUDED) > 0)
        empty = np.setdiff1d(np.arange(grid.cells), keys)
        assert not layout[empty].any()
