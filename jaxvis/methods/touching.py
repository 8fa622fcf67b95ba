"""Points that stand exactly in another surface, as on a floor at the foot of a wall (host)."""

import numpy as np
from jaxtyping import Bool, Float, Float32

from jaxvis.scene import Hits

REACH = 4.0
"""How far away a surface is looked for, in units of the distance by which the rays' origin
leaves the point; this and the next two."""

ON = 0.05
"""Height above a surface that is none."""

CLEAR = 0.5
"""Height to which the origin is moved."""


def cleared_origins(
    positions: Float[np.ndarray, "points 3"],
    origins: Float32[np.ndarray, "points 3"],
    upright: Float[np.ndarray, "points 3"],
    rays: Float[np.ndarray, "points rays 3"],
    hits: Hits,
    normals: Float[np.ndarray, "triangles 3"],
    one_sided: Bool[np.ndarray, "triangles"],
) -> Float32[np.ndarray, "points 3"]:
    """Origins of rays, moved to the front of the one-sided surfaces in which they lie.

    Otherwise rounding would decide on which side of the surface they are. Nobody sees the points
    on its back.

    Args:
        positions: on the scene's surface.
        origins: beside it, where rays start.
        upright: unit normals of the points.
        rays: directions from each origin.
        hits: what they meet, one point's rays after another's.
        normals: of the triangles, on their front.
        one_sided: which triangles have a back that is never shown.
    """
    shape = rays.shape[:2]
    step = np.linalg.norm(origins.astype(np.float64) - positions, axis=-1)
    plane = normals.take(hits.triangle, axis=0).astype(np.float64).reshape(rays.shape)
    distance = hits.distance.reshape(shape)
    near = ((hits.triangle >= 0) & one_sided.take(hits.triangle)).reshape(shape)
    near &= distance < REACH * step[:, None]
    height = -np.where(near, distance, 0.0) * np.sum(plane * rays, axis=-1)
    near &= height < ON * step[:, None]
    touching = np.flatnonzero(near.any(axis=1))
    shift = _shift(
        np.where(near, height, np.inf)[touching],
        plane[touching],
        CLEAR * step[touching],
        upright[touching],
    )
    moved = origins.copy()
    moved[touching] += shift.astype(np.float32)
    return moved


def _shift(
    height: Float[np.ndarray, "points planes"],
    plane: Float[np.ndarray, "points planes 3"],
    least: Float[np.ndarray, "points"],
    normal: Float[np.ndarray, "points 3"],
) -> Float[np.ndarray, "points 3"]:
    """What moves points to the ``least`` height above all planes, but not below their own."""
    shift = np.zeros((len(height), 3))
    row = np.arange(len(height))
    for _ in range(4):
        above = height + np.einsum("spc,sc->sp", plane, shift)
        lowest = np.argmin(above, axis=1)
        lacking = np.maximum(least - above[row, lowest], 0.0)
        shift += lacking[:, None] * plane[row, lowest]
    sunk = np.minimum(np.sum(shift * normal, axis=-1, keepdims=True), 0.0)
    return shift - sunk * normal
