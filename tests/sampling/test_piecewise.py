"""Directions by inversion: the density, the inverse, and stratification kept."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.sampling import LatLongDistribution, sequences
from jaxvis.sphere import latlong

from .chi_square import SIGNIFICANCE, p_value
from .latlong_maps import MAPS, fine_counts, fine_probabilities

COUNT = 100_000
sample = jax.jit(LatLongDistribution.sample)
inverse = jax.jit(LatLongDistribution.inverse)
pdf = jax.jit(LatLongDistribution.pdf)


@pytest.fixture(scope="module")
def uniforms():
    return jax.random.uniform(jax.random.key(41), (COUNT, 2))


@pytest.mark.parametrize("name", MAPS)
def test_directions_follow_the_map_within_its_texels(name, uniforms):
    values = MAPS[name]
    directions = sample(LatLongDistribution.build(values), uniforms)
    counts = fine_counts(directions, *values.shape, 4)
    probabilities = fine_probabilities(values, 4)
    assert counts[probabilities == 0.0].sum() <= 1e-5 * COUNT * values.size
    counts[probabilities == 0.0] = 0.0
    assert p_value(counts, COUNT * probabilities) > SIGNIFICANCE


@pytest.mark.parametrize("name", MAPS)
def test_the_density_is_exact(name):
    values = MAPS[name]
    height, width = values.shape
    exact = fine_probabilities(values, 1) / latlong.row_solid_angles(height, width)[:, None]
    centres = jnp.asarray(latlong.texel_directions(height, width), jnp.float32)
    np.testing.assert_allclose(pdf(LatLongDistribution.build(values), centres), exact, rtol=1e-6)


@pytest.mark.parametrize("name", ["random", "odd height", "poles", "seam", "one texel"])
def test_inverse_undoes_sample(name, uniforms):
    distribution = LatLongDistribution.build(MAPS[name])
    some = uniforms[:5000]
    there = sample(distribution, some)
    back = np.asarray(inverse(distribution, there))
    np.testing.assert_allclose(back[:, 1], some[:, 1], atol=3e-6)
    # A direction on an edge between rows may be found in the next, whose columns differ.
    assert np.mean(np.abs(back[:, 0] - np.asarray(some[:, 0])) < 3e-6) > 0.999
    again = sample(distribution, jnp.asarray(back))
    apart = np.linalg.norm(np.asarray(again) - np.asarray(there), axis=-1)
    assert np.mean(apart < 1e-3) > 0.999


def test_texel_centres_go_to_the_middle_of_their_intervals():
    distribution = LatLongDistribution.build(MAPS["random"])
    weights = fine_probabilities(MAPS["random"], 1)
    along = np.cumsum(weights, axis=1) / weights.sum(axis=1, keepdims=True)
    middle = along - 0.5 * weights / weights.sum(axis=1, keepdims=True)
    centres = jnp.asarray(latlong.texel_directions(6, 12), jnp.float32)
    np.testing.assert_allclose(inverse(distribution, centres)[..., 0], middle, atol=1e-6)


def test_low_discrepancy_points_stay_so():
    """Each texel gets its share of Hammersley's points to a few points; random ones do not."""
    values = MAPS["random"]
    distribution = LatLongDistribution.build(values)
    n = 4096
    expected = n * fine_probabilities(values, 1)
    counts = fine_counts(sample(distribution, sequences.hammersley(n)), 6, 12, 1)
    assert np.abs(counts - expected).max() < 6.0
    random = jax.random.uniform(jax.random.key(1), (n, 2))
    counts = fine_counts(sample(distribution, random), 6, 12, 1)
    assert np.abs(counts - expected).max() > 12.0


def test_extreme_uniforms_draw_texels_with_light():
    ends = jnp.array([0.0, 2.0**-24, 1.0 - 2.0**-24, 1.0])
    grid = jnp.stack(jnp.meshgrid(ends, ends), axis=-1)
    for values in MAPS.values():
        distribution = LatLongDistribution.build(values)
        inward = sample(distribution, jnp.clip(grid, 1e-7, 1.0 - 1e-7))
        np.testing.assert_allclose(sample(distribution, grid), inward, atol=0.02)
