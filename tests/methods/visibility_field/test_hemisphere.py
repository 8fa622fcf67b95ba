"""Rays about the normal: their density, their turns, and their sum as a product of matrices."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.methods.visibility_field.cull import ACCEPT, DROP, TRACE
from jaxvis.methods.visibility_field.hemisphere import (
    Shifts,
    local_directions,
    mean_radiance,
    shifts,
    turned_frames,
    turns,
    world_directions,
)
from jaxvis.sphere import harmonics


def moved(seed=0):
    return shifts(jax.random.key(seed))


def unit_vectors(count, seed=0):
    v = np.random.default_rng(seed).normal(size=(count, 3))
    v = np.concatenate([v, np.eye(3), -np.eye(3)])
    return jnp.asarray(v / np.linalg.norm(v, axis=1, keepdims=True), jnp.float32)


def frames_of(count=30, seed=0):
    normal = unit_vectors(count, seed)
    turn = np.random.default_rng(seed).random(len(normal))
    return turned_frames(normal, jnp.asarray(turn, jnp.float32))


def test_a_key_decides_the_shifts():
    one, again, other = moved(3), moved(3), moved(4)
    for a, b, c in zip(one, again, other, strict=True):
        np.testing.assert_array_equal(a, b)
        assert np.any(np.asarray(a) != np.asarray(c))


def test_shifts_are_uniform_over_keys():
    keys = jax.random.split(jax.random.key(0), 4000)
    many = jax.vmap(shifts)(keys)
    for values in (many.turn, (many.tile % 64)[:, 0] / 64, (many.tile % 64)[:, 1] / 64):
        counts = np.histogram(values, 16, (0.0, 1.0))[0]
        assert counts.sum() == 4000
        assert np.sum((counts - 250.0) ** 2 / 250.0) < 45.0  # chi-square, 15 degrees: p = 1e-4
    together = np.corrcoef(np.stack([many.turn, *many.tile.T]))
    assert np.abs(together - np.eye(3)).max() < 4.0 / np.sqrt(4000)


@pytest.mark.parametrize("samples", [1, 7, 16, 256])
def test_rays_rise_as_the_cosine_says(samples):
    """cos^2 is uniform: its values are the midpoints of as many strata. The turns are others'."""
    local = np.asarray(local_directions(samples), np.float64)
    np.testing.assert_allclose(np.linalg.norm(local, axis=1), 1.0, atol=1e-6)
    expected = 1.0 - (np.arange(samples) + 0.5) / samples
    np.testing.assert_allclose(local[:, 2] ** 2, expected, atol=1e-6)
    assert len(np.unique(np.round(np.arctan2(local[:, 1], local[:, 0]), 5))) == samples


def test_the_density_over_keys_is_the_cosines_to_the_strata():
    """First and second moments of cosine-weighted directions: (0, 0, 2/3), (1/4, 1/4, 1/2)."""
    directions = []
    for seed in range(300):
        frames = turned_frames(jnp.array([[0.0, 0.0, 1.0]]), moved(seed).turn[None])
        directions.append(np.stack(world_directions(frames, local_directions(16)), axis=-1)[0])
    v = np.concatenate(directions).astype(np.float64)
    np.testing.assert_allclose(v.mean(axis=0), [0.0, 0.0, 2.0 / 3.0], atol=0.01)
    np.testing.assert_allclose((v**2).mean(axis=0), [0.25, 0.25, 0.5], atol=0.01)


def test_turns_are_in_one_round_and_differ_between_neighbours():
    height, width = 90, 130
    turn = np.asarray(turns(jnp.arange(height * width), jnp.int32(width), moved()))
    assert turn.min() >= 0.0
    assert turn.max() < 1.0
    image = turn.reshape(height, width)
    np.testing.assert_array_equal(image[64:], image[: height - 64])  # the tile repeats
    np.testing.assert_array_equal(image[:, 64:128], image[:, :64])
    assert len(np.unique(np.round(image[:64, :64] * 4096))) > 4000

    def apart(image):
        """Mean distance of neighbours along the circle of turns."""
        steps = [np.diff(image, axis=axis) for axis in (0, 1)]
        return np.mean([np.abs(step - np.rint(step)).mean() for step in steps])

    white = np.random.default_rng(0).random((height, width))
    assert apart(image) > 1.15 * apart(white)


def test_pixels_left_out_leave_the_others_turns_alone():
    width, chosen = 37, np.array([3, 40, 36, 37, 1000, 1001])
    every = np.asarray(turns(jnp.arange(1100), jnp.int32(width), moved(1)))
    few = np.asarray(turns(jnp.asarray(chosen), jnp.int32(width), moved(1)))
    np.testing.assert_array_equal(few, every[chosen])


