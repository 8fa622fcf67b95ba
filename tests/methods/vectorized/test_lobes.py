"""Prefiltered Phong lobes against sums over all texels."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.lighting import uniform, windows
from jaxvis.methods.vectorized.lobes import LARGEST_EXPONENT, PhongLobes
from jaxvis.sphere import latlong

HEIGHT = 64
EXPONENTS = (0.3, 1.0, 7.0, 40.0, 250.0, 900.0)


@pytest.fixture(scope="module")
def church():
    return windows(height=HEIGHT)


@pytest.fixture(scope="module")
def church_lobes(church):
    return PhongLobes.build(church.radiance)


def directions(count, seed=0):
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    poles_and_seam = [[0, 1, 0], [0, -1, 0], [1e-6, 0.2, -1], [-1e-6, 0.2, -1]]
    vectors = np.concatenate([vectors, poles_and_seam])
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def brute_force(radiance, mirror, exponent, inside=6):
    fine = radiance.shape[0] * inside
    weight = latlong.row_solid_angles(fine, 2 * fine)
    light = np.repeat(np.repeat(np.asarray(radiance, np.float64), inside, 0), inside, 1)
    light = (light * weight[:, None, None]).reshape(-1, 3)
    source = latlong.texel_directions(fine, 2 * fine).reshape(-1, 3)
    values = []
    for axis in mirror:
        cosine = source @ axis
        near = np.flatnonzero(cosine > 1e-8 ** (1.0 / exponent))
        values.append((exponent + 1.0) / (2.0 * np.pi) * cosine[near] ** exponent @ light[near])
    return np.stack(values)


radiance = jax.jit(PhongLobes.radiance)


def look_up(lobes, mirror, exponent):
    exponent = jnp.full(len(mirror), exponent, jnp.float32)
    return np.asarray(radiance(lobes, jnp.float32(mirror), exponent))


@pytest.mark.parametrize("exponent", EXPONENTS)
def test_agrees_with_brute_force_on_hard_light(church, church_lobes, exponent):
    mirror = directions(20)
    expected = brute_force(church.radiance, mirror, exponent)
    error = np.abs(look_up(church_lobes, mirror, exponent) - expected)
    assert error.mean() < 0.01 * expected.mean()
    assert np.median(error / expected) < 0.01


def test_a_uniform_sky_has_the_same_radiance_in_every_lobe():
    lobes = PhongLobes.build(uniform(height=HEIGHT).radiance)
    for exponent in (0.0, 0.4, 13.0, 700.0, 19998.0, 1e6):
        np.testing.assert_allclose(look_up(lobes, directions(20), exponent), 1.0, rtol=2e-5)


def test_exponents_beyond_the_sharpest_count_as_it(church_lobes):
    mirror = directions(20)
    sharpest = look_up(church_lobes, mirror, LARGEST_EXPONENT)
    np.testing.assert_array_equal(look_up(church_lobes, mirror, 1e7), sharpest)


def test_has_a_gradient_in_the_exponent(church_lobes):
    mirror, exponent, step = jnp.float32(directions(3)[:1]), jnp.asarray([30.0]), 0.05

    def value(exponent):
        return radiance(church_lobes, mirror, exponent).sum()

    rise = value(exponent + step) - value(exponent - step)
    _, slope = jax.jvp(value, (exponent,), (jnp.ones(1),))
    np.testing.assert_allclose(slope, rise / (2.0 * step), rtol=0.01)
