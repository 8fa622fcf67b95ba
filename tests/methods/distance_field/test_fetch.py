"""Distances along any direction: texel centres, between them, below the horizon, gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from jaxvis.methods.distance_field.fetch import distance_at, signed_distances_at
from jaxvis.sphere.distance_host import signed_distances
from jaxvis.sphere.hemisphere_grid import texel_directions

UPRIGHT = np.eye(3, dtype=np.float32)[None]


def random_field(count, size, seed=0):
    return np.random.default_rng(seed).uniform(-1.5, 1.5, (count, size, size)).astype(np.float16)


def random_directions(count, seed=0, above=True):
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    if above:
        directions[:, 2] = np.abs(directions[:, 2])
    return (directions / np.linalg.norm(directions, axis=-1, keepdims=True)).astype(np.float32)


def random_frames(count, seed=0):
    rows = np.linalg.qr(np.random.default_rng(seed).normal(size=(count, 3, 3)))[0]
    return (rows * np.sign(np.linalg.det(rows))[:, None, None]).astype(np.float32)


def read(field, frames, directions):
    found = signed_distances_at(jnp.asarray(field), jnp.asarray(frames), jnp.asarray(directions))
    return np.asarray(found)


def angles(directions):
    """(theta, phi) in double precision."""
    x, y, z = np.asarray(directions, np.float64).T
    return np.arctan2(np.hypot(y, z), x), np.arctan2(z, y)


@pytest.mark.parametrize("size", [4, 32, 128])
def test_texel_centres_have_their_own_value(size):
    field = random_field(2, size)
    found = read(field, np.repeat(UPRIGHT, 2, axis=0), texel_directions(size).reshape(-1, 3))
    np.testing.assert_allclose(found, field.reshape(2, -1).astype(np.float32), atol=3e-3)


@pytest.mark.parametrize("size", [5, 32, 128])
def test_between_centres_it_is_bilinear_and_constant_beyond_the_outermost(size):
    field, directions = random_field(3, size), random_directions(5000)
    rows, columns = (angle * size / np.pi - 0.5 for angle in angles(directions))
    for sample, found in enumerate(read(field, np.repeat(UPRIGHT, 3, axis=0), directions)):
        expected = map_coordinates(
            field[sample].astype(np.float64), [rows, columns], order=1, mode="nearest"
        )
        np.testing.assert_allclose(found, expected, atol=2e-3)


def test_each_sample_reads_its_own_map_in_its_own_frame():
    field, frames, directions = random_field(6, 32), random_frames(6), random_directions(400)
    found = read(field, frames, directions)
    for sample in range(6):
        local = directions.astype(np.float64) @ frames[sample].T.astype(np.float64)
        above = local[:, 2] > 0.0
        rows, columns = (angle * 32 / np.pi - 0.5 for angle in angles(local[above]))
        expected = map_coordinates(
            field[sample].astype(np.float64), [rows, columns], order=1, mode="nearest"
        )
        np.testing.assert_allclose(found[sample, above], expected, atol=2e-3)


@pytest.mark.parametrize("size", [32, 128])
def test_a_half_space_is_the_angle_to_its_great_circle(size):
    for axis in ([0.0, 0.0, 1.0], [0.3, 0.6, 0.74], [-0.8, 0.1, 0.59]):
        axis = np.array(axis) / np.linalg.norm(axis)
        if axis[2] > 0.99:
            continue  # the horizon is no boundary
        field = signed_distances((texel_directions(size) @ axis >= 0.0)[None])
        directions = random_directions(2000)
        along = directions @ axis
        # Where the nearest point of the circle is above the horizon.
        foot = directions - along[:, None] * axis
        inside = foot[:, 2] > 0.1 * np.linalg.norm(foot, axis=-1)
        found = read(field, UPRIGHT, directions)[0]
        expected = np.arcsin(along)
        assert inside.sum() > 300
        assert np.abs(found - expected)[inside].max() < 1.1 * np.pi / size


def test_below_the_horizon_it_is_the_nearest_horizon_point_less_the_angle():
    size = 64
    field = np.asarray(random_field(1, size))
    directions = random_directions(3000, above=False)
    directions = directions[directions[:, 2] < 0.0]
    found = read(field, UPRIGHT, directions)[0]
    level = directions.astype(np.float64) * [1.0, 1.0, 0.0]
    level /= np.linalg.norm(level, axis=-1, keepdims=True)
    rows = angles(level)[0] * size / np.pi - 0.5
    columns = np.where(level[:, 1] > 0.0, 0.0, size - 1.0)
    on_horizon = map_coordinates(
        field[0].astype(np.float64), [rows, columns], order=1, mode="nearest"
    )
    expected = on_horizon + np.arcsin(directions[:, 2].astype(np.float64))
    # At the nadir every point of the horizon is nearest.
    steep = directions[:, 2] < -0.999
    np.testing.assert_allclose(found[~steep], expected[~steep], atol=6e-3)


def test_nothing_jumps_at_the_horizon_or_along_it():
    visible = texel_directions(64) @ np.array([0.2, 0.3, 0.93]) < 0.8
    field = signed_distances(visible[None])
    angle = np.linspace(0.01, 2.0 * np.pi + 0.01, 4001)
    for height in (0.0, -0.3, -0.8):
        ring = np.sqrt(1.0 - height**2)
        around = np.stack([ring * np.cos(angle), ring * np.sin(angle), 0 * angle + height], -1)
        found = read(field, UPRIGHT, around.astype(np.float32))[0]
        assert np.abs(np.diff(found)).max() < 0.02
    above, below = (
        read(
            field,
            UPRIGHT,
            np.stack([np.cos(angle), np.sin(angle), 0 * angle + z], -1).astype(np.float32),
        )
        for z in (1e-5, -1e-5)
    )
    np.testing.assert_allclose(above, below, atol=1e-3)


def test_gradients_through_directions_and_distances_are_differences():
    field, frames = jnp.asarray(random_field(1, 16)), jnp.asarray(random_frames(1))
    sample = jnp.zeros((), jnp.int32)

    @jax.jit
    def along(direction):
        x, y, z = direction / jnp.linalg.norm(direction)
        return distance_at(field, sample, x, y, z)

    step, slope = 1e-3, jax.jit(jax.grad(along))
    for direction in random_directions(20, seed=3):
        local = np.asarray(direction, np.float64)
        rows, columns = (angle * 16 / np.pi - 0.5 for angle in angles(local[None]))
        # Differences that straddle a kink tell nothing.
        if min(abs(rows % 1 - 0.5), abs(columns % 1 - 0.5)) > 0.45 or local[2] < 0.1:
            continue
        gradient = np.asarray(slope(jnp.asarray(direction)))
        for axis in np.eye(3):
            ends = [
                float(along(jnp.asarray(direction + sign * step * axis, jnp.float32)))
                for sign in (1, -1)
            ]
            assert gradient @ axis == pytest.approx((ends[0] - ends[1]) / (2 * step), abs=0.06)
    directions = jnp.asarray(random_directions(50))
    weights = jax.jit(jax.grad(lambda f: signed_distances_at(f, frames, directions).sum()))(field)
    # Bilinear weights of each direction add up to 1.
    assert float(weights.sum()) == pytest.approx(50.0, rel=1e-2)


@pytest.mark.parametrize(
    "direction", [(1, 0, 0), (-1, 0, 0), (0, 0, 1), (0, 0, -1), (0, 1, 0), (0, -1, 0)]
)
def test_values_and_gradients_are_finite_at_poles_zenith_and_nadir(direction):
    field = jnp.asarray(random_field(1, 16))

    def along(local):
        return distance_at(field, jnp.zeros((), jnp.int32), *local)

    value, gradient = jax.value_and_grad(along)(jnp.asarray(direction, jnp.float32))
    assert np.isfinite(value)
    assert np.all(np.isfinite(gradient))
