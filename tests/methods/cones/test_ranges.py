"""Ranges of heights over rectangles against the texels themselves."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from jaxvis.methods.cones.ranges import hsat, hsat_range, pyramid, pyramid_range

SIZE = 256


def smooth_heights(size, sigma, seed=0):
    """Gaussian noise filtered over ``sigma`` texels, in [0.02, 0.98] (spec 4.4)."""
    noise = np.random.default_rng(seed).normal(size=(size, size))
    heights = gaussian_filter(noise, sigma, mode="wrap")
    return 0.02 + 0.96 * (heights - heights.min()) / (heights.max() - heights.min())


def windows(count, size, seed=0):
    """Rectangles of all sizes and shapes, many over the borders; lo and hi as [2, count]."""
    rng = np.random.default_rng(seed)
    extent = np.exp(rng.uniform(np.log(0.01), np.log(1.5 * size), (2, count)))
    lo = rng.uniform(-0.2 * size, 1.1 * size, (2, count))
    snap = rng.random(count) < 0.3
    lo, extent = np.where(snap, np.rint(lo), lo), np.where(snap, np.ceil(extent), extent)
    return lo.astype(np.float32), (lo + extent).astype(np.float32)


def squares(count, width, size, seed=0):
    corner = np.random.default_rng(seed).integers(0, size - width + 1, (2, count))
    return corner.astype(np.float32), (corner + width).astype(np.float32)


def touched_range(heights, lo, hi):
    """Brute force: of the texels that share area with the rectangle; (1, 0) if none does."""
    size, found = len(heights), []
    for (x0, z0), (x1, z1) in zip(lo.T, hi.T, strict=True):
        x0, z0, x1, z1 = max(x0, 0.0), max(z0, 0.0), min(x1, size), min(z1, size)
        if not (x0 < x1 and z0 < z1):
            found.append((1.0, 0.0))
            continue
        rows = slice(int(np.floor(z0)), int(np.ceil(z1)))
        part = heights[rows, int(np.floor(x0)) : int(np.ceil(x1))]
        found.append((part.min(), part.max()))
    return np.array(found).T


def asked(range_of, *arguments, **options):
    """Ranges of rectangles [2, count], as float64 [2, count]."""
    *tables, lo, hi = arguments
    pair = range_of(*tables, (*jnp.asarray(lo),), (*jnp.asarray(hi),), **options)
    return np.asarray(pair, np.float64)


@pytest.mark.parametrize("sigma", [0.0, 2.0, 14.0])
def test_the_pyramid_contains_every_texel_that_a_rectangle_touches(sigma):
    heights = smooth_heights(SIZE, sigma).astype(np.float32)
    lo, hi = windows(10_000, SIZE)
    low, high = asked(pyramid_range, pyramid(jnp.asarray(heights)), SIZE, lo, hi)
    least, most = touched_range(heights, lo, hi)
    empty = least > most
    assert 0.02 < empty.mean() < 0.5
    assert np.all(low <= least)
    assert np.all(high >= most)
    assert np.all((low[empty] == 1.0) & (high[empty] == 0.0))


def test_every_rectangle_of_whole_texels_of_a_small_map():
    heights = np.random.default_rng(3).random((8, 8)).astype(np.float32)
    ends = [(a, b) for a in range(8) for b in range(a + 1, 9)]
    lo = np.array([(x[0], z[0]) for x in ends for z in ends], np.float32).T
    hi = np.array([(x[1], z[1]) for x in ends for z in ends], np.float32).T
    low, high = asked(pyramid_range, pyramid(jnp.asarray(heights)), 8, lo, hi)
    least, most = touched_range(heights, lo, hi)
    assert np.all(low <= least)
    assert np.all(high >= most)
    whole = np.all(hi - lo == 8, axis=0)
    assert np.count_nonzero(whole) == 1
    np.testing.assert_allclose(high[whole], heights.max(), rtol=1e-3)
    np.testing.assert_allclose(low[whole], heights.min(), rtol=1e-3)


@pytest.mark.parametrize(("width", "excess"), [(4, 0.01), (16, 0.16), (64, 0.19)])
def test_the_pyramid_is_not_much_wider_than_it_must_be(width, excess):
    """Median excess in units of the height range, and never beyond the texels of a block."""
    heights = smooth_heights(512, 14.0).astype(np.float32)
    lo, hi = squares(2000, width, 512)
    low, high = asked(pyramid_range, pyramid(jnp.asarray(heights)), 512, lo, hi)
    least, most = touched_range(heights, lo, hi)
    # A block of at most 8/3 of the width holds the rectangle: it ends within 5/3 of it.
    beyond = 5 * width // 3
    around_least, around_most = touched_range(heights, lo - beyond, hi + beyond)
    assert np.all(low >= around_least - 1e-3)
    assert np.all(high <= around_most + 1e-3)
    wider = np.median((high - low) - (most - least))
    assert 0.0 < wider < excess


def test_blocks_are_five_thirds_as_wide_as_rectangles_on_average():
    """On a ramp a range tells how many texels were looked at; spec's 2 x 2 cells would be 2."""
    size = 1024
    ramp = np.tile((np.arange(size) + 0.5) / size, (size, 1)).astype(np.float32)
    rng = np.random.default_rng(4)
    # Whole octaves of widths, far from where the map ends.
    width = np.exp2(rng.uniform(4.0, 7.0, 4000)).astype(np.float32)
    lo = rng.uniform(0.0, size / 4, (2, 4000)).astype(np.float32)
    low, high = asked(pyramid_range, pyramid(jnp.asarray(ramp)), size, lo, lo + width)
    texels = (high - low) * size + 1.0
    touched = np.ceil(lo[0] + width) - np.floor(lo[0])
    assert np.all(texels > touched - 0.5)
    assert np.all(texels < 8.0 / 3.0 * touched + 0.5)
    # (1 / ln 2) (4 (1/2 - 1/3) + int_3^4 (4 w - 8) / w^2 dw), less what whole texels add.
    assert np.mean(texels / width) == pytest.approx(1.66, abs=0.08)


