"""The analytic sky."""

import importlib

import numpy as np
import pytest

from jaxvis.lighting import sky
from jaxvis.sphere import latlong

model = importlib.import_module("jaxvis.lighting.sky")
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def to_sun(elevation, azimuth=0.0):
    return np.array([
        np.cos(elevation) * np.sin(azimuth), np.sin(elevation), -np.cos(elevation) * np.cos(azimuth)
    ])  # fmt: skip


def horizontal_illuminance(environment):
    """klx, of a horizontal surface."""
    radiance = np.asarray(environment.radiance, np.float64) @ LUMINANCE
    cosine = np.maximum(latlong.texel_directions(*radiance.shape)[..., 1], 0.0)
    return (radiance * cosine * latlong.row_solid_angles(*radiance.shape)[:, None]).sum()


@pytest.mark.parametrize("turbidity", [2.0, 4.0, 10.0])
@pytest.mark.parametrize("elevation", [0.0, 0.05, 0.8, np.pi / 2])
def test_is_finite_and_not_negative_everywhere(turbidity, elevation):
    radiance = np.asarray(sky(turbidity, elevation, height=16).radiance)
    assert np.all(np.isfinite(radiance) & (radiance >= 0.0))
    assert radiance.max() > 0.0


@pytest.mark.parametrize(("elevation", "azimuth"), [(0.3, 1.0), (0.8, 4.0), (1.2, 5.9), (0.5, 0.0)])
@pytest.mark.parametrize("height", [15, 64])
def test_the_sun_stands_where_the_angles_say(elevation, azimuth, height):
    environment = sky(elevation=elevation, azimuth=azimuth, height=height)
    directions = latlong.texel_directions(height, 2 * height)
    brightest = directions.reshape(-1, 3)[np.argmax(environment.radiance.sum(axis=-1))]
    assert np.arccos(brightest @ to_sun(elevation, azimuth)) < 1.5 * np.pi / height


@pytest.mark.parametrize(("elevation", "azimuth"), [(0.6, 0.0), (1.5707963, 0.0), (0.3, 2.0)])
@pytest.mark.parametrize("height", [2, 17, 128, 600])
def test_the_disc_keeps_its_irradiance_at_any_resolution(elevation, azimuth, height):
    radius = model.SUN_RADIUS
    disc = model._sun_map(to_sun(elevation, azimuth), 3.0, radius, height)
    weights = latlong.row_solid_angles(height, 2 * height)
    total = np.einsum("h,hwc->c", weights, disc)
    solid_angle = 2.0 * np.pi * (1.0 - np.cos(radius))
    expected = model._sun_rgb(np.sin(elevation), 3.0) * solid_angle
    np.testing.assert_allclose(total, expected, rtol=1e-6)


def test_a_larger_disc_is_wider_and_has_the_same_irradiance():
    small = model._sun_map(to_sun(0.8), 3.0, model.SUN_RADIUS, 256)
    large = model._sun_map(to_sun(0.8), 3.0, 0.05, 256)
    weights = latlong.row_solid_angles(256, 512)
    np.testing.assert_allclose(
        np.einsum("h,hwc->c", weights, large), np.einsum("h,hwc->c", weights, small), rtol=1e-6
    )
    directions = latlong.texel_directions(256, 512)[large[..., 0] > 0.0]
    angle = np.arccos(np.clip(directions @ to_sun(0.8), -1.0, 1.0))
    assert 0.045 < angle.max() < 0.06


def test_half_of_a_setting_sun_is_hidden():
    disc = model._sun_map(to_sun(0.0), 3.0, 0.02, 64)
    assert np.all(disc[32:] == 0.0)
    risen = model._sun_map(to_sun(0.1), 3.0, 0.02, 64)
    share = np.count_nonzero(disc) and disc[..., 0].sum() / model._sun_rgb(0.0, 3.0)[0]
    whole = risen[..., 0].sum() / model._sun_rgb(np.sin(0.1), 3.0)[0]
    assert share / whole == pytest.approx(0.5, abs=0.03)


