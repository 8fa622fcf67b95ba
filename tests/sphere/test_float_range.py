"""Values and gradients are finite over all of float32's range, wherever the result is.

Lengths, sharpnesses, amplitudes and radiance go from 0 (and subnormal numbers) to the largest that
the result leaves room for; unit vectors have components of any smallness.
"""

import jax.numpy as jnp
import numpy as np
from hypothesis import given

from jaxvis.sphere import (
    angles,
    contours,
    frames,
    gaussians,
    harmonics,
    hemisphere,
    hemisphere_grid,
    latlong,
    octahedral,
    polygons,
    visibility_integrals,
)
from jaxvis.sphere.contours import ContourTable
from jaxvis.sphere.gaussians import SphericalGaussians
from jaxvis.sphere.polygons import Directions
from jaxvis.sphere.summed_area import SummedAreaTable
from tests.float_range import (
    LARGEST,
    RANDOM,
    ROWS,
    SMALLEST,
    directions,
    magnitudes,
    numbers,
    related,
    require_finite,
    vectors,
    whole_range,
)

HEIGHT, WIDTH = 8, 16


def exactly(vectors):
    """In float64, with subnormal numbers as the zeros that XLA takes them for."""
    vectors = np.asarray(vectors, np.float64)
    return np.where(np.abs(vectors) < SMALLEST, 0.0, vectors)


def maps(random, *shape, most=1e30):
    """Radiance of one magnitude, or of any at each texel."""
    return magnitudes(random, *shape, most=most)


# Frames and angles


@whole_range
@given(random=RANDOM)
def test_normalize(random):
    v = vectors(random, ROWS)
    length = np.linalg.norm(exactly(v), axis=-1, keepdims=True)
    expected = exactly(v) / np.where(length > 0.0, length, 1.0)
    np.testing.assert_allclose(require_finite(frames.normalize, v), expected, atol=3e-7)


def framed(normal, v):
    return frames.frame(normal), frames.to_world(v, normal), frames.to_local(v, normal)


@whole_range
@given(random=RANDOM)
def test_frames(random):
    normal = directions(random, ROWS)
    v = vectors(random, ROWS, most=1e37)
    require_finite(framed, normal, v)
    require_finite(frames.reflect, v, normal)


@whole_range
@given(random=RANDOM)
def test_turns(random):
    v = vectors(random, ROWS)
    turns = require_finite(angles.turns, v[:, 0], v[:, 1])
    y, x = exactly(v[:, 0]), exactly(v[:, 1])
    expected = np.arctan2(y, x + 0.0) / (2.0 * np.pi)
    np.testing.assert_allclose(np.abs(turns), np.abs(expected), rtol=4e-7, atol=2.0 * SMALLEST)
    sine, cosine = require_finite(angles.sine_cosine, numbers(random, ROWS, most=2.0**20))
    assert np.all(np.abs(sine) <= 1.0 + 1e-6)
    assert np.all(np.abs(cosine) <= 1.0 + 1e-6)


# Maps of directions


@whole_range
@given(random=RANDOM)
def test_latlong_coordinates(random):
    v = vectors(random, ROWS, most=0.5 * LARGEST)
    u, theta = require_finite(latlong.coordinates, v)
    x, y, z = exactly(v).T
    np.testing.assert_allclose(
        theta, np.arctan2(np.hypot(x, z), y + 0.0), rtol=1e-6, atol=16.0 * SMALLEST
    )
    apart = np.mod(np.arctan2(x, -z + 0.0) / (2.0 * np.pi) - u + 0.5, 1.0) - 0.5
    np.testing.assert_allclose(apart[(x != 0.0) | (z != 0.0)], 0.0, atol=4e-7)
    require_finite(latlong.direction, numbers(random, ROWS, most=2.0**20), theta)


@whole_range
@given(random=RANDOM)
def test_latlong_lookups(random):
    shape, v = (HEIGHT, WIDTH, 3), vectors(random, ROWS)
    for values in (maps(random, *shape, most=LARGEST), maps(random, *shape, most=1e3)):
        nearest = require_finite(latlong.nearest, values, v)
        assert np.all(nearest <= values.max())
    # Slopes are as steep as the direction is short or close to a pole, and the map bright.
    require_finite(latlong.bilinear, values, vectors(random, ROWS, least=1e-32))
    anywhere = random.normal(size=(ROWS, 3)).astype(np.float32)
    bilinear = require_finite(latlong.bilinear, maps(random, *shape), anywhere)
    assert np.all(bilinear >= 0.0)


