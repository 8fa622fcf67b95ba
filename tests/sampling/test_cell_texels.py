"""Texels within cells: what is drawn, what its density is, and the cells that hold them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.sampling import AliasTable, CellTexels
from jaxvis.sphere import latlong

from .chi_square import SIGNIFICANCE, p_value
from .latlong_maps import MAPS, fine_counts, fine_probabilities

COUNT = 100_000
GRIDS = [(1, 1), (3, 6), (4, 5), (64, 128)]
"""One that divides most of the maps, one that divides none, one finer than all but one."""


@jax.jit
def drawn(texels, table, uniforms):
    """Texels and directions by cells from a table."""
    cell = table.sample(uniforms[0], uniforms[1])
    texel = texels.sample(cell, uniforms[2], uniforms[3])
    return texel, texels.inside(texel, uniforms[4], uniforms[5])


@jax.jit
def density(texels, table):
    """Per steradian, in every texel."""
    texel = jnp.arange(texels.share.shape[0])
    return jnp.take(table.pmf, texels.cell_of(texel)) * texels.pdf_within(texel)


@pytest.fixture(scope="module")
def uniforms():
    return jax.random.uniform(jax.random.key(5), (6, COUNT))


def factors(shape, seed=2):
    """What cells are multiplied with: some by nothing."""
    return np.maximum(np.random.default_rng(seed).random(shape) - 0.2, 0.0)


def cell_by_centre(shape, cells):
    """The cell (row, column) of each texel's centre, one at a time."""
    found = np.zeros((*shape, 2), int)
    for row in range(shape[0]):
        for column in range(shape[1]):
            found[row, column, 0] = int((row + 0.5) / shape[0] * cells[0])
            found[row, column, 1] = int((column + 0.5) / shape[1] * cells[1])
    return found


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("name", MAPS)
def test_cells_by_their_power_give_the_map(name, grid, uniforms):
    values = MAPS[name]
    texels = CellTexels.build(values, *grid)
    table = AliasTable.build(texels.power.reshape(-1))
    _, directions = drawn(texels, table, uniforms)
    counts = fine_counts(directions, *values.shape, 2)
    probabilities = fine_probabilities(values, 2)
    assert counts[probabilities == 0.0].sum() <= 1e-5 * COUNT * values.size
    counts[probabilities == 0.0] = 0.0
    assert p_value(counts, COUNT * probabilities) > SIGNIFICANCE


@pytest.mark.parametrize("grid", GRIDS[1:])
def test_cells_by_anything_give_the_product_and_its_density(grid, uniforms):
    values = MAPS["random"]
    texels = CellTexels.build(values, *grid)
    assert texels.shape == (min(grid[0], 6), min(grid[1], 12))
    factor = factors(texels.shape)
    table = AliasTable.build((texels.power * factor).reshape(-1))
    cell = cell_by_centre(values.shape, texels.shape)
    product = values * factor[cell[..., 0], cell[..., 1]]
    probabilities = fine_probabilities(product, 1)
    texel, directions = drawn(texels, table, uniforms)
    counts = np.bincount(texel, minlength=values.size).reshape(values.shape)
    assert p_value(counts, COUNT * probabilities) > SIGNIFICANCE
    assert p_value(counts, COUNT * fine_probabilities(values, 1)) < SIGNIFICANCE  # would show
    angles = latlong.row_solid_angles(*values.shape)[:, None]
    found = np.asarray(density(texels, table), np.float64).reshape(values.shape)
    np.testing.assert_allclose(found, probabilities / angles, rtol=1e-5)
    assert abs(np.sum(found * angles) - 1.0) < 1e-6
    row, column = latlong.texel(directions, *values.shape)
    assert np.mean(np.asarray(row * 12 + column) == np.asarray(texel)) > 0.9999


@pytest.mark.parametrize("grid", [*GRIDS, (5, 12), (6, 7)])
def test_a_texel_belongs_to_the_cell_of_its_centre(grid):
    texels = CellTexels.build(MAPS["random"], *grid)
    expected = cell_by_centre((6, 12), texels.shape) @ [texels.shape[1], 1]
    np.testing.assert_array_equal(texels.cell_of(jnp.arange(72)), expected.reshape(-1))
    power = np.bincount(expected.reshape(-1), fine_probabilities(MAPS["random"], 1).reshape(-1))
    np.testing.assert_allclose(texels.power.reshape(-1), power, rtol=1e-12)
    angles = latlong.row_solid_angles(*texels.shape)
    cells = jnp.arange(texels.cells)
    np.testing.assert_allclose(
        texels.angle_of(cells), np.repeat(angles, texels.shape[1]), rtol=1e-6
    )


def test_extreme_uniforms_stay_within_the_cell_and_draw_light():
    for name in ("poles", "black rows", "random"):
        values = MAPS[name]
        texels = CellTexels.build(values, 3, 5)
        lit = np.flatnonzero(texels.power.reshape(-1) > 0.0)
        ends = [0.0, 2.0**-24, 0.5, 1.0 - 2.0**-24]
        cell, u, v = (np.ravel(a) for a in np.meshgrid(lit, ends, ends, indexing="ij"))
        texel = texels.sample(jnp.asarray(cell), *(jnp.asarray(a, jnp.float32) for a in (u, v)))
        np.testing.assert_array_equal(texels.cell_of(texel), cell)
        assert np.all(values.reshape(-1)[np.asarray(texel)] > 0.0)


def test_wrong_input_is_named():
    with pytest.raises(ValueError, match="luminance"):
        CellTexels.build(-MAPS["random"], 2, 2)
    with pytest.raises(ValueError, match="rows and columns must be at least 1, got 0 and 2"):
        CellTexels.build(MAPS["random"], 0, 2)
