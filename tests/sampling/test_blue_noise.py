"""Blue noise: every value once, little power at low frequencies, no seam where the tile repeats."""

import numpy as np
import pytest

from jaxvis.sampling.blue_noise import blue_noise


def spectrum(tile):
    """(frequency of each wave in cycles a pixel, its power; 1 on average for white noise)."""
    size = len(tile)
    frequencies = np.fft.fftfreq(size)
    radius = np.hypot(*np.meshgrid(frequencies, frequencies, indexing="ij"))
    power = np.abs(np.fft.fft2(tile - tile.mean())) ** 2 / (tile.size * tile.var())
    return radius, power


def neighbour_steps(tile):
    """Differences between neighbours, across the seam too."""
    return np.concatenate([(tile - np.roll(tile, 1, axis)).reshape(-1) for axis in (0, 1)])


@pytest.mark.parametrize(("size", "seed"), [(64, 0), (16, 0), (16, 5), (4, 0), (7, 0)])
def test_each_value_is_taken_once(size, seed):
    tile = blue_noise(size, seed)
    assert tile.shape == (size, size)
    assert tile.dtype == np.float32
    expected = (np.arange(size * size) + 0.5) / size**2
    np.testing.assert_allclose(np.sort(tile.reshape(-1)), expected, rtol=1e-6)


def test_low_frequencies_have_next_to_no_power():
    radius, power = spectrum(blue_noise())
    low = (radius > 0.0) & (radius < 0.15)
    white = spectrum(np.random.default_rng(0).random((64, 64)))[1]
    assert power[low].mean() < 0.05
    assert 0.8 < white[low].mean() < 1.2
    assert power[radius > 0.3].mean() > 1.0


def test_no_direction_is_favoured():
    _, power = spectrum(blue_noise())
    rows, columns = power[:, 16:].mean(), power[16:, :].mean()
    assert 0.8 < rows / columns < 1.25


def test_neighbours_differ_more_than_those_of_white_noise():
    steps = np.abs(neighbour_steps(blue_noise()))
    white = np.random.default_rng(0).permutation(64 * 64).reshape(64, 64) / 64**2
    assert steps.mean() > 1.1 * np.abs(neighbour_steps(white)).mean()


def test_there_is_no_seam():
    tile = blue_noise()
    for axis in (0, 1):
        steps = np.abs(tile - np.roll(tile, 1, axis))
        inside, seam = np.delete(steps, 0, axis).mean(), np.take(steps, 0, axis).mean()
        assert seam == pytest.approx(inside, rel=0.3)


@pytest.mark.parametrize("share", [0.02, 0.05, 0.1, 0.2])
def test_what_lies_below_any_threshold_is_spread_evenly(share):
    """Nearest neighbours on the torus; among random points they are 1 / 2 sqrt(share) apart."""
    tile = blue_noise()
    points = np.argwhere(tile < share)
    apart = np.abs(points[:, None] - points[None])
    distance = np.hypot(*np.moveaxis(np.minimum(apart, 64 - apart), -1, 0))
    np.fill_diagonal(distance, np.inf)
    nearest = distance.min(axis=1)
    assert nearest.mean() > 1.3 * 0.5 / np.sqrt(share)
    if share <= 0.05:
        assert nearest.min() > 0.5 / np.sqrt(share)
    counts = (tile < share).reshape(4, 16, 4, 16).sum(axis=(1, 3))
    assert np.abs(counts - share * 256).max() < 0.5 * np.sqrt(share * 256) + 2.0


def test_it_is_made_once_and_cannot_be_written():
    tile = blue_noise()
    assert blue_noise() is tile
    with pytest.raises(ValueError, match="read-only"):
        tile[0, 0] = 1.0
    assert np.any(blue_noise(16, 1) != blue_noise(16, 0))


def test_a_tile_too_small_is_refused():
    with pytest.raises(ValueError, match="size must be at least 4, got 3"):
        blue_noise(3)