@whole_range
@given(random=RANDOM)
def test_octahedral(random):
    v = vectors(random, ROWS, most=0.3 * LARGEST)
    v = np.where(
        np.all(exactly(v) == 0.0, axis=-1, keepdims=True), np.array([0, 0, -1], np.float32), v
    )
    found = require_finite(octahedral.encode, v)
    unit = exactly(v) / np.linalg.norm(exactly(v), axis=-1, keepdims=True)
    back = require_finite(octahedral.decode, np.clip(found, -1.0, 1.0))
    np.testing.assert_allclose(back, unit, atol=1e-6)
    places = np.clip(numbers(random, ROWS, 2, most=1.0), -1.0, 1.0)
    require_finite(octahedral.decode, places)
    assert np.all(require_finite(octahedral.jacobian, places) > 0.9)


@whole_range
@given(random=RANDOM)
def test_hemisphere_maps(random):
    way = directions(random, ROWS)
    disc = require_finite(hemisphere.from_direction, way)
    require_finite(hemisphere.to_direction, disc)
    back = np.asarray(hemisphere.to_direction(disc))
    # Next to -z the disc's points are too far apart.
    np.testing.assert_allclose(back[way[:, 2] > -0.9], way[way[:, 2] > -0.9], atol=2e-6)
    inside = disc / np.maximum(np.linalg.norm(disc, axis=-1, keepdims=True), 1.0)
    square = require_finite(hemisphere.disc_to_square, inside)
    require_finite(hemisphere.square_to_disc, square)
    require_finite(hemisphere.square_to_disc, magnitudes(random, ROWS, 2, most=1.0))


def distances(random, *shape, least=SMALLEST):
    """Angles of either sign, up to pi."""
    drawn = numbers(random, *shape, least=least, most=np.pi)
    return np.where(np.abs(drawn) < least, 0.0, drawn).astype(np.float32)


@whole_range
@given(random=RANDOM)
def test_hemisphere_grid(random):
    grids, which = distances(random, 3, 8, 8), random.integers(3, size=ROWS)
    found = require_finite(hemisphere_grid.distance_at, grids, which, *directions(random, ROWS).T)
    assert np.all(np.abs(found) <= 1.5 * np.pi + 1e-5)


# Spherical harmonics


def harmonic_sums(coefficients, radiance, way):
    found = harmonics.reconstruct(coefficients, way), harmonics.irradiance(coefficients, way)
    return *found, harmonics.quadratic_form(coefficients), harmonics.project(radiance, 3)


@whole_range
@given(random=RANDOM)
def test_harmonics(random):
    way, coefficients = directions(random, ROWS), numbers(random, 9, 3, most=1e36)
    require_finite(harmonic_sums, coefficients, maps(random, HEIGHT, WIDTH, 3, most=1e36), way)
    require_finite(six_bands, way)


def six_bands(way):
    return harmonics.evaluate(way, 6)


# Spherical Gaussians


def lobes(random, axis, sharpest=1e30, brightest=1e3, bluntest=SMALLEST):
    shape = axis.shape[:-1]
    sharpness = magnitudes(random, *shape, least=bluntest, most=sharpest)
    parts = axis, sharpness, magnitudes(random, *shape, 3, most=brightest)
    return SphericalGaussians(*map(jnp.asarray, parts))


def lobe_values(lobes, way):
    return lobes.evaluate(way), lobes.integral(), lobes.mixture(way)


