"""Phong-kernel blur against brute force and closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.lighting.blur import phong_blur, phong_lobes
from jaxvis.lighting.resampling import resize
from jaxvis.sphere import latlong


def energy(radiance):
    weights = latlong.row_solid_angles(*radiance.shape[:2])
    return np.einsum("h,hwc->c", weights, np.asarray(radiance, np.float64))


def brute_force(radiance, exponent, height, inside, outside):
    """Every one of ``inside``² places in a source texel to each of ``outside``² in a result's."""
    rows = radiance.shape[0]
    source = latlong.texel_directions(rows * inside, 2 * rows * inside).reshape(-1, 3)
    solid_angle = latlong.row_solid_angles(rows * inside, 2 * rows * inside)
    light = np.repeat(np.repeat(np.asarray(radiance, np.float64), inside, 0), inside, 1)
    light = (light * solid_angle[:, None, None]).reshape(-1, 3)
    target = latlong.texel_directions(height * outside, 2 * height * outside)
    out = np.empty_like(target)
    for i, row in enumerate(target):
        cosine = row @ source.T
        lobe = np.where(cosine > 0.0, np.abs(cosine) ** exponent, 0.0)
        lobe *= (exponent + 1.0) / (2.0 * np.pi)
        out[i] = lobe @ light
    weight = latlong.row_solid_angles(height * outside, 2 * height * outside)
    total = (out * weight[:, None, None]).reshape(height, outside, 2 * height, outside, 3)
    area = weight.reshape(height, outside).sum(axis=1) * outside
    return total.sum(axis=(1, 3)) / area[:, None, None]


def spiky(height, seed=0):
    radiance = np.random.default_rng(seed).random((height, 2 * height, 3)) ** 6 * 10.0
    radiance[height // 3, 3] = 300.0
    radiance[0, 0] = 200.0
    return jnp.asarray(radiance, jnp.float32)


@pytest.mark.parametrize(("rows", "exponent", "height", "inside", "outside"), [
    (4, 1.0, 3, 10, 6), (4, 5.0, 3, 10, 8), (2, 20.0, 3, 24, 14), (4, 0.0, 2, 16, 12),
])  # fmt: skip
def test_agrees_with_brute_force(rows, exponent, height, inside, outside):
    radiance = spiky(rows)
    blurred = phong_blur(radiance, exponent, height)
    expected = brute_force(radiance, exponent, height, inside, outside)
    np.testing.assert_allclose(blurred, expected, rtol=5e-3, atol=2e-3 * expected.max())


@pytest.mark.parametrize("exponent", [0.0, 1.0, 256.0])
@pytest.mark.parametrize(("rows", "height"), [(16, 16), (9, 20), (100, 24)])
def test_a_constant_stays_constant(rows, height, exponent):
    blurred = phong_blur(jnp.full((rows, 2 * rows, 3), 2.5), exponent, height)
    assert blurred.shape == (height, 2 * height, 3)
    np.testing.assert_allclose(blurred, 2.5, rtol=1e-5)


@pytest.mark.parametrize("row", [0, 13, 47])
def test_a_sun_becomes_the_kernel_and_keeps_its_energy(row):
    """At the paper's exponent, against the kernel averaged over both texels."""
    height, exponent = 96, 256.0
    sun = jnp.zeros((height, 2 * height, 1)).at[row, 50].set(1e4)
    blurred = np.asarray(phong_blur(sun, exponent, 64))[..., 0]
    inside = latlong.texel_directions(4 * height, 8 * height)[4 * row : 4 * row + 4, 200:204]
    weight = latlong.row_solid_angles(4 * height, 8 * height)[4 * row : 4 * row + 4]
    cosine = np.einsum("hwc,rsc->hwrs", latlong.texel_directions(256, 512), inside)
    kernel = (exponent + 1.0) / (2.0 * np.pi) * np.maximum(cosine, 0.0) ** exponent
    kernel = np.einsum("hwrs,r->hw", kernel, weight) / (4.0 * weight.sum())
    kernel = jnp.asarray(kernel[..., None], jnp.float32)
    solid_angle = latlong.row_solid_angles(height, 2 * height)[row]
    expected = 1e4 * solid_angle * np.asarray(resize(kernel, 64, 128))[..., 0]
    np.testing.assert_allclose(blurred, expected, atol=0.01 * expected.max())
    np.testing.assert_allclose(energy(blurred[..., None]), energy(sun), rtol=1e-3)
    assert blurred[expected < 1e-7 * expected.max()].max() < 1e-5 * expected.max()


def test_a_lit_hemisphere_under_exponent_one():
    """cos lobe of the upper half: (1 + cos theta) / 2."""
    radiance = jnp.zeros((32, 64, 1)).at[:16].set(1.0)
    blurred = phong_blur(radiance, 1.0, 128)
    theta = np.pi * (np.arange(128) + 0.5) / 128
    expected = np.repeat(0.5 * (1.0 + np.cos(theta))[:, None, None], 256, axis=1)
    np.testing.assert_allclose(blurred, expected, atol=2e-3)


def test_turning_and_blurring_commute():
    radiance = spiky(16)
    one = jnp.roll(phong_blur(radiance, 30.0, 16), 5, axis=1)
    other = phong_blur(jnp.roll(radiance, 5, axis=1), 30.0, 16)
    np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-5)


