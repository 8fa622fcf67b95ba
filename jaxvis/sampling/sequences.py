"""Low-discrepancy points: Hammersley's, and Sobol's from SciPy."""

from functools import partial
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt32

from jaxvis.sphere.components import join

if TYPE_CHECKING:
    from scipy.stats import qmc

BELOW_ONE = 1.0 - 2.0**-24
"""The largest float32 below 1: what uniforms are kept at or below."""


def radical_inverse(
    index: Int[Array, "*points"] | UInt32[Array, "*points"],
) -> Float[Array, "*points"]:
    """Van der Corput's sequence: the binary digits of ``index`` mirrored at the point, in [0, 1).

    float32 keeps the 24 leading digits, so that indices up to 2^24 have distinct values.
    """
    bits = index.astype(jnp.uint32)
    bits = (bits << 16) | (bits >> 16)
    for shift, mask in ((8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
        bits = ((bits & mask) << shift) | ((bits >> shift) & mask)
    return (bits >> 8).astype(jnp.float32) * 2.0**-24


@partial(jax.jit, static_argnames="count")
def hammersley(count: int) -> Float[Array, "samples 2"]:
    """Point i is ((i + 1/2) / count, radical inverse of i), both in [0, 1)."""
    if not 1 <= count <= 2**24:
        raise ValueError(f"count must be from 1 to 2^24, got {count}")
    index = jnp.arange(count)
    first = jnp.minimum((index.astype(jnp.float32) + 0.5) / count, BELOW_ONE)
    return join(first, radical_inverse(index))


def sobol(dimensions: int, seed: int | tuple[int, ...]) -> "qmc.Sobol":
    """Sobol's sequence in [0, 1)^dimensions (float64, host), scrambled by ``seed``."""
    from scipy.stats import qmc  # here: importing it takes as long as importing JAX

    return qmc.Sobol(dimensions, rng=np.random.default_rng(seed))
