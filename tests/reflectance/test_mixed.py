"""Mixed is, at each point, the model that the point's material names; nothing else."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.reflectance import (
    BlinnPhong,
    CookTorrance,
    Lambert,
    Material,
    MaterialValues,
    Mixed,
    Phong,
    evaluate_materials,
    reflectance_by_name,
)
from tests.reflectance.model_cases import NORMAL, material, random_directions, view_at

MODELS = (BlinnPhong(), CookTorrance("beckmann"), Lambert())
MIXED = Mixed(MODELS)


@pytest.fixture(scope="module")
def case():
    """Points with one of three models each, and a view, light and uniforms for each of them."""
    generator = np.random.default_rng(3)
    count = 3000
    lights = jnp.asarray(random_directions(generator).reshape(-1, 3)[:count])
    uniforms = jnp.asarray(generator.uniform(size=(count, 3)), jnp.float32)
    number = jnp.asarray(np.arange(count) % 3, jnp.int32)
    values = MaterialValues(
        jnp.asarray(generator.uniform(size=(count, 3)), jnp.float32),
        jnp.asarray(generator.uniform(0.0, 0.5, size=(count, 3)), jnp.float32),
        jnp.asarray(generator.uniform(0.2, 0.9, size=count), jnp.float32),
        number,
    )
    view = jnp.broadcast_to(jnp.asarray(view_at(0.6)), lights.shape)
    normal = jnp.broadcast_to(jnp.asarray(NORMAL), lights.shape)
    return values, normal, view, lights, uniforms


def test_each_point_has_the_value_and_density_of_its_model(case):
    values, normal, view, light, _ = case
    value, pdf = MIXED.evaluate_and_pdf(values, normal, view, light)
    apart = []
    for number, model in enumerate(MODELS):
        here = np.asarray(values.model) == number
        other, density = model.evaluate_and_pdf(values, normal, view, light)
        apart.append(np.asarray(other))
        np.testing.assert_array_equal(np.asarray(value)[here], np.asarray(other)[here])
        np.testing.assert_array_equal(np.asarray(pdf)[here], np.asarray(density)[here])
    # The models differ where they are compared.
    assert np.abs(apart[0] - apart[1]).max() > 0.01
    assert np.abs(apart[1] - apart[2]).max() > 0.01


def test_samples_are_those_of_the_model(case):
    values, normal, view, _, uniforms = case
    drawn = np.asarray(MIXED.sample(values, normal, view, uniforms))
    for number, model in enumerate(MODELS):
        here = np.asarray(values.model) == number
        expected = np.asarray(model.sample(values, normal, view, uniforms))
        np.testing.assert_array_equal(drawn[here], expected[here])
    pdf = np.asarray(MIXED.pdf(values, normal, view, jnp.asarray(drawn)))
    assert pdf.min() > 0.0


def test_gradients_are_those_of_the_model(case):
    values, normal, view, light, _ = case

    def total(model, roughness, light):
        value, pdf = model.evaluate_and_pdf(
            replace(values, roughness=roughness), normal, view, light
        )
        return value.sum() + pdf.sum()

    def gradients(model):
        return jax.grad(total, argnums=(1, 2))(model, values.roughness, light)

    mixed = gradients(MIXED)
    for number, model in enumerate(MODELS):
        here = np.asarray(values.model) == number
        for one, other in zip(mixed, gradients(model), strict=True):
            assert np.isfinite(one).all()
            np.testing.assert_allclose(
                np.asarray(one)[here], np.asarray(other)[here], rtol=1e-4, atol=1e-5
            )


def test_without_numbers_it_is_the_first_model(case):
    values, normal, view, light, _ = case
    plain = replace(values, model=None)
    value, _ = MIXED.evaluate_and_pdf(plain, normal, view, light)
    expected, _ = MODELS[0].evaluate_and_pdf(plain, normal, view, light)
    np.testing.assert_array_equal(value, expected)


def test_numbers_beyond_the_last_are_the_last():
    surface = replace(material(0.5, 0.2, 0.4), model=jnp.asarray(7))
    normal, light = jnp.asarray(NORMAL), jnp.asarray(view_at(0.8))
    view = jnp.asarray(view_at(0.6))
    value = Mixed((Phong(), Lambert())).evaluate(surface, normal, view, light)
    np.testing.assert_array_equal(value, Lambert().evaluate(surface, normal, view, light))


def test_what_mixed_refuses():
    with pytest.raises(ValueError, match="Mixed needs a tuple of models"):
        Mixed(())
    assert hash(Mixed()) == hash(Mixed())


def test_materials_name_their_model():
    plain, other = Material(), Material(model=1)
    ids = np.array([0, 1, 1, 0])
    numbers = evaluate_materials((plain, other), ids).model
    assert numbers is not None
    np.testing.assert_array_equal(numbers, [0, 1, 1, 0])
    assert evaluate_materials((plain, plain), ids).model is None
    for wrong in (-1, True):
        with pytest.raises(ValueError, match="model must be a whole number of at least 0"):
            Material(model=wrong)


def test_it_has_a_name():
    assert reflectance_by_name("mixed") == Mixed()


def test_pixels_keep_the_model_of_their_material():
    """Through the surface and the estimator: each pixel as if its model were the scene's."""
    from jaxvis.lighting import load_environment
    from jaxvis.methods import create
    from jaxvis.scene import load_scene, trace_surface

    scene = load_scene("balls:detail=16")
    method, light = create("mc-mis:spp=2"), load_environment("windows")
    surfaces = {}
    for model in (Mixed(), *Mixed().models):
        other = scene.with_reflectance(model)
        surface = trace_surface(other, scene.camera, (32, 24))
        visibility = method.precompute(other)
        lit = method.light(light)
        surfaces[model] = np.asarray(method.shade(visibility, lit, surface, key=jax.random.key(0)))
    mask, number = np.asarray(surface.mask), np.asarray(surface.material.model)
    for k, model in enumerate(Mixed().models):
        here = mask & (number == k)
        assert here.sum() > 20
        np.testing.assert_allclose(
            surfaces[Mixed()][here], surfaces[model][here], rtol=1e-3, atol=1e-5
        )
        away = mask & (number != k)
        assert np.abs(surfaces[Mixed()][away] - surfaces[model][away]).max() > 0.01
