"""Weights of multiple importance sampling: Veach and Guibas 1995, "Optimally Combining Sampling
Techniques for Monte Carlo Rendering".
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

Count = Float[Array, "..."] | int | float


def balance(
    n_a: Count, pdf_a: Float[Array, "*#points"], n_b: Count, pdf_b: Float[Array, "*#points"]
) -> Float[Array, "..."]:
    """The balance heuristic's weight of a sample of strategy a, of which ``n_a`` are drawn.

    0 where neither strategy could have drawn it.
    """
    a, b = n_a * pdf_a, n_b * pdf_b
    total = a + b
    possible = total > 0.0
    return jnp.where(possible, a, 0.0) / jnp.where(possible, total, 1.0)


def power(
    n_a: Count, pdf_a: Float[Array, "*#points"], n_b: Count, pdf_b: Float[Array, "*#points"]
) -> Float[Array, "..."]:
    """The power heuristic's weight, exponent 2; densities up to float32's largest do not overflow.

    0 where neither strategy could have drawn it.
    """
    a, b = n_a * pdf_a, n_b * pdf_b
    larger = jnp.maximum(a, b)
    possible = larger > 0.0
    scale = jnp.where(possible, larger, 1.0)
    a, b = jnp.where(possible, a, 0.0) / scale, jnp.where(possible, b, 0.0) / scale
    return a * a / jnp.where(possible, a * a + b * b, 1.0)
