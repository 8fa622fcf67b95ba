"""Counter-based random numbers: cheap enough to draw for every ray.

``jax.random`` costs more than tracing half a ray does; this hash costs a fortieth. Its inputs are
counters (pixel, sample) and words of a ``jax.random`` key, so a number depends on nothing else:
not on chunk size, thread count or which other pixels are drawn.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, UInt32


def key_words(key: jax.Array) -> UInt32[Array, "2"]:
    """Two words that stand for a ``jax.random`` key."""
    return jax.random.bits(key, (2,), jnp.uint32)


def counter_bits(
    words: UInt32[Array, "2"], first: Int[Array, "*#points"], second: Int[Array, "*#points"]
) -> tuple[UInt32[Array, "..."], ...]:
    """Four independent random words for each pair of counters.

    The hash pcg4d of Jarzynski and Olano 2020, "Hash Functions for GPU Rendering".
    """
    first, second = jnp.broadcast_arrays(first, second)
    state = [
        first.astype(jnp.uint32),
        second.astype(jnp.uint32),
        jnp.broadcast_to(words[0], first.shape),
        jnp.broadcast_to(words[1], first.shape),
    ]
    x, y, z, w = (v * jnp.uint32(1664525) + jnp.uint32(1013904223) for v in state)
    for shift in (True, False):
        x = x + y * w
        y = y + z * x
        z = z + x * y
        w = w + y * z
        if shift:
            x, y, z, w = (v ^ (v >> 16) for v in (x, y, z, w))
    return x, y, z, w


def uniform(bits: UInt32[Array, "*points"]) -> Float[Array, "*points"]:
    """Numbers in [0, 1) from the upper 24 bits of random words."""
    return (bits >> 8).astype(jnp.float32) * jnp.float32(2.0**-24)
