"""The lat-long map of directions: the project's one orientation (DESIGN §3).

A panorama seen from inside, as Mitsuba 3's ``envmap`` with identity ``to_world``: theta runs from
+Y (row 0) to -Y, u = atan2(x, -z) / 2 pi modulo 1 runs to the right, so that column 0 begins at
-Z, a quarter of the width is +X and the middle is +Z. A texel's value is the average over it.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxvis.sphere.angles import colatitude, sine_cosine, turns
from jaxvis.sphere.components import join


def direction(
    u: Float[Array, "*points"], theta: Float[Array, "*points"]
) -> Float[Array, "*points 3"]:
    """Unit direction at u (in turns) and colatitude theta (radians from +Y)."""
    sin_theta, cos_theta = sine_cosine(theta * (0.5 / jnp.pi))
    sin_phi, cos_phi = sine_cosine(u)
    return join(sin_theta * sin_phi, cos_theta, -sin_theta * cos_phi)


def coordinates(
    directions: Float[Array, "*points 3"],
) -> tuple[Float[Array, "*points"], Float[Array, "*points"]]:
    """(u in [0, 1), theta in [0, pi]) of directions of any length; accurate at the poles."""
    x, y, z = directions[..., 0], directions[..., 1], directions[..., 2]
    u = turns(x, -z)
    u = jnp.where(u < 0.0, u + 1.0, u)
    u = jnp.where(u >= 1.0, 0.0, u)  # a tiny negative angle rounds up to 1 in float32
    return u, 2.0 * jnp.pi * colatitude(x, y, z)


def texel(
    directions: Float[Array, "*points 3"], height: int, width: int
) -> tuple[Int[Array, "*points"], Int[Array, "*points"]]:
    """(row, column) of the texel of a ``height`` x ``width`` map that holds each direction."""
    u, theta = coordinates(directions)
    row = jnp.clip((theta * (height / jnp.pi)).astype(jnp.int32), 0, height - 1)
    column = jnp.clip((u * width).astype(jnp.int32), 0, width - 1)
    return row, column


@jax.jit
def nearest(
    values: Float[Array, "height width *channels"], directions: Float[Array, "*points 3"]
) -> Float[Array, "..."]:
    """The value of the texel that holds each direction: the piecewise-constant map, exactly."""
    height, width = values.shape[:2]
    row, column = texel(directions, height, width)
    return jnp.take(values.reshape(height * width, *values.shape[2:]), row * width + column, axis=0)


def bilinear(
    values: Float[Array, "height width *channels"], directions: Float[Array, "*points 3"]
) -> Float[Array, "..."]:
    """Interpolated between texel centres: periodic in u, and across a pole the row continues half
    a turn away.
    """
    height, width = values.shape[:2]
    u, theta = coordinates(directions)
    x = u * width - 0.5
    y = theta * (height / jnp.pi) - 0.5
    column, row = jnp.floor(x).astype(jnp.int32), jnp.floor(y).astype(jnp.int32)
    fx, fy = x - column, y - row
    flat = values.reshape(height * width, *values.shape[2:])
    channels = (1,) * (values.ndim - 2)

    def at(r: Int[Array, "..."], c: Int[Array, "..."]) -> Float[Array, "..."]:
        beyond = (r < 0) | (r >= height)
        r = jnp.where(r < 0, -1 - r, jnp.where(r >= height, 2 * height - 1 - r, r))
        c = jnp.mod(jnp.where(beyond, c + width // 2, c), width)
        return jnp.take(flat, r * width + c, axis=0)

    fx, fy = fx.reshape(*fx.shape, *channels), fy.reshape(*fy.shape, *channels)
    top = (1 - fx) * at(row, column) + fx * at(row, column + 1)
    bottom = (1 - fx) * at(row + 1, column) + fx * at(row + 1, column + 1)
    return (1 - fy) * top + fy * bottom


def texel_directions(height: int, width: int) -> Float[np.ndarray, "height width 3"]:
    """Unit directions (float64, host) of the texel centres."""
    theta = np.pi * (np.arange(height) + 0.5)[:, None] / height
    phi = 2.0 * np.pi * (np.arange(width) + 0.5)[None, :] / width
    x, y = np.sin(theta) * np.sin(phi), np.cos(theta) + 0.0 * phi
    return np.stack([x, y, -np.sin(theta) * np.cos(phi)], axis=-1)


def row_solid_angles(height: int, width: int) -> Float[np.ndarray, "height"]:
    """Exact solid angle (sr, float64, host) of one texel in each row; they add up to 4 pi."""
    cosines = np.cos(np.pi * np.arange(height + 1) / height)
    return (2.0 * np.pi / width) * (cosines[:-1] - cosines[1:])
