"""Alias tables hold exactly the weights they were built from, and draw accordingly."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxvis.sampling import AliasTable
from jaxvis.sampling.sequences import BELOW_ONE

from .chi_square import SIGNIFICANCE, p_value

COUNT = 100_000
sample = jax.jit(AliasTable.sample)
sample_remainder = jax.jit(AliasTable.sample_remainder)


def held(table, entries):
    """The probability of each entry that the cells amount to (float64)."""
    keep = np.asarray(table.probability, np.float64)
    cells = keep.size
    total = np.zeros(cells)
    total += keep
    np.add.at(total, np.asarray(table.alias), 1.0 - keep)
    assert not total[entries:].any()  # padding is never drawn
    return total[:entries] / cells


def vose(weights):
    """Vose's algorithm as published, with its two worklists: the slow oracle."""
    n = len(weights)
    scaled = [w * n / sum(weights) for w in weights]
    small = [i for i in range(n) if scaled[i] < 1.0]
    large = [i for i in range(n) if scaled[i] >= 1.0]
    probability, alias = [1.0] * n, list(range(n))
    while small and large:
        s, g = small.pop(), large.pop()
        probability[s], alias[s] = scaled[s], g
        scaled[g] -= 1.0 - scaled[s]
        (small if scaled[g] < 1.0 else large).append(g)
    total = [0.0] * n
    for i in range(n):
        total[i] += probability[i] / n
        total[alias[i]] += (1.0 - probability[i]) / n
    return np.array(total)


CASES = {
    "one": np.array([3.0]),
    "two": np.array([1.0, 3.0]),
    "equal": np.full(16, 0.1),
    "equal, not a power of two": np.full(100, 1.0 / 3.0),
    "one of many": np.eye(1, 77, 40)[0],
    "zeros": np.where(np.arange(50) % 3 == 0, np.arange(50.0), 0.0),
    "tiny and huge": 10.0 ** np.linspace(-200, 200, 33),
    "sun and sky": np.concatenate([np.full(1000, 1e-5), [1.0], np.full(1000, 1e-5)]),
    "random": np.random.default_rng(0).random(1000) ** 8,
}


@pytest.mark.parametrize("name", CASES)
def test_the_table_holds_the_weights(name):
    weights = CASES[name]
    table = AliasTable.build(weights)
    exact = weights / weights.max()
    exact /= exact.sum()
    padded = table.cells.shape[0]
    assert padded < 2 * weights.size or padded == 1
    np.testing.assert_allclose(held(table, weights.size), exact, rtol=1e-6, atol=1e-7 / padded)
    assert not held(table, weights.size)[weights == 0.0].any()
    np.testing.assert_allclose(table.pmf, exact, rtol=1e-6, atol=1e-38)


def test_the_oracle_agrees():
    for name in ("two", "zeros", "sun and sky", "random"):
        weights = CASES[name]
        got = held(AliasTable.build(weights), weights.size)
        np.testing.assert_allclose(got, vose(list(weights)), atol=1e-8)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.lists(st.floats(0.0, 1e6), min_size=1, max_size=70).filter(lambda w: sum(w) > 1e-6))
def test_any_weights_are_held(weights):
    weights = np.array(weights)
    table = AliasTable.build(weights)
    got = held(table, weights.size)
    np.testing.assert_allclose(got, weights / weights.sum(), rtol=1e-6, atol=1e-8)
    assert not got[weights == 0.0].any()


@pytest.mark.parametrize("name", CASES)
def test_draws_follow_the_weights(name):
    weights = CASES[name]
    u = jax.random.uniform(jax.random.key(21), (2, COUNT))
    drawn = np.asarray(sample(AliasTable.build(weights), *u))
    counts = np.bincount(drawn, minlength=weights.size)
    exact = weights / weights.max()
    assert p_value(counts, COUNT * exact / exact.sum()) > SIGNIFICANCE
    if name in ("random", "zeros"):
        assert p_value(np.roll(counts, 1), COUNT * exact / exact.sum()) < SIGNIFICANCE


def test_every_value_of_a_coarse_generator_counts_equally():
    """With 2^10 equally spaced values of each uniform the counts are exact, whatever the size."""
    weights = np.array([5.0, 1.0, 2.0, 0.0, 8.0])  # of 16ths
    line = (jnp.arange(1024) / 1024).astype(jnp.float32)
    drawn = sample(AliasTable.build(weights), *jnp.meshgrid(line, line))
    np.testing.assert_array_equal(np.bincount(np.ravel(drawn), minlength=5), weights * 2**16)


def test_the_remainder_is_uniform_and_independent():
    weights = CASES["random"][:200]
    table = AliasTable.build(weights)
    u = jax.random.uniform(jax.random.key(22), (2, COUNT))
    drawn, rest = sample_remainder(table, *u)
    np.testing.assert_array_equal(drawn, sample(table, *u))
    rest = np.asarray(rest)
    assert rest.min() >= 0.0
    assert rest.max() < 1.0
    counts = np.histogram2d(drawn, rest, bins=[np.arange(201), np.linspace(0, 1, 9)])[0]
    expected = np.outer(weights / weights.sum(), np.full(8, 1 / 8)) * COUNT
    assert p_value(counts, expected) > SIGNIFICANCE
    unstretched = np.histogram2d(drawn, u[1], bins=[np.arange(201), np.linspace(0, 1, 9)])[0]
    assert p_value(unstretched, expected) < SIGNIFICANCE


def test_extreme_uniforms_draw_what_exists():
    ends = jnp.array([0.0, BELOW_ONE, 1.0])
    for weights in CASES.values():
        drawn, rest = sample_remainder(AliasTable.build(weights), *jnp.meshgrid(ends, ends[:2]))
        assert np.all(weights[np.asarray(drawn)] > 0.0)
        assert np.all((np.asarray(rest) >= 0.0) & (np.asarray(rest) < 1.0))


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        (np.array([]), "0 entries"),
        (np.zeros(3), "all are zero"),
        (np.array([1.0, -1.0]), "non-negative"),
        (np.array([1.0, np.nan]), "finite"),
        (np.array([1.0, np.inf]), "finite"),
        (np.broadcast_to(1.0, 2**23 + 1), "resize"),
    ],
)
def test_bad_weights_are_named(weights, message):
    with pytest.raises(ValueError, match=message):
        AliasTable.build(weights)
