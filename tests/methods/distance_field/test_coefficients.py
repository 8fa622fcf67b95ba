"""Maps as spherical harmonics of the world's directions, and the errors between them."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import sph_harm_y

from jaxvis.methods.distance_field.coefficients import (
    FEWEST,
    magnitude,
    map_coefficients,
    visibility_error,
)
from jaxvis.sphere import harmonics
from jaxvis.sphere.hemisphere_grid import texel_directions, texel_solid_angles


def random_frames(count, seed=0):
    """Right-handed orthonormal rows, in all directions."""
    rows = np.linalg.qr(np.random.default_rng(seed).normal(size=(count, 3, 3)))[0]
    return (rows * np.sign(np.linalg.det(rows))[:, None, None]).astype(np.float32)


def summed(maps, frames):
    """Sum over the texels of the basis in world directions, in double precision."""
    size = maps.shape[-1]
    weight = texel_solid_angles(size)[:, None] * maps
    world = np.einsum("ijk,skc->sijc", texel_directions(size).astype(np.float64), frames)
    basis = np.asarray(harmonics.evaluate(jnp.asarray(world, jnp.float32), 4))
    return np.einsum("sij,sijb->sb", weight, basis)


def random_maps(count, size, seed=0):
    return np.random.default_rng(seed).random((count, size, size)) < 0.6


@pytest.mark.parametrize("size", [16, 32])
def test_coefficients_are_sums_over_world_directions(size):
    maps, frames = random_maps(12, size), random_frames(12)
    found = map_coefficients(maps, frames)
    np.testing.assert_allclose(found, summed(maps, frames), atol=2e-5)
    # In the local frame they are others.
    assert np.abs(found - summed(maps, np.repeat(np.eye(3)[None], 12, axis=0))).max() > 0.1


@pytest.mark.parametrize("size", [64, 128, 48])
def test_fine_maps_are_averaged_first(size):
    """32 x 32 texels say as much: a bandlimited basis does not see what is finer."""
    theta, phi = np.meshgrid(*2 * [(np.arange(size) + 0.5) * np.pi / size], indexing="ij")
    maps = np.stack([theta + 0.3 * np.sin(5 * phi) < 1.2, phi > 1.0, np.cos(7 * theta) > 0.0])
    frames = random_frames(3)
    np.testing.assert_allclose(map_coefficients(maps, frames), summed(maps, frames), atol=0.004)


def test_the_first_coefficients_of_an_open_map():
    """Of a hemisphere about n: sqrt(pi) for the mean, and the cosine's pi / 2 x sqrt(3 / pi) n."""
    frames = random_frames(5)
    found = map_coefficients(np.ones((5, 32, 32), bool), frames)
    np.testing.assert_allclose(found[:, 0], np.sqrt(np.pi), rtol=1e-5)
    linear = np.linalg.norm(found[:, 1:4], axis=-1)
    np.testing.assert_allclose(linear, np.pi * np.sqrt(3.0 / (4.0 * np.pi)), rtol=2e-3)
    # Of a function that is even about the plane but for a half, the second band is 0.
    np.testing.assert_allclose(found[:, 4:9], 0.0, atol=3e-3)


def test_energies_of_bands_are_those_of_the_map_whatever_the_frame():
    """An independent basis: SciPy's complex harmonics in the local frame."""
    maps = random_maps(3, 32)
    found = map_coefficients(maps, random_frames(3))
    x, y, z = np.moveaxis(texel_directions(32).astype(np.float64), -1, 0)
    polar, azimuth = np.arccos(z), np.arctan2(y, x)
    weight = texel_solid_angles(32)[:, None] * maps
    for band in range(4):
        own = sum(
            np.abs((weight * sph_harm_y(band, order, polar, azimuth)).sum(axis=(1, 2))) ** 2
            for order in range(-band, band + 1)
        )
        energy = np.square(found[:, band**2 : (band + 1) ** 2]).sum(axis=-1)
        np.testing.assert_allclose(energy, own, rtol=1e-3, atol=1e-6)


def test_turning_the_frame_about_its_normal_changes_nothing():
    """The same occluder, a cap about a world direction, in maps that are turned."""
    towards = np.array([0.3, 0.5, 0.81])
    towards /= np.linalg.norm(towards)
    maps, frames = [], []
    for turn in np.linspace(0.0, 2.0 * np.pi, 7):
        c, s = np.cos(turn), np.sin(turn)
        frame = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        maps.append(texel_directions(128) @ frame @ towards < np.cos(0.5))
        frames.append(frame)
    found = map_coefficients(np.array(maps), np.array(frames, np.float32))
    np.testing.assert_allclose(found, np.repeat(found[:1], 7, axis=0), atol=0.01)
    # A quarter turn of the map that the frame does not follow is seen.
    other = map_coefficients(np.array(maps[:1]).transpose(0, 2, 1), found_frames(frames))
    assert np.abs(other - found[:1]).max() > 0.05


def found_frames(frames):
    return np.array(frames[:1], np.float32)


def test_errors_are_symmetric_sums_and_obey_the_triangle():
    a, b, c = np.random.default_rng(0).normal(size=(3, 10, 16)).astype(np.float32)
    np.testing.assert_array_equal(visibility_error(a, b), visibility_error(b, a))
    assert visibility_error(a, a).max() == 0.0
    expected = [
        sum(abs(float(p) - float(q)) for p, q in zip(*rows, strict=True))
        for rows in zip(a, b, strict=True)
    ]
    np.testing.assert_allclose(visibility_error(a, b), expected, rtol=1e-5)
    assert np.all(visibility_error(a, c) <= visibility_error(a, b) + visibility_error(b, c) + 1e-5)
    assert visibility_error(a[:, None], b[None]).shape == (10, 10)


def test_dark_maps_count_as_a_twentieth_of_an_open_one():
    frames = np.repeat(np.eye(3, dtype=np.float32)[None], 3, axis=0)
    maps = np.zeros((3, 32, 32), bool)
    maps[1] = True
    maps[2, 16, 16] = True
    coefficients = map_coefficients(maps, frames)
    open_size = float(np.abs(coefficients[1]).sum())
    size = magnitude(coefficients)
    np.testing.assert_allclose(size, [FEWEST * open_size, open_size, FEWEST * open_size], rtol=1e-5)
    assert np.abs(coefficients[0]).max() < 1e-6
    assert 0.0 < np.abs(coefficients[2]).sum() < FEWEST * open_size
