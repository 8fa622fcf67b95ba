"""The distance transforms against brute force, the paper's scans, and closed forms."""

import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt

import jaxvis
from jaxvis.sphere.distance_host import signed_distances
from jaxvis.sphere.distance_transform import (
    distance_to,
    hemispherical_distance,
    spherical_distance,
)
from jaxvis.sphere.hemisphere_grid import texel_directions

from .distance_oracle import (
    angle_between,
    brute_force,
    grid_points,
    hemisphere,
    meridians_first,
    scan,
    separating_colatitude,
    signed,
    smooth_maps,
    sphere,
    traced_maps,
)

HALF = 2.0**-11
"""Half precision's relative rounding."""


def assert_distances(found, expected, rounding=0.0):
    """Within 2e-6 rad (and a relative rounding of what is stored), but for the antipode's
    neighbourhood: sin^2(d / 2) is near 1 there, and its rounding grows with 1 / cos(d / 2).
    """
    expected = np.asarray(expected, np.float64)
    found = np.asarray(found, np.float64)
    beyond = np.maximum(np.cos(0.5 * np.minimum(np.abs(expected), np.pi)), 1.2e-3)
    allowed = 1e-6 + 1e-6 / beyond + rounding * np.abs(expected)
    assert found.shape == expected.shape
    error = np.abs(found - expected)
    assert np.all(error <= allowed), f"{np.max(error / allowed)} times the tolerance"


def random_masks(shape, seed=0):
    """Sparse, middling and dense ones, and those of one class."""
    random = np.random.default_rng(seed)
    return [random.random(shape) < density for density in (0.0, 0.005, 0.1, 0.5, 0.95, 1.0)]


