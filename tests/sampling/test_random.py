"""The counter-based generator: the published hash, and numbers that are uniform and independent."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxvis.sampling import random

from .chi_square import SIGNIFICANCE, p_value


@jax.jit
def numbers(key, first, second):
    bits = random.counter_bits(random.key_words(key), first, second)
    return jnp.stack([random.uniform(b) for b in bits])


def pcg4d(v):
    """In Python's integers, from the paper's listing."""
    v = [(x * 1664525 + 1013904223) % 2**32 for x in v]
    for twice in (True, False):
        for target, a, b in ((0, 1, 3), (1, 2, 0), (2, 0, 1), (3, 1, 2)):
            v[target] = (v[target] + v[a] * v[b]) % 2**32
        if twice:
            v = [x ^ (x >> 16) for x in v]
    return v


def test_the_hash_is_the_published_one():
    words = np.array([123456789, 4000000000], np.uint32)
    first, second = np.array([0, 1, 77, 2**31 - 1]), np.array([0, 5, 123456, 2])
    got = random.counter_bits(jnp.asarray(words), jnp.asarray(first), jnp.asarray(second))
    expected = [
        pcg4d([int(a), int(b), *map(int, words)]) for a, b in zip(first, second, strict=True)
    ]
    np.testing.assert_array_equal(np.stack(got, axis=-1), np.array(expected, np.uint32))


def test_uniforms_are_below_one():
    bits = jnp.array([0, 255, 256, 2**31, 2**32 - 1], jnp.uint32)
    expected = [0.0, 0.0, 2.0**-24, 0.5, 1.0 - 2.0**-24]
    np.testing.assert_array_equal(random.uniform(bits), expected)


def test_numbers_are_uniform_and_independent_of_their_neighbours():
    drawn = numbers(jax.random.key(3), jnp.arange(2000)[:, None], jnp.arange(100)[None, :])
    drawn = np.asarray(drawn).reshape(4, -1)
    n = drawn.shape[1]
    pairs = [(drawn[i], drawn[j]) for i in range(4) for j in range(i)]
    pairs += [(row[:-1], row[1:]) for row in drawn]  # the next sample
    pairs += [(row[:-100], row[100:]) for row in drawn]  # the same sample of the next pixel
    for a, b in pairs:
        counts = np.histogram2d(a, b, bins=16, range=[[0, 1], [0, 1]])[0]
        assert p_value(counts, np.full((16, 16), len(a) / 256)) > SIGNIFICANCE
    assert len(np.unique(drawn)) > 0.97 * 4 * n  # of 2^24 values, repeated by chance only


def test_numbers_depend_on_the_key_and_the_counters_alone():
    pixels, samples = jnp.arange(40)[:, None], jnp.arange(8)[None, :]
    whole = numbers(jax.random.key(0), pixels, samples)
    part = numbers(jax.random.key(0), pixels[17:], samples[:, 3:])
    np.testing.assert_array_equal(whole[:, 17:, 3:], part)
    assert not np.any(np.asarray(whole) == np.asarray(numbers(jax.random.key(1), pixels, samples)))
