"""Turning and resizing lat-long maps: exact averages."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxvis.lighting.resampling import box_overlap, resize, rotate
from jaxvis.sphere import latlong

QUICK = settings(max_examples=10, deadline=None, derandomize=True)


def noise(height, seed=0):
    return jnp.asarray(np.random.default_rng(seed).random((height, 2 * height, 3)), jnp.float32)


def energy(radiance):
    weights = latlong.row_solid_angles(*radiance.shape[:2])
    return np.einsum("h,hwc->c", weights, np.asarray(radiance, np.float64))


def slow_resize(radiance, height):
    """Oracle: the overlap of every source texel with every target texel."""
    rows, columns, channels = radiance.shape
    lines = [np.cos(np.pi * np.arange(n + 1) / n) for n in (rows, height)]
    sides = [np.linspace(0.0, 1.0, n + 1) for n in (columns, 2 * height)]
    out = np.zeros((height, 2 * height, channels))
    for i in range(height):
        for j in range(2 * height):
            tall = np.maximum(
                0.0,
                np.minimum(lines[0][:-1], lines[1][i]) - np.maximum(lines[0][1:], lines[1][i + 1]),
            )
            wide = np.maximum(
                0.0,
                np.minimum(sides[0][1:], sides[1][j + 1]) - np.maximum(sides[0][:-1], sides[1][j]),
            )
            weight = tall[:, None] * wide
            out[i, j] = np.einsum("rc,rck->k", weight, radiance) / weight.sum()
    return out


@pytest.mark.parametrize(("source", "target"), [(8, 4), (8, 5), (6, 13), (4, 12), (5, 1)])
def test_resizing_averages_over_exact_overlaps(source, target):
    radiance = noise(source)
    resized = resize(radiance, target, 2 * target)
    expected = slow_resize(np.asarray(radiance, np.float64), target)
    np.testing.assert_allclose(resized, expected, rtol=1e-5)
    np.testing.assert_allclose(energy(resized), energy(radiance), rtol=1e-5)


@pytest.mark.parametrize("row", [0, 3, 20, 31])
@pytest.mark.parametrize("target", [1, 7, 16, 45, 64])
def test_a_one_texel_sun_keeps_its_energy(row, target):
    sun = jnp.zeros((32, 64, 3)).at[row, 63].set(1e5)
    np.testing.assert_allclose(energy(resize(sun, target, 2 * target)), energy(sun), rtol=1e-5)


def test_a_whole_multiple_and_back_is_the_identity():
    radiance = noise(6)
    finer = resize(radiance, 18, 36)
    np.testing.assert_allclose(finer, np.repeat(np.repeat(radiance, 3, 0), 3, 1), rtol=1e-6)
    np.testing.assert_allclose(resize(finer, 6, 12), radiance, rtol=1e-6)


def test_resizing_can_be_jitted_mapped_and_differentiated():
    radiance = noise(4)
    small = jax.jit(lambda r: resize(r, 3, 6))
    np.testing.assert_allclose(
        jax.vmap(small)(jnp.stack([radiance, 2 * radiance]))[1], 2 * small(radiance), rtol=1e-6
    )
    gradient = jax.grad(lambda r: small(r)[1, 2, 0])(radiance)
    np.testing.assert_allclose(gradient.sum(), 1.0, rtol=1e-6)  # an average
    assert np.all(np.asarray(gradient[..., 1:]) == 0.0)


@QUICK
@given(st.integers(1, 30), st.integers(1, 30))
def test_overlaps_tile_both_partitions(one, other):
    source = np.sort(np.append(np.random.default_rng(one).random(one - 1), [0.0, 1.0]))
    target = np.linspace(0.0, 1.0, other + 1)
    cell, into, share = box_overlap(source, target)
    np.testing.assert_allclose(np.bincount(into, share), 1.0)
    kept = np.bincount(cell, share / other, minlength=one)
    np.testing.assert_allclose(kept, np.diff(source), atol=1e-12)


@pytest.mark.parametrize("columns", [0, 1, 5, 16, -3, 40])
def test_turning_by_whole_texels_is_a_roll(columns):
    radiance = noise(8)
    yaw = 2.0 * np.pi * columns / 16
    np.testing.assert_array_equal(rotate(radiance, yaw), jnp.roll(radiance, -columns, axis=1))


@QUICK
@given(st.floats(-20.0, 20.0), st.integers(0, 7))
def test_turning_keeps_energy_and_moves_the_centroid(yaw, row):
    sun = jnp.zeros((8, 16, 1)).at[row, 5].set(3.0)
    turned = np.asarray(rotate(sun, yaw), np.float64)
    np.testing.assert_allclose(energy(turned), energy(sun), rtol=1e-5)
    column = np.flatnonzero(turned[row, :, 0] > 1e-6)
    assert len(column) in (1, 2)
    start = 5.5 - yaw * 16 / (2.0 * np.pi)
    away = np.mod(column + 0.5 - start + 8.0, 16.0) - 8.0
    np.testing.assert_allclose(away @ turned[row, column, 0], 0.0, atol=1e-4)


def test_a_traced_angle_gives_the_same_and_has_a_gradient():
    radiance = noise(8)
    yaw = 1.234
    np.testing.assert_allclose(
        jax.jit(rotate)(radiance, jnp.float32(yaw)), rotate(radiance, yaw), atol=1e-5
    )
    derivative = jax.grad(lambda a: rotate(radiance, a)[3, 4, 1])(yaw)
    step = 1e-3
    difference = (rotate(radiance, yaw + step) - rotate(radiance, yaw - step))[3, 4, 1]
    np.testing.assert_allclose(derivative, difference / (2 * step), rtol=1e-2)
