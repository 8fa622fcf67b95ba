"""Cook-Torrance: limits, a slow oracle in NumPy, and directional albedos by another quadrature."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import erf

from jaxvis.reflectance import CookTorrance, Lambert, MaterialValues

UP = np.array([0.0, 0.0, 1.0], np.float32)
DISTRIBUTIONS = ["ggx", "beckmann"]


@partial(jax.jit, static_argnames="model")
def evaluate(model, material, view, light):
    return model.evaluate_and_pdf(material, jnp.asarray(UP), view, light)


def surface(base, specular, roughness):
    base, specular = (np.broadcast_to(np.float32(c), (3,)) for c in (base, specular))
    return MaterialValues(jnp.asarray(base), jnp.asarray(specular), jnp.float32(roughness))


def oracle_distribution(name, cos, a):
    tan_square = 1.0 / cos**2 - 1.0
    if name == "ggx":
        return a**2 / (np.pi * cos**4 * (a**2 + tan_square) ** 2)
    return np.exp(-tan_square / a**2) / (np.pi * a**2 * cos**4)


def oracle_lambda(name, cos, a):
    tangent = np.sqrt(1.0 / cos**2 - 1.0) + 1e-9
    if name == "ggx":
        return (np.sqrt(1.0 + (a * tangent) ** 2) - 1.0) / 2.0
    x = 1.0 / (a * tangent)
    return (erf(x) - 1.0) / 2.0 + np.exp(-(x**2)) / (2.0 * x * np.sqrt(np.pi))


def oracle(name, base, specular, roughness, view, light):
    """BRDF x cosine for one pair of directions, as it stands in the books."""
    a = roughness**2
    half = (view + light) / np.linalg.norm(view + light)
    grazing = min(1.0, np.mean(specular) / 0.02)

    def fresnel(cos):
        return specular + grazing * (1.0 - specular) * (1.0 - cos) ** 5

    masking = 1.0 + oracle_lambda(name, view[2], a) + oracle_lambda(name, light[2], a)
    facets = oracle_distribution(name, half[2], a) / masking
    specular_part = fresnel(view @ half) * facets / (4.0 * view[2])
    k = grazing * (0.08 + 0.92 * (1.0 - a**2) ** 2)
    into, out = 1.0 - k * (1.0 - light[2]) ** 5, 1.0 - k * (1.0 - view[2]) ** 5
    diffuse_part = base / np.pi * (1.0 - specular) * into * out / (1.0 - k / 21.0)
    return diffuse_part * light[2] + specular_part


@pytest.mark.parametrize("name", DISTRIBUTIONS)
@pytest.mark.parametrize(
    ("specular", "roughness"),
    [((0.04, 0.04, 0.04), 0.5), ((0.9, 0.6, 0.3), 0.3), ((0.001, 0.02, 0.0), 0.8)],
)
def test_values_match_a_slow_oracle(name, specular, roughness):
    generator = np.random.default_rng(1)
    view, light = generator.normal(size=(2, 60, 3))
    light[:30] = view[:30] * [-1, -1, 1] + 0.3 * light[:30]  # half of them near the highlight
    for direction in (view, light):
        direction[:, 2] = np.abs(direction[:, 2]) + 0.05
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    base, specular = np.array([0.2, 0.5, 0.9]), np.array(specular)
    material = surface(base, specular, roughness)
    computed, _ = evaluate(
        CookTorrance(name), material, view.astype(np.float32), light.astype(np.float32)
    )
    expected = [
        oracle(name, base, specular, roughness, v, l) for v, l in zip(view, light, strict=True)
    ]
    np.testing.assert_allclose(computed, expected, rtol=2e-3, atol=1e-6)


def facet_directions(name, cosine, roughness, count=128):
    """Light directions [n, 3] that facets mirror to the view, and their weights (solid angles)."""
    a = roughness**2
    node, weight = np.polynomial.legendre.leggauss(count)
    u, weight = 0.5 * (node + 1.0), 0.5 * weight
    tan_square = a**2 * (u / (1.0 - u) if name == "ggx" else -np.log1p(-u))
    cos = 1.0 / np.sqrt(1.0 + tan_square)
    phi = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    sine, cos = np.sqrt(1.0 - cos**2)[:, None], cos[:, None]
    half = np.stack(np.broadcast_arrays(sine * np.cos(phi), sine * np.sin(phi), cos), axis=-1)
    view = np.array([np.sqrt(1.0 - cosine**2), 0.0, cosine])
    towards = half @ view
    light = 2.0 * towards[..., None] * half - view
    density = oracle_distribution(name, cos, a) * cos / (4.0 * np.abs(towards))
    keep = (towards > 0.0) & (light[..., 2] > 0.0)
    solid_angles = (weight[:, None] / count / density)[keep]
    return view.astype(np.float32), light[keep].astype(np.float32), solid_angles


@pytest.mark.parametrize("name", DISTRIBUTIONS)
@pytest.mark.parametrize("cosine", [1.0, 0.7, 0.3])
def test_a_smooth_mirror_reflects_everything(name, cosine):
    view, light, solid_angles = facet_directions(name, cosine, 0.1)
    value, _ = evaluate(CookTorrance(name), surface(0.0, 1.0, 0.1), view, light)
    np.testing.assert_allclose(solid_angles @ np.asarray(value, np.float64), 1.0, atol=2e-3)


@pytest.mark.parametrize("name", DISTRIBUTIONS)
@pytest.mark.parametrize("cosine", [1.0, 0.7, 0.3])
def test_smooth_varnish_on_a_white_base_neither_adds_nor_loses_light(name, cosine):
    # Schlick's reflectance from the facets and what is left, exactly, from the base.
    fresnel = 0.04 + 0.96 * (1.0 - cosine) ** 5
    view, light, solid_angles = facet_directions(name, cosine, 0.1)
    varnish, _ = evaluate(CookTorrance(name), surface(0.0, 0.04, 0.1), view, light)
    specular = solid_angles @ np.asarray(varnish, np.float64)
    np.testing.assert_allclose(specular, fresnel, rtol=1e-2)

    node, weight = np.polynomial.legendre.leggauss(64)
    height, weight = 0.5 * (node + 1.0), 0.5 * weight
    # At these azimuths, away from the highlight, only the base is left to see.
    light = np.stack([-0.0 * height, np.sqrt(1.0 - height**2), height], axis=-1)
    both = evaluate(CookTorrance(name), surface(1.0, 0.04, 0.1), view, light.astype(np.float32))[0]
    alone = evaluate(CookTorrance(name), surface(0.0, 0.04, 0.1), view, light.astype(np.float32))[0]
    base = 2.0 * np.pi * weight @ np.asarray(both - alone, np.float64)
    np.testing.assert_allclose(base, 1.0 - fresnel, rtol=1e-3)


@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_rough_metal_is_darker_than_a_mirror(name):
    # Masked light is lost (no interreflection between facets): E at a = 1 and v = n. In closed
    # form for GGX: D = 1 / pi, G2 = cos_l / (1 + cos_l) x 2, so that E = 1 - ln 2.
    view, light, solid_angles = facet_directions(name, 1.0, 1.0)
    value, _ = evaluate(CookTorrance(name), surface(0.0, 1.0, 1.0), view, light)
    albedo = solid_angles @ np.asarray(value, np.float64)
    assert np.all(albedo < 0.6)
    if name == "ggx":
        np.testing.assert_allclose(albedo, 1.0 - np.log(2.0), rtol=2e-3)


def test_gltf_mixing_would_reflect_more_than_it_receives():
    # Why the base is not weighted by 1 - F(v.h), as glTF 2.0's appendix B does: at grazing view
    # that adds up to far more than 1. This model's base at the same angle stays below.
    cosine = 0.1
    view, light, solid_angles = facet_directions("ggx", cosine, 0.2)
    coat, _ = evaluate(CookTorrance("ggx"), surface(0.0, 0.04, 0.2), view, light)
    specular = (solid_angles @ np.asarray(coat, np.float64))[0]

    generator = np.random.default_rng(2)
    uniforms = generator.uniform(size=(20_000, 3)).astype(np.float32)
    lights = jax.jit(Lambert().sample)(
        surface(1, 0, 1), jnp.asarray(UP), jnp.asarray(UP), jnp.asarray(uniforms)
    )
    half = np.asarray(lights) + view
    facing = 0.5 * np.linalg.norm(half, axis=1)
    gltf = np.mean(1.0 - (0.04 + 0.96 * (1.0 - facing) ** 5))
    assert specular + gltf > 1.2

    values, _ = evaluate(CookTorrance("ggx"), surface(1.0, 0.04, 0.2), view, lights)
    coats, _ = evaluate(CookTorrance("ggx"), surface(0.0, 0.04, 0.2), view, lights)
    density = np.asarray(lights)[:, 2] / np.pi
    base = np.mean(np.asarray(values - coats)[:, 0] / density)
    assert specular + base < 1.0


def test_rough_objects_have_no_dark_outlines():
    """At grazing views a rough dielectric is nearly as bright as face on, a smooth one is not."""

    def diffuse_at(roughness, cosine):
        values = MaterialValues(jnp.ones(3), jnp.full(3, 0.04), jnp.asarray(roughness, jnp.float32))
        normal = jnp.array([0.0, 0.0, 1.0])
        view = jnp.array([np.sqrt(1.0 - cosine**2), 0.0, cosine], jnp.float32)
        light = jnp.array([0.0, 0.6, 0.8])
        return float(CookTorrance("ggx").evaluate(values, normal, view, light)[0])

    assert diffuse_at(1.0, 0.02) > 0.85 * diffuse_at(1.0, 1.0)
    assert diffuse_at(0.1, 0.02) < 0.2 * diffuse_at(0.1, 1.0)
