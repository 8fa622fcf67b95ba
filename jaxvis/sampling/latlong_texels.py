"""Points within lat-long texels, uniform in solid angle: phi uniform, cos theta uniform.

Heights are kept as sin^2 of half the angle from the nearer pole, which is exact in float32 where
1 - cos theta would have lost its digits, and as uniform as cos theta.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxvis.sampling.sequences import BELOW_ONE
from jaxvis.sphere import latlong
from jaxvis.sphere.angles import sine_cosine
from jaxvis.sphere.components import join


def row_bounds(height: int) -> Float[np.ndarray, "height 2"]:
    """(sin^2 at each row's upper edge, its change towards the lower edge), float32, host.

    Measured from the north pole in rows above the equator (a middle row included), from the south
    pole below.
    """
    half = 0.5 * np.pi * np.arange(height + 1) / height
    north, south = np.sin(half) ** 2, np.cos(half) ** 2
    south[-1] = 0.0
    upper = np.arange(height) < (height + 1) // 2
    first = np.where(upper, north[:-1], south[:-1])
    second = np.where(upper, north[1:], south[1:])
    return np.stack([first, second - first], axis=-1).astype(np.float32)


def _is_upper(row: Int[Array, "*points"], height: int) -> jax.Array:
    return row < (height + 1) // 2


def inside(
    row: Int[Array, "*points"],
    column: Int[Array, "*points"],
    across: Float[Array, "*points"],
    down: Float[Array, "*points"],
    bounds: Float[Array, "height 2"],
    width: int,
) -> Float[Array, "*points 3"]:
    """Unit directions at fractions ``across`` (of u) and ``down`` (of cos theta) of texels."""
    edge = jnp.take(bounds, row, axis=0, mode="clip")
    square = edge[..., 0] + down * edge[..., 1]
    cosine = 1.0 - 2.0 * square
    radius = 2.0 * jnp.sqrt(jnp.maximum(square * (1.0 - square), 0.0))
    sine_phi, cosine_phi = sine_cosine((column + across) * (1.0 / width))
    return join(
        radius * sine_phi,
        jnp.where(_is_upper(row, bounds.shape[0]), cosine, -cosine),
        -radius * cosine_phi,
    )


def locate(
    directions: Float[Array, "*points 3"], bounds: Float[Array, "height 2"], width: int
) -> tuple[
    Int[Array, "*points"], Int[Array, "*points"], Float[Array, "*points"], Float[Array, "*points"]
]:
    """(row, column, across, down) of unit directions: the inverse of :func:`inside`."""
    height = bounds.shape[0]
    row, column = latlong.texel(directions, height, width)
    u, _ = latlong.coordinates(directions)
    x, y, z = directions[..., 0], directions[..., 1], directions[..., 2]
    # sin^2 of half the angle from the row's own pole.
    towards = jnp.where(_is_upper(row, height), y, -y)
    level = x * x + z * z
    square = jnp.where(towards > 0.0, level / (2.0 * (1.0 + jnp.abs(y))), 0.5 * (1.0 - towards))
    edge = jnp.take(bounds, row, axis=0, mode="clip")
    down = (square - edge[..., 0]) / edge[..., 1]
    across = u * width - column
    return row, column, jnp.clip(across, 0.0, BELOW_ONE), jnp.clip(down, 0.0, BELOW_ONE)


def normalised(
    luminance: Float[Array | np.ndarray, "height width"],
) -> tuple[Float[np.ndarray, "height width"], Float[np.ndarray, "height width"]]:
    """(probability of each texel, its density per steradian), float64, in proportion to luminance.

    Raises:
        ValueError: a value is negative or not finite. Zero everywhere means uniform directions.
    """
    density = np.asarray(luminance, np.float64)
    if not np.all(np.isfinite(density)) or np.any(density < 0.0):
        raise ValueError("luminance: must be finite and non-negative")
    largest = density.max()
    density = density / largest if largest > 0.0 else np.ones_like(density)
    weights = density * latlong.row_solid_angles(*density.shape)[:, None]
    total = weights.sum()
    return weights / total, density / total
