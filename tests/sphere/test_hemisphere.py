"""Both maps keep areas and have inverses, centre, rim and horizon included."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxvis.sphere import hemisphere

to_direction = jax.jit(hemisphere.to_direction)
from_direction = jax.jit(hemisphere.from_direction)
square_to_disc = jax.jit(hemisphere.square_to_disc)
disc_to_square = jax.jit(hemisphere.disc_to_square)


def disc_points(count=400, radius=1.0):
    rng = np.random.default_rng(0)
    r, phi = radius * np.sqrt(rng.random(count)), 2 * np.pi * rng.random(count)
    return jnp.asarray(np.stack([r * np.cos(phi), r * np.sin(phi)], axis=-1), jnp.float32)


def test_the_disc_is_lamberts_map():
    points = disc_points()
    directions = to_direction(points)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0, atol=1e-6)
    np.testing.assert_allclose(
        directions[:, 2], 1.0 - np.sum(np.square(points), axis=-1), atol=1e-6
    )
    known = jnp.array([[0.0, 0.0], [1.0, 0.0], [0.0, -1.0]])
    expected = [[0, 0, 1], [1, 0, 0], [0, -1, 0]]
    np.testing.assert_allclose(to_direction(known), expected, atol=1e-6)


def test_disc_and_directions_undo_each_other_below_the_horizon_too():
    points = jnp.concatenate([disc_points(), disc_points(radius=1.41), jnp.zeros((1, 2))])
    there = to_direction(points)
    np.testing.assert_allclose(from_direction(there), points, atol=2e-6)
    # -z is a whole circle: the direction is found, the point is (0, 0), nothing is NaN.
    rim = jnp.array([[np.sqrt(2.0), 0.0], [1.0, 1.0]])
    np.testing.assert_allclose(to_direction(rim)[:, 2], -1.0, atol=1e-6)
    np.testing.assert_array_equal(from_direction(jnp.array([0.0, 0.0, -1.0])), [0, 0])


def test_from_direction_keeps_its_precision_near_the_lower_pole():
    angle = np.array([1e-2, 1e-3, 1e-4])
    directions = np.stack([np.sin(angle), 0 * angle, -np.cos(angle)], axis=-1)
    expected = np.sqrt(2.0) * np.cos(angle / 2.0)
    got = from_direction(jnp.asarray(directions, jnp.float32))[:, 0]
    np.testing.assert_allclose(got, expected, rtol=1e-6)


def test_both_maps_keep_areas():
    points = disc_points(200)
    tangents = np.asarray(jax.jit(jax.vmap(jax.jacfwd(to_direction)))(points), np.float64)
    area = np.linalg.norm(np.cross(tangents[..., 0], tangents[..., 1]), axis=-1)
    np.testing.assert_allclose(area, 2.0, rtol=1e-4)
    square = jnp.asarray(np.random.default_rng(1).random((200, 2)), jnp.float32)
    jacobian = np.asarray(jax.jit(jax.vmap(jax.jacfwd(square_to_disc)))(square), np.float64)
    np.testing.assert_allclose(np.linalg.det(jacobian), np.pi, rtol=1e-4)


def test_square_and_disc_undo_each_other():
    line = np.linspace(0.0, 1.0, 21)
    square = jnp.asarray(np.stack(np.meshgrid(line, line), axis=-1), jnp.float32)
    disc = square_to_disc(square)
    np.testing.assert_allclose(disc_to_square(disc), square, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(disc[0], axis=-1), 1.0, atol=1e-6)
    np.testing.assert_allclose(disc[10, 10], [0.0, 0.0], atol=1e-7)
    np.testing.assert_allclose(disc[10, 20], [1.0, 0.0], atol=1e-6)
    points = disc_points()
    again = square_to_disc(disc_to_square(points))
    np.testing.assert_allclose(again, points, atol=1e-6)


def test_gradients_are_finite_at_the_special_points():
    for function, point in (
        (to_direction, [0.0, 0.0]),
        (to_direction, [1.0, 1.0]),
        (from_direction, [0.0, 0.0, 1.0]),
        (from_direction, [0.0, 0.0, -1.0]),
        (square_to_disc, [0.5, 0.5]),
        (disc_to_square, [0.0, 0.0]),
    ):
        assert np.all(np.isfinite(jax.jit(jax.jacrev(function))(jnp.array(point)))), function
