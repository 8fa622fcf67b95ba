"""Lambert: closed forms."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxvis.reflectance import Lambert, MaterialValues
from jaxvis.sphere import latlong

evaluate = jax.jit(Lambert().evaluate_and_pdf)
UP = jnp.array([0.0, 1.0, 0.0])


def test_a_white_surface_in_a_white_furnace_is_white():
    white = MaterialValues(jnp.ones(3), jnp.zeros(3), jnp.ones(()))
    lights = jnp.asarray(latlong.texel_directions(64, 128), jnp.float32)
    view = jnp.array([0.6, 0.8, 0.0])
    value, pdf = evaluate(white, UP, view, lights)
    solid_angles = latlong.row_solid_angles(64, 128)[:, None]
    np.testing.assert_allclose((value * solid_angles[..., None]).sum((0, 1)), 1.0, rtol=1e-3)
    np.testing.assert_allclose((pdf * solid_angles).sum(), 1.0, rtol=1e-3)


def test_value_and_density():
    material = MaterialValues(jnp.array([0.2, 0.4, 0.8]), jnp.ones(3), jnp.zeros(()))
    light = jnp.array([0.8, 0.6, 0.0])
    value, pdf = evaluate(material, UP, UP, light)
    np.testing.assert_allclose(value, np.array([0.2, 0.4, 0.8]) * 0.6 / np.pi, rtol=1e-6)
    np.testing.assert_allclose(pdf, 0.6 / np.pi, rtol=1e-6)


def test_every_sample_of_a_white_surface_weighs_one():
    white = MaterialValues(jnp.ones(3), jnp.zeros(3), jnp.ones(()))
    uniforms = np.random.default_rng(1).uniform(size=(500, 3)).astype(np.float32)
    view = jnp.array([0.6, 0.8, 0.0])
    lights = jax.jit(Lambert().sample)(white, UP, view, jnp.asarray(uniforms))
    value, pdf = evaluate(white, UP, view, lights)
    np.testing.assert_allclose(value / pdf[..., None], 1.0, rtol=1e-6)
