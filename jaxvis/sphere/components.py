"""Joining separately computed components into vectors, in the form that XLA compiles well."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def join(*components: Float[Array, "..."]) -> Float[Array, "..."]:
    """``jnp.stack(components, axis=-1)`` for a few components of one shape.

    Written as a selection: on the CPU a concatenation makes XLA compute what the components share
    (gathers included) once for each component, a selection computes it once.
    """
    index = jnp.arange(len(components))
    joined = components[-1][..., None]
    for k in range(len(components) - 2, -1, -1):
        joined = jnp.where(index == k, components[k][..., None], joined)
    return joined
