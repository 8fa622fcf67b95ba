"""Spherical harmonics against their polynomials, SciPy's, orthonormality, and exact integrals."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import sph_harm_y

from jaxvis.sphere import harmonics, latlong

evaluate = jax.jit(harmonics.evaluate, static_argnums=1)
project = jax.jit(harmonics.project, static_argnums=1)
reconstruct = jax.jit(harmonics.reconstruct)
irradiance_at = jax.jit(harmonics.irradiance)


def unit_vectors(count=200):
    v = np.random.default_rng(0).normal(size=(count, 3))
    v = np.concatenate([v, np.eye(3), -np.eye(3), [[1e-4, 0.0, 1.0]]])
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def as_jax(array):
    return jnp.asarray(array, jnp.float32)


def oracle(v, bands):
    """From SciPy's complex harmonics, which carry the Condon-Shortley sign."""
    theta, phi = np.arccos(np.clip(v[:, 2], -1, 1)), np.arctan2(v[:, 1], v[:, 0])
    columns = []
    for l in range(bands):
        for m in range(-l, l + 1):
            value = sph_harm_y(l, abs(m), theta, phi)
            sign = np.sqrt(2.0) * (-1.0) ** m
            columns.append(value.real if m == 0 else sign * (value.imag if m < 0 else value.real))
    return np.stack(columns, axis=-1)


def test_the_first_nine_are_the_polynomials_of_the_specification():
    v = unit_vectors()
    x, y, z = v.T
    expected = [
        *(0.282095 + 0 * x, 0.488603 * y, 0.488603 * z, 0.488603 * x),
        *(1.092548 * x * y, 1.092548 * y * z, 0.315392 * (3 * z * z - 1)),
        *(1.092548 * x * z, 0.546274 * (x * x - y * y)),
    ]
    got = evaluate(as_jax(v), 3)
    np.testing.assert_allclose(got, np.stack(expected, axis=-1), atol=2e-6)


@pytest.mark.parametrize("bands", [1, 2, 7])
def test_against_scipy(bands):
    v = unit_vectors()
    got = evaluate(as_jax(v), bands)
    np.testing.assert_allclose(got, oracle(v, bands), atol=3e-6 * bands)


def test_64_bands_are_right_in_float32():
    v = unit_vectors(50).astype(np.float32)
    v64 = v.astype(np.float64)
    got = np.stack(harmonics.basis(v[:, 0], v[:, 1], v[:, 2], 64), axis=-1)
    assert got.dtype == np.float32
    exact = np.stack(harmonics.basis(*v64.T, 64), axis=-1)
    np.testing.assert_allclose(got, exact, atol=1e-3)  # the functions reach 3.2
    unit = v64 / np.linalg.norm(v64, axis=1, keepdims=True)
    np.testing.assert_allclose(
        np.stack(harmonics.basis(*unit.T, 64), axis=-1), oracle(unit, 64), atol=1e-9
    )


def test_they_are_orthonormal():
    nodes, weights = np.polynomial.legendre.leggauss(16)
    phi = 2.0 * np.pi * np.arange(32) / 32
    z, phi = np.meshgrid(nodes, phi, indexing="ij")
    r = np.sqrt(1.0 - z * z)
    v = np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1).reshape(-1, 3)
    y = np.stack(harmonics.basis(*v.T, 9), axis=-1)
    measure = np.repeat(weights, 32) * 2.0 * np.pi / 32
    np.testing.assert_allclose(y.T @ (measure[:, None] * y), np.eye(81), atol=1e-12)


def quadratic(matrices, v):
    """d^T M d of each channel with d = (x, y, z, 1), float64."""
    d = np.concatenate([v, np.ones((len(v), 1))], axis=1)
    return np.einsum("pa,cab,pb->pc", d, np.asarray(matrices, np.float64), d)


@pytest.mark.parametrize("channels", [1, 3])
def test_the_quadratic_form_is_the_function(channels):
    coefficients = np.random.default_rng(3).normal(size=(9, channels))
    matrices = jax.jit(harmonics.quadratic_form)(as_jax(coefficients))
    assert matrices.shape == (channels, 4, 4)
    np.testing.assert_array_equal(matrices, np.swapaxes(matrices, 1, 2))
    v = unit_vectors()
    expected = oracle(v, 3) @ coefficients
    np.testing.assert_allclose(quadratic(matrices, v), expected, atol=5e-6)
    np.testing.assert_allclose(
        reconstruct(as_jax(coefficients), as_jax(v)), quadratic(matrices, v), atol=1e-5
    )


@pytest.mark.parametrize("which", range(9))
def test_the_quadratic_form_of_each_function_alone(which):
    coefficients = jnp.zeros((9, 1)).at[which].set(1.0)
    v = unit_vectors()
    found = quadratic(harmonics.quadratic_form(coefficients), v)[:, 0]
    np.testing.assert_allclose(found, oracle(v, 3)[:, which], atol=1e-6)


def test_sums_of_the_quadratic_form_follow_from_second_moments():
    coefficients = as_jax(np.random.default_rng(4).normal(size=(9, 3)))
    v = unit_vectors()
    d = np.concatenate([v, np.ones((len(v), 1))], axis=1)
    matrices = np.asarray(harmonics.quadratic_form(coefficients), np.float64)
    found = np.einsum("cab,ab->c", matrices, d.T @ d)
    expected = (oracle(v, 3) @ np.asarray(coefficients, np.float64)).sum(axis=0)
    np.testing.assert_allclose(found, expected, atol=1e-6 * len(v))


