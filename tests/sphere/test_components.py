"""join is stack."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.sphere.components import join


@pytest.mark.parametrize("count", [1, 2, 3, 7])
def test_join_is_stack_in_value_and_gradient(count):
    parts = np.arange(6.0 * count, dtype=np.float32).reshape(count, 2, 3)
    joined, transpose = jax.vjp(jax.jit(lambda p: join(*p)), jnp.asarray(parts))
    np.testing.assert_array_equal(joined, np.moveaxis(parts, 0, -1))
    weights = np.arange(6.0 * count, dtype=np.float32).reshape(2, 3, count)
    np.testing.assert_array_equal(transpose(jnp.asarray(weights))[0], np.moveaxis(weights, -1, 0))


def test_a_part_that_is_not_a_number_stays_in_its_place():
    joined = join(jnp.ones(2), jnp.full(2, jnp.nan), jnp.zeros(2))
    np.testing.assert_array_equal(np.isnan(joined), [[False, True, False]] * 2)