@whole_range
@given(random=RANDOM)
def test_lobes(random):
    axis = directions(random, ROWS)
    for sharpest, brightest in ((1e30, 1e3), (1e3, 1e30)):
        found = lobes(random, axis, sharpest, brightest)
        one, integral, _ = require_finite(lobe_values, found, related(random, axis))
        assert np.all(one <= found.amplitude * (1.0 + 1e-6))
        assert np.all(integral <= found.amplitude * (4.0 * np.pi + 1e-4))
    exact = magnitudes(random, ROWS)
    full = np.where(exact > 1e-3, -np.expm1(-2.0 * exactly(exact)) / np.maximum(exact, 1e-3), 2.0)
    total = require_finite(gaussians.total, exact)
    np.testing.assert_allclose(total, 2.0 * np.pi * full, rtol=2e-3, atol=16.0 * SMALLEST)


@whole_range
@given(random=RANDOM)
def test_products_of_lobes(random):
    axis = directions(random, ROWS)
    for sharpest, brightest in ((1e30, 1e3), (1e3, 1e15)):
        a = lobes(random, axis, sharpest, brightest, 1e-30)
        b = lobes(random, related(random, axis), sharpest, brightest, 1e-30)
        both = require_finite(gaussians.product, a, b)
        np.testing.assert_allclose(np.linalg.norm(both.axis, axis=-1), 1.0, atol=1e-5)
        assert np.all(both.sharpness <= (exactly(a.sharpness) + b.sharpness) * (1.0 + 1e-6))
        assert np.all(require_finite(gaussians.inner_product, a, b) >= 0.0)


@whole_range
@given(random=RANDOM)
def test_half_spaces(random):
    distance, sharpness = 1.5 * distances(random, ROWS), magnitudes(random, ROWS)
    share = require_finite(gaussians.visible_share, distance, sharpness)
    assert np.all((share >= 0.0) & (share <= 1.0))
    assert np.all(share[distance >= 0.0] >= 0.5 - 1e-6)
    assert np.all(share[distance <= 0.0] <= 0.5 + 1e-6)
    assert np.all(share[distance <= -np.pi] <= 1e-6)
    require_finite(gaussians.half_space, distance, sharpness)
    assert np.all(np.abs(require_finite(gaussians.error_function, numbers(random, ROWS))) <= 1.0)


# Polygons and contours


def outlines(random, normal, vertices=8):
    """Polygons [ROWS, vertices] of unit directions with repeated, opposite and collinear vertices,
    edges of any shortness, and vectors that are zero.
    """
    some = directions(random, ROWS, vertices, least=1e-18)
    for k in range(1, vertices):
        beside = related(random, some[:, k - 1])
        some[:, k] = np.where(random.random((ROWS, 1)) < 0.6, beside, some[:, k])
    level = some - np.sum(some * normal[:, None], axis=-1, keepdims=True) * normal[:, None]
    some = np.where(random.random((ROWS, 1, 1)) < 0.2, level, some)
    some = np.where(random.random((ROWS, vertices, 1)) < 0.05, 0.0, some)
    # Longitudes change too steeply next to the poles.
    return np.where(np.abs(some) < 1e-18, 0.0, some).astype(np.float32)


def apart(vectors):
    return Directions(*np.moveaxis(vectors, -1, 0))


def seen(points, weights, position, normal):
    vectors = jnp.concatenate([points, weights], axis=-2, dtype=jnp.float32)
    there = polygons.clamp_to_hemisphere(polygons.seen_from(vectors, position), normal)
    return there, polygons.normalized(there)


@whole_range
@given(random=RANDOM)
def test_polygons_seen_from_anywhere(random):
    normal = directions(random, ROWS)
    points = vectors(random, ROWS, 8, most=1e24).swapaxes(-1, -2)
    weights = random.integers(2, size=(ROWS, 1, 8))  # no gradient: that is as large as the position
    position = vectors(random, ROWS, most=1e24)
    far, unit = require_finite(seen, points, weights, position, normal)
    far, length = exactly(far), np.linalg.norm(exactly(unit), axis=0)
    expected = np.linalg.norm(far, axis=0)
    np.testing.assert_allclose(length[expected > 1.1e-12], 1.0, atol=1e-6)
    assert np.all(length[expected < 0.9e-12] == 0.0)


def irradiances(outlines, normal, cosine):
    pieces = polygons.subdivide(outlines, 2)
    cap = polygons.retract_to_cap(outlines, normal, cosine)
    vector = polygons.vector_irradiance(cap)
    return pieces, cap, vector, polygons.uniform_irradiance(outlines, normal)