def brute_projection(radiance, bands, fine=60):
    """Sum over many points of each texel, float64."""
    height, width = radiance.shape[:2]
    v = latlong.texel_directions(height * fine, width * fine)
    angles = latlong.row_solid_angles(height * fine, width * fine)
    y = np.stack(harmonics.basis(v[..., 0], v[..., 1], v[..., 2], bands), axis=-1)
    y = (y * angles[:, None, None]).reshape(height, fine, width, fine, -1).sum(axis=(1, 3))
    return np.einsum("rcb,rcx->bx", y, radiance)


def test_projection_is_that_of_the_piecewise_constant_map():
    radiance = np.random.default_rng(1).random((3, 6, 2)) ** 4
    got = project(as_jax(radiance), 5)
    np.testing.assert_allclose(got, brute_projection(radiance, 5), atol=2e-4)
    centres = latlong.texel_directions(3, 6)
    y = np.stack(harmonics.basis(*np.moveaxis(centres, -1, 0), 5), axis=-1)
    at_centres = np.einsum("rcb,rcx,r->bx", y, radiance, latlong.row_solid_angles(3, 6))
    assert np.abs(at_centres - got).max() > 1e-2  # the centre rule would not have passed


@pytest.mark.parametrize("bands", [3, 6])
def test_projection_of_a_band_limited_function_gives_its_coefficients_back(bands):
    """To the error of a map of 256 rows: its texels hold averages."""
    coefficients = np.random.default_rng(2).normal(size=(bands * bands, 3))
    v = latlong.texel_directions(256, 512)
    y = np.stack(harmonics.basis(v[..., 0], v[..., 1], v[..., 2], bands), axis=-1)
    got = project(as_jax(y @ coefficients), bands)
    np.testing.assert_allclose(got, coefficients, atol=2e-3)
    points = unit_vectors()
    there = reconstruct(as_jax(coefficients), as_jax(points))
    np.testing.assert_allclose(there, oracle(points, bands) @ coefficients, atol=2e-5 * bands)


def test_a_constant_map_has_one_coefficient_and_irradiance_pi_L():
    coefficients = project(jnp.full((8, 16, 3), 2.0), 3)
    np.testing.assert_allclose(coefficients[0], 2.0 * np.sqrt(4.0 * np.pi), rtol=1e-6)
    np.testing.assert_allclose(coefficients[1:], 0.0, atol=1e-5)
    irradiance = irradiance_at(coefficients, as_jax(unit_vectors()))
    np.testing.assert_allclose(irradiance, 2.0 * np.pi, rtol=1e-5)


def test_irradiance_of_a_sky_that_brightens_upwards():
    """L = 1 + 0.8 y has bands 0 and 1 only: E = pi + 0.8 (2 pi / 3) n_y."""
    v = latlong.texel_directions(128, 256)
    coefficients = project(as_jax(1.0 + 0.8 * v[..., 1:2]), 3)
    normals = unit_vectors()
    expected = np.pi + 0.8 * 2.0 * np.pi / 3.0 * normals[:, 1:2]
    got = irradiance_at(coefficients, as_jax(normals))
    np.testing.assert_allclose(got, expected, atol=2e-3)


def test_irradiance_of_one_bright_texel_is_the_nine_term_cosine():
    radiance = np.zeros((32, 64, 1))
    radiance[5, 20] = 1000.0
    flux = 1000.0 * latlong.row_solid_angles(32, 64)[5]
    towards = latlong.texel_directions(32, 64)[5, 20]
    normals = unit_vectors()
    cosine = normals @ towards
    nine_terms = 0.25 + cosine / 2.0 + (15.0 * cosine**2 - 5.0) / 32.0
    coefficients = project(as_jax(radiance), 3)
    got = irradiance_at(coefficients, as_jax(normals))[:, 0]
    np.testing.assert_allclose(got, flux * nine_terms, atol=4e-3 * flux)
    assert np.abs(nine_terms - np.maximum(cosine, 0.0)).max() <= 3.0 / 32.0
    assert got.min() < 0.0  # unclamped, as documented


def test_turning_the_map_keeps_each_bands_power():
    radiance = np.random.default_rng(5).random((16, 32, 1))
    power = []
    for turned in (radiance, np.roll(radiance, 11, axis=1), radiance[::-1]):
        c = np.asarray(project(as_jax(turned), 5))[:, 0]
        power.append([np.sum(c[l * l : (l + 1) ** 2] ** 2) for l in range(5)])
    np.testing.assert_allclose(power[1:], [power[0]] * 2, rtol=1e-4)


def test_projection_is_differentiable_in_the_light():
    radiance = as_jax(np.random.default_rng(6).random((4, 8, 3)))
    weights = as_jax(np.random.default_rng(7).normal(size=(9, 3)))
    gradient = jax.grad(lambda r: jnp.sum(weights * project(r, 3)))(radiance)
    for texel in ((0, 0, 0), (2, 5, 1), (3, 7, 2)):
        bump = jnp.zeros((4, 8, 3)).at[texel].set(1.0)
        expected = jnp.sum(weights * project(bump, 3))  # it is linear
        np.testing.assert_allclose(gradient[texel], expected, rtol=1e-4, atol=1e-6)


def test_wrong_numbers_of_bands_and_coefficients_are_named():
    with pytest.raises(ValueError, match="bands must be at least 1"):
        evaluate(jnp.ones((1, 3)), 0)
    with pytest.raises(ValueError, match="8 coefficients"):
        harmonics.reconstruct(jnp.ones((8, 3)), jnp.ones((1, 3)))
