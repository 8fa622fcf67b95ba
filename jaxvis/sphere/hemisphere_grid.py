"""The grid on which hemispherical visibility maps are kept: both angles in (0, pi).

Local frame, normal along +z. The polar axis lies on the horizon, along +x: theta is measured from
it and phi turns about it, from +y through the normal at phi = pi / 2. No row or column wraps, and
the hemisphere is the whole open square (paper 002, figure 2; which of the tangents is the pole is
our choice). Map rows are theta, columns phi; texel i covers pi i / n to pi (i + 1) / n.
"""

import functools

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32, Float64, Int

from jaxvis.sphere.angles import turns


@functools.lru_cache(maxsize=8)
def texel_directions(resolution: int) -> Float32[np.ndarray, "rows columns 3"]:
    """Local unit directions of the texel centres."""
    if resolution < 1:
        raise ValueError(f"resolution must be at least 1, got {resolution}")
    angle = np.pi * (np.arange(resolution) + 0.5) / resolution
    theta, phi = np.meshgrid(angle, angle, indexing="ij")
    ring = np.sin(theta)
    local = np.stack([np.cos(theta), ring * np.cos(phi), ring * np.sin(phi)], axis=-1)
    local = local.astype(np.float32)
    local.flags.writeable = False
    return local


@functools.lru_cache(maxsize=8)
def texel_solid_angles(resolution: int) -> Float64[np.ndarray, "rows"]:
    """Exact solid angle of each row's texels in steradians; a map's texels add up to 2 pi."""
    edges = np.cos(np.pi * np.arange(resolution + 1) / resolution)
    return np.pi / resolution * -np.diff(edges)


def distance_at(
    signed_distance: Float[Array, "maps n n"],
    which: Int[Array, "*#points"],
    x: Float[Array, "*#points"],
    y: Float[Array, "*#points"],
    z: Float[Array, "*#points"],
) -> Float[Array, "*points"]:
    """Signed distances of some maps along local unit directions, radians.

    Bilinear between texel centres. Below the horizon: the distance at the nearest point of the
    horizon less the angle to it, so that what is below counts as occluded, gradually.

    Args:
        signed_distance: maps on this grid (paper 002, eq. 4), in any precision.
        which: the map that each direction is looked up in.
        x, y, z: the directions' components.
    """
    size = signed_distance.shape[-1]
    below, above = jnp.clip(-z, 0.0, 1.0), jnp.maximum(z, 0.0)
    # theta from the pole on the horizon and phi about it; on and below the horizon phi is 0 or pi.
    theta = 2.0 * size * turns(jnp.sqrt(jnp.maximum(y * y + above * above, 1e-12)), x) - 0.5
    phi = 2.0 * size * turns(above, y) - 0.5
    row = jnp.clip(theta, 0.0, size - 1.0)
    column = jnp.clip(phi, 0.0, size - 1.0)
    # Not the last one, so that there is a texel beyond; the weights do the rest.
    i = jnp.clip(row.astype(jnp.int32), 0, max(size - 2, 0))
    j = jnp.clip(column.astype(jnp.int32), 0, max(size - 2, 0))
    s, t = row - i, column - j
    flat, start = signed_distance.reshape(-1), (which * size + i) * size + j

    def texel(offset: int) -> Array:
        return jnp.take(flat, start + offset, mode="clip").astype(jnp.float32)

    upper = texel(0) + t * (texel(1) - texel(0))
    lower = texel(size) + t * (texel(size + 1) - texel(size))
    depth = 2.0 * jnp.pi * turns(below, jnp.sqrt(jnp.maximum(1.0 - below * below, 1e-12)))
    return upper + s * (lower - upper) - depth
