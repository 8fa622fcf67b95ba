"""Integrals over what is visible: closed forms, exact sums over random masks, gradients."""

from functools import lru_cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.ndimage
import scipy.special

from jaxvis.sphere import hemisphere_grid, visibility_integrals
from jaxvis.sphere.distance_transform import hemispherical_distance
from jaxvis.sphere.gaussians import SphericalGaussians

SIZE = 128
DIRECTIONS = hemisphere_grid.texel_directions(SIZE)
SOLID_ANGLES = np.repeat(hemisphere_grid.texel_solid_angles(SIZE)[:, None], SIZE, axis=1)
MEANS = {
    name: jax.jit(function, static_argnums=(1, 2))
    for name, function in {
        "coverage": visibility_integrals.coverage_integral,
        "isoline": visibility_integrals.isoline_integral,
    }.items()
}


def cosine(w):
    return w[..., 2:]


def lobe(axis, sharpness):
    """As an integrand."""
    return lambda w: jnp.exp(sharpness * (w @ jnp.asarray(axis, jnp.float32) - 1.0))[..., None]


@partial(jax.jit, static_argnames=("means", "cells"))
def lobes_by_cells(distances, axes, sharpness, means, cells):
    """[maps, lobes]."""

    def integrand(w):
        return jnp.exp(sharpness * (w @ axes.T - 1.0))

    return jax.lax.map(lambda d: MEANS[means](d, integrand, cells), distances)


def plane_distance(normal):
    """Exact distances of the half-space on this side of a plane through the point."""
    return jnp.asarray(np.arcsin(np.clip(DIRECTIONS @ normal, -1.0, 1.0)), jnp.float32)


def unit(v):
    return np.asarray(v) / np.linalg.norm(v)


PLANES = [unit(v) for v in ([1, 0, 1e-9], [0.3, -0.8, 0.2], [-0.5, 0.1, 0.9], [0.2, 1.0, -0.4])]


@pytest.mark.parametrize("means", MEANS)
@pytest.mark.parametrize("normal", PLANES, ids=str)
def test_irradiance_of_a_half_space_is_in_closed_form(means, normal):
    """Of the hemisphere's part on one side of a plane whose normal has height z: pi (1 + z) / 2."""
    tolerance = {"coverage": 3e-3, "isoline": 1e-3}[means]
    found = MEANS[means](plane_distance(normal), cosine, 32)
    np.testing.assert_allclose(found, [np.pi * (1.0 + normal[2]) / 2.0], atol=tolerance * np.pi)


def test_isolines_converge_as_the_square_and_are_exact_where_nothing_is_cut():
    exact = np.pi * (1.0 + PLANES[1][2]) / 2.0
    errors = [
        abs(float(MEANS["isoline"](plane_distance(PLANES[1]), cosine, m)[0]) - exact)
        for m in (4, 16)
    ]
    assert errors[1] < errors[0] / 8.0
    everything = jnp.full((SIZE, SIZE), jnp.pi)
    np.testing.assert_allclose(MEANS["isoline"](everything, cosine, 8), [np.pi], rtol=1e-5)
    np.testing.assert_array_equal(MEANS["isoline"](-everything, cosine, 8), [0.0])
    np.testing.assert_allclose(MEANS["coverage"](everything, cosine, 32), [np.pi], rtol=5e-3)
    np.testing.assert_array_equal(MEANS["coverage"](-everything, cosine, 32), [0.0])


def cut_cell(a, b, c, coefficients):
    """Integral of sum k_ij t^i p^j over a + b p + c t > 0 in the unit square, by a fine grid."""
    n = 2000
    p, t = np.meshgrid((np.arange(n) + 0.5) / n, (np.arange(n) + 0.5) / n)
    value = np.polynomial.polynomial.polyval2d(t, p, coefficients)
    return np.sum(value * (a + b * p + c * t > 0.0)) / n**2


