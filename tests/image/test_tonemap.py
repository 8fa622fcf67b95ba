"""One exposure and the sRGB curve."""

import numpy as np
import pytest

from jaxvis.image import display, exposure_of, luminance, srgb_encode


def test_luminance_of_primaries_and_white():
    assert np.allclose(luminance(np.eye(3)), [0.2126, 0.7152, 0.0722])
    assert luminance(np.ones((1, 3)))[0] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("linear", "encoded"),
    [
        (0.0, 0.0),
        (0.0031308, 0.0404499),  # where the two pieces of the standard meet
        (0.2140411, 0.5),
        (1.0, 1.0),
        (0.18, 0.46135613),
        (7.0, 1.0),
        (-1.0, 0.0),
    ],
)
def test_srgb_curve(linear, encoded):
    assert srgb_encode(np.array([linear]))[0] == pytest.approx(encoded, abs=2e-6)


def test_srgb_inverts_the_standard_decoding():
    code = np.linspace(0.0, 1.0, 257)
    linear = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    assert np.allclose(srgb_encode(linear), code, atol=1e-6)


def test_exposure_maps_the_percentile_of_covered_pixels_to_one():
    grey = np.arange(1001.0).reshape(7, 143) / 100.0
    reference = np.repeat(grey[..., None], 3, axis=-1)
    covered = np.ones(grey.shape, bool)
    assert exposure_of(reference, covered) == pytest.approx(1.0 / 9.95)  # order statistic 995


def test_exposure_ignores_uncovered_pixels_and_black_stays_black():
    reference = np.full((4, 4, 3), 2.0)
    covered = np.ones((4, 4), bool)
    covered[0], reference[0] = False, 1e6
    assert exposure_of(reference, covered) == pytest.approx(0.5)
    assert exposure_of(np.zeros((4, 4, 3)), covered) == 1.0
    with pytest.raises(ValueError, match="no pixel sees the scene"):
        exposure_of(reference, np.zeros((4, 4), bool))


def test_display_exposes_then_encodes():
    pixels = np.full((2, 3, 3), 0.428082, np.float32)
    shown = display(pixels, 0.5)
    assert shown.dtype == np.float32
    assert np.allclose(shown, 0.5, atol=1e-5)
