"""Vectors and local frames. Local coordinates have the normal along +z."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32

from jaxvis.sphere.ranges import moderating


def dot(a: Float[Array, "*#points 3"], b: Float[Array, "*#points 3"]) -> Float[Array, "*points"]:
    """Scalar product over the last axis. Written out: XLA vectorises it over the points."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def normalize(vector: Float[Array, "*#points 3"]) -> Float[Array, "*points 3"]:
    """Unit vectors; the zero vector stays zero (with a zero, not NaN, gradient)."""
    scale = moderating(vector[..., 0], vector[..., 1], vector[..., 2])
    vector = vector * scale[..., None]
    squared = dot(vector, vector)
    safe = jnp.where(squared > 0.0, squared, 1.0)
    return vector * (jnp.where(squared > 0.0, 1.0, 0.0) / jnp.sqrt(safe))[..., None]


def frame(
    normal: Float[Array, "*#points 3"],
) -> tuple[Float[Array, "*#points 3"], Float[Array, "*#points 3"]]:
    """Tangent and bitangent so that (tangent, bitangent, normal) is right-handed orthonormal.

    Branchless and without a singular direction (Duff et al. 2017, "Building an Orthonormal
    Basis, Revisited").
    """
    x, y, z = normal[..., 0], normal[..., 1], normal[..., 2]
    sign = jnp.where(z >= 0.0, 1.0, -1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    tangent = jnp.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=-1)
    bitangent = jnp.stack([b, sign + y * y * a, -y], axis=-1)
    return tangent, bitangent


def frames_on_host(normals: Float[np.ndarray, "points 3"]) -> Float32[np.ndarray, "points 3 3"]:
    """Rows tangent, bitangent and normal: those of :func:`frame`, in NumPy."""
    x, y, z = normals.astype(np.float64).T
    sign = np.where(z >= 0.0, 1.0, -1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    tangent = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=-1)
    bitangent = np.stack([b, sign + y * y * a, -y], axis=-1)
    return np.stack([tangent, bitangent, normals], axis=1).astype(np.float32)


def to_world(
    local: Float[Array, "*#points 3"], normal: Float[Array, "*#points 3"]
) -> Float[Array, "*points 3"]:
    """From the local frame of ``normal`` to the world."""
    tangent, bitangent = frame(normal)
    return local[..., 0:1] * tangent + local[..., 1:2] * bitangent + local[..., 2:3] * normal


def to_local(
    world: Float[Array, "*#points 3"], normal: Float[Array, "*#points 3"]
) -> Float[Array, "*points 3"]:
    """From the world to the local frame of ``normal``."""
    tangent, bitangent = frame(normal)
    return jnp.stack([dot(world, tangent), dot(world, bitangent), dot(world, normal)], axis=-1)


def reflect(
    direction: Float[Array, "*#points 3"], normal: Float[Array, "*#points 3"]
) -> Float[Array, "*points 3"]:
    """Mirror direction of ``direction`` (pointing away from the surface) about ``normal``."""
    return 2.0 * dot(direction, normal)[..., None] * normal - direction