@pytest.mark.parametrize(
    ("a", "b", "c"),
    [
        (-0.4, 1.0, 0.3),
        (-0.4, 0.3, 1.0),
        (0.4, -0.3, -1.0),
        (-1.5, 1.0, 1.0),
        (1.2, -1.1, -0.9),
        (0.3, -1.0, 0.1),
        (-0.6, 0.0, 1.0),
        (0.25, 1.0, -1.0),
        (1.0, 0.2, 0.1),
        (-1.0, 0.2, 0.1),
    ],
)
def test_one_cell_cut_by_a_line_is_integrated_exactly(a, b, c):
    """Corners, strips both ways, uncut cells: a polynomial of degree 2 in both variables."""
    corners = jnp.asarray([[a, a + b], [a + c, a + b + c]], jnp.float32)
    coefficients = np.random.default_rng(2).normal(size=(3, 3))
    nodes = visibility_integrals._NODES
    values = np.polynomial.polynomial.polygrid2d(nodes, nodes, coefficients)
    line = visibility_integrals._isoline(corners)
    values = values if bool(line.steep[0, 0]) else values.T  # [along, across]
    below = np.sum(values * np.asarray(visibility_integrals._weights_below(line))[0, 0])
    weights = visibility_integrals._WEIGHTS
    whole = np.sum(values * weights[:, None] * weights)
    part = below if bool(line.visible_below[0, 0]) else whole - below
    found = part if bool(line.crossed[0, 0]) else float(line.share[0, 0]) * whole
    np.testing.assert_allclose(found, cut_cell(a, b, c, coefficients), atol=2e-3)


def test_a_saddle_counts_in_proportion():
    line = visibility_integrals._isoline(jnp.array([[3.0, -1.0], [-1.0, 1.0]]))
    assert not line.crossed[0, 0]
    np.testing.assert_allclose(line.share[0, 0], 4.0 / 6.0)


@lru_cache
def blobs():
    """(visible, distances) of 12 random masks."""
    random = np.random.default_rng(0)
    masks = []
    for _ in range(12):
        noise = random.normal(size=(SIZE, SIZE))
        smooth = scipy.ndimage.gaussian_filter(noise, random.uniform(8.0, 20.0), mode="nearest")
        masks.append(smooth > np.quantile(smooth, random.uniform(0.2, 0.8)))
    return np.stack(masks), hemispherical_distance(jnp.asarray(np.stack(masks)))


@lru_cache
def axes():
    random = np.random.default_rng(1).normal(size=(24, 3))
    random[:, 2] = np.abs(random[:, 2]) + 0.3
    return jnp.asarray(random / np.linalg.norm(random, axis=1, keepdims=True), jnp.float32)


def exact_sums(sharpness):
    """[maps, lobes], and the integral of a lobe."""
    values = np.exp(sharpness * (DIRECTIONS @ np.asarray(axes()).T - 1.0)) * SOLID_ANGLES[..., None]
    return np.einsum("mij,ijl->ml", blobs()[0], values), 2.0 * np.pi / sharpness


@pytest.mark.parametrize(
    ("sharpness", "half_space", "coverage", "isoline"),
    [(5.0, 0.11, 1.5e-3, 4e-3), (20.0, 0.07, 3e-3, 5e-3), (100.0, 0.03, 7e-3, 8e-3)],
)
def test_means_against_the_exact_sum_over_texels(sharpness, half_space, coverage, isoline):
    """Mean errors in units of the lobe; the half-space does not follow the shapes of occluders."""
    exact, whole = exact_sums(sharpness)
    distances = blobs()[1]
    lobes = SphericalGaussians(axes(), jnp.full(24, sharpness), jnp.ones((24, 1)))
    by_lobe = jax.vmap(lambda d: visibility_integrals.half_space_integral(d, lobes)[:, 0])(
        distances
    )
    assert np.abs(by_lobe - exact).mean() < half_space * whole
    for means, bound in (("coverage", coverage), ("isoline", isoline)):
        found = lobes_by_cells(distances, axes(), sharpness, means, 32)
        assert np.abs(found - exact).mean() < bound * whole
    unshadowed = np.abs(whole - exact).mean()
    assert unshadowed > 2.0 * half_space * whole  # the control: no visibility at all


def test_narrow_lobes_want_finer_cells_of_coverage():
    exact, whole = exact_sums(500.0)
    errors = {
        (means, m): np.abs(lobes_by_cells(blobs()[1], axes(), 500.0, means, m) - exact).mean()
        / whole
        for means in MEANS
        for m in (32, 64)
    }
    assert errors["coverage", 32] > 1e-2
    assert errors["coverage", 64] < 4e-3
    assert errors["isoline", 32] < 1e-2


