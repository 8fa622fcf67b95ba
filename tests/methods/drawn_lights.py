"""Holds the directions that a light draws for points to the density that it tells."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxvis.methods.estimators import Drawn
from jaxvis.methods.traced import shading_points
from jaxvis.sampling.random import key_words
from jaxvis.sphere import latlong
from tests.sampling.chi_square import p_value


def probabilities(light, points):
    """Of each texel for each point [points, texels], by the light's density."""
    height, width = light.environment.radiance.shape[:2]
    shape = (len(points.pixel), height * width)
    centres = latlong.texel_directions(height, width).reshape(-1, 3).astype(np.float32)
    directions = tuple(jnp.broadcast_to(axis, shape) for axis in centres.T)
    texel = jnp.broadcast_to(jnp.arange(shape[1]), shape)
    angles = np.repeat(latlong.row_solid_angles(height, width), width)
    return np.asarray(light.density(points, Drawn(directions, texel)), np.float64) * angles


def drawn_by(light, points, samples, seed=0):
    """Texels and directions for each point."""
    return light.draw(key_words(jax.random.key(seed)), points, samples)


def assert_draws_follow_the_density(light, surface, samples=1, seeds=24, significance=1e-5):
    """Chi-squared over texels, and over quarters of them: positions within texels are uniform.

    Returns the probabilities of each texel for each point.
    """
    points = shading_points(surface)
    expected = probabilities(light, points)
    np.testing.assert_allclose(expected.sum(axis=1), 1.0, atol=2e-6)
    height, width = light.environment.radiance.shape[:2]
    total = np.zeros((height * width, 4))
    for seed in range(seeds):
        drawn = drawn_by(light, points, samples, seed)
        directions = jnp.stack(drawn.directions, axis=-1)
        np.testing.assert_allclose(jnp.linalg.norm(directions, axis=-1), 1.0, atol=1e-5)
        row, column = latlong.texel(directions, height, width)
        assert np.mean(np.asarray(row * width + column == drawn.texel)) > 0.999
        fine_row, fine_column = latlong.texel(directions, 2 * height, 2 * width)
        quarter = 2 * (np.asarray(fine_row) % 2) + np.asarray(fine_column) % 2
        np.add.at(total, (np.asarray(drawn.texel).reshape(-1), quarter.reshape(-1)), 1)
    assert np.all(total[expected.sum(axis=0) == 0.0] == 0.0)
    counts = total.sum(axis=1)
    mean = expected.mean(axis=0)
    assert p_value(counts, counts.sum() * mean / mean.sum()) > significance
    edges = np.cos(np.pi * np.arange(2 * height + 1) / (2 * height))
    halves = (edges[:-1] - edges[1:]).reshape(height, 2)
    share = np.repeat(halves / halves.sum(axis=1, keepdims=True), 2, axis=1) / 2.0
    inside = np.repeat(share, width, axis=0) * counts[:, None]
    assert p_value(total, inside) > significance
    return expected
