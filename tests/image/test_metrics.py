"""Metrics against closed forms, scikit-image, and their own invariances."""

import builtins

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jaxtyping import TypeCheckError

from jaxvis.image import (
    display,
    displayed_error,
    exposure_of,
    flip,
    psnr,
    relative_rmse,
    relmse,
    rmse,
)

FULL = np.ones((8, 9), bool)


def _pair(seed=0):
    random = np.random.default_rng(seed)
    reference = random.gamma(1.0, 1.0, (8, 9, 3)).astype(np.float32)
    image = reference * random.uniform(0.8, 1.2, reference.shape).astype(np.float32)
    return image, reference


def test_psnr_of_a_constant_offset_after_encoding():
    # White stays white; half the pixels differ by exactly 0.1 of an encoded level.
    decode = lambda code: ((code + 0.055) / 1.055) ** 2.4  # noqa: E731
    reference = np.full((8, 10, 3), decode(0.5))
    reference[0] = 1.0
    image = reference.copy()
    image[1:, ::2] = decode(0.6)
    covered = np.ones((8, 10), bool)
    mean_square = 0.1**2 * 35 / 80
    assert psnr(image, reference, covered, 1.0) == pytest.approx(
        -10.0 * np.log10(mean_square), abs=1e-9
    )
    assert displayed_error(image, reference, covered, 1.0)[1, 0] == pytest.approx(0.1)


def test_psnr_agrees_with_scikit_image_on_displayed_pixels():
    metrics = pytest.importorskip("skimage.metrics")
    image, reference = _pair()
    exposure = exposure_of(reference, FULL)
    expected = metrics.peak_signal_noise_ratio(
        display(reference, exposure).astype(np.float64),
        display(image, exposure).astype(np.float64),
        data_range=1.0,
    )
    assert psnr(image, reference, FULL) == pytest.approx(expected, abs=1e-4)


def test_equal_images():
    _, reference = _pair()
    assert psnr(reference, reference, FULL) == float("inf")
    assert rmse(reference, reference, FULL) == 0.0
    assert relative_rmse(reference, reference, FULL) == 0.0
    assert relmse(reference, reference, FULL) == 0.0


def test_rmse_closed_forms():
    reference = np.full((8, 9, 3), 2.0)
    image = reference + np.array([0.3, 0.0, -0.4])
    assert rmse(image, reference, FULL) == pytest.approx(np.sqrt(0.25 / 3.0))
    assert relative_rmse(image, reference, FULL) == pytest.approx(np.sqrt(0.25 / 3.0) / 2.0)
    # The exposure is 1/2, so that epsilon in the light's unit is 0.01 * 2².
    assert relmse(image, reference, FULL) == pytest.approx(0.25 / 3.0 / (4.0 + 0.04))


def test_relative_rmse_of_a_black_reference():
    black = np.zeros((8, 9, 3))
    assert relative_rmse(black, black, FULL) == 0.0
    assert relative_rmse(black + 1.0, black, FULL) == float("inf")


@settings(max_examples=15, deadline=None, derandomize=True)
@given(scale=st.floats(1e-3, 1e3), seed=st.integers(0, 99))
def test_the_unit_of_light_does_not_matter(scale, seed):
    image, reference = (pixels.astype(np.float64) for pixels in _pair(seed))
    for metric in (psnr, relative_rmse, relmse):
        assert metric(scale * image, scale * reference, FULL) == pytest.approx(
            metric(image, reference, FULL), rel=1e-9
        )
    assert rmse(scale * image, scale * reference, FULL) == pytest.approx(
        scale * rmse(image, reference, FULL), rel=1e-9
    )


@pytest.mark.parametrize("metric", [psnr, rmse, relative_rmse, relmse, flip])
def test_only_covered_pixels_count(metric):
    image, reference = _pair()
    covered = FULL.copy()
    covered[:2] = False
    spoiled = image.copy()
    spoiled[:2] = 1e4
    value = metric(image, reference, covered)
    if value is None:
        pytest.skip("flip-evaluator is not installed")
    assert metric(spoiled, reference, covered) == pytest.approx(value)
    spoiled[2, 0] = 1e4
    assert metric(spoiled, reference, covered) != pytest.approx(value)


@pytest.mark.parametrize("metric", [psnr, rmse, relative_rmse, relmse, flip])
def test_bad_shapes_and_empty_coverage_are_refused(metric):
    image, reference = _pair()
    with pytest.raises(ValueError, match="no pixel sees the scene"):
        metric(image, reference, np.zeros((8, 9), bool))
    with pytest.raises((ValueError, TypeCheckError)):
        metric(image, reference, np.ones((8, 8), bool))


def test_flip_orders_images_and_is_zero_for_equal_ones():
    pytest.importorskip("flip_evaluator")
    image, reference = _pair()
    worse = reference + 3.0 * (image - reference)
    assert flip(reference, reference, FULL) == pytest.approx(0.0, abs=1e-6)
    assert 0.0 < flip(image, reference, FULL) < flip(np.maximum(worse, 0), reference, FULL) < 1.0


def test_flip_is_none_without_its_package(monkeypatch):
    real_import = builtins.__import__

    def without_flip(name, *args, **kwargs):
        if name == "flip_evaluator":
            raise ImportError(name)
        return real_import(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without_flip)
    image, reference = _pair()
    assert flip(image, reference, FULL) is None
