"""Every model is finite everywhere, and its gradients match finite differences."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from jaxvis.reflectance import MaterialValues
from tests.reflectance.model_cases import (
    NORMAL,
    RECIPROCAL,
    jitted_evaluate,
    jitted_sample,
    named,
    view_at,
)


@partial(jax.jit, static_argnames="model")
def gradients(model, *arguments):
    """Of the sum of all values and densities, by material, normal, view and light."""

    def total(*arguments):
        value, pdf = model.evaluate_and_pdf(*arguments)
        return value.sum() + pdf.sum()

    return jax.grad(total, argnums=(0, 1, 2, 3))(*arguments)


@pytest.mark.parametrize("model", **named(RECIPROCAL))
def test_gradients_match_finite_differences(model):
    generator = np.random.default_rng(11)
    view = np.array([view_at(cosine) for cosine in np.linspace(0.4, 0.9, 8)])
    light = (2.0 * (view @ NORMAL)[:, None] * NORMAL - view) + 0.15 * generator.normal(size=(8, 3))
    light /= np.linalg.norm(light, axis=-1, keepdims=True)
    assert np.all(light @ NORMAL > 0.05)
    colours = generator.uniform(0.1, 0.5, (2, 8, 3))
    surface = MaterialValues(*jnp.asarray(colours, jnp.float32), jnp.linspace(0.4, 0.9, 8))
    at = surface, *(jnp.asarray(x, jnp.float32) for x in (np.tile(NORMAL, (8, 1)), view, light))
    leaves, structure = jax.tree.flatten(at)
    step = 4e-3

    def points(leaves):
        value, pdf = jitted_evaluate(model, *jax.tree.unflatten(structure, leaves))
        return np.asarray(value).sum(axis=-1) + np.asarray(pdf)

    for k, gradient in enumerate(jax.tree.leaves(gradients(model, *at))):
        for component in [...] if gradient.ndim == 1 else [(..., c) for c in range(3)]:
            moved = [leaves[k].at[component].add(sign * step) for sign in (1.0, -1.0)]
            up, down = (points([*leaves[:k], leaf, *leaves[k + 1 :]]) for leaf in moved)
            np.testing.assert_allclose(
                gradient[component], (up - down) / (2.0 * step), rtol=3e-2, atol=1e-2
            )


def unit(vectors):
    """Eight unit vectors, exactly along an axis or nearly so, or anywhere."""
    vectors = np.where(np.linalg.norm(vectors, axis=1, keepdims=True) < 1e-6, [0, 0, 1], vectors)
    return (vectors / np.linalg.norm(vectors, axis=1, keepdims=True)).astype(np.float32)


COMPONENTS = st.one_of(
    st.sampled_from([0.0, 1.0, -1.0, 1e-7, -1e-7, 1e-20, 0.5]), st.floats(-1.0, 1.0)
)
DIRECTIONS = arrays(np.float64, (8, 3), elements=COMPONENTS).map(unit)
NUMBERS = st.one_of(st.sampled_from([0.0, 1.0, 1e-20, 1e-6]), st.floats(0.0, 1.0, width=32))


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    normal=DIRECTIONS,
    view=DIRECTIONS,
    light=DIRECTIONS,
    numbers=arrays(np.float32, (8, 4), elements=NUMBERS),
    view_is=st.sampled_from(["anywhere", "normal", "below"]),
    light_is=st.sampled_from(["anywhere", "view", "opposite", "upright facet"]),
)
def test_everything_is_finite_everywhere(normal, view, light, numbers, view_is, light_is):
    view = {"anywhere": view, "normal": normal, "below": -normal}[view_is]
    upright = view - 2.0 * np.sum(normal * view, axis=-1, keepdims=True) * normal
    light = {"anywhere": light, "view": view, "opposite": -view, "upright facet": upright}[light_is]
    surface = MaterialValues(
        jnp.asarray(numbers[:, :1] * np.ones(3, np.float32)),
        jnp.asarray(numbers[:, 1:2] * np.float32([1, 0.5, 0])),
        jnp.asarray(numbers[:, 2]),
    )
    below_one = np.nextafter(np.float32(1.0), np.float32(0.0))
    uniforms = np.minimum(numbers[:, [3, 0, 1]], below_one)
    for model in RECIPROCAL:
        lights = jitted_sample(model, surface, normal, view, uniforms)
        np.testing.assert_allclose(np.linalg.norm(lights, axis=-1), 1.0, atol=1e-4)
        for result in jitted_evaluate(model, surface, normal, view, light):
            assert np.all(np.isfinite(result)), model
            assert np.all(result >= 0.0), model
        for gradient in jax.tree.leaves(gradients(model, surface, normal, view, light)):
            assert np.all(np.isfinite(gradient)), model
