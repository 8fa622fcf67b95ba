"""Errors of what neighbours foretell: an oracle in NumPy, closed forms, what harmonics miss."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.methods.distance_field.fetch import signed_distances_at
from jaxvis.methods.distance_field.foretold import (
    BLUR,
    SHARE,
    SIDE,
    Seen,
    check_measure,
    contested,
    foretold,
)
from jaxvis.methods.distance_field.neighbours import Nearest
from jaxvis.sphere.distance_host import signed_distances
from jaxvis.sphere.frames import frames_on_host
from jaxvis.sphere.hemisphere_grid import texel_directions, texel_solid_angles

UP = np.array([0.0, 0.0, 1.0])


def seen_of(blocked, normals, size=64):
    """Maps that are blocked where ``blocked(world directions)`` says."""
    frames = frames_on_host(np.asarray(normals, np.float32))
    world = np.einsum("ija,sac->sijc", texel_directions(size), frames)
    maps = ~np.stack([b(w) for b, w in zip(blocked, world, strict=True)])
    return Seen(maps, signed_distances(maps), frames)


def near_of(samples):
    samples = np.asarray(samples, np.int32)
    return Nearest(samples, np.ones(samples.shape, np.float32), samples >= 0)


def toward(axis, cosine):
    return lambda d: d @ np.asarray(axis) > cosine


def random_case(count=12, near=5, size=64):
    rng = np.random.default_rng(3)
    axes = rng.normal(size=(count, 3)) + UP
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    normals = 0.3 * rng.normal(size=(count, 3)) + UP
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    seen = seen_of(
        [toward(a, c) for a, c in zip(axes, rng.random(count), strict=True)], normals, size
    )
    samples = rng.integers(0, count, (count, near))
    samples[:, -1] = np.where(rng.random(count) < 0.5, -1, samples[:, -1])
    share = rng.random((count, near)).astype(np.float32) * (samples >= 0)
    return seen, near_of(samples), share / share.sum(axis=1, keepdims=True)


def coverage(distance):
    return np.clip(0.5 + distance / BLUR, 0.0, 1.0)


@pytest.mark.parametrize(
    ("size", "atol"),
    [
        (16, 2e-3),
        (32, 2e-3),
        # Every second and every fourth texel is read: boundaries move by a part of a texel.
        (64, 0.05),
        (128, 0.05),
    ],
)
def test_distances_are_compared_as_they_are_read_for_shading(size, atol):
    seen, near, share = random_case(size=size)
    local = texel_directions(SIDE).reshape(-1, 3)
    weight = np.repeat(texel_solid_angles(SIDE), SIDE) * local[:, 2]
    weight /= weight.sum()
    off = foretold(seen, near, share, "distances")
    no_maps = contested(seen, seen.frames, near, share)
    for sample in range(len(seen.maps)):
        world = jnp.asarray(local @ seen.frames[sample], jnp.float32)
        read = signed_distances_at(
            jnp.asarray(seen.signed_distance), jnp.asarray(seen.frames), world
        )
        read = np.asarray(read, np.float64)
        there = near.samples[sample] >= 0
        around = read[near.samples[sample][there]]
        together = share[sample][there] @ around
        own = coverage(read[sample])
        expected = np.abs(coverage(together) - own) @ weight / SHARE
        assert off.error[sample] == pytest.approx(expected, rel=0.02, abs=atol)
        pairs = np.abs(coverage(around) - own) @ weight / SHARE
        np.testing.assert_allclose(off.pairs[sample][there], pairs, rtol=0.02, atol=atol)
        assert not off.pairs[sample][~there].any()
        alone = np.abs(coverage(around) - coverage(together)) @ weight / SHARE
        assert no_maps[sample] == pytest.approx(share[sample][there] @ alone, rel=0.02, abs=atol)


def test_half_of_the_sky_is_half_of_the_weight():
    """One sample sees everything, its neighbour nothing on one side: half is misjudged."""
    seen = seen_of([toward(UP, 2.0), toward([1.0, 0.0, 0.0], 0.0)], [UP, UP])
    near, share = near_of([[1], [0]]), np.ones((2, 1), np.float32)
    off = foretold(seen, near, share, "distances")
    np.testing.assert_allclose(off.error * SHARE, 0.5, atol=0.03)
    np.testing.assert_array_equal(off.pairs[:, 0], off.error)


@pytest.mark.parametrize("measure", ["distances", "coefficients"])
def test_equal_neighbours_foretell_exactly(measure):
    seen = seen_of([toward([0.6, 0.0, 0.8], 0.7)] * 3, [UP] * 3)
    near = near_of([[1, 2], [0, 2], [0, 1]])
    off = foretold(seen, near, np.full((3, 2), 0.5, np.float32), measure)
    assert off.error.max() < 1e-4
    assert contested(seen, seen.frames, near, np.full((3, 2), 0.5, np.float32)).max() < 1e-4


def test_distances_follow_an_edge_that_moves():
    """An occluder's edge at -20, 0 and 20 degrees: the mean distance tells the middle one."""
    angles = np.deg2rad([-20.0, 0.0, 20.0])
    edges = [toward([np.cos(a), 0.0, np.sin(a)], 0.0) for a in angles]
    seen = seen_of(edges, [UP] * 3)
    near, share = near_of([[1, 2], [0, 2], [0, 1]]), np.full((3, 2), 0.5, np.float32)
    off = foretold(seen, near, share, "distances")
    assert off.error[1] < 0.1
    # The outer ones it does not tell, and its own neighbours differ from it and from one another.
    assert off.error[[0, 2]].min() > 0.3
    assert off.pairs[1].min() > 0.3
    assert contested(seen, seen.frames[1:2], near_of([[0, 2]]), share[:1])[0] > 0.3


def test_a_wrong_measure_is_named():
    with pytest.raises(ValueError, match=r"^measure must be distances or coefficients, got 'l2'$"):
        check_measure("l2")
