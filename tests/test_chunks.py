"""chunked_map: the same results and gradients whatever the chunk, in bounded pieces."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.chunks import chunked_map


def square_and_sum(points):
    return {"square": points["x"] ** 2, "sum": points["x"] + points["y"][:, 0]}


@pytest.mark.parametrize("chunk", [1, 3, 7, 8, 100])
def test_chunks_do_not_change_results(chunk):
    points = {"x": jnp.arange(7.0), "y": jnp.ones((7, 2))}
    whole, mapped = square_and_sum(points), chunked_map(square_and_sum, points, chunk)
    for name in whole:
        np.testing.assert_array_equal(mapped[name], whole[name])


@pytest.mark.parametrize("remat", [True, False])
def test_gradients_pass_through(remat):
    def loss(x):
        return chunked_map(lambda x: jnp.sin(x) * x, x, 4, remat=remat).sum()

    x = jnp.linspace(0.0, 2.0, 10)
    np.testing.assert_allclose(jax.grad(loss)(x), jnp.cos(x) * x + jnp.sin(x), rtol=1e-6)


def test_the_function_sees_one_chunk_at_a_time():
    seen = []
    chunked_map(lambda x: seen.append(x.shape) or x, jnp.zeros((10, 3)), 4)
    assert set(seen) == {(4, 3)}


def test_a_chunk_of_nothing_is_refused():
    with pytest.raises(ValueError, match="chunk must be at least 1"):
        chunked_map(lambda x: x, jnp.zeros(3), 0)
