"""Weights add up to one, and so estimates are unbiased."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.sampling import mis

HEURISTICS = [mis.balance, mis.power]


@pytest.mark.parametrize("weight", HEURISTICS)
def test_weights_of_both_strategies_add_up_to_one(weight):
    rng = np.random.default_rng(0)
    p, q = (jnp.asarray(10.0 ** rng.uniform(-18, 18, 500), jnp.float32) for _ in range(2))
    for n, m in ((1, 1), (3, 7), (0.5, 0.5)):
        np.testing.assert_allclose(weight(n, p, m, q) + weight(m, q, n, p), 1.0, rtol=1e-6)


def test_the_formulas():
    p, q = jnp.array([2.0]), jnp.array([0.5])
    np.testing.assert_allclose(mis.balance(1, p, 4, q), 0.5)
    np.testing.assert_allclose(mis.balance(1, p, 1, q), 0.8)
    np.testing.assert_allclose(mis.power(1, p, 1, q), 16.0 / 17.0, rtol=1e-6)
    np.testing.assert_allclose(mis.power(1, p, 4, q), 0.5)


@pytest.mark.parametrize("weight", HEURISTICS)
def test_impossible_samples_weigh_nothing_and_nothing_is_nan(weight):
    zero, one, huge = jnp.zeros(1), jnp.ones(1), jnp.full(1, 3e38)
    np.testing.assert_array_equal(weight(1, zero, 1, zero), 0.0)
    np.testing.assert_array_equal(weight(1, zero, 1, one), 0.0)
    np.testing.assert_array_equal(weight(1, one, 1, zero), 1.0)
    np.testing.assert_array_equal(mis.power(1, huge, 1, one), 1.0)
    slope = jax.grad(lambda p, q: weight(1, p, 1, q), argnums=(0, 1))
    for p in (0.0, 1.0):
        for q in (0.0, 1.0):
            assert np.all(np.isfinite(slope(jnp.float32(p), jnp.float32(q))))


@pytest.mark.parametrize("weight", HEURISTICS)
def test_combined_estimates_are_unbiased(weight):
    """The integral of x^2 over [0, 1] from 3 samples of density 1 and 1 of density 2x."""
    n = 100_000
    u, v = jax.random.uniform(jax.random.key(0), (2, n))
    v = jnp.sqrt(v)

    def contribution(x, mine, n_mine, other, n_other):
        return x * x / mine * weight(n_mine, mine, n_other, other)

    first = contribution(u, jnp.ones(n), 3, 2.0 * u, 1)
    second = contribution(v, 2.0 * v, 1, jnp.ones(n), 3)
    estimates = np.stack([first, second])
    error = np.sqrt(np.sum(estimates.var(axis=1)) / n)
    assert abs(estimates.mean(axis=1).sum() - 1.0 / 3.0) < 4.0 * error
    assert error < 1e-3
