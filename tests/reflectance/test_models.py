"""What holds for every model: reciprocity, energy, limits, shapes, names."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.reflectance import (
    BlinnPhong,
    CookTorrance,
    Lambert,
    MaterialValues,
    Phong,
    reflectance_by_name,
)
from tests.reflectance.model_cases import (
    GLOSSY,
    MODELS,
    NORMAL,
    RECIPROCAL,
    albedo,
    evaluate,
    jitted_evaluate,
    jitted_sample,
    material,
    mirror,
    named,
    random_directions,
    sample,
    samples,
    sphere_quadrature,
    view_at,
)

pytestmark = pytest.mark.usefixtures("optimised")


def test_the_quadrature_integrates_the_sphere():
    directions, weights = sphere_quadrature(0.4)
    assert weights.sum() == pytest.approx(4.0 * np.pi, rel=1e-6)
    cosines = np.maximum(directions @ NORMAL, 0.0)
    assert (weights * cosines).sum() == pytest.approx(np.pi, rel=1e-3)


@pytest.mark.parametrize("model", **named(RECIPROCAL))
@pytest.mark.parametrize("roughness", [0.15, 0.5, 1.0])
def test_reciprocity(model, roughness):
    generator = np.random.default_rng(3)
    view, light = (random_directions(generator) for _ in range(2))
    cos_view, cos_light = view @ NORMAL, light @ NORMAL
    surface = material([0.3, 0.5, 0.1], [0.2, 0.04, 0.5], roughness)
    forward = np.asarray(evaluate(model, surface, view, light)[0])
    backward = np.asarray(evaluate(model, surface, light, view)[0])
    up = (cos_view > 0.02) & (cos_light > 0.02)
    assert up.sum() > 50
    np.testing.assert_allclose(
        forward[up] / cos_light[up, None], backward[up] / cos_view[up, None], rtol=1e-3, atol=1e-6
    )


def test_the_form_without_foreshortening_is_not_reciprocal():
    surface, model = material(0.0, 0.5, 0.5), Phong(foreshortened=False)
    view, light = view_at(0.9), view_at(0.5)
    forward = evaluate(model, surface, view, light)[0][0] / 0.5
    backward = evaluate(model, surface, light, view)[0][0] / 0.9
    assert abs(forward / backward - 1.0) > 0.5


@pytest.mark.parametrize("model", **named(MODELS))
@pytest.mark.parametrize("cosine", [1.0, 0.8, 0.6, 0.4, 0.2, 0.05])
def test_energy_is_conserved(model, cosine):
    # Facets take their share from the base themselves, up to 0.5 % (they turn towards the view,
    # and reflect more there than the mean surface); elsewhere the colours must add up to 1.
    whole = isinstance(model, CookTorrance)
    limit = 1.0 + (5e-3 if whole else 1e-3)
    for specular in (0.01, 0.04, 0.5, 1.0):
        for roughness in (0.1, 0.3, 0.5, 0.7, 1.0):
            surface = material(1.0 if whole else 1.0 - specular, specular, roughness)
            assert albedo(model, surface, cosine).max() <= limit, (specular, roughness)


@pytest.mark.parametrize("model", **named(MODELS))
def test_nothing_below_the_horizon(model):
    generator = np.random.default_rng(10)
    view, light = (random_directions(generator) for _ in range(2))
    surface = material(0.5, 0.5, 0.6)
    value, _ = evaluate(model, surface, view, light)
    above = (view @ NORMAL > 1e-6) & (light @ NORMAL > 1e-6)
    below = (view @ NORMAL < -1e-6) | (light @ NORMAL < -1e-6)
    assert np.all(np.asarray(value)[above] > 0.0)
    np.testing.assert_array_equal(np.asarray(value)[below], 0.0)

    up = np.array([0.0, 0.0, 1.0], np.float32)
    level, oblique = (
        np.broadcast_to(np.float32(x), light.shape) for x in ([1, 0, 0], [0.6, 0, 0.8])
    )
    for view, light in ((level, oblique), (oblique, level)):
        np.testing.assert_array_equal(jitted_evaluate(model, surface, up, view, light)[0], 0.0)


@pytest.mark.parametrize("model", **named(GLOSSY))
def test_black_specular_is_exactly_lambert(model):
    generator = np.random.default_rng(4)
    view, light = (random_directions(generator) for _ in range(2))
    uniforms = generator.uniform(size=(200, 200, 3)).astype(np.float32)
    surface = material([0.3, 0.9, 0.0], 0.0, 0.4)
    value, pdf = evaluate(model, surface, view, light)
    expected, expected_pdf = evaluate(Lambert(), surface, view, light)
    np.testing.assert_allclose(value, expected, rtol=1e-6)
    np.testing.assert_allclose(pdf, expected_pdf, rtol=1e-6)
    np.testing.assert_allclose(
        sample(model, surface, view, uniforms),
        sample(Lambert(), surface, view, uniforms),
        atol=3e-7,  # compiled on its own, the same sum may round differently
    )


@pytest.mark.parametrize("model", **named(GLOSSY))
def test_black_base_samples_the_lobe_alone(model):
    surface, view = material(0.0, 0.5, 0.1), view_at(0.7)
    lights = samples(model, surface, view, 1)
    assert np.median(lights @ mirror(view)) > 0.999
    assert evaluate(model, surface, view, view_at(0.9))[1] < 1e-2 / np.pi


def test_lobes_are_chosen_by_luminance():
    surface = material([0.6, 0.3, 0.4], [0.1, 0.5, 0.2], 0.5)
    specular, base = (
        0.2126 * r + 0.7152 * g + 0.0722 * b for r, g, b in ((0.1, 0.5, 0.2), (0.6, 0.3, 0.4))
    )
    share = specular / (specular + base)
    for model in (Phong(), BlinnPhong()):
        assert model.specular_share(surface, jnp.float32(0.3)) == pytest.approx(share, rel=1e-5)
    # Facets reflect more at grazing angles: there nearly all samples are theirs.
    assert CookTorrance().specular_share(surface, jnp.float32(0.01)) > 0.9


@pytest.mark.parametrize("model", **named(MODELS))
def test_an_all_black_material_samples_the_cosine(model):
    lights, _ = sphere_quadrature(0.6)
    density = evaluate(model, material(0.0, 0.0, 0.5), view_at(0.6), lights)[1]
    np.testing.assert_allclose(density, np.maximum(lights @ NORMAL, 0.0) / np.pi, atol=1e-6)


@pytest.mark.parametrize("model", **named([Lambert(), BlinnPhong(), CookTorrance("ggx")]))
def test_arguments_broadcast_and_vmap(model):
    generator = np.random.default_rng(8)
    view = np.stack([view_at(0.9), view_at(0.4)])[:, None]
    light = random_directions(generator)[:2, :3]
    colours = jnp.asarray(generator.uniform(0.0, 0.5, (2, 2, 1, 3)), jnp.float32)
    surface = MaterialValues(*colours, jnp.float32([[0.3], [0.8]]))
    value, pdf = jitted_evaluate(model, surface, NORMAL, view, light)
    assert value.shape == (2, 3, 3)
    assert pdf.shape == (2, 3)
    assert jitted_sample(model, surface, NORMAL, view, light * 0.0 + 0.5).shape == (2, 3, 3)

    def one(surface, view, light):
        return model.evaluate_and_pdf(surface, jnp.asarray(NORMAL), view, light)

    # A material without points, one view and three lights, mapped over the two points.
    squeezed = MaterialValues(*colours[:, :, 0], surface.roughness[:, 0])
    mapped, mapped_pdf = jax.jit(jax.vmap(one))(squeezed, view[:, 0], light)
    np.testing.assert_allclose(mapped, value, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(mapped_pdf, pdf, rtol=1e-4, atol=1e-6)


def test_evaluate_and_pdf_are_the_parts_of_evaluate_and_pdf():
    arguments = material(0.3, 0.5, 0.6), *map(jnp.asarray, (NORMAL, view_at(0.4), view_at(0.8)))

    def parts(*arguments):
        model = BlinnPhong()
        both = model.evaluate_and_pdf(*arguments)
        return both, (model.evaluate(*arguments), model.pdf(*arguments))

    (value, pdf), (evaluated, density) = jax.jit(parts)(*arguments)
    np.testing.assert_array_equal(evaluated, value)
    np.testing.assert_array_equal(density, pdf)
    assert value.shape == (3,)
    assert pdf.shape == ()


@pytest.mark.parametrize(
    ("name", "model"),
    list(zip(["lambert", "phong", "blinn-phong", "ggx", "beckmann"], RECIPROCAL, strict=True)),
)
def test_models_by_name(name, model):
    assert reflectance_by_name(name) == model
    assert hash(reflectance_by_name(name)) == hash(model)


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(ValueError, match="no reflectance 'mirror': use one of lambert, phong, bl"):
        reflectance_by_name("mirror")
