"""Directions from the texels' alias table: poles, seam, and positions within texels."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.sampling import EnvironmentSampler
from jaxvis.sphere import latlong

from .chi_square import SIGNIFICANCE, p_value
from .latlong_maps import MAPS, fine_counts, fine_probabilities

COUNT = 100_000
sample = jax.jit(EnvironmentSampler.sample)
pdf = jax.jit(EnvironmentSampler.pdf)


@pytest.fixture(scope="module")
def uniforms():
    return jax.random.uniform(jax.random.key(31), (COUNT, 4))


@pytest.mark.parametrize("dimensions", [2, 3, 4])
@pytest.mark.parametrize("name", MAPS)
def test_directions_follow_the_map_within_its_texels(name, dimensions, uniforms):
    """A direction may round to the texel beside its own: 1e-5 of the draws a texel may stray."""
    values = MAPS[name]
    drawn = sample(EnvironmentSampler.build(values), uniforms[:, :dimensions])
    counts = fine_counts(drawn.directions, *values.shape, 4)
    probabilities = fine_probabilities(values, 4)
    strays = counts[probabilities == 0.0].sum()
    assert strays <= 1e-5 * COUNT * values.size
    counts[probabilities == 0.0] = 0.0
    assert p_value(counts, COUNT * probabilities) > SIGNIFICANCE
    np.testing.assert_allclose(np.linalg.norm(drawn.directions, axis=-1), 1.0, atol=1e-6)


def test_forgetting_the_solid_angle_would_show(uniforms):
    values = MAPS["random"]
    drawn = sample(EnvironmentSampler.build(values), uniforms)
    counts = fine_counts(drawn.directions, *values.shape, 1)
    assert p_value(counts, COUNT * values / values.sum()) < SIGNIFICANCE


@pytest.mark.parametrize("name", MAPS)
def test_texels_directions_and_densities_agree(name, uniforms):
    values = MAPS[name]
    height, width = values.shape
    sampler = EnvironmentSampler.build(values)
    drawn = sample(sampler, uniforms)
    row, column = latlong.texel(drawn.directions, height, width)
    same = np.asarray(row * width + column == drawn.texel)
    assert same.mean() > 1.0 - 1e-5 * values.size
    exact = fine_probabilities(values, 1) / latlong.row_solid_angles(height, width)[:, None]
    np.testing.assert_allclose(drawn.pdf, exact.reshape(-1)[drawn.texel], rtol=1e-6)
    np.testing.assert_array_equal(np.asarray(pdf(sampler, drawn.directions))[same], drawn.pdf[same])
    np.testing.assert_array_equal(sampler.texel_pdf(drawn.texel), drawn.pdf)
    centres = jnp.asarray(latlong.texel_directions(height, width), jnp.float32)
    np.testing.assert_allclose(pdf(sampler, centres), exact, rtol=1e-6)
    np.testing.assert_allclose(pdf(sampler, 1e3 * centres), exact, rtol=1e-6)


def test_the_density_integrates_to_one_and_so_does_its_estimate(uniforms):
    sampler = EnvironmentSampler.build(MAPS["poles"])
    angles = latlong.row_solid_angles(6, 12)[:, None]
    assert abs(np.sum(np.asarray(sampler.density, np.float64) * angles) - 1.0) < 1e-6
    drawn = sample(sampler, uniforms)
    weights = 1.0 / np.asarray(drawn.pdf, np.float64)
    assert abs(weights.mean() - 4.0 * np.pi) < 4.0 * weights.std() / np.sqrt(COUNT)


def test_black_texels_are_never_drawn(uniforms):
    values = MAPS["black rows"]
    drawn = sample(EnvironmentSampler.build(values), uniforms)
    assert np.all(values.reshape(-1)[np.asarray(drawn.texel)] > 0.0)


def test_several_lights_can_be_mapped_over(uniforms):
    one, other = (EnvironmentSampler.build(MAPS[name]) for name in ("random", "poles"))
    both = jax.tree.map(lambda *leaves: jnp.stack(leaves), one, other)
    mapped = jax.jit(jax.vmap(EnvironmentSampler.sample, in_axes=(0, None)))
    drawn = mapped(both, uniforms)
    np.testing.assert_array_equal(drawn.texel[1], sample(other, uniforms).texel)


def test_wrong_input_is_named(uniforms):
    sampler = EnvironmentSampler.build(MAPS["random"])
    with pytest.raises(ValueError, match="2, 3 or 4"):
        sampler.sample(uniforms[:, :1])
    with pytest.raises(ValueError, match="luminance"):
        EnvironmentSampler.build(-MAPS["random"])
