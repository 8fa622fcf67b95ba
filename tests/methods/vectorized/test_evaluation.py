"""Sums over polygons: whatever the chunks, the sizes and the way they run; and irradiance."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxvis.methods.vectorized.evaluation import Sites, sum_over_polygons
from jaxvis.methods.vectorized.irradiance import Quadrature, irradiance
from jaxvis.sphere.contours import integrate, trapezoid
from jaxvis.sphere.polygons import (
    clamp_to_hemisphere,
    normalized,
    seen_from,
    subdivide,
    uniform_irradiance,
)
from tests.methods.vectorized.analytic import (
    UP,
    horizon,
    polygons,
    random_map,
    random_polygons,
    table_light,
    uniform,
    window,
)

QUADRATURES = [
    Quadrature(),
    Quadrature("split", 1, "bilinear"),
    Quadrature("vsat", 1, "nearest"),
    Quadrature("vsat", 1, "bilinear"),
]


def random_sites(visibility, count=70, seed=1, spread=0.2):
    """Sites near random polygons, with one to three of them."""
    rng = np.random.default_rng(seed)
    polygon = rng.integers(0, len(visibility.counts), (count, 3)).astype(np.int32)
    polygon[rng.random((count, 3)) < 0.3] = -1
    near = np.maximum(polygon[:, 0], 0)
    position = np.asarray(visibility.positions)[near] + spread * rng.normal(size=(count, 3))
    normal = np.asarray(visibility.normals)[near] + 0.3 * rng.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    plane = normal + 0.2 * rng.normal(size=(count, 3))
    plane /= np.linalg.norm(plane, axis=-1, keepdims=True)
    weight = rng.random((count, 3))
    position, normal, plane, weight = (
        field.astype(np.float32) for field in (position, normal, plane, weight)
    )
    return Sites(position, normal, plane, polygon, weight, np.full(count, -1, np.int32))


def oracle(visibility, sites, integral):
    """``integral`` of unit directions and normals, of all polygons at their full length at once."""
    number = np.maximum(sites.polygon, 0).reshape(-1)
    repeated = (jnp.asarray(np.repeat(field, 3, axis=0)) for field in sites[:3])
    position, normal, plane = repeated
    above = clamp_to_hemisphere(seen_from(visibility.vectors[number], position), plane)
    above = clamp_to_hemisphere(above, normal)
    values = np.asarray(integral(normalized(above), normal)).reshape(-1, 3, 3)
    weight = np.where(sites.polygon >= 0, sites.weight, 0.0)
    return (weight[..., None] * values).sum(axis=1)


def lengths(visibility):
    """An integral that tells which polygon it was and whether it had all of its vectors."""
    counts = np.asarray(visibility.counts)

    def integral(references, size):
        assert np.all(counts[np.asarray(references.polygon)] <= size)
        polygon = jnp.asarray(references.polygon, jnp.float32)
        return jnp.stack([polygon, jnp.asarray(references.position)[:, 1]], axis=-1)

    return integral


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 5000), st.integers(0, 40))
def test_sums_are_weighted_whatever_the_chunks(seed, lookups, count):
    visibility = random_polygons(seed=3)
    sites = random_sites(visibility, count, seed)
    found = sum_over_polygons(
        lengths(visibility),
        visibility,
        sites,
        channels=2,
        lookups_per_vector=2,
        lookups_per_chunk=lookups,
    )
    there = np.where(sites.polygon >= 0, sites.weight, 0.0)
    expected = np.stack(
        [(there * sites.polygon).sum(axis=1), there.sum(axis=1) * sites.position[:, 1]], axis=-1
    )
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5)


def test_what_else_the_integral_needs_comes_along():
    visibility = random_polygons()
    sites = random_sites(visibility, 30)
    extra = {"number": np.arange(30, dtype=np.float32)}

    def integral(references, size):
        return jnp.asarray(references.extra["number"])[:, None]

    for traced in (False, True):
        found = sum_over_polygons(
            integral,
            visibility,
            sites,
            channels=1,
            lookups_per_vector=1,
            extra=extra,
            traced=traced,
            lookups_per_chunk=400,
        )
        there = np.where(sites.polygon >= 0, sites.weight, 0.0).sum(axis=1)
        np.testing.assert_allclose(found[:, 0], there * np.arange(30), rtol=1e-6)


@pytest.mark.parametrize("quadrature", QUADRATURES, ids=str)
def test_a_uniform_sky_gives_lambert_s_formula(quadrature):
    visibility = random_polygons()
    sites = random_sites(visibility)
    light = table_light(uniform(1.0, 512 if quadrature.lookup == "nearest" else 64))
    found = irradiance(visibility, light, sites, quadrature, light.vector)

    def exact(directions, normal):
        return jnp.tile(uniform_irradiance(directions, normal)[:, None], (1, 3))

    expected = oracle(visibility, sites, exact)
    # Polygons of few vectors have long edges: their chords in the table are not great circles.
    assert np.abs(expected).max() > 0.5 * np.pi
    assert np.quantile(np.abs(found - expected), 0.8) < 0.01 * np.pi / quadrature.pieces


def test_irradiance_is_what_the_contours_of_each_polygon_give():
    """Under a contrasted map, against the same rule applied to one polygon at a time."""
    visibility = random_polygons(24)
    sites = random_sites(visibility, 40)
    light = table_light(random_map())
    quadrature = Quadrature("split", 2, "bilinear")

    def one(directions, normal):
        lookups = trapezoid(light.vector.height, subdivide(directions, 2), "bilinear")
        moments = integrate(light.vector, lookups).reshape(-1, 3, 3)
        return jnp.einsum("pac,pa->pc", moments, normal)

    expected = oracle(visibility, sites, one)
    found = irradiance(visibility, light, sites, quadrature, light.vector)
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-4 * expected.max())
    both = irradiance(visibility, light, sites, quadrature, light.vector, light.blurred)
    np.testing.assert_array_equal(both[:, :3], found)
    np.testing.assert_array_equal(both[:, 3:], found)


@pytest.mark.parametrize("quadrature", [Quadrature(), Quadrature("vsat")], ids=str)
def test_chunks_capacity_and_compiled_loops_change_nothing_but_rounding(quadrature):
    visibility = random_polygons()
    sites = random_sites(visibility)
    light = table_light(random_map(512 if quadrature.lookup == "nearest" else 16))
    found = irradiance(visibility, light, sites, quadrature, light.vector)
    # Sums of a thousand corners, each as large as all of the light, in float32.
    rounding = 1e-5 * float(light.scalar.total.max())
    small = irradiance(
        visibility, light, sites, quadrature, light.vector, lookups_per_chunk=1 << 11
    )
    np.testing.assert_allclose(small, found, atol=rounding)
    padding = ((0, 0), (0, 0), (0, 37))
    padded = replace(visibility, vectors=jnp.pad(visibility.vectors, padding, mode="edge"))
    longer = irradiance(padded, light, sites, quadrature, light.vector)
    np.testing.assert_allclose(longer, found, atol=rounding)
    compiled = jax.jit(
        lambda lit: irradiance(
            visibility, lit, sites, quadrature, lit.vector, lookups_per_chunk=1 << 12
        )
    )(light)
    np.testing.assert_allclose(compiled, found, atol=rounding)
    order = np.random.default_rng(0).permutation(len(sites.normal))
    shuffled = irradiance(visibility, light, sites.take(order), quadrature, light.vector)
    np.testing.assert_allclose(shuffled, found[order], atol=rounding)


def test_a_plane_and_a_normal_cut_the_sky():
    """A tilted normal over a flat surface: pi (1 + cos) / 2 of a uniform sky; without the plane pi.

    Negative control: with the plane left out nothing is cut.
    """
    angle = np.array([0.0, 0.3, 0.8])
    normal = np.stack([np.sin(angle), np.cos(angle), 0.0 * angle], axis=-1).astype(np.float32)
    # A polygon that reaches all round the nadir, as those of precomputation reach below the plane.
    ring = horizon(UP, 64) - np.array([0.0, 0.95, 0.0, 0.0])
    ring[:, :3] /= np.linalg.norm(ring[:, :3], axis=-1, keepdims=True)
    visibility = polygons([ring], [[0.0, 0.0, 0.0]], [UP], np.zeros((0, 3)))
    polygon = np.array([[0, -1, -1]] * 3, np.int32)
    plane = np.tile(UP, (3, 1)).astype(np.float32)
    sites = Sites(0.0 * plane, normal, plane, polygon, np.ones((3, 3), np.float32), polygon[:, 1])
    light = table_light(uniform(1.0, 64))
    quadrature = Quadrature("split", 4, "bilinear")
    found = irradiance(visibility, light, sites, quadrature, light.vector)[:, 0]
    np.testing.assert_allclose(found, np.pi * (1.0 + np.cos(angle)) / 2.0, rtol=5e-3)
    open_ = irradiance(visibility, light, sites._replace(plane=normal), quadrature, light.vector)[
        :, 0
    ]
    np.testing.assert_allclose(open_, np.pi, rtol=5e-3)


def test_finite_vectors_are_seen_from_the_site():
    """Under a round window of radius R at height h: E = pi R^2 / (R^2 + h^2)."""
    visibility = polygons(
        [window([0.0, 1.0, 0.0], UP, 2.0, 60)], [[0.0, 0.0, 0.0]], [UP], np.zeros((0, 3))
    )
    height = np.array([0.0, -1.0, 0.5])
    position = np.stack([0.0 * height, height, 0.0 * height], axis=-1).astype(np.float32)
    up = np.tile(UP, (3, 1)).astype(np.float32)
    polygon = np.array([[0, -1, -1]] * 3, np.int32)
    sites = Sites(position, up, up, polygon, np.ones((3, 3), np.float32), polygon[:, 1])
    light = table_light(uniform(1.0, 64))
    found = irradiance(visibility, light, sites, Quadrature("split", 4, "bilinear"), light.vector)[
        :, 0
    ]
    np.testing.assert_allclose(found, np.pi * 4.0 / (4.0 + (1.0 - height) ** 2), rtol=8e-3)
