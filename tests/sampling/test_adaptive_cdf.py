"""Compressed cumulative distributions: the curves, and what is drawn by them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.sampling import AdaptiveCdfs
from jaxvis.sampling.adaptive_cdf import compress, cumulative, slopes
from jaxvis.sphere import latlong

from .chi_square import SIGNIFICANCE, p_value
from .latlong_maps import fine_counts

COUNT = 100_000
SHAPE = (8, 16)
sample = jax.jit(AdaptiveCdfs.sample)
sample_cell = jax.jit(AdaptiveCdfs.sample_cell)
pdf = jax.jit(AdaptiveCdfs.pdf)


def tables():
    """Noise, a smooth lobe with a floor, one bright cell at each pole, black rows, nothing."""
    random = np.random.default_rng(3).random(SHAPE) ** 4
    lobe = np.maximum(latlong.texel_directions(*SHAPE) @ [0.6, 0.64, -0.48], 0.0) ** 4 + 0.02
    poles = np.full(SHAPE, 0.01)
    poles[0, 3] = poles[-1, 15] = 5.0
    rows = np.where(np.arange(8) % 3, 1.0, 0.0)[:, None] * np.ones(16)
    return np.stack([random, lobe, poles, rows, np.zeros(SHAPE)])


def exact(tables):
    """The probability of each cell before anything is compressed."""
    tables = np.where(tables.any(axis=(1, 2), keepdims=True), tables, 1.0)
    weights = tables * latlong.row_solid_angles(*SHAPE)[:, None]
    return weights / weights.sum(axis=(1, 2), keepdims=True)


def probabilities(cdfs):
    """Those of :meth:`AdaptiveCdfs.pdf`."""
    angles = latlong.row_solid_angles(*SHAPE)[:, None]
    return np.asarray(cdfs.density, np.float64) * angles


def recursive(x, y, tolerance):
    """Douglas and Peucker's algorithm as they wrote it."""
    apart = np.abs(y - np.interp(x, x[[0, -1]], y[[0, -1]]))
    worst = int(np.argmax(apart))
    if apart[worst] <= tolerance:
        return [x[0], x[-1]]
    return recursive(x[: worst + 1], y[: worst + 1], tolerance)[:-1] + recursive(
        x[worst:], y[worst:], tolerance
    )


@pytest.mark.parametrize("tolerance", [0.0, 0.002, 0.02, 0.3])
def test_what_is_kept_is_near_everywhere_and_what_the_slow_way_keeps(tolerance):
    x = np.cumsum(np.random.default_rng(0).random(33))
    y = cumulative(np.random.default_rng(1).random((6, 32)) ** 3)
    kept = compress(x, y, tolerance)
    assert kept[:, 0].all()
    assert kept[:, -1].all()
    for curve, mask in zip(y, kept, strict=True):
        assert np.abs(np.interp(x, x[mask], curve[mask]) - curve).max() <= tolerance + 1e-15
        np.testing.assert_array_equal(x[mask], recursive(x, curve, tolerance))
    if tolerance == 0.0:
        assert kept.all()
    if tolerance == 0.3:
        assert kept.mean() < 0.2


def test_a_straight_line_keeps_its_ends_alone():
    x = np.linspace(0.0, 1.0, 17)
    kept = compress(x, x[None], 1e-12)
    assert kept.sum() == 2
    corner = np.minimum(2.0 * x, 1.0)[None]
    np.testing.assert_array_equal(np.flatnonzero(compress(x, corner, 1e-6)), [0, 8, 16])
    np.testing.assert_allclose(
        slopes(x, corner, compress(x, corner, 1e-6)), [[2.0] * 8 + [0.0] * 8]
    )


