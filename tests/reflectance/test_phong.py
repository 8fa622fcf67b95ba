"""Phong and Blinn-Phong: closed forms, and a slow oracle in NumPy."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import beta

from jaxvis.reflectance import BlinnPhong, MaterialValues, Phong

UP = np.array([0.0, 0.0, 1.0], np.float32)


@partial(jax.jit, static_argnames="model")
def evaluate(model, material, view, light):
    return model.evaluate_and_pdf(material, jnp.asarray(UP), view, light)


def surface(roughness):
    base, specular = jnp.array([0.3, 0.2, 0.1]), jnp.array([0.1, 0.4, 0.7])
    return MaterialValues(base, specular, jnp.float32(roughness))


def random_upward(seed, count):
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    directions[:, 2] = np.abs(directions[:, 2])
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def albedo_seen_from_above(model, material):
    """Directional albedo for v = n, where the value depends on the light's cosine alone."""
    node, weight = np.polynomial.legendre.leggauss(400)
    root, weight = 0.5 * (node + 1.0), 0.5 * weight
    angle = 0.5 * np.pi * root**2
    light = np.stack([np.sin(angle), 0.0 * angle, np.cos(angle)], axis=-1).astype(np.float32)
    value = np.asarray(evaluate(model, material, UP, light)[0], np.float64)
    return (weight * np.pi * root * 2.0 * np.pi * np.sin(angle)) @ value


@pytest.mark.parametrize("model", [Phong(), BlinnPhong(), Phong(foreshortened=False)], ids=str)
@pytest.mark.parametrize("roughness", [0.1, 0.25, 0.5, 0.8, 1.0])
def test_seen_from_above_it_reflects_base_plus_specular(model, roughness):
    material = surface(roughness)
    expected = material.base_colour + material.specular
    np.testing.assert_allclose(albedo_seen_from_above(model, material), expected, rtol=1e-3)


def test_the_rough_limit_of_both_is_diffuse():
    view, light = (random_upward(seed, 50).astype(np.float32) for seed in (1, 2))
    same_side = np.einsum("ij,ij->i", view * [-1, -1, 1], light) > 0.0  # where Phong's lobe is
    material = surface(1.0)
    colour = (material.base_colour + material.specular) / np.pi
    expected = light[:, 2:] * np.asarray(colour)
    for model, where in ((BlinnPhong(), slice(None)), (Phong(), same_side)):
        value = np.asarray(evaluate(model, material, view, light)[0])
        np.testing.assert_allclose(value[where], expected[where], rtol=1e-5)


@pytest.mark.parametrize("roughness", [0.2, 0.5, 0.9])
def test_values_match_the_formulas(roughness):
    view, light = random_upward(3, 200), random_upward(4, 200)
    light[:100] = view[:100] * [-1, -1, 1] + 0.1 * light[:100]  # half of them near the highlight
    light /= np.linalg.norm(light, axis=1, keepdims=True)
    material = surface(roughness)
    base, specular = np.asarray(material.base_colour), np.asarray(material.specular)
    exponent = 2.0 / roughness**4 - 2.0
    cos_light = light[:, 2:]
    mirror = np.maximum(np.sum(light * view * [-1, -1, 1], axis=1, keepdims=True), 0.0)
    half = view + light
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    facet = half[:, 2:]
    diffuse = base / np.pi * cos_light
    normalisation = (exponent + 2) * (exponent + 4)
    normalisation /= 8 * np.pi * (2 ** (-exponent / 2) + exponent)
    expected = {
        Phong(): diffuse + specular * (exponent + 2) / (2 * np.pi) * mirror**exponent * cos_light,
        Phong(foreshortened=False): diffuse
        + specular * (exponent + 1) / (2 * np.pi) * mirror**exponent,
        BlinnPhong(): diffuse + specular * normalisation * facet**exponent * cos_light,
    }
    for model, value in expected.items():
        computed = evaluate(model, material, view.astype(np.float32), light.astype(np.float32))[0]
        np.testing.assert_allclose(computed, value, rtol=2e-3, atol=1e-5, err_msg=str(model))


def test_without_foreshortening_half_of_the_lobe_is_left_at_grazing_view():
    # Paper 000's eq. 13 has no cosine: the lobe about a horizontal axis reflects half of specular.
    exponent = 2.0 / 0.5**4 - 2.0
    material = surface(0.5)
    view = np.array([1.0, 0.0, 1e-6], np.float32)
    count = 200
    node, weight = np.polynomial.legendre.leggauss(count)
    height, weight = 0.5 * (node + 1.0), 0.5 * weight  # cosines from the normal: the horizon is 0
    phi = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    sine = np.sqrt(1.0 - height**2)[:, None]
    light = np.stack(
        np.broadcast_arrays(sine * np.cos(phi), sine * np.sin(phi), height[:, None]), axis=-1
    ).astype(np.float32)
    value, _ = evaluate(Phong(foreshortened=False), material, view, light)
    albedo = 2.0 * np.pi * np.einsum("i,ijc->c", weight, np.asarray(value, np.float64)) / count
    expected = np.asarray(material.base_colour) + np.asarray(material.specular) / 2.0
    np.testing.assert_allclose(albedo, expected, rtol=2e-3)
    # With it: (a + 2) / 2 pi times the integral of n.l (r.l)^a over the hemisphere.
    value, _ = evaluate(Phong(), material, view, light)
    albedo = 2.0 * np.pi * np.einsum("i,ijc->c", weight, np.asarray(value, np.float64)) / count
    share = (exponent + 2.0) / (2.0 * np.pi) * beta((exponent + 1.0) / 2.0, 1.5)
    expected = np.asarray(material.base_colour) + np.asarray(material.specular) * share
    np.testing.assert_allclose(albedo, expected, rtol=2e-3)
