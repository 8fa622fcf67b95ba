"""Limbs, trunk, head and shoes of a walking figure: grids of points bent to its joints (host)."""

from collections.abc import Sequence

import numpy as np
import scipy
from jaxtyping import Float, Float64

from jaxvis.scene.builtin.gait import BALL, Foot, Frame, Limb
from jaxvis.scene.builtin.mesh import unit
from jaxvis.scene.builtin.noise import smoothstep

Places = Float64[np.ndarray, "rows columns 2"]
GridPoints = Float64[np.ndarray, "rows columns 3"]


def ring_places(rows: int, columns: int) -> Places:
    """(around, along), both 0 to 1, rows denser at both ends, where rings shrink to points."""
    t = np.linspace(0.0, 1.0, rows + 1)
    along = t - 0.12 * np.sin(2.0 * np.pi * t) / (2.0 * np.pi)
    around = np.linspace(0.0, 1.0, columns + 1)
    return np.stack(np.broadcast_arrays(around[None, :], along[:, None]), axis=-1)


def profile(
    knots: Sequence[tuple[float, ...]], along: Float[np.ndarray, "rows"]
) -> Float64[np.ndarray, "rows values"]:
    """Smooth interpolation, without overshoot, of rows (along, value, ...)."""
    table = np.asarray(knots, np.float64)
    return scipy.interpolate.PchipInterpolator(table[:, 0], table[:, 1:], axis=0)(along)


def rounding(
    along: Float[np.ndarray, "rows"], first: float, last: float
) -> Float[np.ndarray, "rows"]:
    """Factor of a ring's size that closes both ends, like ellipses over these shares of all."""
    begin = np.clip(along / first, 0.0, 1.0)
    end = np.clip((1.0 - along) / last, 0.0, 1.0)
    return np.sqrt(begin * (2.0 - begin)) * np.sqrt(end * (2.0 - end))


def limb(
    places: Places,
    joints: Limb,
    before: float,
    beyond: float,
    knots: Sequence[tuple[float, ...]],
    ends: tuple[float, float],
) -> GridPoints:
    """A tube along two bones, bent softly at the hinge.

    Args:
        places: of its grid.
        before, beyond: how far it reaches over the first and the last joint.
        knots: (along, half width, half depth, offset forward) from end to end.
        ends: shares of the length that are round.
    """
    start, middle, stop = joints.joints
    first, second = np.linalg.norm(middle - start), np.linalg.norm(stop - middle)
    one, two = (middle - start) / first, (stop - middle) / second
    along = places[:, 0, 1]
    way = along * (before + first + second + beyond) - before - first
    # The bones' directions blend over this length around the hinge: a curve of even curvature.
    soft = 0.09
    t = np.clip(way / soft, -1.0, 1.0)
    share = np.where(np.abs(way) < soft, 0.25 * soft * np.square(1.0 + t), np.maximum(way, 0.0))
    centre = middle + (way - share)[:, None] * one + share[:, None] * two
    mix = (0.5 * (1.0 + t))[:, None]
    tangent = unit((1.0 - mix) * one + mix * two)
    forward = unit(np.cross(joints.hinge, tangent))
    # The hinge's axis is on one side, forward where the knee points.
    wide, deep, offset = np.moveaxis(profile(knots, along), -1, 0)
    size = rounding(along, *ends)
    angle = 2.0 * np.pi * np.mod(places[..., 0], 1.0)
    aside = (size * wide)[:, None] * np.cos(angle)
    front = (size * deep)[:, None] * np.sin(angle) + offset[:, None]
    return centre[:, None] + aside[..., None] * joints.hinge + front[..., None] * forward[:, None]


