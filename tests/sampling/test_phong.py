"""Phong lobes from flat to needle-sharp."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.sampling import phong

from .chi_square import SIGNIFICANCE, p_value, zone_counts, zone_probabilities

COUNT = 100_000
sample_lobe = jax.jit(phong.sample_lobe)


@pytest.fixture(scope="module")
def uniforms():
    return jax.random.uniform(jax.random.key(12), (COUNT, 2))


def quantiles(exponent, zones=12):
    return np.linspace(0.0, 1.0, zones + 1) ** (1.0 / (exponent + 1.0))


@pytest.mark.parametrize("exponent", [0.0, 1.0, 20.0, 300.0])
def test_samples_follow_the_density(exponent, uniforms):
    directions = sample_lobe(uniforms, exponent)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0, atol=1e-6)
    edges = quantiles(exponent)
    probabilities = zone_probabilities(
        lambda d: phong.pdf_lobe(jnp.asarray(d[..., 2]), exponent), edges, 8
    )
    assert abs(probabilities.sum() - 1.0) < 1e-3
    assert p_value(zone_counts(directions, edges, 8), COUNT * probabilities) > SIGNIFICANCE
    wrong = zone_probabilities(
        lambda d: phong.pdf_lobe(jnp.asarray(d[..., 2]), 1.1 * exponent + 0.1), edges, 8
    )
    assert p_value(zone_counts(directions, edges, 8), COUNT * wrong) < SIGNIFICANCE


@pytest.mark.parametrize("exponent", [20_000.0, 2e6])
def test_needle_lobes_keep_their_shape(exponent, uniforms):
    """Binned by the sine, which float32 resolves near the axis: sin^2 = 1 - (1 - u)^(2/(a+1))."""
    directions = np.asarray(sample_lobe(uniforms, exponent), np.float64)
    edges = -np.expm1(2.0 * np.log1p(-np.linspace(0.0, 0.95, 20)) / (exponent + 1.0))
    sine_square = directions[:, 0] ** 2 + directions[:, 1] ** 2
    counts = np.histogram(sine_square, bins=[*edges, 1.0])[0]
    assert p_value(counts, np.full(20, COUNT / 20)) > SIGNIFICANCE


def test_the_density_at_the_axis_and_below():
    cosine = jnp.array([1.0, 0.0, -0.5])
    np.testing.assert_allclose(
        phong.pdf_lobe(cosine, 9.0), [10.0 / (2.0 * np.pi), 0.0, 0.0], rtol=1e-6
    )


def test_gradients_are_finite_and_right():
    slope = jax.grad(lambda c, a: phong.pdf_lobe(c, a), argnums=(0, 1))
    for cosine in (-1.0, 0.0, 1e-30, 0.5, 1.0):
        assert np.all(np.isfinite(slope(jnp.float32(cosine), jnp.float32(30.0))))
    in_cosine, in_exponent = slope(jnp.float32(0.9), jnp.float32(5.0))
    value = 6.0 / (2.0 * np.pi) * 0.9**5
    np.testing.assert_allclose(in_cosine, value * 5.0 / 0.9, rtol=1e-5)
    np.testing.assert_allclose(in_exponent, value * (np.log(0.9) + 1.0 / 6.0), rtol=1e-5)
