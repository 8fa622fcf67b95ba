"""Points within texels: exact at the poles, and inverted by locate."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.sampling import latlong_texels
from jaxvis.sphere import latlong

inside = jax.jit(latlong_texels.inside, static_argnames="width")
locate = jax.jit(latlong_texels.locate, static_argnames="width")


@pytest.mark.parametrize("height", [1, 2, 5, 512])
def test_bounds_are_the_edges_of_the_rows(height):
    bounds = latlong_texels.row_bounds(height).astype(np.float64)
    theta = np.pi * np.arange(height + 1) / height
    upper = np.arange(height) < (height + 1) // 2
    first = np.where(upper, np.sin(theta[:-1] / 2) ** 2, np.cos(theta[:-1] / 2) ** 2)
    last = np.where(upper, np.sin(theta[1:] / 2) ** 2, np.cos(theta[1:] / 2) ** 2)
    np.testing.assert_allclose(bounds[:, 0], first, rtol=1e-7)
    np.testing.assert_allclose(bounds.sum(axis=1), last, rtol=1e-5, atol=1e-13)
    # Its change is the solid angle: 4 pi of it in all.
    areas = 4.0 * np.pi * np.abs(bounds[:, 1]) / (2 * height)
    np.testing.assert_allclose(areas, latlong.row_solid_angles(height, 2 * height), rtol=1e-6)


@pytest.mark.parametrize("height", [1, 5, 8, 512])
def test_points_are_in_their_texels_and_are_found_again(height):
    rng = np.random.default_rng(height)
    width = 2 * height
    row = np.concatenate([[0, height - 1, height // 2], rng.integers(0, height, 500)])
    column = np.concatenate([[0, width - 1, 0], rng.integers(0, width, 500)])
    across, down = rng.uniform(0.01, 0.99, (2, row.size))
    bounds = jnp.asarray(latlong_texels.row_bounds(height))
    arguments = (jnp.asarray(row), jnp.asarray(column))
    fractions = (jnp.asarray(across, jnp.float32), jnp.asarray(down, jnp.float32))
    directions = inside(*arguments, *fractions, bounds, width=width)
    # The exact direction, float64.
    edges = np.cos(np.pi * np.arange(height + 1) / height)
    y = edges[row] + down * (edges[row + 1] - edges[row])
    phi = 2 * np.pi * (column + across) / width
    r = np.sqrt(1.0 - y * y)
    np.testing.assert_allclose(
        directions, np.stack([r * np.sin(phi), y, -r * np.cos(phi)], axis=-1), atol=1e-6
    )
    got = locate(directions, bounds, width=width)
    np.testing.assert_array_equal(got[0], row)
    np.testing.assert_array_equal(got[1], column)
    np.testing.assert_allclose(got[2], across, atol=2e-7 * width + 1e-6)
    np.testing.assert_allclose(got[3], down, atol=4e-7 * height + 1e-6)


@pytest.mark.parametrize("row", [0, 511])
def test_rows_at_the_poles_are_resolved(row):
    """Of a cap of 0.35 degrees, float32's cosine knows a hundred values; these are all distinct."""
    bounds = jnp.asarray(latlong_texels.row_bounds(512))
    down = jnp.linspace(0.0, 0.999, 1000)
    cell = jnp.full(1000, row)
    directions = np.asarray(
        inside(cell, 0 * cell, 0.0 * down, down, bounds, width=1024), np.float64
    )
    angle = np.hypot(directions[:, 0], directions[:, 2])
    from_pole = np.asarray(down, np.float64) if row == 0 else 1.0 - np.asarray(down, np.float64)
    cap = np.sin(np.pi / 1024) ** 2 * from_pole
    np.testing.assert_allclose(angle, 2.0 * np.sqrt(cap * (1.0 - cap)), rtol=1e-6, atol=5e-9)
    assert len(np.unique(angle)) == 1000
    assert len(np.unique(np.abs(directions[:, 1]))) < 400


def test_probabilities_and_densities_fit_together():
    luminance = np.random.default_rng(0).random((6, 12)) ** 4
    weights, density = latlong_texels.normalised(luminance)
    areas = latlong.row_solid_angles(6, 12)[:, None]
    np.testing.assert_allclose(weights, density * areas, rtol=1e-12)
    assert abs(weights.sum() - 1.0) < 1e-12
    np.testing.assert_allclose(density / density[0, 0], luminance / luminance[0, 0], rtol=1e-12)
    np.testing.assert_allclose(latlong_texels.normalised(np.zeros((4, 8)))[1], 0.25 / np.pi)


@pytest.mark.parametrize("bad", [-1.0, np.nan, np.inf])
def test_bad_luminance_is_named(bad):
    luminance = np.ones((4, 8))
    luminance[2, 3] = bad
    with pytest.raises(ValueError, match="luminance: must be finite and non-negative"):
        latlong_texels.normalised(luminance)
