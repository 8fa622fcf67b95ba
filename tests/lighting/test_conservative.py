"""Conversion to lat-long maps: nothing is lost, invented, or in the wrong place."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxvis.lighting.conservative import to_latlong
from jaxvis.lighting.projections import Angular, Cube
from jaxvis.sphere import latlong

QUICK = settings(max_examples=15, deadline=None, derandomize=True)


def cube_solid_angles(size):
    """Closed form (sr): second differences of atan(xy / sqrt(1 + x² + y²))."""
    edge = 2.0 * np.arange(size + 1) / size - 1.0
    x, y = edge[None, :], edge[:, None]
    corner = np.arctan2(x * y, np.sqrt(x * x + y * y + 1.0))
    return np.tile(np.diff(np.diff(corner, axis=0), axis=1).ravel(), 6)


def energy(radiance):
    height, width = radiance.shape[:2]
    return np.einsum("h,hwc->c", latlong.row_solid_angles(height, width), radiance)


def by_supersampling(values, projection, height, per_side):
    """Slow oracle: many places in each lat-long texel of a cube, each looked up in its face."""
    fine = latlong.texel_directions(height * per_side, 2 * height * per_side)
    weight = latlong.row_solid_angles(height * per_side, 2 * height * per_side)
    looked_up = np.zeros((*fine.shape[:2], values.shape[1]))
    size = projection.size
    for face in range(6):
        centre = projection.directions(face, np.zeros(()), np.zeros(()))
        to_right = projection.directions(face, np.ones(()), np.zeros(())) * np.sqrt(2.0) - centre
        to_up = projection.directions(face, np.zeros(()), np.ones(())) * np.sqrt(2.0) - centre
        ahead = fine @ centre
        inside = np.isclose(ahead, np.abs(fine).max(axis=-1))
        column = ((fine @ to_right)[inside] / ahead[inside] + 1.0) * size / 2.0
        row = (1.0 - (fine @ to_up)[inside] / ahead[inside]) * size / 2.0
        row, column = (np.clip(i.astype(int), 0, size - 1) for i in (row, column))
        looked_up[inside] = values[(face * size + row) * size + column]
    weighted = looked_up * weight[:, None, None]
    out = weighted.reshape(height, per_side, 2 * height, per_side, -1).sum(axis=(1, 3))
    return out / (weight.reshape(height, per_side).sum(axis=1) * per_side)[:, None, None]


@pytest.mark.parametrize("projection", [Cube(1), Cube(2), Cube(7), Cube(16), Angular(4),
                                        Angular(6), Angular(9), Angular(32)])  # fmt: skip
@pytest.mark.parametrize("height", [1, 3, 8, 40])
def test_a_constant_stays_constant_and_the_sphere_is_covered_once(projection, height):
    values = np.full((projection.faces * projection.size**2, 2), 3.0)
    radiance, solid_angles = to_latlong(values, projection, height)
    np.testing.assert_allclose(radiance, 3.0, rtol=1e-12)
    assert solid_angles.min() >= 0.0
    np.testing.assert_allclose(solid_angles.sum(), 4.0 * np.pi, rtol=1e-12)


@pytest.mark.parametrize("height", [5, 64])
@pytest.mark.parametrize("size", [1, 2, 3, 8, 33])
def test_solid_angles_of_a_cube_are_the_closed_form(size, height):
    _, solid_angles = to_latlong(np.zeros((6 * size * size, 1)), Cube(size), height)
    np.testing.assert_allclose(solid_angles, cube_solid_angles(size), rtol=3e-4)


def test_solid_angles_of_an_angular_map_are_sinc_times_area():
    size = 64
    _, solid_angles = to_latlong(np.zeros((size * size, 1)), Angular(size), 16)
    place = 2.0 * (np.arange(size) + 0.5) / size - 1.0
    radius = np.hypot(place[None, :], place[:, None]).ravel()
    expected = np.pi**2 * np.sinc(radius) * (2.0 / size) ** 2
    inside = radius < 0.97
    np.testing.assert_allclose(solid_angles[inside], expected[inside], rtol=2e-3)
    assert np.all(solid_angles[radius > 1.0 + np.sqrt(2.0) / size] == 0.0)


def special_texels(size):
    """Corners, edge middles and the centre (for py and ny: the poles; for nz: the seam)."""
    middle = size // 2
    return [
        (face * size + row) * size + column
        for face in range(6)
        for row, column in ((0, 0), (0, size - 1), (size - 1, 0), (0, middle), (middle, middle))
    ]


@pytest.mark.parametrize(("size", "height"), [(16, 32), (16, 9), (9, 64), (5, 10)])
def test_one_texel_suns_keep_their_energy_anywhere(size, height):
    texels = special_texels(size)
    solid_angles = cube_solid_angles(size)[texels]
    values = np.zeros((6 * size * size, len(texels)))
    values[texels, np.arange(len(texels))] = 1e5
    radiance, _ = to_latlong(values, Cube(size), height)
    np.testing.assert_allclose(energy(radiance), 1e5 * solid_angles, rtol=3e-4)


@QUICK
@given(size=st.integers(1, 24), height=st.integers(1, 40), place=st.floats(0.0, 0.999))
def test_any_texel_keeps_its_energy_at_any_resolution(size, height, place):
    values = np.zeros((6 * size * size, 1))
    texel = int(place * len(values))
    values[texel] = 1.0
    radiance, _ = to_latlong(values, Cube(size), height)
    np.testing.assert_allclose(energy(radiance)[0], cube_solid_angles(size)[texel], rtol=1e-3)


@pytest.mark.parametrize(("size", "height"), [(6, 12), (3, 20), (20, 8)])
def test_agrees_with_supersampling(size, height):
    values = np.random.default_rng(size).random((6 * size * size, 1))
    radiance, _ = to_latlong(values, Cube(size), height)
    expected = by_supersampling(values, Cube(size), height, per_side=30)
    error = np.abs(radiance - expected)
    assert error.max() < 0.02  # of the oracle, where an edge runs along its samples
    assert error.mean() < 4e-3


def test_a_sun_lands_in_the_texels_that_it_covers_and_in_no_other():
    size, height = 8, 64
    projection = Cube(size)
    values = np.zeros((6 * size * size, 1))
    values[(0 * size + 2) * size + 6] = 1.0
    radiance, _ = to_latlong(values, projection, height)
    lit = latlong.texel_directions(height, 2 * height)[radiance[..., 0] > 0.0]
    # The face px has its middle at -X, its right towards -Z, its top at +Y.
    right, up = lit[:, 2] / lit[:, 0], -lit[:, 1] / lit[:, 0]
    slack = 2.0 * np.pi / height
    assert np.all(lit[:, 0] < 0.0)
    assert np.all((right > 0.5 - slack) & (right < 0.75 + slack))
    assert np.all((up > 0.25 - slack) & (up < 0.5 + slack))


def test_point_sampling_would_lose_a_sun():
    """The negative control: looking texels up at lat-long texel centres."""
    size, height = 32, 8
    values = np.zeros((6 * size * size, 1))
    values[5 * size + 7] = 1.0
    sampled = by_supersampling(values, Cube(size), height, per_side=1)
    radiance, _ = to_latlong(values, Cube(size), height)
    assert energy(sampled)[0] == 0.0
    assert energy(radiance)[0] > 0.0