@whole_range
@given(random=RANDOM)
def test_irradiance_of_polygons(random):
    normal = directions(random, ROWS)
    cosine = np.clip(numbers(random, ROWS, most=1.0), -1.0, 1.0)
    *_, irradiance = require_finite(irradiances, apart(outlines(random, normal)), normal, cosine)
    assert np.all(np.abs(irradiance) <= 8.0 * 0.5 * np.pi * (1.0 + 1e-5))


def contour_integrals(values, luminous, outlines, sharpness):
    table, light = ContourTable.build(values), ContourTable.build(luminous)
    found = []
    for lookup in ("nearest", "bilinear"):
        for lookups in (
            contours.trapezoid(HEIGHT, [outlines], lookup),
            contours.vsat(light, [outlines], sharpness, lookup),
        ):
            found.append(contours.integrate(table, lookups))
            found.append(contours.integrate_small(table, lookups))
    return found


def place(way):
    return contours._locate(HEIGHT, way, "bilinear")


@whole_range
@given(random=RANDOM)
def test_contour_integrals(random):
    outline = apart(outlines(random, directions(random, ROWS)))
    places = latlong.texel_directions(HEIGHT, WIDTH)
    values = magnitudes(random, HEIGHT, WIDTH, 1, most=1e3)
    # beta changes as much more steeply as its sharpness is high and the light that it weighs dim.
    for dimmest, brightest, sharpest in ((SMALLEST, 1e3, 1e10), (1e27, 1e30, 1e30)):
        luminance = magnitudes(random, HEIGHT, WIDTH, 1, least=dimmest, most=brightest)
        luminous = (luminance * places).astype(np.float32)
        sharpness = magnitudes(random, ROWS, 1, most=sharpest)
        require_finite(contour_integrals, values, luminous, outline, sharpness)
    # Nowhere dark: rounding then stands for the light there, and gradients overflow above 1e15.
    bright = random.uniform(0.1, 1.0, (HEIGHT, WIDTH, 1)).astype(np.float32) * 1e30
    luminous, sharpness = (bright * places).astype(np.float32), np.full((1, 1), 8.0, np.float32)
    outline = apart(random.normal(size=(ROWS, 8, 3)).astype(np.float32))
    require_finite(contour_integrals, bright, luminous, outline, sharpness)


@whole_range
@given(random=RANDOM)
def test_places_of_directions_of_any_length(random):
    v = vectors(random, ROWS, 4, least=1e-35, most=0.5 * LARGEST)
    found = require_finite(place, apart(v))
    x, y, z = np.moveaxis(exactly(v), -1, 0)
    rows = np.arctan2(np.hypot(x, z), y + 0.0) * (HEIGHT / np.pi)
    np.testing.assert_allclose(found.row + found.down, rows, atol=1e-5)


# Tables and distance maps


def boxes(values, u, v):
    table = SummedAreaTable.build(values)
    return table.lookup(u, v), table.box(u, v, u + 0.3, 0.5 * v), table.total


@whole_range
@given(random=RANDOM)
def test_summed_areas(random):
    u, v = numbers(random, ROWS, most=1e6), magnitudes(random, ROWS, most=HEIGHT)
    require_finite(boxes, maps(random, HEIGHT, WIDTH, 3), u, v)


def visible_integrals(signed_distance, lobes):
    def integrand(way):
        return lobes.evaluate(way[..., None, :]).sum(axis=-2)

    return (
        visibility_integrals.half_space_integral(signed_distance, lobes),
        visibility_integrals.coverage_integral(signed_distance, integrand, 8),
        visibility_integrals.isoline_integral(signed_distance, integrand, 8),
    )


@whole_range
@given(random=RANDOM)
def test_visibility_integrals(random):
    found = lobes(random, directions(random, 8), 1e10, 1e3)
    signed = distances(random, 16, 16, least=1e-12)
    if random.random() < 0.5:  # distances of ordinary size, and iso-lines through the corners
        signed = random.integers(-2, 3, (16, 16)).astype(np.float32)
    for integral in require_finite(visible_integrals, signed, found):
        assert np.all(integral >= -1e-3 * jnp.max(found.amplitude))
