"""The grid on which hemispherical visibility maps are kept: both angles in (0, pi).

Local frame, normal along +z. The polar axis lies on the horizon, along +x: theta is measured from
it and phi turns about it, from +y through the normal at phi = pi / 2. No row or column wraps, and
the hemisphere is the whole open square (paper 002, figure 2; which of the tangents is the pole is
our choice). Map rows are theta, columns phi; texel i covers pi i / n to pi (i + 1) / n.
"""

import functools

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32, Float64


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


def coordinates(
    x: Float[Array, "*points"], y: Float[Array, "*points"], z: Float[Array, "*points"]
) -> tuple[Float[Array, "*points"], Float[Array, "*points"]]:
    """(theta, phi) of local unit directions of the upper hemisphere, in radians."""
    theta = jnp.arctan2(jnp.sqrt(jnp.maximum(y * y + z * z, 1e-30)), x)
    return theta, jnp.arctan2(z, y)
