"""From roughness to microfacet width and exponent."""

import jax.numpy as jnp
import numpy as np

from jaxvis.reflectance import MaterialValues


def values(roughness):
    roughness = jnp.asarray(roughness, jnp.float32)
    return MaterialValues(
        jnp.ones((*roughness.shape, 3)), jnp.ones((*roughness.shape, 3)), roughness
    )


def test_width_and_exponent():
    material = values([1.0, np.sqrt(0.5), 0.5, 0.1])
    np.testing.assert_allclose(material.microfacet_width, [1.0, 0.5, 0.25, 0.01], rtol=1e-6)
    np.testing.assert_allclose(material.exponent, [0.0, 6.0, 30.0, 19998.0], rtol=1e-5, atol=1e-5)


def test_no_material_is_a_mirror():
    np.testing.assert_array_equal(values([0.0]).exponent, values([0.1]).exponent)
