"""Cones from needles to whole spheres: uniform, and nothing outside."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.sampling.cone import pdf_cone, sample_cone

from .chi_square import SIGNIFICANCE, p_value, zone_counts, zone_probabilities

COUNT = 100_000
sample = jax.jit(sample_cone)


@pytest.fixture(scope="module")
def uniforms():
    return jax.random.uniform(jax.random.key(13), (COUNT, 2))


def apart(directions):
    """1 - cos of the angle to +z, without its cancellation."""
    d = np.asarray(directions, np.float64)
    return 0.5 * (d[..., 0] ** 2 + d[..., 1] ** 2 + (d[..., 2] - 1.0) ** 2)


@pytest.mark.parametrize("versine", [0.1, 0.5, 1.0, 2.0])
def test_samples_follow_the_density(versine, uniforms):
    directions = sample(uniforms, versine)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0, atol=1e-6)
    # Zones of the cone, and the rest of the sphere, if there is any.
    edges = np.unique([-1.0, *np.linspace(1.0 - versine, 1.0, 11)])

    def density(width):
        return zone_probabilities(lambda d: pdf_cone(jnp.asarray(1.0 - d[..., 2]), width), edges, 8)

    counts = zone_counts(directions, edges, 8)
    assert abs(density(versine).sum() - 1.0) < 1e-3
    assert p_value(counts, COUNT * density(versine)) > SIGNIFICANCE
    # A density that leans to the axis by a few per cent is told apart.
    lean = density(versine) * (1.0 + 0.05 * np.linspace(-1.0, 1.0, len(edges) - 1))[:, None]
    assert p_value(counts, COUNT * lean / lean.sum()) < SIGNIFICANCE


@pytest.mark.parametrize("versine", [1e-12, 1e-6, 1e-3])
def test_needles_keep_their_shape(versine, uniforms):
    """Binned by the sine: its square is (1 - cos)(1 + cos), uniform but for the second factor."""
    directions = np.asarray(sample(uniforms, versine), np.float64)
    share = (directions[:, 0] ** 2 + directions[:, 1] ** 2) / (versine * (2.0 - versine))
    counts = np.histogram(share, bins=np.linspace(0.0, 1.0 + 1e-5, 21))[0]
    assert p_value(counts, np.full(20, COUNT / 20)) > SIGNIFICANCE


@pytest.mark.parametrize("versine", [1e-6, 0.3, 1.0, 2.0])
def test_every_sample_has_the_one_density(versine):
    ends = jnp.array([0.0, 2.0**-24, 0.5, 1.0 - 2.0**-24])
    directions = sample(jnp.stack(jnp.meshgrid(ends, ends), axis=-1), versine)
    assert np.all(np.isfinite(directions))
    within = jnp.asarray(apart(directions) * (1.0 - 1e-6), jnp.float32)
    np.testing.assert_allclose(pdf_cone(within, versine), 1.0 / (2.0 * np.pi * versine), rtol=1e-6)
    assert pdf_cone(jnp.float32(1.01 * versine), versine) == 0.0


def test_cones_broadcast_against_points(uniforms):
    widths = jnp.array([0.1, 1.0])
    both = sample(uniforms[:5, None], widths)
    assert both.shape == (5, 2, 3)
    np.testing.assert_allclose(both[:, 1], sample(uniforms[:5], 1.0), atol=1e-7)
    np.testing.assert_allclose(apart(both[:, 0]), 0.1 * uniforms[:5, 0], rtol=1e-5, atol=1e-9)
