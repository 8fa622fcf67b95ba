"""Specular light through visibility polygons (paper 000, eqs. 14 to 16).

The light that a lobe receives is what it would receive without occluders, times a ratio gamma: the
visible part of the light under a Cap kernel about the mirror direction r (eq. 15). Cap is linear in
the direction, so that the tables of light and of light x direction integrate it over the polygon
inside the circle W, where it is positive.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxvis.methods.vectorized.light import PolygonLight
from jaxvis.sphere.contours import Lookup, Lookups, trapezoid
from jaxvis.sphere.frames import frame
from jaxvis.sphere.polygons import Directions, retract_to_cap, subdivide

CIRCLE_VECTORS = 32
"""Of the polygon that stands for W."""
NEGLIGIBLE = 1e-8
"""Denominators of gamma below this part of the light's mean count as zero."""

_SHARPEST_CAP = 100.0  # a + 2 up to which the kernel is the paper's


class Cap(NamedTuple):
    """The kernel max(l.r - base, 0) inside the circle l.r > rim, 0 outside; base <= rim."""

    rim: Float[Array, "*points"]
    base: Float[Array, "*points"]


def phong_cap(exponent: Float[Array, "*points"]) -> Cap:
    """The Cap kernel (eq. 16, its inequality put right) whose mean 1 - cos is a Phong lobe's.

    The paper leaves the radius xi of W open. The means are (1 - cos xi) / 3 for Cap and
    m = 1 / (a + 2) for Phong: cos xi = 1 - 3 / (a + 2), at most a hemisphere.

    Cap's integral over a small circle is a small difference of what the tables hold: in float32
    rounding makes nonsense of it for a > 300. So from a = 98 on the kernel falls from its height h
    at the centre to (1 - t) h at the circle instead of 0, with t = (100 m)^2, and h is 2e-4 / m or
    more: a frustum that tends to a constant. The radius keeps the mean:
    1 - cos xi = m (1 - t / 2) / (1 / 2 - t / 3), which is 3 m for t = 1.
    """
    mean = 1.0 / (exponent + 2.0)
    fall = jnp.minimum(jnp.square(_SHARPEST_CAP * mean), 1.0)
    radius = jnp.minimum(mean * (1.0 - 0.5 * fall) / (0.5 - fall / 3.0), 1.0)
    return Cap(1.0 - radius, 1.0 - radius / fall)


def parts_in_cap(
    directions: Directions,
    mirror: Float[Array, "points 3"],
    rim: Float[Array, "points"],
    pieces: int,
) -> list[Directions]:
    """The part of each polygon inside the circle about ``mirror``, as sets to be taken in turn.

    Edges are divided before they are moved to the circle, which they then follow more closely.

    Args:
        directions: unit, above the horizon.
        mirror: unit, above the horizon.
        rim: cosine of the circle's radius.
        pieces: of each edge, for the trapezoidal rule.
    """
    return [retract_to_cap(part, mirror, rim) for part in subdivide(directions, pieces)]


def circle_lookups(
    height: int, mirror: Float[Array, "points 3"], rim: Float[Array, "points"], lookup: Lookup
) -> Lookups:
    """Lookups of the whole circle W, as a polygon of :data:`CIRCLE_VECTORS` vectors."""
    tangent, bitangent = frame(mirror)
    angle = 2.0 * np.pi * (np.arange(CIRCLE_VECTORS) + 0.5) / CIRCLE_VECTORS
    radius = jnp.sqrt(jnp.maximum(1.0 - rim * rim, 0.0))[:, None]
    across, up = radius * np.float32(np.cos(angle)), radius * np.float32(np.sin(angle))
    circle = Directions(
        *(
            rim[:, None] * mirror[:, i, None]
            + across * tangent[:, i, None]
            + up * bitangent[:, i, None]
            for i in range(3)
        )
    )
    return trapezoid(height, [circle], lookup)


def cap_integral(
    vector: Float[Array, "points 9"],
    scalar: Float[Array, "points 3"],
    mirror: Float[Array, "points 3"],
    base: Float[Array, "points"],
) -> Float[Array, "points 3"]:
    """The Cap-weighted light of a region inside the circle: r . int l L - base int L, at least 0.

    Args:
        vector: the region's integral in ``PolygonLight.vector``.
        scalar: that in ``PolygonLight.scalar``.
        mirror: r.
        base: of the :class:`Cap`.
    """
    x, y, z = (mirror[:, i, None] * vector[:, 3 * i : 3 * i + 3] for i in range(3))
    return jnp.maximum(x + y + z - base[:, None] * scalar, 0.0)


def visible_ratio(
    visible: Float[Array, "points 3"],
    whole: Float[Array, "points 3"],
    light: PolygonLight,
) -> Float[Array, "points 3"]:
    """gamma (eq. 15) in [0, 1]; 1 where the circle holds no light.

    Args:
        visible: the polygon's :func:`cap_integral`, or the interpolated ones of three.
        whole: the circle's.
        light: whose mean tells what is negligible.
    """
    some = whole > NEGLIGIBLE * light.scalar.total
    return jnp.where(some, jnp.clip(visible / jnp.where(some, whole, 1.0), 0.0, 1.0), 1.0)