def single_texels(height, width):
    """A texel alone: in the corners, at the edges, in the middle."""
    places = [(0, 0), (0, width - 1), (height - 1, 0), (height // 2, width // 2), (height // 3, 0)]
    masks = np.zeros((len(places), height, width), bool)
    for mask, place in zip(masks, places, strict=True):
        mask[place] = True
    return [*masks, *~masks]


# What is known


@pytest.mark.parametrize("size", [4, 7, 16, 33, 40])
def test_hemispheres_match_brute_force(size):
    grid = hemisphere(size)
    for mask in [*random_masks((size, size)), *single_texels(size, size), *smooth_maps(2, size)]:
        expected = signed(mask, grid)
        assert_distances(hemispherical_distance(mask), expected)
        assert_distances(distance_to(mask), brute_force(mask, grid))
        half = signed_distances(mask)
        assert half.dtype == np.float16
        assert_distances(half, expected, HALF)


@pytest.mark.parametrize("size", [128, 256])
def test_large_hemispheres_match_brute_force(size):
    """At the size of the paper's maps, and beyond."""
    random = np.random.default_rng(1)
    for mask in (smooth_maps(1, size)[0], random.random((size, size)) < 5e-4):
        for one, seeds in ((mask, ~mask), (~mask, mask)):
            # Brute force of the sparser class only; the other takes a gigabyte and a minute.
            if seeds.sum() < 5000:
                expected = brute_force(seeds, hemisphere(size))
                assert_distances(distance_to(seeds), expected)
                found = np.asarray(hemispherical_distance(one))
                assert_distances(found[one], expected[one])
                half = signed_distances(one)
                assert_distances(half[one], expected[one], HALF)


@pytest.mark.parametrize(
    ("height", "width"), [(4, 8), (16, 32), (5, 3), (9, 31), (33, 20), (1, 6), (6, 1)]
)
def test_spheres_match_brute_force(height, width):
    grid = sphere(height, width)
    masks = [*random_masks((height, width)), *smooth_maps(2, width, height=height)]
    for mask in [*masks, *single_texels(height, width)]:
        expected = signed(mask, grid)
        assert_distances(spherical_distance(mask), expected)


def test_small_distances_keep_their_precision():
    """Beside the pole, where texels are 8e-5 rad apart, an arccosine would give 0 or 3e-4."""
    size = 256
    seeds = np.zeros((size, size), bool)
    seeds[0, 100] = True
    expected = brute_force(seeds, hemisphere(size))[0, 90:111]
    assert expected[11] < 1e-4
    found = np.asarray(distance_to(seeds), np.float64)[0, 90:111]
    np.testing.assert_allclose(found, expected, rtol=1e-5)
    cosine = np.float32(np.cos(expected))
    assert np.max(np.abs(np.arccos(cosine) - expected)) > 2e-5
    half = signed_distances(~seeds).astype(np.float64)[0, 90:111]
    others = np.arange(21) != 10
    np.testing.assert_allclose(half[others], expected[others], rtol=HALF + 2e-6)


@pytest.mark.parametrize("size", [16, 128])
@pytest.mark.parametrize("pole", [(0.0, 0.3, 1.0), (0.8, 0.5, 0.1), (-0.4, 0.7, -0.2)])
def test_a_half_space_is_an_arcsine(size, pole):
    """Paper 002, eq. 4: the edge of what is visible is the great circle about the pole."""
    pole = np.asarray(pole) / np.linalg.norm(pole)
    height = texel_directions(size) @ pole
    found = np.asarray(hemispherical_distance(height > 0.0))
    np.testing.assert_array_equal(found > 0.0, height > 0.0)
    # Nearest points of the circle that lie below the horizon are none of the map's.
    nearest = texel_directions(size) - height[..., None] * pole
    inside = nearest[..., 2] > 0.05
    assert inside.mean() > 0.4
    excess = np.abs(found) - np.abs(np.arcsin(height))
    texel = np.pi / size
    assert excess[inside].min() > -1e-6  # the other class begins beyond the circle
    assert excess[inside].max() < 1.5 * texel


def test_one_class_alone_is_pi():
    for size in (1, 5, 16):
        for value in (True, False):
            maps = np.full((2, size, size), value)
            expected = np.full(maps.shape, np.pi if value else -np.pi)
            np.testing.assert_allclose(hemispherical_distance(maps), expected, rtol=1e-6)
            np.testing.assert_allclose(spherical_distance(maps), expected, rtol=1e-6)
            np.testing.assert_allclose(signed_distances(maps), expected, rtol=HALF)
    np.testing.assert_allclose(distance_to(np.zeros((5, 5), bool)), np.pi, rtol=1e-6)
    np.testing.assert_array_equal(distance_to(np.ones((5, 5), bool)), 0.0)


# The paper's algorithm


@pytest.mark.parametrize("grid", [hemisphere(17), sphere(12, 21), sphere(9, 16)])
def test_the_papers_scans_are_exact_once_mended(grid):
    shape = (len(grid[0]), len(grid[1]))
    transform = spherical_distance if grid[2] else hemispherical_distance
    for mask in [*random_masks(shape, 3), *single_texels(*shape)]:
        scanned = scan(mask, grid)
        np.testing.assert_allclose(scanned, brute_force(mask, grid), atol=1e-7)
        found = np.asarray(transform(~mask))[~mask]
        assert_distances(found, scanned[~mask])


def test_the_separating_colatitude():
    """The specification's numbers (section 5): as far from the one as from the other."""
    theta = separating_colatitude(0.6, 0.2, 1.5, 1.0, 0.0)
    assert abs(theta - 1.589928) < 1e-6
    at, s, g = (
        grid_points((np.array([t]), np.array([p]), False))[0, 0]
        for t, p in ((theta, 0.0), (0.6, 0.2), (1.5, 1.0))
    )
    assert abs(angle_between(at, s) - 1.003330) < 1e-6
    assert abs(angle_between(at, g) - 1.003330) < 1e-6


# Negative controls


def test_meridians_first_is_wrong():
    """Whence the order of the phases: the other errs by hundredths of a radian."""
    size = 32
    worst = 0.0
    for seed in range(6):
        mask = np.random.default_rng(seed).random((size, size)) < 0.01
        exact = brute_force(mask, hemisphere(size))
        worst = max(worst, np.max(meridians_first(mask, hemisphere(size)) - exact))
        assert_distances(distance_to(mask), exact)
    assert worst > 0.03


def test_a_ring_cut_open_is_wrong():
    """Where two seeds share a row, the nearer may lie across the seam."""
    grid = sphere(16, 32)
    mask = np.zeros((16, 32), bool)
    mask[8, 1] = mask[8, 14] = True
    exact = brute_force(mask, grid)
    assert np.max(scan(mask, (*grid[:2], False)) - exact) > 0.02
    found = np.asarray(spherical_distance(~mask))
    assert_distances(found[~mask], exact[~mask])


def test_the_hemisphere_does_not_wrap():
    """The last column is half a turn from the first: a seed there is far, not next door."""
    mask = np.zeros((16, 16), bool)
    mask[8, 0] = True
    assert distance_to(mask)[8, 15] > 2.5
    np.testing.assert_allclose(
        np.abs(spherical_distance(~mask))[8, 15], 2.0 * np.pi / 16, rtol=0.01
    )


def test_flat_distances_are_wrong():
    """Texels are no squares: the Euclidean transform of the map errs by tenths of a radian."""
    size = 32
    mask = smooth_maps(1, size)[0]
    flat = distance_transform_edt(~mask) * np.pi / size
    assert np.max(np.abs(flat - brute_force(mask, hemisphere(size)))) > 0.1


# What holds for every map


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 1.0), st.booleans())
@example(0, 0.0, False)
@example(0, 1.0, True)
def test_signs_are_classes_and_steps_are_short(seed, density, blobs):
    """Between neighbours of one class the distance changes by no more than they are apart."""
    size = 24
    mask = np.random.default_rng(seed).random((size, size)) < density
    if blobs:
        mask |= smooth_maps(1, size, seed)[0]
    directions = texel_directions(size).astype(np.float64)
    for found in (hemispherical_distance(mask), signed_distances(mask)):
        distance = np.asarray(found, np.float64)
        np.testing.assert_array_equal(distance > 0.0, mask)
        slack = 1e-5 if np.asarray(found).dtype == np.float32 else 2.0 * HALF * np.pi
        for axis in (0, 1):
            same = np.diff(mask, axis=axis) == 0
            apart = angle_between(
                np.delete(directions, 0, axis=axis), np.delete(directions, -1, axis=axis)
            )
            change = np.abs(np.diff(distance, axis=axis))
            assert np.all((change <= apart + slack)[same])


