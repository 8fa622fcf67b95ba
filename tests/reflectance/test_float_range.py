"""Values and gradients are finite for every material, and directions of any nearness to each other.

Colours and roughness go down to the smallest numbers and 0, components of unit vectors to 1e-30 and
0 (axes of lobes turn as steeply as the view is close to the normal); views and lights are grazing,
below the horizon, along the normal, equal or opposite.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given

from jaxvis.reflectance import MaterialValues, Mixed, cosine_lobe, specular_lobe
from jaxvis.reflectance.model import Cosines
from tests.float_range import (
    RANDOM,
    ROWS,
    directions,
    magnitudes,
    related,
    require_finite,
    whole_range,
)
from tests.reflectance.model_cases import MODELS, named

ALL = [*MODELS, Mixed()]


def colours(random, *shape):
    return jnp.asarray(np.minimum(magnitudes(random, *shape, most=1.0), 1.0))


def surfaces(random):
    """Base colour, specular colour and roughness in [0, 1], and the number of a model."""
    model = jnp.asarray(random.integers(3, size=ROWS), jnp.int32)
    base, specular = colours(random, ROWS, 3), colours(random, ROWS, 3)
    return (base, specular, colours(random, ROWS)), model


def arrangements(random):
    """Normals, views and lights, each anywhere or next to what another one singles out."""
    normal = directions(random, ROWS)
    view = related(random, normal)
    mirror = 2.0 * np.sum(normal * view, axis=-1, keepdims=True) * normal - view
    mirror = (mirror / np.linalg.norm(mirror, axis=-1, keepdims=True)).astype(np.float32)
    kind = random.integers(3, size=(ROWS, 1))
    about = np.select([kind == 0, kind == 1], [normal, view], mirror).astype(np.float32)
    vectors = normal, view, related(random, about)
    return tuple(np.where(np.abs(v) < 1e-30, np.float32(0.0), v) for v in vectors)


def material(parts, model):
    base_colour, specular, roughness = parts
    return MaterialValues(base_colour, specular, roughness, model)


def evaluation(model):
    """Values and densities by the parts of a surface and directions; one function a model."""

    def evaluate(parts, number, normal, view, light):
        return model.evaluate_and_pdf(material(parts, number), normal, view, light)

    return evaluate


def coloured_terms(model):
    def terms(parts, number, cosines):
        surface = material(parts, number)
        return model.terms(surface, Cosines.of(*cosines)), model.colours(surface)

    return terms


def drawing(model):
    def sample(parts, number, normal, view, counts):
        uniforms = counts.astype(jnp.float32) * jnp.float32(2.0**-24)
        return model.sample(material(parts, number), normal, view, uniforms)

    return sample


def lobe(model):
    def specular(parts, number, normal, view):
        return specular_lobe(model, material(parts, number), normal, view)

    return specular


EVALUATIONS = {model: evaluation(model) for model in ALL}
TERMS = {model: coloured_terms(model) for model in ALL}
SAMPLES = {model: drawing(model) for model in ALL}
LOBES = {model: lobe(model) for model in ALL}


@pytest.mark.parametrize("model", **named(ALL))
@whole_range
@given(random=RANDOM)
def test_values_and_densities(model, random):
    value, pdf = require_finite(EVALUATIONS[model], *surfaces(random), *arrangements(random))
    assert np.all(value >= 0.0)
    assert np.all(pdf >= 0.0)


@pytest.mark.parametrize("model", **named(ALL))
@whole_range
@given(random=RANDOM)
def test_terms(model, random):
    normal, view, light = arrangements(random)
    pairs = (normal, view), (normal, light), (view, light)
    cosines = tuple(np.clip(np.sum(a * b, axis=-1), -1.0, 1.0) for a, b in pairs)
    terms, _ = require_finite(TERMS[model], *surfaces(random), cosines)
    assert all(np.all(term >= 0.0) for term in terms)


@pytest.mark.parametrize("model", **named(ALL))
@whole_range
@given(random=RANDOM)
def test_samples(model, random):
    """For numbers in [0, 1), the first and the last too; by them there is no gradient here."""
    counts = random.integers(0, 2**24, (ROWS, 3))
    ends = random.choice([0, 1, 2, 2**23, 2**24 - 1], (ROWS, 3))
    counts = np.where(random.random((ROWS, 3)) < 0.5, ends, counts)
    normal, view, _ = arrangements(random)
    light = require_finite(SAMPLES[model], *surfaces(random), normal, view, counts)
    np.testing.assert_allclose(np.linalg.norm(light, axis=-1), 1.0, atol=1e-4)


@pytest.mark.parametrize("model", **named(ALL))
@whole_range
@given(random=RANDOM)
def test_lobes(model, random):
    normal, view, _ = arrangements(random)
    found = require_finite(LOBES[model], *surfaces(random), normal, view)
    np.testing.assert_allclose(np.linalg.norm(found.axis, axis=-1), 1.0, atol=1e-5)
    assert np.all(found.sharpness > 0.0)
    assert np.all(found.amplitude >= 0.0)


@whole_range
@given(random=RANDOM)
def test_cosine_lobes(random):
    require_finite(cosine_lobe, directions(random, ROWS))
