"""A cowboy hat of felt: its surface as a function of two parameters and of time (host)."""

from dataclasses import dataclass

import numpy as np
import scipy
from jaxtyping import Float, Float64

from jaxvis.scene.builtin.mesh import unit
from jaxvis.scene.builtin.noise import smoothstep

THICKNESS = 0.005
"""Of the felt, metres."""
RIM = 0.01
"""Half the share of the way from the top's outside to its inside that goes round the edge."""
BRIM_EDGE = 0.187
"""Half the hat's length, before the brim is curled."""

# Half length (front to back), half width and height of the middle surface, from the top of the
# crown to the edge of the brim: control points of a spline, which rounds shoulder and fillet.
_PROFILE = np.array(
    [
        (0.000, 0.000, 0.134),
        (0.030, 0.022, 0.134),
        (0.062, 0.046, 0.134),
        (0.085, 0.065, 0.133),
        (0.090, 0.070, 0.110),
        (0.095, 0.075, 0.060),
        (0.100, 0.080, 0.020),
        (0.102, 0.082, 0.000),
        (0.120, 0.100, -0.001),
        (0.150, 0.129, 0.000),
        (BRIM_EDGE, 0.165, 0.002),
    ]
)


@dataclass(frozen=True)
class Stance:
    """How a hat is bent: 0 everywhere is its ordinary shape."""

    curl: float = 0.0
    """Share by which the sides of the brim are bent up more than ordinarily."""
    dip: float = 0.0
    """Metres by which front (+) and back (-) of the brim dip further."""
    swell: float = 0.0
    """Share by which the crown is wider and taller."""


def middle_surface(
    along: Float[np.ndarray, "*points"], angle: Float[np.ndarray, "*points"], stance: Stance
) -> Float64[np.ndarray, "*points 3"]:
    """Points of the felt's middle; +z is the hat's front, y = 0 where the crown meets the brim.

    Args:
        along: 0 at the top's centre, 1 at the brim's edge, even in arc length.
        angle: about +Y, 0 at the right side (+x) and pi / 2 at the front.
    """
    length, width, height = np.moveaxis(_profile(along), -1, 0)
    x, y, z = width * np.cos(angle), height, length * np.sin(angle)
    x, y, z = _creased_crown(x, y, z, stance)
    return _bent_brim(x, y, z, along, stance)


def _profile(along: Float[np.ndarray, "*points"]) -> Float64[np.ndarray, "*points 3"]:
    degree, count = 3, len(_PROFILE)
    inner = np.linspace(0.0, 1.0, count - degree + 1)
    spline = scipy.interpolate.BSpline(
        np.r_[[0.0] * degree, inner, [1.0] * degree], _PROFILE, degree
    )
    fine = np.linspace(0.0, 1.0, 2001)
    steps = np.linalg.norm(np.diff(spline(fine), axis=0), axis=-1)
    arc = np.r_[0.0, np.cumsum(steps)]
    return spline(np.interp(along, arc / arc[-1], fine))


def _creased_crown(
    x: Float[np.ndarray, "*points"],
    y: Float[np.ndarray, "*points"],
    z: Float[np.ndarray, "*points"],
    stance: Stance,
) -> tuple[Float[np.ndarray, "*points"], ...]:
    """The cattleman's crease: a groove along the top, and a dent in the front of either side."""
    upper = smoothstep(0.01, 0.13, y)
    front = smoothstep(-0.03, 0.09, z)
    top = smoothstep(0.09, 0.13, y)
    groove = np.exp(-np.square(x / 0.027)) * (1.0 - smoothstep(0.045, 0.095, np.abs(z)))
    dent = np.exp(-np.square((y - 0.112) / 0.032) - np.square((z - 0.036) / 0.034))
    x = x * (1.0 - 0.24 * front * upper) - 0.010 * dent * np.tanh(x / 0.04)
    y = y - 0.032 * groove * top - 0.016 * front * upper - 0.006 * dent
    swell = stance.swell * upper
    return x * (1.0 + swell), y * (1.0 + swell), z * (1.0 + swell)


def _bent_brim(
    x: Float[np.ndarray, "*points"],
    y: Float[np.ndarray, "*points"],
    z: Float[np.ndarray, "*points"],
    along: Float[np.ndarray, "*points"],
    stance: Stance,
) -> Float64[np.ndarray, "*points 3"]:
    """Sides rolled up about axes along the hat, front and back turned down."""
    brim = smoothstep(0.02, 0.0, y)
    # A soft start of the bend keeps the curvature continuous: sqrt(t^2 + s^2) + t is 2 max(t, 0).
    start, soft = 0.094, 0.012
    t = np.abs(x) - start
    beyond = 0.5 * (t + np.sqrt(t * t + soft * soft)) * brim
    curvature = 15.0 * (1.0 + stance.curl)
    x = x - np.sign(x) * (beyond - np.sin(curvature * beyond) / curvature)
    y = y + (1.0 - np.cos(curvature * beyond)) / curvature
    out = np.square(np.maximum(np.abs(z) - 0.06, 0.0) / (BRIM_EDGE - 0.06))
    dip = np.where(z > 0.0, 0.034 + stance.dip, 0.022 - stance.dip)
    y = y - dip * out * brim * smoothstep(0.4, 1.0, along)
    return np.stack([x, y, z], axis=-1)


def hat_grid(rows: int, columns: int) -> Float64[np.ndarray, "rows meridians 2"]:
    """Texture coordinates of a hat's grid: around (0 to 1), and down the outside, over the brim's
    edge and up the inside (0 to 1, the edge at 1/2). The last column is the first again.

    They stay half a texel of 512 away from 0 and 1 in the second, where textures repeat.
    """
    outside = np.linspace(0.0, 0.5 - RIM, rows // 2)
    rim = np.linspace(0.5 - RIM, 0.5 + RIM, 5)[1:-1]
    down = (0.5 + 511.0 * np.r_[outside, rim, 1.0 - outside[::-1]]) / 512.0
    around = np.linspace(0.0, 1.0, columns + 1)
    return np.stack(np.broadcast_arrays(around[None, :], down[:, None]), axis=-1)


def hat_points(
    places: Float64[np.ndarray, "*points 2"], stance: Stance
) -> Float64[np.ndarray, "*points 3"]:
    """The felt's surface at texture coordinates as :func:`hat_grid` gives them.

    Both sides of the middle surface, half the thickness away, with a round edge in between.
    """
    down = np.clip((places[..., 1] * 512.0 - 0.5) / 511.0, 0.0, 1.0)
    angle = 2.0 * np.pi * np.mod(places[..., 0], 1.0)
    turn = np.clip((down - 0.5) / RIM, -1.0, 1.0) * (0.5 * np.pi)
    along = 1.0 - np.clip((np.abs(down - 0.5) - RIM) / (0.5 - RIM), 0.0, 1.0)
    step = 1e-4
    # Slopes from a little inside, where the surface is defined; at the centre from around it.
    inner = np.clip(along, 4.0 * step, 1.0 - step)
    outward = middle_surface(inner + step, angle, stance) - middle_surface(
        inner - step, angle, stance
    )
    aside = middle_surface(inner, angle + step, stance) - middle_surface(
        inner, angle - step, stance
    )
    normal, outward = unit(np.cross(aside, outward)), unit(outward)
    normal = np.where(along[..., None] < 4.0 * step, [0.0, 1.0, 0.0], normal)
    upper = -np.sin(turn)[..., None] * normal + np.cos(turn)[..., None] * outward
    return middle_surface(along, angle, stance) + 0.5 * THICKNESS * upper
