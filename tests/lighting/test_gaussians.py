"""Environments as lobes: energies are exact, partitions tile, fits find lobes that are there."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.lighting import Environment, cell_gaussians, fit_gaussians, sky, uniform, windows
from jaxvis.lighting.gaussians import LUMINANCE
from jaxvis.lighting.partition import partition
from jaxvis.sphere import latlong
from jaxvis.sphere.gaussians import SphericalGaussians

pytestmark = pytest.mark.usefixtures("own_caches")


def energy_of(environment):
    angles = latlong.row_solid_angles(environment.height, environment.width)
    return np.einsum("r,rcx->x", angles, np.asarray(environment.radiance, np.float64))


def one_texel(row, column, height=32):
    radiance = np.full((height, 2 * height, 3), 1e-3, np.float32)
    radiance[row, column] = [1e4, 2e4, 3e4]
    return Environment(jnp.asarray(radiance))


def of_lobes(lobes, height=64):
    d = jnp.asarray(latlong.texel_directions(height, 2 * height), jnp.float32)
    return Environment(lobes.mixture(d))


SOME = {
    "windows": lambda: windows(height=64),
    "sky": lambda: sky(height=64),
    "uniform": lambda: uniform((0.5, 1.0, 2.0), height=16),
    "texel": lambda: one_texel(9, 40),
    "pole": lambda: one_texel(0, 3),
}


@pytest.mark.parametrize("name", SOME)
@pytest.mark.parametrize("count", [8, 100, 512])
def test_cells_keep_all_energy(name, count):
    environment = SOME[name]()
    lobes = cell_gaussians(environment, count)
    assert lobes.axis.shape == (count, 3)
    np.testing.assert_allclose(lobes.integral().sum(axis=0), energy_of(environment), rtol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(lobes.axis, axis=-1), 1.0, atol=1e-6)
    assert np.asarray(lobes.amplitude).min() >= 0.0


@pytest.mark.parametrize("shape", [(1, 2), (2, 4), (5, 10), (64, 128)])
@pytest.mark.parametrize("count", [8, 9, 77, 3000])
def test_a_partition_tiles_the_map(shape, count):
    brightness = np.random.default_rng(0).random(shape) ** 8
    cells = partition(brightness, count)
    covered = np.zeros(shape, int)
    for top, bottom, left, right in cells:
        covered[top:bottom, left:right] += 1
    assert (covered == 1).all()
    assert len(cells) == min(count, brightness.size)


def test_cells_halve_the_energy_and_crowd_where_light_is():
    environment = one_texel(9, 40)
    cells = partition(np.asarray(environment.radiance)[..., 1] * 1.0, 40)
    assert [9, 10, 40, 41] in cells.tolist()
    two = np.zeros((16, 32))
    two[2, 3] = two[2, 5] = 1.0
    cells = partition(two, 9)
    split = [c for c in cells.tolist() if c[0] == 0 and c[3] <= 8]
    assert len(split) == 2  # the two texels' octant was the one to divide, between them
    assert split[0][3] in (4, 5)


def test_a_uniform_sky_is_divided_evenly():
    cells = partition(np.repeat(latlong.row_solid_angles(64, 128)[:, None], 128, axis=1), 256)
    edges = np.cos(np.pi * np.arange(65) / 64)
    areas = [(edges[a] - edges[b]) * (d - c) * 2.0 * np.pi / 128 for a, b, c, d in cells]
    assert np.max(areas) < 4.0 * np.pi / 256 * 3.0


def test_the_lobe_of_a_bright_texel_stands_in_it():
    environment = one_texel(9, 40)
    lobes = cell_gaussians(environment, 64)
    brightest = int(np.argmax(np.asarray(lobes.integral()) @ LUMINANCE))
    towards = latlong.texel_directions(32, 64)[9, 40]
    np.testing.assert_allclose(lobes.axis[brightest], towards, atol=1e-5)
    solid_angle = latlong.row_solid_angles(32, 64)[9]
    np.testing.assert_allclose(lobes.sharpness[brightest], 4.0 * np.pi / solid_angle, rtol=1e-3)
    np.testing.assert_allclose(
        lobes.integral()[brightest], np.array([1e4, 2e4, 3e4]) * solid_angle, rtol=1e-4
    )


def test_cells_give_the_irradiance_of_the_map():
    environment = windows(height=64)
    normals = np.random.default_rng(1).normal(size=(50, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    flux = np.asarray(environment.radiance, np.float64)
    flux = flux * latlong.row_solid_angles(64, 128)[:, None, None]
    cosine = np.maximum(latlong.texel_directions(64, 128) @ normals.T, 0.0)
    exact = np.einsum("rcn,rcx->nx", cosine, flux)
    errors = []
    for count in (32, 512):
        lobes = cell_gaussians(environment, count)
        found = np.maximum(normals @ np.asarray(lobes.axis).T, 0.0) @ np.asarray(lobes.integral())
        errors.append(np.abs(found - exact).mean() / exact.mean())
    assert errors[1] < 4e-3
    assert errors[1] < 0.2 * errors[0]


def test_black_maps_give_black_lobes():
    lobes = cell_gaussians(Environment(jnp.zeros((8, 16, 3))), 20)
    np.testing.assert_array_equal(lobes.amplitude, 0.0)
    assert np.isfinite(lobes.axis).all()
    fit = fit_gaussians(Environment(jnp.zeros((8, 16, 3))), 2, 5, height=8)
    np.testing.assert_array_equal(fit.lobes.amplitude, 0.0)
    assert np.isfinite(fit.lobes.axis).all()


def test_a_fit_finds_the_lobes_that_are_there():
    axis = np.array([[0.0, 1.0, 0.0], [0.8, -0.6, 0.0], [-0.6, 0.0, 0.8]])
    truth = SphericalGaussians(
        jnp.asarray(axis, jnp.float32),
        jnp.array([3.0, 20.0, 60.0]),
        jnp.array([[0.5, 0.4, 0.3], [5.0, 1.0, 0.5], [1.0, 10.0, 20.0]]),
    )
    fit = fit_gaussians(of_lobes(truth), 3, 600)
    assert fit.residual < 0.02
    np.testing.assert_allclose(fit.energy, 1.0, atol=0.02)
    for k in range(3):
        found = int(np.argmax(np.asarray(fit.lobes.axis) @ axis[k]))
        assert np.dot(fit.lobes.axis[found], axis[k]) > 0.999
        np.testing.assert_allclose(fit.lobes.sharpness[found], truth.sharpness[k], rtol=0.1)
        np.testing.assert_allclose(
            fit.lobes.amplitude[found], truth.amplitude[k], rtol=0.1, atol=0.05
        )


def test_a_fit_keeps_energy_and_more_lobes_or_steps_fit_better():
    environment = windows(height=32)
    fits = {
        (count, steps): fit_gaussians(environment, count, steps, height=32)
        for count, steps in ((8, 0), (8, 200), (40, 200))
    }
    for fit in fits.values():
        integral = fit.lobes.integral().sum(axis=0)
        np.testing.assert_allclose(integral, energy_of(environment), rtol=1e-4)
    residuals = [fit.weighted_residual for fit in fits.values()]
    assert residuals[0] > residuals[1] > 1.5 * residuals[2]
    again = fit_gaussians(environment, 8, 200, height=32, cached=False)
    for one, other in zip(
        [again.lobes.axis, again.lobes.sharpness, again.lobes.amplitude],
        [fits[8, 200].lobes.axis, fits[8, 200].lobes.sharpness, fits[8, 200].lobes.amplitude],
        strict=True,
    ):
        np.testing.assert_array_equal(one, other)


def test_a_sun_of_one_texel_is_not_lost():
    """Its neighbours' darkness must not outweigh it (the control: 0.99 with plain weights)."""
    environment = sky(height=64)
    fit = fit_gaussians(environment, 8, 200)
    assert fit.residual < 0.6
    brightest = np.unravel_index(np.argmax(np.asarray(environment.radiance)[..., 1]), (64, 128))
    sun = latlong.texel_directions(64, 128)[brightest]
    sharp = int(np.argmax(fit.lobes.sharpness))
    assert np.dot(fit.lobes.axis[sharp], sun) > np.cos(np.pi / 64)


def test_bad_numbers_are_named():
    with pytest.raises(ValueError, match="count must be at least 8, got 7"):
        cell_gaussians(uniform(), 7)
    with pytest.raises(ValueError, match="count must be at least 1"):
        fit_gaussians(uniform(), 0)
    with pytest.raises(ValueError, match="height must be at least 4"):
        fit_gaussians(uniform(), 4, height=2)
