"""Cosine and uniform directions follow their densities."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.sampling import hemisphere

from .chi_square import SIGNIFICANCE, p_value, zone_counts, zone_probabilities

COUNT = 200_000
PAIRS = {
    "cosine": (jax.jit(hemisphere.sample_cosine), hemisphere.pdf_cosine),
    "uniform": (jax.jit(hemisphere.sample_uniform), hemisphere.pdf_uniform),
}
EDGES = np.linspace(0.0, 1.0, 11)


@pytest.fixture(scope="module")
def uniforms():
    return jax.random.uniform(jax.random.key(11), (COUNT, 2))


@pytest.mark.parametrize("name", PAIRS)
def test_samples_follow_the_density(name, uniforms):
    sample, pdf = PAIRS[name]
    directions = sample(uniforms)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0, atol=1e-6)
    probabilities = zone_probabilities(lambda d: pdf(jnp.asarray(d[..., 2])), EDGES, 12)
    assert abs(probabilities.sum() - 1.0) < 1e-6
    assert p_value(zone_counts(directions, EDGES, 12), COUNT * probabilities) > SIGNIFICANCE


def test_each_sampler_fails_the_test_of_the_other_density(uniforms):
    for name, other in (("cosine", "uniform"), ("uniform", "cosine")):
        sample, pdf = PAIRS[name][0], PAIRS[other][1]
        wrong = zone_probabilities(lambda d, pdf=pdf: pdf(jnp.asarray(d[..., 2])), EDGES, 12)
        assert p_value(zone_counts(sample(uniforms), EDGES, 12), COUNT * wrong) < SIGNIFICANCE


@pytest.mark.parametrize("name", PAIRS)
def test_extreme_uniforms_stay_above_the_horizon(name):
    sample, pdf = PAIRS[name]
    ends = jnp.array([0.0, 2.0**-24, 1.0 - 2.0**-24])
    grid = jnp.stack(jnp.meshgrid(ends, ends), axis=-1)
    directions = sample(grid)
    assert np.all(np.asarray(directions[..., 2]) > 0.0)
    assert np.all(np.asarray(pdf(directions[..., 2])) > 0.0)
    np.testing.assert_allclose(sample(jnp.zeros(2)), [0.0, 0.0, 1.0], atol=1e-7)


def test_nothing_comes_from_below():
    below = jnp.array([-1.0, -0.1])
    np.testing.assert_array_equal(hemisphere.pdf_cosine(below), 0.0)
    np.testing.assert_array_equal(hemisphere.pdf_uniform(below), 0.0)


def test_adding_to_the_second_uniform_turns_about_the_normal(uniforms):
    sample = PAIRS["cosine"][0]
    turned, straight = sample(uniforms + jnp.array([0.0, 0.25])), sample(uniforms)
    expected = jnp.stack([-straight[:, 1], straight[:, 0], straight[:, 2]], axis=-1)
    np.testing.assert_allclose(turned, expected, atol=1e-6)
