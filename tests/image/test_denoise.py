"""Open Image Denoise: what it must do to simple images, and what is said where it is missing."""

import inspect
import sys

import numpy as np
import pytest

from jaxvis.image.denoise import denoise, denoiser

SIZE = (48, 40, 3)


def guides(size=SIZE):
    """Two halves of different albedo that face different ways."""
    albedo, normal = np.full(size, 0.8, np.float32), np.zeros(size, np.float32)
    albedo[:, size[1] // 2 :] = (0.2, 0.3, 0.5)
    normal[:, : size[1] // 2, 1] = 1.0
    normal[:, size[1] // 2 :, 0] = 1.0
    return albedo, normal


def clean_and_noisy(scale=1.0, seed=0):
    """Light that falls off downwards on the two halves, and the same with noise of mean 1."""
    albedo, _ = guides()
    clean = scale * albedo * np.linspace(1.0, 0.3, SIZE[0], dtype=np.float32)[:, None, None]
    noise = np.random.default_rng(seed).gamma(2.0, 0.5, (*SIZE[:2], 1)).astype(np.float32)
    return clean, clean * noise


def rmse(a, b):
    return np.sqrt(np.mean(np.square(np.asarray(a, np.float64) - b)))


@pytest.mark.parametrize("scale", [1e-3, 1.0, 500.0])
def test_noise_goes_whatever_the_unit(scale):
    clean, noisy = clean_and_noisy(scale)
    given = noisy.copy()
    done = denoise(noisy, *guides())
    assert done.shape == SIZE
    assert done.dtype == np.float32
    assert np.all(np.isfinite(done))
    assert np.all(done >= 0.0)
    assert rmse(done, clean) < 0.25 * rmse(noisy, clean)
    np.testing.assert_array_equal(noisy, given)
    np.testing.assert_array_equal(done, denoise(noisy, *guides()))  # deterministic


def test_guides_keep_the_edge_between_materials():
    clean, noisy = clean_and_noisy()
    flat = np.zeros(SIZE, np.float32)
    edge = np.s_[:, SIZE[1] // 2 - 2 : SIZE[1] // 2 + 2]
    guided, blind = denoise(noisy, *guides()), denoise(noisy, flat, flat)
    assert rmse(guided[edge], clean[edge]) < rmse(blind[edge], clean[edge])


@pytest.mark.parametrize("value", [0.01, 1.0, 50.0])
def test_a_constant_stays_constant_to_its_edges(value):
    flat = np.full((40, 56, 3), value, np.float32)
    albedo, normal = np.full_like(flat, 0.8), np.zeros_like(flat)
    normal[..., 2] = 1.0
    np.testing.assert_allclose(denoise(flat, albedo, normal), value, rtol=0.01)


@pytest.mark.parametrize("size", [(1, 1, 3), (1, 30, 3), (7, 3, 3)])
def test_small_images_keep_their_size(size):
    done = denoise(np.ones(size), np.ones(size), np.zeros(size))
    assert done.shape == size
    np.testing.assert_allclose(done, 1.0, rtol=0.1)


def test_black_stays_black():
    black = np.zeros(SIZE, np.float32)
    np.testing.assert_allclose(denoise(black, *guides()), 0.0, atol=1e-6)


def test_wrong_images_are_named():
    image = np.ones(SIZE)
    with pytest.raises(ValueError, match=r"albedo \(48, 39, 3\) and radiance .* differ in size"):
        inspect.unwrap(denoise)(image, image[:, 1:], image)  # without the tests' own check
    with pytest.raises(ValueError, match="normal: must be finite"):
        denoise(image, image, np.full(SIZE, np.nan))
    with pytest.raises(ValueError, match="without pixels"):
        denoise(image[:0], image[:0], image[:0])


def test_a_missing_extra_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyoidn", None)  # its import fails
    with pytest.raises(ValueError, match=r'pip install "jaxvis\[denoise\]"$'):
        denoise(np.ones(SIZE), np.ones(SIZE), np.ones(SIZE))


def test_an_old_version_says_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyoidn", type(sys)("pyoidn"))
    with pytest.raises(ValueError, match="too old"):
        denoiser()
