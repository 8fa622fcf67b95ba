"""Spherical Gaussians: identities against float64, f_h against quadrature, gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import erf

from jaxvis.sphere import gaussians
from jaxvis.sphere.gaussians import SphericalGaussians

SHARPNESSES = np.array([0.0, 1e-3, 0.03, 0.124, 0.126, 0.7, 3.0, 20.0, 300.0, 1e4])

product = jax.jit(gaussians.product)
inner_product = jax.jit(gaussians.inner_product)
half_space = jax.jit(gaussians.half_space)
visible_share = jax.jit(gaussians.visible_share)
total = jax.jit(gaussians.total)


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def unit_vectors(*shape, seed=0):
    return unit(np.random.default_rng(seed).normal(size=(*shape, 3)))


def lobes_of(axis, sharpness, amplitude):
    sharpness = np.broadcast_to(sharpness, axis.shape[:-1])
    parts = axis, sharpness, np.broadcast_to(amplitude, (*sharpness.shape, 1))
    return SphericalGaussians(*(jnp.asarray(part, jnp.float32) for part in parts))


def value(lobes, w):
    """In float64, of the float32 lobes; their axes are taken to be of length 1."""
    p, l, m = (np.asarray(part, np.float64) for part in jax.tree.leaves(lobes))
    return m * np.exp(-0.5 * l * np.square(unit(p) - w).sum(-1))[..., None]


def near(axis, sharpness, reach=2.0, seed=5):
    """Directions some lobe widths from the axes."""
    step = np.random.default_rng(seed).normal(size=axis.shape)
    return unit(axis + reach * step / np.sqrt(np.maximum(sharpness, 1.0))[..., None])


def test_a_lobe_by_hand():
    lobe = lobes_of(np.array([0.0, 0.0, 1.0]), 2.0, 3.0)
    ways = jnp.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    found = lobe.evaluate(ways)[:, 0]
    np.testing.assert_allclose(found, 3.0 * np.exp([0.0, -2.0, -4.0]), rtol=1e-6)
    two = SphericalGaussians(
        jnp.stack([lobe.axis, lobe.axis]),
        jnp.array([2.0, 0.0]),
        jnp.array([[3.0, 0.0], [1.0, 5.0]]),
    )
    np.testing.assert_allclose(two.mixture(ways), np.stack([found + 1.0, 5.0 + 0 * found], 1))


@pytest.mark.parametrize("sharpness", SHARPNESSES)
def test_the_integral_is_that_of_quadrature(sharpness):
    """Over t in [0, 2], t = 1 - cos: 2 pi exp(-lambda t), on panels that follow the lobe."""
    node, weight = np.polynomial.legendre.leggauss(60)
    end = min(2.0, 40.0 / max(sharpness, 1e-9))
    t = 0.5 * end * (1.0 + node)
    exact = 2.0 * np.pi * 0.5 * end * np.sum(weight * np.exp(-sharpness * t))
    lobe = lobes_of(unit_vectors(), sharpness, 1.5)
    np.testing.assert_allclose(lobe.integral(), [1.5 * exact], rtol=1e-6)
    slope = -2.0 * np.pi * 0.5 * end * np.sum(weight * t * np.exp(-sharpness * t))
    np.testing.assert_allclose(jax.grad(total)(jnp.float32(sharpness)), slope, rtol=1e-5)


@pytest.mark.parametrize("apart", [0.0, 1e-4, 0.01, 0.3, 3.0])
def test_the_product_is_the_product(apart):
    first, second = np.meshgrid(SHARPNESSES, SHARPNESSES)
    axis = unit_vectors(*first.shape)
    a = lobes_of(axis, first, 2.0)
    b = lobes_of(unit(axis + apart * unit_vectors(*first.shape, seed=1)), second, 0.5)
    both = product(a, b)
    w = near(np.asarray(both.axis, np.float64), np.asarray(both.sharpness))
    exact = value(a, w) * value(b, w)
    assert exact.max() > 0.3 * np.exp(-apart)
    np.testing.assert_allclose(value(both, w), exact, atol=1e-5, rtol=0)
    np.testing.assert_allclose(both.evaluate(jnp.asarray(w, jnp.float32)), exact, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(both.axis, axis=-1), 1.0, atol=3e-7)


def test_the_plain_formula_loses_narrow_lobes():
    """The control: 1 - p.w from a float32 scalar product is wrong by far more than the test's."""
    axis = unit_vectors(2000).astype(np.float32)
    w = near(axis.astype(np.float64), np.full(2000, 1e4)).astype(np.float32)
    lobes = lobes_of(axis, 1e4, 1.0)
    exact = value(lobes, w.astype(np.float64))[:, 0]
    plain = np.exp(np.float32(1e4) * (np.sum(axis * w, axis=-1, dtype=np.float32) - 1.0))
    assert np.abs(plain - exact).max() > 5e-4
    np.testing.assert_allclose(lobes.evaluate(jnp.asarray(w))[:, 0], exact, atol=5e-4)


