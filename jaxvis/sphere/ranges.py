"""Quotients and lengths over all of float32's range.

The usual formulas square their numbers, and JAX the divisor in a quotient's derivative; in float32
the square of 1e-20 is 0 and that of 1e20 infinite, and either soon makes NaN.
"""

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


@jax.custom_jvp
def quotient(a: Float[Array, "*#points"], b: Float[Array, "*#points"]) -> Float[Array, "*points"]:
    """a / b, and a where b is 0; derivatives are finite wherever they are float32 numbers."""
    return a / jnp.where(b != 0.0, b, 1.0)


@quotient.defjvp
def _quotient_jvp(primals: tuple, tangents: tuple) -> tuple:
    a, b = primals
    value, safe = quotient(a, b), jnp.where(b != 0.0, b, 1.0)
    return value, (tangents[0] - jnp.where(b != 0.0, value, 0.0) * tangents[1]) / safe


def hypotenuse(a: Float[Array, "*points"], b: Float[Array, "*points"]) -> Float[Array, "*points"]:
    """sqrt(a^2 + b^2) without the squares; the gradient at 0 is finite."""
    a, b = jnp.abs(a), jnp.abs(b)
    longer, ratio = jnp.maximum(a, b), quotient(jnp.minimum(a, b), jnp.maximum(a, b))
    return longer * jnp.sqrt(1.0 + ratio * ratio)


def shrinking(*components: Float[Array, "*points"]) -> Float[Array, "*points"]:
    """A power of two that brings vectors longer than 2^60, whose squares overflow, below 2^40.

    1 for all others, which it leaves as they are.
    """
    return jnp.where(_longest(components) > 2.0**60, 2.0**-90, 1.0)


def moderating(*components: Float[Array, "*points"]) -> Float[Array, "*points"]:
    """:func:`shrinking`, or the power of two that brings vectors shorter than 2^-42 above 2^-42.

    The inverse cubes of the results' lengths are numbers, as derivatives of unit vectors need them.
    """
    stretching = jnp.where(_longest(components) < 2.0**-42, 2.0**84, 1.0)
    return shrinking(*components) * stretching


def _longest(components: tuple) -> Array:
    return functools.reduce(jnp.maximum, [jnp.abs(component) for component in components])
