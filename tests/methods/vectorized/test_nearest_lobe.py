"""Phong lobes that stand for other models: directional albedos, light that they reflect."""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.lighting import windows
from jaxvis.methods.vectorized.nearest_lobe import share_above_horizon, specular_lobe
from jaxvis.reflectance import BlinnPhong, CookTorrance, Lambert, Mixed, Phong
from jaxvis.reflectance.model import Reflectance
from jaxvis.sphere import latlong
from jaxvis.sphere.frames import normalize
from tests.reflectance.model_cases import NORMAL, jitted_evaluate, material, view_at

PAPER = Phong(foreshortened=False)
GLOSSY = [PAPER, Phong(), BlinnPhong(), CookTorrance("ggx"), CookTorrance("beckmann")]
HEIGHT = 128
PLACES = latlong.texel_directions(HEIGHT, 2 * HEIGHT).reshape(-1, 3).astype(np.float32)
WEIGHT = np.repeat(latlong.row_solid_angles(HEIGHT, 2 * HEIGHT), 2 * HEIGHT)
UP = PLACES @ NORMAL > 0.0


def approximate(lobe, light):
    """base E / pi + scale x lobe, both over the light above the horizon."""
    cosine = PLACES @ np.asarray(lobe.mirror)
    exponent = float(lobe.exponent)
    kernel = np.maximum(cosine, 1e-9) ** exponent * (cosine > 0.0) * (exponent + 1.0) / (2 * np.pi)
    glossy = (kernel * UP * WEIGHT * light).sum()
    irradiance = ((PLACES @ NORMAL) * UP * WEIGHT * light).sum()
    return np.asarray(lobe.diffuse) * irradiance / np.pi + np.asarray(lobe.scale) * glossy


def exact(model, values, view, light):
    view = np.broadcast_to(view, PLACES.shape)
    value, _ = jitted_evaluate(model, values, NORMAL, view, PLACES)
    return (np.asarray(value, np.float64) * (WEIGHT * light)[:, None]).sum(axis=0)


@pytest.mark.parametrize("model", [Lambert(), *GLOSSY], ids=str)
def test_a_uniform_sky_is_reflected_as_the_model_does(model):
    for roughness in (0.35, 0.6, 1.0):
        values = material([0.5, 0.2, 0.1], [0.04, 0.5, 1.0], roughness)
        for cosine in (1.0, 0.7, 0.31, 0.1):
            view = view_at(cosine)
            lobe = specular_lobe(model, values, jnp.asarray(NORMAL), jnp.asarray(view))
            expected = exact(model, values, view, 1.0)
            np.testing.assert_allclose(approximate(lobe, 1.0), expected, rtol=0.02)


