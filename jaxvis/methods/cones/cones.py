"""Cones over the hemisphere, and the samples along them (paper 003, section VI)."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float64

from jaxvis.sphere.frames import normalize

TILT = np.pi / 3.0
"""Angle of the ring's cones from the normal."""


class Cones(NamedTuple):
    """Axes in the local frame (normal along +z), and weights that add up to pi."""

    axes: Float64[np.ndarray, "cones 3"]
    weights: Float64[np.ndarray, "cones"]


def cone_set(count: int) -> Cones:
    """One cone about the normal and a ring of the others at 60 degrees.

    Six of 60 degrees are those of voxel cone tracing since Crassin et al. 2011. The weight of the
    middle one is the cosine's integral over it, pi sin^2 30 (eq. 3); the others share the rest.

    Raises:
        ValueError: fewer than four cones, which cover no hemisphere.
    """
    if count < 4:
        raise ValueError(f"cones must be at least 4, one and a ring of three, got {count}")
    angle = 2.0 * np.pi * np.arange(count - 1) / (count - 1)
    ring = np.stack(
        [np.sin(TILT) * np.sin(angle), np.sin(TILT) * np.cos(angle), np.cos(TILT) + 0.0 * angle], -1
    )
    middle = np.pi / 4.0
    return Cones(
        np.concatenate([[[0.0, 0.0, 1.0]], ring]),
        np.concatenate([[middle], np.full(count - 1, (np.pi - middle) / (count - 1))]),
    )


def upright_frame(
    normal: Float[Array, "*points 3"], azimuth: Float[Array, ""] | np.float32 | float = 0.0
) -> tuple[Float[Array, "*points 3"], Float[Array, "*points 3"]]:
    """Tangent and bitangent: those of +y, turned with it to the normal the shortest way.

    Continuous but for normals straight down, so that the ring of cones does not jump along a
    surface. The tangent of +y has the given azimuth (radians, from +x towards +z).
    """
    x, y, z = normal[..., 0], normal[..., 1], normal[..., 2]
    c, s = jnp.cos(azimuth), jnp.sin(azimuth)
    lean = (c * x + s * z) / jnp.maximum(1.0 + y, 1e-4)
    tangent = jnp.stack([c - lean * x, -lean * (1.0 + y), s - lean * z], axis=-1)
    return normalize(tangent), normalize(jnp.cross(normal, tangent))


def own_azimuth(positions: Float[np.ndarray, "vertices 3"]) -> np.float32:
    """An azimuth that turns with the scene about +y (radians): of a vertex well off its middle.

    A ring of five cones is not the same after a quarter turn. If it starts here, an image does not
    depend on how the scene happens to stand to the axes.
    """
    offset = positions - 0.5 * (positions.min(axis=0) + positions.max(axis=0))
    distance = np.hypot(offset[:, 0], offset[:, 2])
    x, _, z = offset[np.argmax(distance > 0.6 * distance.max())]
    return np.float32(np.arctan2(z, x))
