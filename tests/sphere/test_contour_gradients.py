"""Gradients of contour integrals: against finite differences, and finite where slopes are not."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxvis.sphere import contours, latlong
from jaxvis.sphere.contours import ContourTable, integrate
from jaxvis.sphere.polygons import normalized

from .contour_oracle import HEIGHT, WIDTH, as_jax, directions_of, random_values, star


def test_gradients_match_finite_differences():
    rng = np.random.default_rng(14)
    values = as_jax(random_values(3))
    luminance = as_jax(random_values(1))
    places = as_jax(latlong.texel_directions(HEIGHT, WIDTH))
    polygon = directions_of(star(rng, [0.2, 0.5, -0.6], 24))

    def value(values, luminance, sharpness):
        luminous = ContourTable.build(luminance * places)
        lookups = contours.vsat(luminous, [polygon], sharpness)
        return jnp.sum(integrate(ContourTable.build(values), lookups) * as_jax([1.0, 0.3, -0.5]))

    arguments = (values, luminance, jnp.float32(6.0))
    slopes = jax.jit(jax.grad(value, argnums=(0, 1, 2)))(*arguments)
    value = jax.jit(value)
    for which, slope in enumerate(np.asarray(slope, np.float64) for slope in slopes):
        change = 0.05 * arguments[which] * as_jax(np.sign(slope))  # uphill

        def moved(sign, which=which, change=change):
            there = list(arguments)
            there[which] = there[which] + sign * change
            return float(value(*there))

        expected = 0.5 * (moved(1.0) - moved(-1.0))
        np.testing.assert_allclose(np.sum(slope * np.asarray(change)), expected, rtol=0.03)


def test_degenerate_directions_stay_finite_and_so_do_gradients():
    """Zero vectors, poles, equal neighbours, opposite ones; a dark map too."""
    points = np.array(
        [
            *([0, 1, 0], [0, -1, 0], [0, -1, 0], [0, 0, 0], [1, 0, 0], [-1, 0, 0]),
            *([0, 0, 1], [0, 0, 0], [0, 0, 0], [0, 0.6, 0.8], [0, -0.6, -0.8], [0, 0, -1]),
        ],
        np.float64,
    )
    places = as_jax(latlong.texel_directions(HEIGHT, WIDTH))

    def value(values, directions, sharpness, lookup):
        table = ContourTable.build(values)
        luminous = ContourTable.build(values[..., :1] * places)
        sets = [normalized(directions)]
        return jnp.sum(integrate(table, contours.vsat(luminous, sets, sharpness, lookup)))

    slope = jax.jit(jax.value_and_grad(value, argnums=(0, 1, 2)), static_argnums=3)
    one_bright = np.zeros((HEIGHT, WIDTH, 1))
    one_bright[5, 9] = 1.0
    for values in (random_values(1), one_bright, np.zeros_like(one_bright)):
        for lookup in ("nearest", "bilinear"):
            got = slope(as_jax(values), directions_of(points), jnp.float32(8.0), lookup)
            assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(got))


def test_light_squarely_beside_an_edge_has_a_finite_gradient():
    """Where the arcsine of eq. 11 has an infinite slope."""
    start, end = directions_of(np.array([[0.0, 0.0, 1.0]])), directions_of(np.array([[1.0, 0, 0]]))

    def beta(y):
        light = contours.Directions(jnp.zeros((1, 1)), y[None, None], jnp.zeros((1, 1)))
        return contours._beta(light, start, end, 5.0)[0, 0]

    value, slope = jax.jit(jax.value_and_grad(beta))(jnp.float32(0.3))
    np.testing.assert_allclose(value, 0.5 + 0.5 * np.tanh(5.0 * 0.5 * np.pi), rtol=1e-5)
    assert np.isfinite(slope)
