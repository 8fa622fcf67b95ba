"""Reading signed distances along any direction (array code)."""

import jax.numpy as jnp
from jaxtyping import Array, Float, Float16

from jaxvis.sphere.angles import turns


def signed_distances_at(
    signed_distance: Float16[Array, "samples n n"],
    frames: Float[Array, "samples 3 3"],
    directions: Float[Array, "directions 3"],
) -> Float[Array, "samples directions"]:
    """Every sample's distance along each of some unit world directions, radians.

    Bilinear between texel centres. Below a sample's horizon: that at the nearest point of the
    horizon less the angle to it, so that what other samples see above theirs can be interpolated.
    """
    count = signed_distance.shape[0]
    x, y, z = (
        frames[:, row, 0:1] * directions[:, 0]
        + frames[:, row, 1:2] * directions[:, 1]
        + frames[:, row, 2:3] * directions[:, 2]
        for row in range(3)
    )
    sample = jnp.broadcast_to(jnp.arange(count)[:, None], x.shape)
    return distance_at(signed_distance, sample, x, y, z)


def distance_at(
    signed_distance: Float16[Array, "samples n n"],
    sample: Array,
    x: Float[Array, "*points"],
    y: Float[Array, "*points"],
    z: Float[Array, "*points"],
) -> Float[Array, "*points"]:
    """Distances in samples' maps along local unit directions (see :func:`signed_distances_at`)."""
    size = signed_distance.shape[-1]
    below, above = jnp.clip(-z, 0.0, 1.0), jnp.maximum(z, 0.0)
    # theta from the pole on the horizon and phi about it; on and below the horizon phi is 0 or pi.
    theta = 2.0 * size * turns(jnp.sqrt(jnp.maximum(y * y + above * above, 1e-12)), x) - 0.5
    phi = 2.0 * size * turns(above, y) - 0.5
    row = jnp.clip(theta, 0.0, size - 1.0)
    column = jnp.clip(phi, 0.0, size - 1.0)
    # Not the last one, so that there is a texel to its right; the weights do the rest.
    i = jnp.minimum(row.astype(jnp.int32), size - 2)
    j = jnp.minimum(column.astype(jnp.int32), size - 2)
    s, t = row - i, column - j
    flat, start = signed_distance.reshape(-1), (sample * size + i) * size + j

    def texel(offset: int) -> Array:
        return jnp.take(flat, start + offset, mode="clip").astype(jnp.float32)

    upper = texel(0) + t * (texel(1) - texel(0))
    lower = texel(size) + t * (texel(size + 1) - texel(size))
    level = jnp.sqrt(jnp.maximum(1.0 - below * below, 1e-12))
    return upper + s * (lower - upper) - 2.0 * jnp.pi * turns(below, level)
