"""Rays drawn by the BRDF are those of the reflectance's own sampling."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.methods.traced import shading_points
from jaxvis.methods.visibility_field.brdf_rays import brdf_directions, ggx_directions, lobes
from jaxvis.reflectance import CookTorrance, Lambert, Material, Phong
from jaxvis.sampling.sequences import hammersley
from jaxvis.sphere.components import join
from tests.methods.known_scenes import SCENES

SAMPLES = 32
MODELS = [Lambert(), Phong(), CookTorrance("ggx"), CookTorrance("beckmann")]


def points_of(roughness, reflectance):
    material = Material(base_colour=(0.3, 0.2, 0.1), specular=(0.6,) * 3, roughness=roughness)
    return shading_points(SCENES[3].surface(material, reflectance))


def uniforms_of(turn):
    square = hammersley(SAMPLES)
    angle = square[None, :, 1] + turn[:, None]
    angle = angle - jnp.floor(angle)
    return join(jnp.broadcast_to(square[None, :, 0], angle.shape), angle, lobes(SAMPLES, turn))


@pytest.mark.parametrize("roughness", [0.1, 0.45, 1.0])
@pytest.mark.parametrize("model", MODELS, ids=repr)
def test_directions_are_the_reflectances_own(model, roughness):
    points = points_of(roughness, model)
    turn = jax.random.uniform(jax.random.key(4), points.pixel.shape)
    found = brdf_directions(points, turn, samples=SAMPLES, reflectance=model)
    expected = model.sample(*points.per_sample(), uniforms_of(turn))
    # A facet seen edge-on turns with the last digit of the view: few directions, and slightly.
    apart = np.linalg.norm(np.stack(found, axis=-1) - np.asarray(expected), axis=-1)
    assert np.quantile(apart, 0.999) < 1e-4
    assert np.max(apart) < 1e-2
    np.testing.assert_allclose(np.linalg.norm(np.stack(found), axis=0), 1.0, atol=1e-5)


def test_the_comparison_would_see_another_width():
    """Negative control: facets that are a tenth wider send rays elsewhere."""
    model = CookTorrance("ggx")
    points, wider = points_of(0.45, model), points_of(0.45 * 1.1**0.5, model)
    turn = jax.random.uniform(jax.random.key(4), points.pixel.shape)
    square, lobe = hammersley(SAMPLES), lobes(SAMPLES, turn)
    found = ggx_directions(wider, turn, square, lobe, model)
    expected = model.sample(*points.per_sample(), uniforms_of(turn))
    apart = np.linalg.norm(np.stack(found, axis=-1) - np.asarray(expected), axis=-1)
    assert np.quantile(apart, 0.999) > 1e-2


def test_lobe_numbers_are_spread_evenly_for_each_pixel():
    numbers = np.sort(np.asarray(lobes(64, jnp.linspace(0.0, 0.99, 7))), axis=1)
    assert np.all(numbers >= 0.0)
    assert np.all(numbers < 1.0)
    gaps = np.diff(np.concatenate([numbers, numbers[:, :1] + 1.0], axis=1), axis=1)
    assert gaps.max() < 4.0 / 64
