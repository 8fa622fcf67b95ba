"""Phong lobes about +z: density proportional to the cosine to a power."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxvis.sphere.angles import sine_cosine
from jaxvis.sphere.components import join


def sample_lobe(
    uniforms: Float[Array, "*#points 2"], exponent: Float[Array, "..."] | float
) -> Float[Array, "..."]:
    """Unit directions of density (a + 1) / 2 pi cos^a about +z, for ``exponent`` a >= 0.

    cos = (1 - u)^(1 / (a + 1)), phi = 2 pi v. The sine comes from expm1, so that narrow lobes
    keep their shape in float32. To turn the lobe to a direction, use ``frames.to_world``.
    """
    logarithm = jnp.log1p(-uniforms[..., 0]) / (exponent + 1.0)
    sine_square = -jnp.expm1(2.0 * logarithm)
    radius = jnp.sqrt(jnp.maximum(sine_square, 1e-30))  # the root's gradient at 0 is infinite
    sine, cosine = sine_cosine(uniforms[..., 1])
    return join(radius * cosine, radius * sine, jnp.exp(logarithm))


def pdf_lobe(
    cosine: Float[Array, "*#points"], exponent: Float[Array, "..."] | float
) -> Float[Array, "..."]:
    """Density per steradian of :func:`sample_lobe` at an angle of this cosine from the axis.

    The relative error is about ``exponent`` times the cosine's own: 1e-3 for 20000 in float32.
    """
    above = cosine > 0.0
    power = jnp.exp(exponent * jnp.log(jnp.where(above, cosine, 1.0)))
    return jnp.where(above, power * (exponent + 1.0) * (0.5 / jnp.pi), 0.0)