@pytest.mark.parametrize(("model", "error"), [
    (PAPER, 1e-3), (Phong(), 0.06), (BlinnPhong(), 0.35), (CookTorrance(), 0.5),
    (CookTorrance("beckmann"), 0.4),
], ids=str)  # fmt: skip
def test_hard_light_is_reflected_nearly_as_the_model_does(model, error):
    """Root mean square over eight turns of the church, relative to the mean."""
    values = material([0.0] * 3, [1.0] * 3, 0.5)
    radiance = np.asarray(windows(height=HEIGHT).radiance[..., 1], np.float64)
    for cosine in (0.95, 0.4):
        view = view_at(cosine)
        lobe = specular_lobe(model, values, jnp.asarray(NORMAL), jnp.asarray(view))
        pairs = []
        for turn in range(0, 2 * HEIGHT, 2 * HEIGHT // 8):
            light = np.roll(radiance, turn, axis=1).ravel()
            pairs.append((approximate(lobe, light)[1], exact(model, values, view, light)[1]))
        got, expected = np.array(pairs).T
        assert np.sqrt(np.mean((got - expected) ** 2)) < error * expected.mean()


def test_the_paper_s_phong_is_itself():
    values = material([0.3] * 3, [0.7, 0.5, 0.2], 0.4)
    view = jnp.asarray(view_at(0.6))
    lobe = specular_lobe(PAPER, values, jnp.asarray(NORMAL), view)
    np.testing.assert_allclose(lobe.exponent, values.exponent)
    np.testing.assert_allclose(lobe.scale, values.specular)
    np.testing.assert_allclose(lobe.mirror, 2.0 * 0.6 * NORMAL - view, atol=1e-6)
    np.testing.assert_allclose(lobe.diffuse, values.base_colour)


def test_the_fit_finds_what_is_a_phong_lobe():
    """At normal incidence n.l is r.l, which only raises the exponent by 1."""
    values = material([0.0] * 3, [1.0] * 3, 0.4)
    lobe = specular_lobe(Phong(), values, jnp.asarray(NORMAL), jnp.asarray(NORMAL))
    np.testing.assert_allclose(lobe.exponent, values.exponent + 1.0, rtol=0.01)
    np.testing.assert_allclose(lobe.mirror, NORMAL, atol=1e-3)
    np.testing.assert_allclose(lobe.scale, 1.0, rtol=1e-3)


def test_a_view_from_below_sees_nothing():
    values = material([0.5] * 3, [0.5] * 3, 0.5)
    for model in (Lambert(), *GLOSSY):
        lobe = specular_lobe(model, values, jnp.asarray(NORMAL), jnp.asarray(-view_at(0.5)))
        np.testing.assert_array_equal(lobe.scale, 0.0)
        np.testing.assert_array_equal(lobe.diffuse, 0.0)


def test_the_share_above_the_horizon():
    cosine = np.array([1.0, 1e-9, 1e-9, 0.3])
    share = share_above_horizon(cosine, np.array([5.0, 0.0, 800.0, 0.0]))
    # For a = 0 the part of a hemisphere about an axis that is above the horizon.
    expected = [1.0, 0.5, 0.5, 1.0 - np.arccos(0.3) / np.pi]
    np.testing.assert_allclose(share, expected, atol=2e-3)


@pytest.mark.parametrize("model", [Phong(), CookTorrance()], ids=str)
def test_gradients_in_the_material(model):
    values = material([0.3, 0.4, 0.5], [0.3, 0.2, 0.6], 0.463)
    view = jnp.asarray(view_at(0.52))

    @jax.jit
    def value(values):
        lobe = specular_lobe(model, values, jnp.asarray(NORMAL), view)
        parts = (lobe.scale, lobe.diffuse, jnp.log(lobe.exponent), lobe.mirror[0])
        return sum(jnp.sum(part) for part in parts)

    gradient = jax.grad(value)(values)
    step = 4e-3
    for name in ("base_colour", "specular", "roughness"):
        up = replace(values, **{name: getattr(values, name) + step})
        down = replace(values, **{name: getattr(values, name) - step})
        rise = (value(up) - value(down)) / (2.0 * step)
        np.testing.assert_allclose(np.sum(getattr(gradient, name)), rise, rtol=0.02, atol=2e-3)


def test_refuses_models_that_it_does_not_know():
    @dataclass(frozen=True)
    class Strange(Reflectance):
        evaluate_and_pdf = sample = terms = colours = None

    values = material([0.5] * 3, [0.5] * 3, 0.5)
    with pytest.raises(ValueError, match="Strange"):
        specular_lobe(Strange(), values, jnp.asarray(NORMAL), jnp.asarray(NORMAL))


def test_a_mixture_has_the_lobe_of_each_points_model():
    values = jax.tree.map(lambda leaf: jnp.stack([leaf] * 3), material([0.5] * 3, [0.3] * 3, 0.4))
    values = replace(values, model=jnp.array([0, 1, 1]))
    normal = jnp.tile(jnp.asarray(NORMAL), (3, 1))
    view = normalize(normal + jnp.array([0.4, 0.1, 0.2]))
    models = (BlinnPhong(), CookTorrance("beckmann"))
    mixed = specular_lobe(Mixed(models), values, normal, view)
    for point, model in ((0, models[0]), (1, models[1]), (2, models[1])):
        alone = specular_lobe(model, values, normal, view)
        for ours, theirs in zip(mixed, alone, strict=True):
            np.testing.assert_allclose(ours[point], theirs[point], rtol=1e-6)