def test_inner_products_are_those_of_quadrature():
    node, weight = np.polynomial.legendre.leggauss(120)
    phi = 2.0 * np.pi * np.arange(240) / 240
    z, phi = np.meshgrid(node, phi, indexing="ij")
    r = np.sqrt(1.0 - z * z)
    w = np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1)[:, :, None]
    sharpness = np.random.default_rng(3).uniform(0.0, 30.0, size=(2, 30))
    a, b = (lobes_of(unit_vectors(30, seed=k), sharpness[k], 1.0 + k) for k in (0, 1))
    measure = weight[:, None, None, None] * 2.0 * np.pi / 240
    exact = (value(a, w) * value(b, w) * measure).sum(axis=(0, 1))
    np.testing.assert_allclose(inner_product(a, b), exact, atol=1e-6, rtol=1e-5)


def test_products_broadcast_and_opposite_equal_lobes_give_a_constant():
    a = lobes_of(unit_vectors(4, 1), 3.0, 1.0)
    b = lobes_of(-np.asarray(a.axis).reshape(1, 4, 3), 3.0, 1.0)
    both = product(a, b)
    assert both.axis.shape == (4, 4, 3)
    for k in range(4):
        np.testing.assert_allclose(both.sharpness[k, k], 0.0, atol=1e-4)
        np.testing.assert_allclose(both.amplitude[k, k], np.exp(-6.0), rtol=1e-5)
    assert np.isfinite(jax.grad(lambda b: jnp.sum(product(a, b).integral()))(b).axis).all()


def exact_half_space(distance, sharpness):
    """int exp(lambda (cos g - 1)) sin g 2 arccos(-tan D / tan g) dg, by the midpoint rule."""
    g = np.pi * (np.arange(200000) + 0.5) / 200000
    with np.errstate(divide="ignore"):
        arc = 2.0 * np.arccos(np.clip(-np.tan(distance) / np.tan(g), -1.0, 1.0))
    lobe = np.exp(sharpness * (np.cos(g) - 1.0)) * np.sin(g)
    return np.sum(lobe * arc) * np.pi / len(g)


@pytest.mark.parametrize(
    ("distance", "sharpness", "exact"),
    [(0.1, 20, 0.210325), (-0.3, 8, 0.165680), (0.5, 2, 2.169419), (0.02, 500, 0.00845108)],
)
def test_half_space_against_the_specifications_vectors(distance, sharpness, exact):
    np.testing.assert_allclose(exact_half_space(distance, sharpness), exact, rtol=2e-5)
    whole = 2.0 * np.pi / sharpness * -np.expm1(-2.0 * sharpness)
    found = half_space(jnp.float32(distance), jnp.float32(sharpness))
    np.testing.assert_allclose(found, exact, atol=5e-3 * whole)


def test_half_space_is_the_integral_to_half_a_percent():
    worst = 0.0
    for sharpness in (0.01, 0.3, 0.5, 1.0, 2.0, 5.0, 12.0, 40.0, 500.0):
        whole = 2.0 * np.pi / sharpness * -np.expm1(-2.0 * sharpness)
        d = np.linspace(-1.55, 1.55, 21) * min(1.0, 4.0 / np.sqrt(sharpness))
        exact = np.array([exact_half_space(x, sharpness) for x in d])
        found = half_space(jnp.asarray(d, jnp.float32), jnp.float32(sharpness))
        worst = max(worst, np.abs(found - exact).max() / whole)
    assert worst < 5e-3


def test_shares_add_up_rise_and_end_at_none_and_all():
    distance = jnp.linspace(-np.pi, np.pi, 801)[:, None]
    sharpness = jnp.asarray(SHARPNESSES, jnp.float32)
    share = np.asarray(visible_share(distance, sharpness))
    np.testing.assert_allclose(share + share[::-1], 1.0, atol=1e-5)
    assert np.diff(share, axis=0).min() > -1e-6
    np.testing.assert_allclose(share[[0, -1]], [[0.0] * 10, [1.0] * 10], atol=1e-6)
    quarter = visible_share(jnp.float32(np.pi / 2), sharpness)
    np.testing.assert_allclose(quarter, 1.0 / (1.0 + np.exp(-SHARPNESSES)), atol=3e-5)


