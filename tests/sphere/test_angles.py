"""The polynomials against float64."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxvis.sphere import angles

sine_cosine = jax.jit(angles.sine_cosine)
turns = jax.jit(angles.turns)


def test_sine_and_cosine_of_any_number_of_turns():
    t = np.concatenate([np.linspace(-3.0, 3.0, 4801), [1000.37, -1e6 + 0.125, 2.0**20 + 0.25]])
    t = t.astype(np.float32)
    sine, cosine = sine_cosine(jnp.asarray(t))
    exact = 2.0 * np.pi * np.mod(t.astype(np.float64), 1.0)
    np.testing.assert_allclose(sine, np.sin(exact), atol=2e-7)
    np.testing.assert_allclose(cosine, np.cos(exact), atol=2e-7)


def test_quarter_turns_are_exact_and_small_angles_keep_their_digits():
    sine, cosine = sine_cosine(jnp.arange(-4.0, 5.0) / 4.0)
    np.testing.assert_array_equal(sine, [0, 1, 0, -1, 0, 1, 0, -1, 0])
    np.testing.assert_array_equal(cosine, [1, 0, -1, 0, 1, 0, -1, 0, 1])
    small = np.float32([1e-20, 1e-9, 1e-4])
    np.testing.assert_allclose(sine_cosine(jnp.asarray(small))[0], 2 * np.pi * small, rtol=3e-7)


def test_turns_is_atan2_with_its_relative_precision():
    exponents = np.linspace(-30, 30, 121)
    y = np.concatenate([10.0**exponents, np.linspace(0.0, 2.0, 2001)]).astype(np.float32)
    for sx in (1.0, -1.0):
        for sy in (1.0, -1.0):
            x = np.full_like(y, sx)
            exact = np.arctan2((sy * y).astype(np.float64), x.astype(np.float64)) / (2 * np.pi)
            got = turns(jnp.asarray(sy * y), jnp.asarray(x))
            nonzero = y > 0.0
            np.testing.assert_allclose(got[nonzero], exact[nonzero], rtol=3e-7)


def test_turns_on_the_axes_and_at_the_origin():
    y = jnp.array([0.0, 1.0, 0.0, -1.0, 0.0, 1.0, -0.0])
    x = jnp.array([1.0, 0.0, -1.0, 0.0, 0.0, 1.0, -2.0])
    np.testing.assert_allclose(turns(y, x), [0, 0.25, 0.5, -0.25, 0, 0.125, 0.5], atol=2e-8)
    assert np.all(np.isfinite(jax.jit(jax.grad(lambda p: turns(p[0], p[1])))(jnp.zeros(2))))


def test_gradients():
    def angle(p):
        return turns(p[1], p[0])

    for p in ([0.3, 0.4], [-0.3, 0.9], [0.8, -0.1], [-2.0, -1.0]):
        x, y = p
        expected = np.array([-y, x]) / (x * x + y * y) / (2.0 * np.pi)
        np.testing.assert_allclose(
            jax.jit(jax.grad(angle))(jnp.array(p)), expected, rtol=1e-4, atol=1e-6
        )
    for t in (0.0, 0.07, 0.31, -0.6):
        slope = jax.jit(jax.jacfwd(lambda s: jnp.stack(sine_cosine(s))))(jnp.float32(t))
        turn = 2.0 * np.pi * t
        expected = [2.0 * np.pi * np.cos(turn), -2.0 * np.pi * np.sin(turn)]
        np.testing.assert_allclose(slope, expected, atol=1e-5)