def test_the_zenith_has_preethams_luminance():
    """Worked by hand for turbidity 3 and the sun 0.8 rad high: 7.46 kcd/m²."""
    chi = (4.0 / 9.0 - 3.0 / 120.0) * (np.pi - 2.0 * (np.pi / 2 - 0.8))
    expected = (4.0453 * 3.0 - 4.9710) * np.tan(chi) - 0.2155 * 3.0 + 2.4192
    overhead = model._sky_rgb(np.array([0.0, 1.0, 0.0]), to_sun(0.8), 3.0)
    assert overhead @ LUMINANCE == pytest.approx(expected, rel=2e-3)
    assert expected == pytest.approx(7.46, abs=0.01)


def test_scale_and_colours_are_those_of_daylight():
    clear = sky(turbidity=2.5, elevation=1.0, height=64)
    assert 80.0 < horizontal_illuminance(clear) < 130.0  # klx
    disc = model._sun_rgb(np.sin(1.0), 2.5)
    assert 0.8e6 < disc @ LUMINANCE < 1.8e6  # kcd/m²
    assert disc[0] > disc[1] > disc[2]
    overhead = model._sky_rgb(np.array([0.3, 0.9, 0.3]), to_sun(0.5), 2.5)
    assert overhead[2] > overhead[1] > overhead[0]
    low, high = (model._sun_rgb(np.sin(e), 2.5) for e in (0.05, 1.0))
    assert low[0] / low[1] > 1.5 * high[0] / high[1]  # sunsets are red
    assert np.all(model._sun_rgb(0.5, 6.0) < model._sun_rgb(0.5, 3.0))  # haze dims the sun


def test_the_sun_outside_the_atmosphere_has_its_known_luminance():
    """133 klx over 6.8e-5 sr; a black body of 5778 K is within some percent of it."""
    wavelength = np.arange(380.0, 781.0, 5.0)
    metres = wavelength * 1e-9
    planck = 1.191043e-16 / metres**5 / np.expm1(1.438777e-2 / (metres * 5778.0))
    luminance = 683.0 * (model._matching_functions(wavelength)[1] * planck).sum() * 5e-9
    assert luminance == pytest.approx(1.95e9, rel=0.08)


def test_the_matching_functions_have_the_observers_integrals():
    x, y, z = model._matching_functions(np.arange(360.0, 831.0)).sum(axis=1)
    np.testing.assert_allclose([x, y, z], 106.87, rtol=0.01)


@pytest.mark.parametrize("ground", [0.0, 0.5, (0.1, 0.2, 0.4)])
@pytest.mark.parametrize("height", [32, 33])
def test_the_ground_is_matt_and_lit_by_the_sky(ground, height):
    environment = sky(elevation=0.7, ground=ground, height=height)
    radiance = np.asarray(environment.radiance, np.float64)
    below = radiance[(height + 1) // 2 :]
    assert np.ptp(below, axis=(0, 1)).max() == 0.0
    cosine = np.maximum(latlong.texel_directions(height, 2 * height)[..., 1], 0.0)
    weights = latlong.row_solid_angles(height, 2 * height)[:, None]
    irradiance = np.einsum("hw,hwc->c", cosine * weights, radiance)
    np.testing.assert_allclose(below[0, 0], np.asarray(ground) * irradiance / np.pi, rtol=1e-3)


def test_azimuth_is_a_rotation():
    one = sky(azimuth=0.0, height=16)
    other = sky(azimuth=np.pi / 2, height=16)
    np.testing.assert_allclose(one.rotate(-np.pi / 2).radiance[:8], other.radiance[:8], rtol=0.02)


@pytest.mark.parametrize("bad", [
    {"turbidity": 1.0}, {"turbidity": np.nan}, {"elevation": -0.1}, {"elevation": 2.0},
    {"azimuth": np.inf}, {"ground": 1.5}, {"ground": (0.1, 0.2, -0.3)}, {"sun_radius": 0.0},
    {"sun_radius": 1.0}, {"height": 1},
])  # fmt: skip
def test_parameters_out_of_range_are_named(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        sky(**bad)
