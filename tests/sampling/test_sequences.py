"""Hammersley's points against the definition."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.sampling import sequences

hammersley = jax.jit(sequences.hammersley, static_argnums=0)
radical_inverse = jax.jit(sequences.radical_inverse)


def test_the_first_points_of_eight():
    expected = [[0.0625, 0.0], [0.1875, 0.5], [0.3125, 0.25], [0.4375, 0.75]]
    np.testing.assert_array_equal(hammersley(8)[:4], expected)


def test_radical_inverse_mirrors_the_digits():
    index = np.concatenate([np.arange(300), [2**24 - 1, 2**23, 123_456, 9_999_999]])
    expected = [int(f"{i:024b}"[::-1], 2) / 2**24 for i in index]
    np.testing.assert_array_equal(radical_inverse(jnp.asarray(index)), expected)
    largest = radical_inverse(jnp.array([2**32 - 1], jnp.uint32))
    assert largest[0] == 1.0 - 2.0**-24


@pytest.mark.parametrize("count", [1, 7, 64, 1000])
def test_points_are_in_the_unit_square(count):
    points = np.asarray(hammersley(count))
    assert points.shape == (count, 2)
    assert points.min() >= 0.0
    assert points.max() < 1.0


def test_every_elementary_interval_holds_its_share():
    points = np.asarray(hammersley(256))
    for k in range(9):
        counts = np.histogram2d(*points.T, bins=[2**k, 2 ** (8 - k)], range=[[0, 1], [0, 1]])[0]
        np.testing.assert_array_equal(counts, 1)


@pytest.mark.parametrize("count", [0, -3, 2**24 + 1])
def test_counts_out_of_range_are_refused(count):
    with pytest.raises(ValueError, match="count"):
        hammersley(count)