def test_storage_as_float16_keeps_the_bounds_only_if_rounded_outwards():
    heights = smooth_heights(SIZE, 14.0).astype(np.float32)
    table = pyramid(jnp.asarray(heights))
    assert table.dtype == jnp.float16
    exact = np.float64(heights)
    top = np.asarray(table, np.float64)[-1]
    assert top[0] <= exact.min()
    assert top[1] >= exact.max()
    np.testing.assert_allclose(top, [exact.min(), exact.max()], rtol=1e-3)
    nearest = heights.astype(np.float16).astype(np.float64)
    assert np.mean(nearest > exact) > 0.3  # what rounding to nearest would lose
    assert np.mean(nearest < exact) > 0.3


def test_values_at_the_ends_of_float16():
    heights = jnp.asarray([[0.0, 1.0], [1e-9, 0.33333334]], jnp.float32)
    table = np.asarray(pyramid(heights), np.float64).reshape(-1, 2)
    assert len(table) == 5
    assert table[-1].tolist() == [0.0, 1.0]
    single = table[3]  # the last texel has no further neighbours
    assert single[0] <= np.float32(0.33333334) <= single[1]
    assert single[1] - single[0] < 3e-4


def test_one_cell_of_the_ordinary_chain_is_no_bound():
    """Negative control: a rectangle that straddles cells needs its neighbours too."""
    heights = smooth_heights(SIZE, 14.0)
    lo, hi = squares(2000, 8, SIZE)
    _, most = touched_range(heights, lo, hi)
    chain = heights.reshape(SIZE // 8, 8, SIZE // 8, 8).max(axis=(1, 3))
    own = chain[lo[1].astype(int) // 8, lo[0].astype(int) // 8]
    assert np.mean(own < most) > 0.3


def test_rectangles_that_hold_nothing():
    table = pyramid(jnp.full((4, 4), 0.5))
    lo = np.array([[1.0, 3.0, 4.0, -3.0, np.nan], [1.0, 1.0, 0.0, 1.0, 0.0]], np.float32)
    hi = np.array([[1.0, 2.0, 9.0, 0.0, 2.0], [2.0, 2.0, 2.0, 2.0, 2.0]], np.float32)
    tables = hsat(np.full((4, 4), 0.5))
    for found in (asked(pyramid_range, table, 4, lo, hi), asked(hsat_range, tables, lo, hi)):
        np.testing.assert_array_equal(found, [[1.0] * 5, [0.0] * 5])


def test_queries_come_in_any_shape_and_inside_other_programs():
    heights = jnp.asarray(smooth_heights(SIZE, 14.0), jnp.float32)
    lo, hi = windows(24, SIZE)
    flat = asked(pyramid_range, pyramid(heights), SIZE, lo, hi)

    @jax.jit
    def nested(heights, lo, hi):
        return jnp.stack(pyramid_range(pyramid(heights), SIZE, (lo[0], lo[1]), (hi[0], hi[1])))

    shaped = nested(heights, lo.reshape(2, 2, 3, 4), hi.reshape(2, 2, 3, 4))
    np.testing.assert_array_equal(np.asarray(shaped, np.float64).reshape(2, -1), flat)


@pytest.mark.parametrize("shape", [(12, 12), (8, 16), (8,)])
def test_maps_of_other_shapes_are_refused(shape):
    for build in (pyramid, hsat):
        with pytest.raises((ValueError, TypeError)):
            build(jnp.zeros(shape))


def test_power_below_one_is_refused():
    with pytest.raises(ValueError, match="power"):
        hsat(np.full((4, 4), 0.5), power=0)


def power_mean_oracle(heights, lo, hi, power):
    """Eqs. 13 and 14 texel by texel, in float64."""
    found = []
    for (x0, z0), (x1, z1) in zip(lo.T.astype(int), hi.T.astype(int), strict=True):
        part = heights[z0:z1, x0:x1]
        least = 1.0 - np.mean((1.0 - part) ** power) ** (1.0 / power)
        found.append((least, np.mean(part**power) ** (1.0 / power)))
    return np.array(found).T


@pytest.mark.parametrize("width", [1, 4, 16, 64])
def test_power_means_are_those_of_the_texels(width):
    heights = smooth_heights(512, 14.0)
    lo, hi = squares(500, width, 512)
    found = asked(hsat_range, hsat(heights), lo, hi, window=np.inf, widening=0.0)
    np.testing.assert_allclose(found, power_mean_oracle(heights, lo, hi, 8), atol=2e-4)


@pytest.mark.parametrize(("width", "error"), [(4, 0.018), (16, 0.078), (64, 0.18)])
def test_power_means_miss_the_maximum_by_what_the_specification_says(width, error):
    """Spec 4.6, smooth terrain: mean errors in units of the height range, within 30 %."""
    heights = smooth_heights(512, 14.0)
    lo, hi = squares(4000, width, 512)
    low, high = asked(hsat_range, hsat(heights), lo, hi, window=np.inf, widening=0.0)
    least, most = touched_range(heights, lo, hi)
    assert np.mean(most - high) == pytest.approx(error, rel=0.3)
    assert np.mean(low - least) == pytest.approx(error, rel=0.3)
    assert np.all(high <= most + 1e-4)  # a lower bound of the maximum, never an upper one


def test_single_float32_sums_are_of_no_use_for_small_rectangles():
    """Negative control (spec 4.6): errors of up to 0.2 at p = 8 over 4 x 4 texels."""
    heights = smooth_heights(2048, 14.0)
    lo, hi = squares(4000, 4, 2048)
    exact = power_mean_oracle(heights, lo, hi, 8)
    sums = np.pad((heights**8).cumsum(0).cumsum(1), ((1, 0), (1, 0))).astype(np.float32)
    (x0, z0), (x1, z1) = lo.astype(int), hi.astype(int)
    total = (sums[z1, x1] - sums[z1, x0]) - (sums[z0, x1] - sums[z0, x0])
    single = np.maximum(total / 16.0, 0.0) ** 0.125
    pairs = asked(hsat_range, hsat(heights), lo, hi, window=np.inf, widening=0.0)
    assert np.abs(single - exact[1]).max() > 0.1
    assert np.abs(pairs - exact).max() < 2e-3


def test_the_papers_range_at_its_own_level_is_nearer_but_no_bound():
    """What the mip chain averages away between 64 and 4 texels, no widening of 0.05 brings back."""
    heights = smooth_heights(512, 14.0)
    lo, hi = squares(4000, 64, 512)
    _, most = touched_range(heights, lo, hi)
    tables = hsat(heights)
    _, far = asked(hsat_range, tables, lo, hi, window=np.inf, widening=0.0)
    _, near = asked(hsat_range, tables, lo, hi)
    assert np.mean(most - near) < 0.85 * np.mean(most - far)
    assert np.mean(near < most) > 0.9
    _, bound = asked(pyramid_range, pyramid(jnp.asarray(heights, jnp.float32)), 512, lo, hi)
    assert np.all(bound >= np.float32(most))


@pytest.mark.parametrize("width", [1, 2, 4])
def test_the_widened_range_holds_small_rectangles(width):
    heights = smooth_heights(512, 14.0)
    lo, hi = squares(4000, width, 512)
    least, most = touched_range(heights, lo, hi)
    low, high = asked(hsat_range, hsat(heights), lo, hi)
    assert np.mean((low <= least) & (high >= most)) > 0.99
