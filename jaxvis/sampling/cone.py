"""Uniform directions of a circular cone about +z: what a sphere subtends.

Cones are given by the versine of their half angle, 1 - cos, which float32 keeps for narrow ones.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxvis.sphere.angles import sine_cosine
from jaxvis.sphere.components import join


def sample_cone(
    uniforms: Float[Array, "*#points 2"], versine: Float[Array, "..."] | float
) -> Float[Array, "..."]:
    """Unit directions of density 1 / (2 pi versine): 1 - cos theta = u versine, phi = 2 pi v.

    ``versine`` is in (0, 2] and broadcasts against the points. To turn the cone to a direction,
    use ``frames.to_world``.
    """
    apart = uniforms[..., 0] * versine
    radius = jnp.sqrt(apart * (2.0 - apart))
    sine, cosine = sine_cosine(uniforms[..., 1])
    return join(radius * cosine, radius * sine, 1.0 - apart)


def pdf_cone(
    apart: Float[Array, "*#points"], versine: Float[Array, "*#points"] | float
) -> Float[Array, "*points"]:
    """Density per steradian of :func:`sample_cone` where 1 - cos of the angle to the axis is
    ``apart``."""
    return jnp.where(apart <= versine, 0.5 / jnp.pi, 0.0) / versine
