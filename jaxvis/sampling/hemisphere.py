"""Cosine-weighted and uniform directions of the hemisphere, in the local frame (normal = +z)."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxvis.sphere.angles import sine_cosine
from jaxvis.sphere.components import join


def sample_cosine(uniforms: Float[Array, "*points 2"]) -> Float[Array, "*points 3"]:
    """Unit directions of density cos / pi: cos theta = sqrt(1 - u), phi = 2 pi v.

    Adding a constant to v turns the directions about the normal.
    """
    u = uniforms[..., 0]
    sine, cosine = sine_cosine(uniforms[..., 1])
    radius = jnp.sqrt(u)
    return join(radius * cosine, radius * sine, jnp.sqrt(1.0 - u))


def pdf_cosine(cosine: Float[Array, "*points"]) -> Float[Array, "*points"]:
    """Density per steradian of :func:`sample_cosine` where the direction's z is ``cosine``."""
    return jnp.maximum(cosine, 0.0) * (1.0 / jnp.pi)


@jax.jit
def sample_uniform(uniforms: Float[Array, "*points 2"]) -> Float[Array, "*points 3"]:
    """Unit directions of density 1 / 2 pi: cos theta = 1 - u, phi = 2 pi v."""
    u = uniforms[..., 0]
    sine, cosine = sine_cosine(uniforms[..., 1])
    radius = jnp.sqrt(u * (2.0 - u))
    return join(radius * cosine, radius * sine, 1.0 - u)


def pdf_uniform(cosine: Float[Array, "*points"]) -> Float[Array, "*points"]:
    """Density per steradian of :func:`sample_uniform` where the direction's z is ``cosine``."""
    return jnp.where(cosine > 0.0, 0.5 / jnp.pi, 0.0)