@pytest.mark.parametrize("sharpness", [0.05, 0.9, 7.0, 200.0])
@pytest.mark.parametrize("distance", [0.0, 0.03, -0.6, np.pi / 2 - 0.01, 2.2, -np.pi + 0.2])
def test_gradients_of_the_share_are_finite_differences(distance, sharpness):
    def share(d, l):
        return np.float64(visible_share(jnp.float32(d), jnp.float32(l)))

    d, l = jnp.float32(distance), jnp.float32(sharpness)
    got = jax.grad(visible_share, argnums=(0, 1))(d, l)
    step = 4e-3
    by_distance = (share(distance + step, l) - share(distance - step, l)) / (2.0 * step)
    h = 0.02 * sharpness
    by_sharpness = (share(distance, sharpness + h) - share(distance, sharpness - h)) / (2.0 * h)
    np.testing.assert_allclose(got[0], by_distance, atol=2e-4, rtol=0.01)
    np.testing.assert_allclose(got[1], by_sharpness, atol=1e-4 / h, rtol=0.01)


@pytest.mark.parametrize("distance", [-np.pi, -np.pi / 2, np.pi / 2, np.pi, 4.0])
@pytest.mark.parametrize("sharpness", [0.0, 1.0, 1e4])
def test_gradients_at_the_ends_are_finite(distance, sharpness):
    d, l = jnp.float32(distance), jnp.float32(sharpness)
    assert np.isfinite(jax.grad(half_space, argnums=(0, 1))(d, l)).all()


def test_gradients_through_lobes_are_finite_differences():
    """Of the integral of a product, through every parameter, in float64 by the plain formula."""
    a, b = (lobes_of(unit_vectors(1, seed=k)[0], 3.0 + 4.0 * k, 1.5) for k in (0, 1))

    def plain(axis, sharpness, amplitude):
        p = np.asarray(b.axis, np.float64)
        vector = sharpness * axis + 7.0 * p
        length = np.linalg.norm(vector)
        # Axes off the sphere: exp(lambda (p.w - 1)) with 1 as (|p|^2 + 1) / 2, as by the chord.
        apart = 0.5 * ((axis * axis).sum() + 1.0)
        fall = np.exp(length - sharpness * apart - 7.0)
        return amplitude * 1.5 * fall * 2.0 * np.pi / length * -np.expm1(-2.0 * length)

    got = jax.grad(lambda a: inner_product(a, b)[0])(a)
    axis = np.asarray(a.axis, np.float64)
    np.testing.assert_allclose(inner_product(a, b)[0], plain(axis, 3.0, 1.5), rtol=1e-5)
    for tangent in np.linalg.svd(axis[None])[2][1:]:  # the two directions along the sphere
        slope = (
            plain(unit(axis + 1e-4 * tangent), 3.0, 1.5)
            - plain(unit(axis - 1e-4 * tangent), 3.0, 1.5)
        ) / 2e-4
        np.testing.assert_allclose(np.dot(got.axis, tangent), slope, rtol=1e-3, atol=1e-5)
    slope = (plain(axis, 3.001, 1.5) - plain(axis, 2.999, 1.5)) / 2e-3
    np.testing.assert_allclose(got.sharpness, slope, rtol=1e-3, atol=1e-5)
    np.testing.assert_allclose(got.amplitude[0], plain(axis, 3.0, 1.0), rtol=1e-5)


def test_the_polynomials():
    x = np.linspace(-6.0, 6.0, 4001)
    found = np.asarray(gaussians.error_function(jnp.asarray(x, jnp.float32)))
    assert np.abs(found - erf(x)).max() < 5.1e-4
    angle = np.linspace(-np.pi / 2, np.pi / 2, 2001)
    np.testing.assert_allclose(
        gaussians._sine(jnp.asarray(angle, jnp.float32)), np.sin(angle), atol=1e-6
    )


def test_a_mixture_of_a_grid_of_lobes_is_refused():
    with pytest.raises(ValueError, match="one list of lobes"):
        lobes_of(unit_vectors(2, 2), 1.0, 1.0).mixture(jnp.ones((1, 3)))