def test_a_keys_turn_adds_to_the_tile():
    pixel, width = jnp.arange(500), jnp.int32(25)
    here = Shifts(jnp.array([0, 0]), jnp.float32(0.0))
    there = Shifts(jnp.array([0, 0]), jnp.float32(0.75))
    difference = np.asarray(turns(pixel, width, there)) - np.asarray(turns(pixel, width, here))
    np.testing.assert_allclose(difference - np.floor(difference), 0.75, atol=1e-6)
    across = Shifts(jnp.array([2, 5]), jnp.float32(0.0))
    tile = np.asarray(turns(pixel, width, here)).reshape(20, 25)
    other = np.asarray(turns(pixel, width, across)).reshape(20, 25)
    np.testing.assert_array_equal(other[:-2, :-5], tile[2:, 5:])


def test_frames_are_orthonormal_right_handed_and_turned():
    normal = unit_vectors(50)
    turn = jnp.asarray(np.random.default_rng(1).random(len(normal)), jnp.float32)
    frames = np.asarray(turned_frames(normal, turn), np.float64)
    gram = np.einsum("pkc,plc->pkl", frames, frames)
    np.testing.assert_allclose(gram, np.broadcast_to(np.eye(3), gram.shape), atol=2e-6)
    np.testing.assert_allclose(np.linalg.det(frames), 1.0, atol=2e-6)
    np.testing.assert_array_equal(frames[:, 2], np.asarray(normal))
    still = np.asarray(turned_frames(normal, jnp.zeros_like(turn)), np.float64)
    angle = np.arctan2(
        np.einsum("pc,pc->p", frames[:, 0], still[:, 1]),
        np.einsum("pc,pc->p", frames[:, 0], still[:, 0]),
    )
    apart = angle / (2.0 * np.pi) - np.asarray(turn)
    np.testing.assert_allclose(apart - np.rint(apart), 0.0, atol=2e-6)


def test_world_directions_are_the_frames_combinations():
    frames, local = frames_of(), local_directions(11)
    found = np.stack(world_directions(frames, local), axis=-1)
    expected = np.einsum("sk,pkc->psc", np.asarray(local), np.asarray(frames))
    np.testing.assert_allclose(found, expected, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(found, axis=-1), 1.0, atol=1e-5)
    rise = np.einsum("psc,pc->ps", found, np.asarray(frames)[:, 2])
    np.testing.assert_allclose(rise, np.broadcast_to(local[:, 2], rise.shape), atol=1e-6)


@pytest.mark.parametrize("samples", [1, 16, 129])
def test_the_mean_is_that_of_the_rays_one_by_one(samples):
    rng = np.random.default_rng(samples)
    coefficients = rng.normal(size=(9, 3)).astype(np.float32)
    frames, local = frames_of(seed=samples), local_directions(samples)
    decision = rng.choice([DROP, ACCEPT, TRACE], (len(frames), samples)).astype(np.uint8)
    decision[0], decision[1] = ACCEPT, DROP
    found = mean_radiance(jnp.asarray(coefficients), frames, local, jnp.asarray(decision))
    directions = jnp.stack(world_directions(frames, local), axis=-1)
    radiance = np.asarray(harmonics.reconstruct(jnp.asarray(coefficients), directions), np.float64)
    expected = (radiance * (decision == ACCEPT)[..., None]).sum(axis=1) / samples
    np.testing.assert_allclose(found, expected, atol=3e-6 * np.abs(radiance).max())
    assert np.all(np.asarray(found)[1] == 0.0)


@pytest.mark.parametrize("which", range(9))
def test_the_mean_of_each_harmonic_alone(which):
    coefficients = jnp.zeros((9, 3)).at[which].set(jnp.array([1.0, -2.0, 0.5]))
    frames, local = frames_of(seed=5), local_directions(16)
    decision = np.random.default_rng(which).choice([DROP, ACCEPT], (len(frames), 16))
    found = mean_radiance(coefficients, frames, local, jnp.asarray(decision, jnp.uint8))
    directions = jnp.stack(world_directions(frames, local), axis=-1)
    function = np.asarray(harmonics.evaluate(directions, 3), np.float64)[..., which]
    expected = (function * (decision == ACCEPT)).sum(axis=1) / 16
    np.testing.assert_allclose(found, expected[:, None] * [1.0, -2.0, 0.5], atol=4e-6)


def test_many_free_rays_give_the_irradiance_over_pi():
    coefficients = jnp.asarray(np.random.default_rng(0).normal(size=(9, 3)), jnp.float32)
    frames, local = frames_of(), local_directions(1024)
    every = jnp.full((len(frames), 1024), ACCEPT, jnp.uint8)
    found = mean_radiance(coefficients, frames, local, every)
    expected = harmonics.irradiance(coefficients, frames[:, 2]) / jnp.pi
    np.testing.assert_allclose(found, expected, atol=5e-3)