@pytest.mark.parametrize("tolerance", [0.0, 0.002, 0.05])
def test_directions_follow_the_compressed_distribution(tolerance):
    cdfs = AdaptiveCdfs.build(tables(), tolerance)
    pieces = 3
    for table in range(5):
        uniforms = jax.random.uniform(jax.random.key(table), (COUNT, 2))
        directions = sample(cdfs, jnp.full(COUNT, table), uniforms)
        np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0, atol=1e-6)
        expected = np.kron(probabilities(cdfs)[table], np.full((pieces, pieces), 1.0 / pieces**2))
        counts = fine_counts(directions, *SHAPE, pieces)
        assert counts[expected == 0.0].sum() <= 1e-5 * COUNT * expected.size
        counts[expected == 0.0] = 0.0
        assert p_value(counts, COUNT * expected) > SIGNIFICANCE
        uncompressed = fine_counts(directions, *SHAPE, 1)
        if tolerance == 0.05 and table < 2:  # the test would see the difference
            assert p_value(uncompressed, COUNT * exact(tables())[table]) < SIGNIFICANCE
        cells = sample_cell(cdfs, jnp.full(COUNT, table), uniforms)
        row, column = latlong.texel(directions, *SHAPE)
        assert np.mean(np.asarray(row * 16 + column) == np.asarray(cells)) > 0.9999


@pytest.mark.parametrize("tolerance", [0.0, 0.002, 0.05])
def test_densities_integrate_to_one_and_are_near_the_tables(tolerance):
    cdfs = AdaptiveCdfs.build(tables(), tolerance)
    np.testing.assert_allclose(probabilities(cdfs).sum(axis=(1, 2)), 1.0, atol=1e-6)
    # Heights and turns by the tolerance each; a cell is between four corners.
    assert np.abs(probabilities(cdfs) - exact(tables())).max() < 4.0 * tolerance + 1e-6
    centres = jnp.asarray(latlong.texel_directions(*SHAPE), jnp.float32)
    for table in range(5):
        found = pdf(cdfs, jnp.full(SHAPE, table), 3.0 * centres)
        np.testing.assert_array_equal(found, cdfs.density[table])


def test_positive_densities_stay_positive():
    faint = np.full(SHAPE, 1e-4)
    faint[3, 5] = 1.0
    for tolerance in (0.0, 0.01, 0.4):
        assert np.all(np.asarray(AdaptiveCdfs.build(faint[None], tolerance).density) > 0.0)


def test_a_larger_error_takes_fewer_knots_of_the_same_shape():
    few, many = (AdaptiveCdfs.build(tables(), tolerance) for tolerance in (0.05, 0.0))
    assert few.knots < 0.6 * many.knots
    assert [leaf.shape for leaf in jax.tree.leaves(few)] == [
        leaf.shape for leaf in jax.tree.leaves(many)
    ]


def test_several_tables_at_once_are_each_their_own():
    cdfs = AdaptiveCdfs.build(tables(), 0.002)
    uniforms = jax.random.uniform(jax.random.key(0), (4, 50, 2))
    each = jnp.arange(4)[:, None] * jnp.ones((1, 50), jnp.int32)
    together = sample(cdfs, each, uniforms)
    for table in range(4):
        alone = sample(cdfs, jnp.full(50, table), uniforms[table])
        np.testing.assert_array_equal(together[table], alone)


def test_extreme_uniforms_give_directions_of_positive_density():
    ends = jnp.array([0.0, 2.0**-24, 1.0 - 2.0**-24])
    grid = jnp.stack(jnp.meshgrid(ends, ends), axis=-1)
    cdfs = AdaptiveCdfs.build(tables(), 0.002)
    for table in range(5):
        where = jnp.full((3, 3), table)
        cells = np.asarray(sample_cell(cdfs, where, grid))
        assert np.all(np.asarray(cdfs.density)[table].reshape(-1)[cells] > 0.0)
        assert np.all(np.isfinite(sample(cdfs, where, grid)))


def test_wrong_input_is_named():
    with pytest.raises(ValueError, match="tables: must be finite and non-negative"):
        AdaptiveCdfs.build(-tables(), 0.01)
    with pytest.raises(ValueError, match="tolerance must be a number of at least 0, got -1"):
        AdaptiveCdfs.build(tables(), -1.0)
