"""Light without files."""

import numpy as np
import pytest
import scipy.ndimage

from jaxvis.lighting import load_environment, uniform, windows
from jaxvis.lighting.builtin import built_in
from jaxvis.sphere import latlong


@pytest.fixture(scope="module", params=[0, 7])
def interior(request):
    return np.asarray(windows(seed=request.param, height=128).radiance)


def test_walls_are_dark_windows_bright_and_the_dome_open(interior):
    brightness = interior.max(axis=-1)
    height = len(brightness)
    floor = interior[height // 2 :]
    assert floor.min() >= 0.05
    assert floor.max() <= 0.3
    dome = interior[: height // 16].max(axis=(0, 1))
    assert np.all(dome > 100.0)
    rows = np.pi / 2 - np.pi * (np.arange(height) + 0.5) / height  # elevation
    for low, high in ((0.1, 0.44), (0.66, 0.88)):
        row = interior[(rows > low) & (rows < high)]
        assert 20.0 <= row.max() <= 60.0
        assert 0.05 <= row.min() <= 0.3


def test_there_are_two_rows_of_windows_and_one_opening(interior):
    lit = interior[..., 1] > 5.0
    lit = np.roll(lit, -int(np.argmin(lit[: len(lit) // 2].sum(axis=0))), axis=1)
    _, count = scipy.ndimage.label(lit)
    assert count == 9 + 7 + 1


def test_is_hard_light(interior):
    """Few texels hold most of the energy."""
    luminance = interior.mean(axis=-1)
    share = latlong.row_solid_angles(*luminance.shape)[:, None] / (4.0 * np.pi)
    energy = luminance * share
    bright = luminance > 5.0
    assert (share * bright).sum() < 0.05
    assert energy[bright].sum() > 0.8 * energy.sum()


def test_windows_are_the_same_light_at_any_height():
    fine, coarse = windows(height=64), windows(height=16)
    np.testing.assert_allclose(fine.resize(16).radiance, coarse.radiance, rtol=0.3, atol=1.5)
    weights = [latlong.row_solid_angles(e.height, e.width) for e in (fine, coarse)]
    totals = [
        np.einsum("h,hwc->c", w, e.radiance) for w, e in zip(weights, (fine, coarse), strict=True)
    ]
    np.testing.assert_allclose(totals[0], totals[1], rtol=0.03)


def test_the_seed_decides():
    one, same, other = (windows(seed=s, height=16).radiance for s in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert np.abs(one - other).max() > 1.0


def test_uniform_light():
    environment = uniform((1.0, 2.0, 3.0), height=2)
    np.testing.assert_array_equal(environment.radiance, np.broadcast_to([1.0, 2.0, 3.0], (2, 4, 3)))
    np.testing.assert_array_equal(load_environment("uniform").radiance, 1.0)


def test_bad_parameters():
    with pytest.raises(ValueError, match="height"):
        windows(height=1)
    with pytest.raises(ValueError, match="seed"):
        windows(seed=-1)
    with pytest.raises(ValueError, match="height"):
        uniform(height=0)
    with pytest.raises(ValueError, match="no built-in environment 'fog': use one of sky"):
        built_in("fog")
