"""Spherical polygons as arrays: sequences of directions, cyclic, the last joined to the first.

A polygon runs counter-clockwise about its region seen from outside the sphere. It may touch or
cross itself: every integral counts a direction as often as the polygon winds round it, so that
holes run clockwise and two loops may be joined by a bridge that is walked both ways. Repeated
directions are edges of length zero, which add nothing.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxvis.sphere.angles import turns
from jaxvis.sphere.ranges import shrinking

LEAST_SINE = 1e-7
"""No edge between float32 directions is shorter, but for those of no length."""


class Directions(NamedTuple):
    """Components of the directions of many polygons, kept apart: XLA vectorises over them."""

    x: Float[Array, "*points vectors"]
    y: Float[Array, "*points vectors"]
    z: Float[Array, "*points vectors"]


def seen_from(
    vectors: Float[Array, "*points 4 vectors"], position: Float[Array, "*points 3"]
) -> Directions:
    """q - w s, not normalised: the directions of homogeneous points (q, w) seen from s.

    Paper 000, eq. 3; with w = 0 a vector is a direction, the same from everywhere.
    """
    w = vectors[..., 3, :]
    return Directions(*(vectors[..., i, :] - w * position[..., i, None] for i in range(3)))


def along(directions: Directions, axis: Float[Array, "*points 3"]) -> Float[Array, "..."]:
    """Scalar products with one axis a polygon, [*points, vectors]."""
    x, y, z = (axis[..., i, None] for i in range(3))
    return directions.x * x + directions.y * y + directions.z * z


def normalized(directions: Directions) -> Directions:
    """Unit directions; vectors shorter than 1e-12, whose gradients overflow, become zero."""
    x, y, z = directions
    scale = shrinking(x, y, z)
    x, y, z = x * scale, y * scale, z * scale
    square = x * x + y * y + z * z
    some = square > 1e-24
    scale = jnp.where(some, 1.0, 0.0) / jnp.sqrt(jnp.where(some, square, 1.0))
    return Directions(x * scale, y * scale, z * scale)


def clamp_to_hemisphere(directions: Directions, normal: Float[Array, "*points 3"]) -> Directions:
    """The part of each polygon above the plane of ``normal``; lengths may change.

    Directions below the plane move up to it along great circles through the normal. That sweeps
    over no direction above the plane, so that how often the polygon winds round it stays the same,
    and edges between two moved directions run along the horizon. Only an edge that crosses the
    horizon changes: it meets it at its moved end instead, which adds or takes a triangle less high
    than the edge is long. The opposite of the normal itself becomes the zero vector.
    """
    below = jnp.minimum(along(directions, normal), 0.0)
    return Directions(*(directions[i] - below * normal[..., i, None] for i in range(3)))


def retract_to_cap(
    directions: Directions,
    axis: Float[Array, "*points 3"],
    cosine: Float[Array, "*points"],
) -> Directions:
    """The part of each polygon of unit directions inside the spherical circle about ``axis``.

    Directions outside move to the circle along great circles through the axis (see
    :func:`clamp_to_hemisphere`), and edges between them become its chords: subdivide first where
    edges are long for the circle. Only a polygon that winds round ``-axis`` would gain the whole
    circle; no visibility polygon does while the axis is above its horizon.

    Args:
        directions: unit.
        axis: unit, the circle's centre.
        cosine: of the circle's angular radius.
    """
    cosine = cosine[..., None]
    height = along(directions, axis)
    across = Directions(*(directions[i] - height * axis[..., i, None] for i in range(3)))
    # Not 1 - height^2, which is rounding alone next to the axis and its opposite.
    square = across.x * across.x + across.y * across.y + across.z * across.z
    scale = jnp.sqrt(jnp.maximum(1.0 - cosine * cosine, 1e-12) / jnp.maximum(square, 1e-12))
    outside = height < cosine
    return Directions(
        *(
            jnp.where(outside, cosine * axis[..., i, None] + scale * across[i], directions[i])
            for i in range(3)
        )
    )


def following(directions: Directions) -> Directions:
    """The next direction of each: the other ends of the edges."""
    return Directions(*(jnp.roll(axis, -1, axis=-1) for axis in directions))


def subdivide(directions: Directions, pieces: int) -> list[Directions]:
    """Each great-circle edge in ``pieces`` pieces: as many sets of directions, taken in turn.

    The first set are the given directions (unit), the k-th lies k / ``pieces`` along the edges, by
    chord: pieces are equally long to second order in the edge's length.
    """
    ends = following(directions)
    return [directions] + [
        normalized(
            Directions(
                *(
                    (1.0 - k / pieces) * a + (k / pieces) * b
                    for a, b in zip(directions, ends, strict=True)
                )
            )
        )
        for k in range(1, pieces)
    ]


def vector_irradiance(directions: Directions) -> Float[Array, "*points 3"]:
    """The integral of the direction over each polygon: its product with a normal is the irradiance
    from radiance 1, for polygons above that normal's horizon. Directions are unit.
    """
    shape = (*directions.x.shape[:-1], 3)
    axes = (jnp.broadcast_to(axis, shape) for axis in jnp.eye(3))
    return jnp.stack([uniform_irradiance(directions, axis) for axis in axes], axis=-1)


def uniform_irradiance(
    directions: Directions, normal: Float[Array, "*points 3"]
) -> Float[Array, "*points"]:
    """Irradiance from radiance 1 in polygons above the horizon; pi for the whole hemisphere.

    Lambert's formula: half the sum over the edges of their angle times the height of their plane's
    normal. Exact for great-circle edges; directions are unit. Edges below :data:`LEAST_SINE` count
    as so long where they are divided by.
    """
    a, b = directions, following(directions)
    cross = Directions(
        a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x
    )  # of length sin(angle)
    square = cross.x * cross.x + cross.y * cross.y + cross.z * cross.z
    # Not a case for zero: a compiler that computes the square twice, once with fused products,
    # takes both sides for an edge of no length.
    sine = jnp.sqrt(jnp.maximum(square, LEAST_SINE * LEAST_SINE))
    cosine = a.x * b.x + a.y * b.y + a.z * b.z
    angle = 2.0 * jnp.pi * turns(sine, cosine)
    return 0.5 * jnp.sum(along(cross, normal) * (angle / sine), axis=-1)