def test_has_a_gradient_in_the_light():
    """It is linear: the gradient is the kernel that gives the value."""
    radiance = spiky(6)
    value, gradient = jax.value_and_grad(lambda light: phong_blur(light, 8.0, 4)[1, 2, 0])(radiance)
    np.testing.assert_allclose((gradient * radiance).sum(), value, rtol=1e-4)
    assert np.all(np.asarray(gradient[..., 1:]) == 0.0)
    other = spiky(6, seed=1)
    np.testing.assert_allclose(
        (gradient * other).sum(), phong_blur(other, 8.0, 4)[1, 2, 0], rtol=1e-4
    )


@pytest.mark.parametrize("exponent", [-1.0, np.nan, np.inf])
def test_refuses_exponents_that_are_no_lobe(exponent):
    with pytest.raises(ValueError, match="exponent must be"):
        phong_blur(jnp.ones((4, 8, 3)), exponent, 4)


def test_refuses_an_empty_result():
    with pytest.raises(ValueError, match="height must be"):
        phong_blur(jnp.ones((4, 8, 3)), 1.0, 0)


def lobe_sums(radiance, exponent, directions, inside):
    """Sums over ``inside``^2 places in each texel, for lobes about ``directions`` (float64)."""
    fine = radiance.shape[0] * inside
    source = latlong.texel_directions(fine, 2 * fine).reshape(-1, 3)
    light = np.repeat(np.repeat(np.asarray(radiance, np.float64), inside, 0), inside, 1)
    light = (light * latlong.row_solid_angles(fine, 2 * fine)[:, None, None]).reshape(-1, 3)
    cosine = directions @ source.T
    lobe = np.where(cosine > 0.0, np.abs(cosine) ** exponent, 0.0)
    return (exponent + 1.0) / (2.0 * np.pi) * lobe @ light


@pytest.mark.parametrize("height", [6, 7])
def test_lobes_about_the_texels_centres_agree_with_brute_force(height):
    radiance, exponents = spiky(6), [1.0, 8.0, 60.0]
    lobes = np.asarray(phong_lobes(radiance, exponents, height))
    assert lobes.shape == (3, height, 2 * height, 3)
    centres = latlong.texel_directions(height, 2 * height).reshape(-1, 3)
    for lobe, exponent in zip(lobes, exponents, strict=True):
        expected = lobe_sums(radiance, exponent, centres, 32)
        error = np.abs(lobe.reshape(-1, 3) - expected)
        assert error.max() < 0.01 * expected.max(), exponent


def test_lobes_of_a_constant_are_that_constant():
    lobes = phong_lobes(jnp.full((9, 18, 1), 2.5), [0.0, 3.0, 500.0], 20)
    np.testing.assert_allclose(lobes, 2.5, rtol=1e-5)


def test_lobes_refuse_what_is_no_lobe():
    with pytest.raises(ValueError, match="exponent must be"):
        phong_lobes(jnp.ones((4, 8, 3)), [1.0, -1.0], 4)