def trunk(
    places: Places, pelvis: Frame, chest: Frame, knots: Sequence[tuple[float, ...]]
) -> GridPoints:
    """Rings from the crotch to the neck, carried by the pelvis below and by the chest above.

    Args:
        knots: (along, height over the hips, half width, half depth, offset forward).
    """
    along = places[:, 0, 1]
    height, wide, deep, offset = np.moveaxis(profile(knots, along), -1, 0)
    local = _rings(places, height, wide, deep, offset, rounding(along, 0.08, 0.05), 2.5)
    rise = np.array([0.0, 0.513, 0.0])
    share = np.clip((height - 0.05) / 0.33, 0.0, 1.0)
    share = (share * share * (3.0 - 2.0 * share))[:, None, None]
    return (1.0 - share) * pelvis.place(local) + share * chest.place(local - rise)


def head(places: Places, neck: Frame, knots: Sequence[tuple[float, ...]]) -> GridPoints:
    """Neck and head with nose and chin; ``neck`` is the frame of the shoulders' height."""
    along = places[:, 0, 1]
    height, wide, deep, offset = np.moveaxis(profile(knots, along), -1, 0)
    local = _rings(places, height, wide, deep, offset, rounding(along, 0.05, 0.16), 2.1)
    x, y, z = np.moveaxis(local, -1, 0)
    front = np.clip(z / 0.05, 0.0, 1.0)
    nose = np.exp(-np.square(x / 0.012) - np.square((y - 0.205) / 0.020)) * front
    brow = np.exp(-np.square((np.abs(x) - 0.032) / 0.022) - np.square((y - 0.236) / 0.014)) * front
    eyes = np.exp(-np.square((np.abs(x) - 0.032) / 0.018) - np.square((y - 0.218) / 0.013)) * front
    z = z + 0.020 * nose + 0.005 * brow - 0.008 * eyes
    return neck.place(np.stack([x, y, z], axis=-1))


def _rings(
    places: Places,
    height: Float[np.ndarray, "rows"],
    wide: Float[np.ndarray, "rows"],
    deep: Float[np.ndarray, "rows"],
    offset: Float[np.ndarray, "rows"],
    size: Float[np.ndarray, "rows"],
    power: float,
) -> GridPoints:
    """Superellipses |x / wide|^p + |z / deep|^p = 1 at heights."""
    angle = 2.0 * np.pi * np.mod(places[..., 0], 1.0)
    cosine, sine = np.cos(angle), np.sin(angle)
    radius = (np.abs(cosine) ** power + np.abs(sine) ** power) ** (-1.0 / power)
    x = (size * wide)[:, None] * radius * cosine
    z = (size * deep)[:, None] * radius * sine + offset[:, None]
    return np.stack(np.broadcast_arrays(x, height[:, None], z), axis=-1)


def shoe(places: Places, foot: Foot) -> GridPoints:
    """A shoe on its sole; the rings go from heel to toe."""
    along = places[:, 0, 1]
    knots = (
        (0.0, 0.036, 0.058),
        (0.15, 0.040, 0.070),
        (0.40, 0.042, 0.060),
        (0.55, 0.043, 0.040),
        (0.75, 0.048, 0.030),
        (0.92, 0.042, 0.025),
        (1.0, 0.036, 0.022),
    )
    wide, high = np.moveaxis(profile(knots, along), -1, 0)
    size = rounding(along, 0.10, 0.14)
    angle = 2.0 * np.pi * np.mod(places[..., 0], 1.0)
    x = (size * wide)[:, None] * np.cos(angle)
    rise = np.sin(angle)
    # Soles are flat: the lower half of each ring is squeezed.
    y = (size * high)[:, None] * np.maximum(rise, 0.0)
    y = (
        y
        + 0.022
        + 0.018 * np.where(rise < 0.0, -np.sqrt(np.clip(-rise, 0.0, 1.0)), 0.0) * size[:, None]
    )
    z = -0.085 + 0.285 * along[:, None] + 0.0 * x
    # The toes stay on the ground while the heel rises.
    turn = foot.bend * smoothstep(BALL - 0.04, BALL + 0.04, z)
    cosine, sine = np.cos(turn), np.sin(turn)
    y, z = y * cosine + (z - BALL) * sine, BALL + (z - BALL) * cosine - y * sine
    return foot.frame.place(np.stack([x, y, z], axis=-1))