def test_real_maps_match_brute_force():
    """What vertices of the teapot see; the same from the host's transform."""
    size = 48
    maps = traced_maps(jaxvis.load_scene("teapot"), 8, size)
    mixed = maps.any(axis=(1, 2)) & ~maps.all(axis=(1, 2))
    assert mixed.sum() >= 3
    found = np.asarray(hemispherical_distance(maps))
    expected = np.stack([signed(mask, hemisphere(size)) for mask in maps])
    assert_distances(found, expected)
    assert_distances(signed_distances(maps), expected, HALF)


# Shapes


def test_batches_are_their_maps():
    """Whatever the number of maps, in blocks or not, mapped or inside another program."""
    maps = np.stack(random_masks((3, 7, 12, 12), 5))
    alone = np.stack([hemispherical_distance(mask) for mask in maps.reshape(-1, 12, 12)])
    alone = alone.reshape(maps.shape)
    np.testing.assert_allclose(hemispherical_distance(maps), alone, rtol=1e-6)
    np.testing.assert_allclose(hemispherical_distance(maps[0]), alone[0], rtol=1e-6)
    mapped = jax.jit(jax.vmap(jax.vmap(hemispherical_distance), in_axes=1, out_axes=1))
    np.testing.assert_allclose(mapped(jnp.asarray(maps)), alone, rtol=1e-6)
    host = signed_distances(maps)
    np.testing.assert_allclose(host, alone, rtol=HALF)
    np.testing.assert_array_equal(host[2, 1, 4], signed_distances(maps[2, 1, 4]))
    np.testing.assert_array_equal(host[:, ::2], signed_distances(maps[:, ::2]))
    ring = np.stack([spherical_distance(mask) for mask in maps[3, 1]])
    np.testing.assert_allclose(spherical_distance(maps[3])[1], ring, rtol=1e-6)


@pytest.mark.parametrize("transform", [distance_to, hemispherical_distance, signed_distances])
def test_no_maps_and_wrong_maps(transform):
    assert transform(np.zeros((0, 8, 8), bool)).shape == (0, 8, 8)
    bare = inspect.unwrap(transform)  # without the annotations' own check, which only tests make
    for shape in ((2, 8, 9), (8,)):
        with pytest.raises(ValueError, match="square"):
            bare(np.zeros(shape, bool))
