"""Suns apart from the sky, and the sky averaged over cones in two halves."""

import math

import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.lighting import Environment, sky, uniform
from jaxvis.lighting.blur import phong_blur
from jaxvis.methods.cones.light import EXPONENT, ROWS, Sky, cone_light
from jaxvis.sphere import latlong
from tests.methods.known_scenes import contrasted


def energy(radiance):
    solid = latlong.row_solid_angles(*radiance.shape[:2])
    return (np.asarray(radiance, np.float64) * solid[:, None, None]).sum(axis=(0, 1))


def seen(smooth, along):
    """From above and from below the horizon together."""
    upper, lower = smooth.over(along)
    return upper + lower


def axes(count=200, seed=0):
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return jnp.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True), jnp.float32)


@pytest.mark.parametrize(
    ("elevation", "azimuth", "height"), [(0.8, 2.2, 128), (0.3, 0.0, 128), (1.2, 5.0, 256)]
)
def test_the_suns_direction_and_flux_are_the_skys(elevation, azimuth, height):
    environment = sky(elevation=elevation, azimuth=azimuth, height=height)
    light = cone_light(environment, 2, 64)
    expected = np.array(
        [
            math.cos(elevation) * math.sin(azimuth),
            math.sin(elevation),
            -math.cos(elevation) * math.cos(azimuth),
        ]
    )
    assert light.sun_directions.shape == (1, 3)
    apart = np.degrees(np.arccos(min(float(np.asarray(light.sun_directions)[0] @ expected), 1.0)))
    assert apart < 0.5
    # Flux of the disc: what texels within four degrees have above those around them.
    cosine = latlong.texel_directions(height, 2 * height) @ expected
    radiance = np.asarray(environment.radiance, np.float64)
    disc = cosine > math.cos(math.radians(4.0))
    around = np.median(radiance[(cosine > math.cos(math.radians(8.0))) & ~disc], axis=0)
    solid = latlong.row_solid_angles(height, 2 * height)[:, None, None]
    flux = ((radiance - around) * solid)[disc].sum(axis=0)
    np.testing.assert_allclose(np.asarray(light.sun_flux)[0], flux, rtol=0.1)
    # What is left of the sky has no sun: a cone that meets it is far from as bright as it was.
    kept = seen(light.sky, jnp.asarray(expected[None], jnp.float32))
    blurred = flux.max() * (EXPONENT + 1.0) / (2.0 * math.pi)
    assert float(kept.max()) < 0.3 * blurred


def test_no_suns_where_there_are_none_or_none_are_wanted():
    assert cone_light(uniform(1.0), 2, 64).sun_flux.shape == (0, 3)
    assert cone_light(uniform(0.0), 2, 64).sun_flux.shape == (0, 3)
    assert cone_light(sky(height=64), 0, 64).sun_flux.shape == (0, 3)


def test_no_more_suns_than_wanted_and_the_brightest_first():
    radiance = np.full((128, 256, 3), 0.01, np.float32)
    for row, column, value in ((20, 30, 200.0), (30, 100, 400.0), (40, 200, 300.0)):
        radiance[row, column] = value
    environment = Environment(jnp.asarray(radiance))
    solid = latlong.row_solid_angles(128, 256)
    light = cone_light(environment, 2, 64)
    flux = np.asarray(light.sun_flux)[:, 0]
    expected = [400.0 * solid[30], 300.0 * solid[40]]
    assert expected[0] > expected[1]
    np.testing.assert_allclose(flux, expected, rtol=0.05)
    assert len(cone_light(environment, 5, 64).sun_flux) == 3


@pytest.mark.parametrize("suns", [0, 2])
def test_cells_and_suns_have_the_energy_of_the_map(suns):
    environment = sky(height=128)
    light = cone_light(environment, suns, 64)
    assert len(light.flux) <= 64
    np.testing.assert_allclose(np.linalg.norm(light.directions, axis=-1), 1.0, atol=1e-5)
    total = np.asarray(light.flux, np.float64).sum(axis=0)
    total += np.asarray(light.sun_flux, np.float64).sum(axis=0)
    # Behind a sun's cell the sky goes on.
    np.testing.assert_allclose(total, energy(environment.radiance), rtol=0.003 if suns else 1e-5)


def test_a_whole_cone_sees_the_blurred_map():
    radiance = contrasted(16).radiance
    found = seen(Sky.of(radiance), axes())
    expected = latlong.bilinear(phong_blur(radiance, EXPONENT, ROWS), axes())
    np.testing.assert_allclose(found, expected, rtol=1e-3)


def test_irradiance_of_both_halves_is_that_of_the_map():
    environment = contrasted(16)
    smooth = Sky.of(environment.radiance)
    whole = environment.irradiance_map(ROWS)
    np.testing.assert_allclose(smooth.from_above + smooth.from_below, whole, rtol=1e-3)
    # A wall sees as much of each under a uniform sky.
    level = Sky.of(jnp.ones((16, 32, 3)))
    along = jnp.asarray([[1.0, 0.0, 0.0]])
    for half in (level.from_above, level.from_below):
        np.testing.assert_allclose(latlong.bilinear(half, along), 0.5 * math.pi, rtol=2e-3)


def test_a_free_surface_receives_what_the_halves_send():
    """Irradiance over the normal under a sky that is bright above and black below."""
    radiance = jnp.concatenate([jnp.ones((16, 64, 3)), jnp.zeros((16, 64, 3))])
    smooth = Sky.of(radiance)
    normals = axes()
    above = latlong.bilinear(smooth.from_above, normals)
    below = latlong.bilinear(smooth.from_below, normals)
    expected = 0.5 * math.pi * (1.0 + np.asarray(normals)[:, 1:2])
    np.testing.assert_allclose(above, np.repeat(expected, 3, axis=1), atol=0.02)
    assert float(jnp.abs(below).max()) < 1e-6