def test_half_spaces_are_right_for_half_spaces():
    """A plane through the point, lobes narrow enough that the horizon does not matter."""
    normal, sharpness = unit([0.6, -0.5, 0.3]), 80.0
    lobes = SphericalGaussians(axes(), jnp.full(24, sharpness), jnp.ones((24, 1)))
    found = visibility_integrals.half_space_integral(plane_distance(normal), lobes)[:, 0]
    height = np.asarray(axes()) @ normal
    exact = (
        2.0 * np.pi / sharpness * 0.5 * (1.0 + scipy.special.erf(np.sqrt(sharpness / 2) * height))
    )
    np.testing.assert_allclose(found, exact, atol=4e-3 * 2.0 * np.pi / sharpness)


def test_distances_between_texels_and_below_the_horizon():
    normal = unit([0.2, 0.4, 0.9])
    distances = plane_distance(normal)
    np.testing.assert_allclose(
        visibility_integrals.distance_at(distances, jnp.asarray(DIRECTIONS)), distances, atol=1e-4
    )
    random = np.random.default_rng(4).normal(size=(500, 3))
    random[:, 2] = np.abs(random[:, 2])
    random /= np.linalg.norm(random, axis=1, keepdims=True)
    found = visibility_integrals.distance_at(distances, jnp.asarray(random, jnp.float32))
    np.testing.assert_allclose(found, np.arcsin(random @ normal), atol=0.03)
    sunk = jnp.asarray(unit([0.8, 0.3, -0.4]), jnp.float32)
    level = jnp.asarray(unit([0.8, 0.3, 0.0]), jnp.float32)
    at_horizon = visibility_integrals.distance_at(distances, level)
    depth = np.arcsin(-float(sunk[2]))
    np.testing.assert_allclose(
        visibility_integrals.distance_at(distances, sunk), at_horizon - depth, atol=1e-5
    )


@pytest.mark.parametrize("means", ["half_space", *MEANS])
def test_gradients_are_finite_differences(means):
    """Through axis, sharpness and amplitude of a lobe, and an offset of all distances."""
    distances = blobs()[1][3]

    def integral(offset, axis, sharpness, amplitude):
        shifted = distances + offset
        if means == "half_space":
            one = SphericalGaussians(axis, sharpness, amplitude)
            return visibility_integrals.half_space_integral(shifted, one)[0]
        found = MEANS[means](shifted, lobe(axis, sharpness), 32)
        return amplitude[0] * found[0]

    integral_at = jax.jit(integral)
    arguments = (
        jnp.float32(0.013),
        jnp.asarray(unit([0.3, -0.4, 0.7]), jnp.float32),
        jnp.float32(12.0),
        jnp.array([1.5], jnp.float32),
    )
    got = jax.jit(jax.grad(integral, argnums=(0, 1, 2, 3)))(*arguments)
    tangent = jnp.asarray(np.cross(arguments[1], unit([0.1, 0.9, 0.2])), jnp.float32)
    bumps = [(0, 1.0, 4e-3), (1, tangent, 1e-3), (2, 1.0, 0.05), (3, jnp.ones(1), 0.05)]
    for which, bump, step in bumps:
        ends = []
        for sign in (1.0, -1.0):
            moved = list(arguments)
            moved[which] = moved[which] + sign * step * bump
            ends.append(float(integral_at(*moved)))
        slope = (ends[0] - ends[1]) / (2.0 * step)
        assert abs(slope) > 1e-4
        np.testing.assert_allclose(jnp.vdot(got[which], bump), slope, rtol=0.05, atol=2e-4)


@pytest.mark.parametrize("means", MEANS)
def test_gradients_are_finite_where_nothing_is_cut_or_distances_are_zero(means):
    for value in (np.pi, 0.0, -np.pi):
        distances = jnp.full((32, 32), value, jnp.float32)
        gradient = jax.jit(jax.grad(lambda d: MEANS[means](d, cosine, 16)[0]))(distances)
        assert np.isfinite(gradient).all()


@pytest.mark.parametrize("means", MEANS)
def test_cells_that_do_not_divide_the_map_are_named(means):
    with pytest.raises(ValueError, match="cells must divide the map's 128 texels a side, got 48"):
        MEANS[means](blobs()[1][0], cosine, 48)
