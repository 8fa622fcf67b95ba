"""Specular lobes against the exact models: energy, direction, shape, gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.reflectance import (
    BlinnPhong,
    CookTorrance,
    Lambert,
    MaterialValues,
    Mixed,
    Phong,
    cosine_lobe,
    gaussians,
)
from tests.reflectance.model_cases import (
    NORMAL,
    evaluate,
    material,
    mirror,
    named,
    sphere_quadrature,
    view_at,
)

pytestmark = pytest.mark.usefixtures("own_caches")

MODELS = [Phong(), BlinnPhong(), CookTorrance("ggx"), CookTorrance("beckmann")]
specular_lobe = jax.jit(gaussians.specular_lobe, static_argnums=0)


def lobe_and_model(model, surface, degrees):
    """(lobe, its values, the model's values, weights, directions), in the green channel."""
    cosine = float(np.cos(np.radians(degrees)))
    light, weights = sphere_quadrature(cosine)
    lobe = specular_lobe(model, surface, jnp.asarray(NORMAL), jnp.asarray(view_at(cosine)))
    value = np.asarray(evaluate(model, surface, view_at(cosine), light)[0], np.float64)[..., 1]
    return (
        lobe,
        np.asarray(lobe.evaluate(jnp.asarray(light)), np.float64)[..., 1],
        value,
        weights,
        light,
    )


@pytest.mark.parametrize("model", **named(MODELS))
@pytest.mark.parametrize("roughness", [0.1, 0.23, 0.375, 0.6, 0.9])
@pytest.mark.parametrize("degrees", [0, 30, 60, 75])
def test_a_lobe_has_the_models_energy_and_direction(model, roughness, degrees):
    lobe, value, exact, weights, light = lobe_and_model(
        model, material(0.0, 0.4, roughness), degrees
    )
    energy = np.sum(weights * exact)
    np.testing.assert_allclose(np.sum(weights * value), energy, rtol=0.02)
    np.testing.assert_allclose(lobe.integral()[1], energy, rtol=0.02)
    mean = np.einsum("ij,ijk->k", weights * exact, light)
    mean /= np.linalg.norm(mean)
    between = np.dot(mean, mirror(view_at(np.cos(np.radians(degrees)))))
    # The axis of least squares lies from the mirror direction to the mean direction.
    assert np.dot(mean, lobe.axis) > between - 1e-4


@pytest.mark.parametrize(
    ("model", "bounds"),
    [
        (Phong(), (0.02, 0.03, 0.04)),
        (BlinnPhong(), (0.02, 0.1, 0.36)),
        (CookTorrance("beckmann"), (0.02, 0.1, 0.37)),
        (CookTorrance("ggx"), (0.25, 0.27, 0.43)),
    ],
    ids=str,
)
@pytest.mark.parametrize("roughness", [0.2, 0.375])
def test_errors_of_shape(model, bounds, roughness):
    """Relative root mean square over the sphere at 0, 30 and 60 degrees."""
    for degrees, bound in zip((0, 30, 60), bounds, strict=True):
        _, value, exact, weights, _ = lobe_and_model(model, material(0.0, 0.4, roughness), degrees)
        error = np.sqrt(np.sum(weights * (value - exact) ** 2) / np.sum(weights * exact**2))
        assert error < bound


def test_the_warped_lobe_alone_has_far_too_much_energy_when_rough():
    """The control: the peak of the model with the sharpness 2 / a^2 / (4 v.h)."""
    surface = material(0.0, 0.4, 0.6)
    lobe, _, exact, weights, _ = lobe_and_model(CookTorrance("ggx"), surface, 0)
    peak = evaluate(CookTorrance("ggx"), surface, view_at(1.0), NORMAL)[0][1]
    sharpness = gaussians.warped_sharpness(CookTorrance("ggx"), surface, jnp.float32(1.0))
    warped = 2.0 * np.pi / sharpness * peak
    energy = np.sum(weights * exact)
    assert warped > 1.15 * energy
    np.testing.assert_allclose(lobe.integral()[1], energy, rtol=0.01)


def test_arrays_of_different_materials_are_those_one_by_one():
    random = np.random.default_rng(0)
    roughness = random.uniform(0.05, 1.0, (3, 4)).astype(np.float32)
    specular = random.uniform(0.0, 1.0, (3, 4, 3)).astype(np.float32)
    surface = MaterialValues(jnp.ones((3, 4, 3)), jnp.asarray(specular), jnp.asarray(roughness))
    view = jnp.asarray(view_at(0.6))
    all_lobes = specular_lobe(CookTorrance(), surface, jnp.asarray(NORMAL), view)
    assert all_lobes.amplitude.shape == (3, 4, 3)
    for place in np.ndindex(3, 4):
        one = material(0.3, specular[place], roughness[place])
        lobe = specular_lobe(CookTorrance(), one, jnp.asarray(NORMAL), view)
        for a, b in zip(jax.tree.leaves(lobe), jax.tree.leaves(all_lobes), strict=True):
            np.testing.assert_allclose(a, b[place], rtol=2e-5, atol=1e-6)


def test_mixed_models_give_each_point_its_own_lobe():
    mixed = Mixed((BlinnPhong(), CookTorrance()))
    surface = material(0.2, 0.5, 0.4)
    three = MaterialValues(
        jnp.tile(surface.base_colour, (3, 1)),
        jnp.tile(surface.specular, (3, 1)),
        jnp.tile(surface.roughness, 3),
        jnp.array([0, 1, 5]),
    )
    view = jnp.asarray(view_at(0.7))
    found = specular_lobe(mixed, three, jnp.asarray(NORMAL), view)
    for k, model in enumerate((BlinnPhong(), CookTorrance(), CookTorrance())):
        alone = specular_lobe(model, surface, jnp.asarray(NORMAL), view)
        np.testing.assert_allclose(found.sharpness[k], alone.sharpness, rtol=1e-5)
        np.testing.assert_allclose(found.amplitude[k], alone.amplitude, rtol=1e-5)
    plain = specular_lobe(mixed, surface, jnp.asarray(NORMAL), view)
    first = specular_lobe(BlinnPhong(), surface, jnp.asarray(NORMAL), view)
    np.testing.assert_allclose(plain.amplitude, first.amplitude, rtol=1e-6)


def test_black_lambert_and_views_from_below_reflect_nothing():
    view = jnp.asarray(view_at(0.5))
    normal = jnp.asarray(NORMAL)
    for model, surface, towards in (
        (CookTorrance(), material(0.8, 0.0, 0.5), view),
        (Lambert(), material(0.8, 1.0, 0.5), view),
        (Phong(), material(0.8, 1.0, 0.5), -view),
    ):
        lobe = specular_lobe(model, surface, normal, towards)
        np.testing.assert_array_equal(lobe.amplitude, 0.0)
        assert np.isfinite(lobe.axis).all()


def test_gradients_of_energy_and_sharpness_are_finite_differences():
    def measured(roughness, specular):
        surface = MaterialValues(jnp.zeros(3), specular * jnp.ones(3), roughness)
        lobe = gaussians.specular_lobe(
            CookTorrance(), surface, jnp.asarray(NORMAL), jnp.asarray(view_at(0.66))
        )
        return jnp.stack([lobe.integral()[0], jnp.log(lobe.sharpness)])

    measured = jax.jit(measured)
    at = jnp.float32(0.42), jnp.float32(0.3)
    got = jax.jacobian(measured, argnums=(0, 1))(*at)
    step = 2e-3
    by_roughness = (measured(at[0] + step, at[1]) - measured(at[0] - step, at[1])) / (2 * step)
    by_specular = (measured(at[0], at[1] + step) - measured(at[0], at[1] - step)) / (2 * step)
    np.testing.assert_allclose(got[0], by_roughness, rtol=0.01, atol=2e-3)
    np.testing.assert_allclose(got[1], by_specular, rtol=0.01, atol=2e-3)


@pytest.mark.parametrize("model", **named(MODELS))
def test_gradients_are_finite_everywhere(model):
    def amount(view, roughness):
        surface = MaterialValues(jnp.zeros(3), jnp.full(3, 0.5), roughness)
        lobe = gaussians.specular_lobe(model, surface, jnp.asarray(NORMAL), view)
        return jnp.sum(lobe.amplitude) + jnp.sum(lobe.axis) + lobe.sharpness

    gradient = jax.jit(jax.grad(amount, argnums=(0, 1)))
    for cosine in (1.0, 0.3, 0.01, 0.0):
        for roughness in (0.0, 0.1, 0.55, 1.0):
            found = gradient(jnp.asarray(view_at(cosine)), jnp.float32(roughness))
            assert all(np.isfinite(leaf).all() for leaf in found), (cosine, roughness)


def test_the_lobe_of_a_cosine():
    """Integral pi, or the least-squares one; its error over the sphere."""
    normal = jnp.array([0.0, 0.6, 0.8])
    lobe = cosine_lobe(normal)
    np.testing.assert_allclose(lobe.integral(), [np.pi], rtol=1e-4)
    nearest = cosine_lobe(normal, keep_energy=False)
    np.testing.assert_allclose(nearest.integral(), [1.083 * np.pi], rtol=2e-3)
    t = np.linspace(-1.0, 1.0, 20001)
    exact = np.maximum(t, 0.0)

    def squared(sharpness, amplitude):
        return np.mean((amplitude * np.exp(sharpness * (t - 1.0)) - exact) ** 2)

    best = squared(2.144, 1.177)
    for sharpness, amplitude in ((2.1, 1.177), (2.19, 1.177), (2.144, 1.16), (2.144, 1.2)):
        assert squared(sharpness, amplitude) > best
    np.testing.assert_allclose(
        np.sqrt(squared(2.144, gaussians.COSINE_AMPLITUDE_OF_ENERGY)), 0.07, atol=0.01
    )
