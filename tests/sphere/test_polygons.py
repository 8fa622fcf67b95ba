"""Polygons of directions: closed forms, and winding numbers counted one direction at a time."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.sphere import polygons
from jaxvis.sphere.polygons import Directions

from .contour_oracle import about, arcs, circle, directions_of, points_of, star, unit, winding

seen_from = jax.jit(polygons.seen_from)
clamp = jax.jit(polygons.clamp_to_hemisphere)
retract = jax.jit(polygons.retract_to_cap)
irradiance = jax.jit(polygons.uniform_irradiance)
normalized = jax.jit(polygons.normalized)


def as_jax(array):
    return jnp.asarray(array, jnp.float32)


def random_directions(rng, count):
    return unit(rng.normal(size=(count, 3)))


def with_crossings(points, axis, cosine=0.0):
    """The polygon with vertices added where edges cross the circle, or pass it close by."""
    fine = arcs(points, 512)
    height = fine @ axis - cosine
    crosses = height * np.roll(height, -1) < 0.0
    kept = crosses | np.roll(crosses, 1) | (np.arange(len(fine)) % 512 == 0)
    return fine[kept]


def test_directions_seen_from_a_place():
    """q - w s: a point is seen from elsewhere, a direction (w = 0) is the same from everywhere."""
    vectors = np.array([[3.0, 0.0], [4.0, 1.0], [5.0, 0.0], [1.0, 0.0]])  # a point, a direction
    seen = seen_from(as_jax([vectors, vectors]), as_jax([[0.0, 0.0, 0.0], [1.0, -2.0, 4.0]]))
    expected = [[[3, 4, 5], [0, 1, 0]], [[2, 6, 1], [0, 1, 0]]]
    np.testing.assert_array_equal(points_of(seen), expected)


def test_along_is_the_scalar_product():
    rng = np.random.default_rng(0)
    points, axes = rng.normal(size=(4, 7, 3)), rng.normal(size=(4, 3))
    got = polygons.along(directions_of(*points), as_jax(axes))
    np.testing.assert_allclose(got, np.einsum("pki,pi->pk", points, axes), atol=1e-5)


def test_normalized():
    points = np.array([[[3.0, 0.0, 4.0], [0.0, 0.0, 0.0], [1e-20, 0.0, 0.0], [0.0, -1e-5, 0.0]]])
    expected = [[[0.6, 0.0, 0.8], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, -1.0, 0.0]]]
    np.testing.assert_allclose(points_of(normalized(directions_of(*points))), expected, atol=1e-7)


def test_clamping_moves_what_is_below_to_the_horizon():
    rng = np.random.default_rng(1)
    normal = unit(rng.normal(size=(5, 3)))
    points = rng.normal(size=(5, 40, 3))
    height = np.einsum("pki,pi->pk", points, normal)
    clamped = points_of(clamp(directions_of(*points), as_jax(normal)))
    above = height > 1e-6
    np.testing.assert_allclose(clamped[above], points[above], atol=1e-6)
    below = points - height[..., None] * normal[:, None]
    np.testing.assert_allclose(clamped[~above], below[~above], atol=1e-5)


@pytest.mark.parametrize("tilt", [0.2, 0.9, 1.5])
def test_clamping_keeps_winding_numbers_above_the_horizon(tilt):
    """Exactly, where edges that cross the horizon have a vertex there; holes and overlaps too."""
    rng = np.random.default_rng(2)
    tried = 0
    for _ in range(6):
        axis = unit(rng.normal(size=3))
        normal = unit(np.cos(tilt) * axis + np.sin(tilt) * np.cross(axis, unit([0.1, 0.7, 0.2])))
        shape = star(rng, axis, 32, 0.3, 1.2)
        hole = circle(axis, 0.25, 12)[::-1]
        twice = about(axis, 4.0 * np.pi * np.arange(40) / 40, 0.8 + 0.3 * rng.random(40))
        for points in (shape, np.concatenate([shape, shape[:1], hole, hole[:1]]), twice):
            points = with_crossings(points, normal)
            clamped = points_of(clamp(directions_of(points), as_jax(normal[None])))[0]
            assert (clamped @ normal).min() > -1e-6
            where = random_directions(rng, 150)
            where = where[(where @ normal > 1e-3) & (where @ axis > 1e-3)]
            np.testing.assert_array_equal(winding(clamped, where), winding(points, where))
            tried += np.count_nonzero(winding(points, where))
    assert tried > 200


def test_clamping_to_two_hemispheres_keeps_winding_numbers_above_both():
    rng = np.random.default_rng(3)
    for _ in range(6):
        axis = unit(rng.normal(size=3))
        first, second = unit(axis + 0.5 * rng.normal(size=(2, 3)))
        points = with_crossings(star(rng, axis, 32), first)
        points = with_crossings(points, second)
        once = clamp(directions_of(points), as_jax(first[None]))
        clamped = unit(points_of(clamp(once, as_jax(second[None])))[0])
        where = random_directions(rng, 200)
        above = (where @ axis > 1e-3) & (where @ first > 0.02) & (where @ second > 0.02)
        np.testing.assert_array_equal(winding(clamped, where[above]), winding(points, where[above]))


def test_without_clamping_irradiance_is_wrong():
    """A cap about the horizon: half of it counts, not none."""
    points = circle([1.0, 0.0, 0.0], 0.5)
    normal = as_jax([[0.0, 1.0, 0.0]])
    half = irradiance(normalized(clamp(directions_of(points), normal)), normal)
    np.testing.assert_allclose(half, 0.5 - 0.5 * np.sin(1.0), rtol=1e-3)
    np.testing.assert_allclose(irradiance(directions_of(points), normal), 0.0, atol=1e-5)


@pytest.mark.parametrize("radius", [0.1, 0.4, 1.2])
def test_retracting_keeps_winding_numbers_inside_the_circle(radius):
    rng = np.random.default_rng(4)
    tried = 0
    for _ in range(8):
        axis = unit(rng.normal(size=3))
        centre = unit(axis + 0.4 * rng.normal(size=3))
        points = with_crossings(star(rng, centre, 64, 0.2, 1.2), axis, np.cos(radius))
        moved = retract(directions_of(points), as_jax(axis[None]), as_jax([np.cos(radius)]))
        moved = points_of(moved)[0]
        np.testing.assert_allclose(np.linalg.norm(moved, axis=-1), 1.0, atol=1e-5)
        assert (moved @ axis).min() > np.cos(radius) - 1e-6
        # Chords of the circle leave out what is nearer to it than their sagitta.
        where = about(axis, 2.0 * np.pi * rng.random(60), 0.85 * radius * np.sqrt(rng.random(60)))
        where = where[where @ centre > 0.0]
        np.testing.assert_array_equal(winding(moved, where), winding(points, where))
        tried += np.count_nonzero(winding(points, where))
    assert tried > 60


def test_retracting_keeps_directions_within_unit_length_next_to_the_opposite_axis():
    """1 - (d . axis)^2 is only rounding there."""
    axis = unit([0.3, -0.5, 0.8])
    for distance in (1e-2, 1e-3, 1e-4):
        points = circle(-axis, distance, 16)
        moved = points_of(retract(directions_of(points), as_jax(axis[None]), as_jax([0.9])))
        np.testing.assert_allclose(np.linalg.norm(moved, axis=-1), 1.0, atol=5e-3)
        np.testing.assert_allclose(moved @ axis, 0.9, atol=5e-3)


def test_only_a_polygon_round_the_opposite_of_the_axis_becomes_the_circle():
    """The known limit: nothing there can be lit, as the axis is above the horizon."""
    axis = as_jax([[0.0, 1.0, 0.0]])
    moved = points_of(retract(directions_of(circle([0, -1, 0], 0.3, 24)), axis, as_jax([0.9])))[0]
    assert abs(winding(moved, np.array([[0.01, 1.0, 0.02]]))[0]) == 1
    moved = points_of(retract(directions_of(circle([1, 0, 0], 0.3, 24)), axis, as_jax([0.9])))[0]
    assert winding(moved, np.array([[0.01, 1.0, 0.02]]))[0] == 0


def test_pieces_lie_on_the_arcs():
    rng = np.random.default_rng(5)
    points = star(rng, [0.2, 0.9, -0.3], 24)
    directions = directions_of(points)
    assert polygons.subdivide(directions, 1) == [directions]
    sets = [points_of(d)[0] for d in polygons.subdivide(directions, 3)]
    assert len(sets) == 3
    np.testing.assert_array_equal(sets[0], points_of(directions)[0])
    a, b = points, np.roll(points, -1, axis=0)
    for k in (1, 2):
        np.testing.assert_allclose(np.linalg.norm(sets[k], axis=-1), 1.0, atol=1e-6)
        np.testing.assert_allclose((sets[k] * np.cross(a, b)).sum(-1), 0.0, atol=1e-6)
        lengths = np.arccos((a * sets[k]).sum(-1)), np.arccos((a * b).sum(-1))
        np.testing.assert_allclose(lengths[0] / lengths[1], k / 3, atol=0.02)
    np.testing.assert_allclose(
        polygons.subdivide(directions, 2)[1].x[0], arcs(points, 2)[1::2, 0], atol=1e-6
    )


CENTRES = [[0, 1, 0], [0, -1, 0], [1, 0, 0], [0, 0, -1], [0.3, -0.5, 0.8]]


@pytest.mark.parametrize("centre", CENTRES)
def test_uniform_irradiance_of_caps(centre):
    """pi for the hemisphere, pi sin^2 r for a cap, and the complement for its hole."""
    centre = unit(centre)
    normal = as_jax(centre[None])
    horizon = circle(centre, 0.5 * np.pi, 128)
    np.testing.assert_allclose(irradiance(directions_of(horizon), normal), np.pi, rtol=1e-6)
    for radius in (0.05, 0.2, 0.7, 1.3):
        cap = circle(centre, radius, 512)
        exact = np.pi * np.sin(radius) ** 2
        np.testing.assert_allclose(irradiance(directions_of(cap), normal), exact, rtol=1e-4)
        np.testing.assert_allclose(irradiance(directions_of(cap[::-1]), normal), -exact, rtol=1e-4)
        holed = np.concatenate([horizon, horizon[:1], cap[::-1], cap[-1:]])  # and two bridges
        np.testing.assert_allclose(
            irradiance(directions_of(holed), normal), np.pi - exact, rtol=1e-4
        )


def test_uniform_irradiance_of_an_octant():
    """A right-angled triangle about each axis: a quarter of pi."""
    for sign in (1.0, -1.0):
        octant = sign * np.eye(3)[:: int(sign)]
        for axis in range(3):
            normal = as_jax([sign * np.eye(3)[axis]])
            got = irradiance(directions_of(octant), normal)
            np.testing.assert_allclose(got, 0.25 * np.pi, rtol=1e-6)


def test_uniform_irradiance_of_stars_against_samples():
    rng = np.random.default_rng(6)
    for _ in range(3):
        normal = unit(rng.normal(size=3))
        points = star(rng, normal, 40)
        # Stratified over the disc below the hemisphere: irradiance is pi times the share inside.
        side = 80
        i, j = np.meshgrid(np.arange(side), np.arange(side))
        r = np.sqrt((i.ravel() + 0.5) / side)
        where = about(normal, 2.0 * np.pi * (j.ravel() + 0.5) / side, np.arcsin(r))
        expected = np.pi * winding(points, where).mean()
        got = irradiance(directions_of(points), as_jax(normal[None]))
        np.testing.assert_allclose(got, expected, atol=5e-3 * np.pi)


def test_repeated_directions_and_bridges_add_nothing():
    rng = np.random.default_rng(7)
    normal = unit([0.2, 0.4, -0.9])
    points = star(rng, normal, 40)
    aside = about(normal, np.array([0.3]), np.array([0.1]))
    bridged = np.concatenate([points, points[:1], aside])
    padded = np.concatenate([points, np.repeat(points[-1:], 2, axis=0)])
    plain, *same = (
        irradiance(directions_of(p), as_jax(normal[None])) for p in (points, bridged, padded)
    )
    np.testing.assert_allclose(same[0], plain, rtol=2e-6)
    np.testing.assert_allclose(same[1], plain, rtol=2e-6)
    nothing = directions_of(np.repeat(normal[None], 40, axis=0))
    np.testing.assert_allclose(irradiance(nothing, as_jax(normal[None])), 0.0, atol=1e-7)


DEGENERATE = np.array(
    [
        *([0, 1, 0], [0, -1, 0], [0, -1, 0], [0, 0, 0], [1, 0, 0], [-1, 0, 0]),
        *([0, 0, 1], [0, 0, 0], [0, 0, 0], [0, 0.6, 0.8], [0, -0.6, -0.8], [0, 1, 0]),
    ],
    np.float64,
)


def test_degenerate_directions_stay_finite_and_so_do_gradients():
    """Zero vectors, equal neighbours, opposite ones, directions along the axis and against it."""

    def total(directions, axis, cosine):
        clamped = normalized(polygons.clamp_to_hemisphere(directions, axis))
        moved = polygons.retract_to_cap(clamped, axis, cosine)
        value = jnp.sum(polygons.uniform_irradiance(moved, axis))
        return value + sum(jnp.sum(part) for d in polygons.subdivide(moved, 3) for part in d)

    slope = jax.jit(jax.value_and_grad(total, argnums=(0, 1, 2)))
    for axis in ([0, 1, 0], [0, -1, 0], [1, 0, 0], [0, 0.6, 0.8]):
        for cosine in (0.0, 0.9, 1.0):
            got = slope(directions_of(DEGENERATE), as_jax([axis]), as_jax([cosine]))
            assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(got))


def test_gradient_of_irradiance_matches_finite_differences():
    rng = np.random.default_rng(8)
    normal = unit([0.3, 0.8, 0.1])
    points = star(rng, normal, 24)
    axis = as_jax(normal[None])

    def value(directions):
        moved = polygons.retract_to_cap(
            normalized(polygons.clamp_to_hemisphere(directions, axis)), axis, as_jax([0.7])
        )
        return polygons.uniform_irradiance(normalized(moved), axis)[0]

    slope = points_of(jax.jit(jax.grad(value))(directions_of(points)))[0]
    change = rng.normal(size=points.shape)
    value = jax.jit(value)
    ahead, back = (float(value(directions_of(points + s * 1e-3 * change))) for s in (1, -1))
    np.testing.assert_allclose((slope * change).sum(), (ahead - back) / 2e-3, rtol=0.02, atol=2e-3)


def test_directions_are_a_tree():
    """Maps over sets of directions reach their components."""
    doubled = jax.tree.map(lambda x: 2.0 * x, directions_of(np.eye(3)))
    assert isinstance(doubled, Directions)
    np.testing.assert_array_equal(points_of(doubled)[0], 2.0 * np.eye(3))
