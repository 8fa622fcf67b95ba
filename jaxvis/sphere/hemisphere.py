"""Equal-area maps: disc to hemisphere (Lambert's azimuthal map) and square to disc.

Local frame, normal along +z. Both maps keep ratios of areas, so that uniform points of the square
become uniform directions of the hemisphere.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxvis.sphere.angles import sine_cosine, turns
from jaxvis.sphere.components import join


def to_direction(points: Float[Array, "*points 2"]) -> Float[Array, "*points 3"]:
    """Unit directions of points of the unit disc: z = 1 - r^2, the horizon at r = 1.

    Points of 1 < r <= sqrt(2) continue the map over the lower hemisphere. A unit of the disc's
    area is 2 sr.
    """
    x, y = points[..., 0], points[..., 1]
    square = x * x + y * y
    inner = jnp.maximum(2.0 - square, 0.0)
    scale = jnp.sqrt(jnp.where(inner > 0.0, inner, 1.0)) * jnp.where(inner > 0.0, 1.0, 0.0)
    return join(x * scale, y * scale, 1.0 - square)


def from_direction(directions: Float[Array, "*points 3"]) -> Float[Array, "*points 2"]:
    """Points of the disc (r <= 1 on the upper hemisphere) of unit directions.

    -z is the whole circle r = sqrt(2); the result there is (0, 0).
    """
    x, y, z = directions[..., 0], directions[..., 1], directions[..., 2]
    # 1 + z from the sine where z is negative: it keeps its relative precision near -z.
    sine_square = x * x + y * y
    rise = jnp.where(z < 0.0, sine_square / (1.0 - jnp.minimum(z, 0.0)), 1.0 + z)
    inside = rise > 0.0
    scale = jnp.where(inside, 1.0, 0.0) / jnp.sqrt(jnp.where(inside, rise, 1.0))
    return join(x * scale, y * scale)


def square_to_disc(square: Float[Array, "*points 2"]) -> Float[Array, "*points 2"]:
    """Concentric map of [0, 1]^2 to the unit disc: Shirley and Chiu 1997, "A Low Distortion Map
    Between Disk and Square". A unit of the square's area is pi of the disc's.
    """
    a, b = 2.0 * square[..., 0] - 1.0, 2.0 * square[..., 1] - 1.0
    sideways = jnp.abs(a) > jnp.abs(b)
    radius, other = jnp.where(sideways, a, b), jnp.where(sideways, b, a)
    angle = 0.125 * other / jnp.where(radius == 0.0, 1.0, radius)
    sine, cosine = sine_cosine(angle)
    return join(
        radius * jnp.where(sideways, cosine, sine), radius * jnp.where(sideways, sine, cosine)
    )


def disc_to_square(disc: Float[Array, "*points 2"]) -> Float[Array, "*points 2"]:
    """The inverse of :func:`square_to_disc`, into [0, 1]^2."""
    x, y = disc[..., 0], disc[..., 1]
    sideways = jnp.abs(x) > jnp.abs(y)
    main, other = jnp.where(sideways, x, y), jnp.where(sideways, y, x)
    square = x * x + y * y
    occupied = square > 0.0
    radius = jnp.sqrt(jnp.where(occupied, square, 1.0)) * jnp.where(main < 0.0, -1.0, 1.0)
    radius = jnp.where(occupied, radius, 0.0)
    across = 8.0 * radius * turns(jnp.where(main < 0.0, -other, other), jnp.abs(main))
    a, b = jnp.where(sideways, radius, across), jnp.where(sideways, across, radius)
    return join(0.5 * (a + 1.0), 0.5 * (b + 1.0))
