"""Samples that stand exactly in another surface, as on a floor at the foot of a wall (host)."""

import numpy as np
from jaxtyping import Bool, Float, Float32

from jaxvis.methods.vectorized.hemisphere_map import Samples, look_around
from jaxvis.scene import RayTracer

REACH = 4.0
"""How far away a surface is looked for, in units of the distance by which the rays' origin
leaves the sample; this and the next two."""

ON = 0.05
"""Height above a surface that is none."""

CLEAR = 0.5
"""Height to which the origin is moved."""


def clear_of_surfaces(
    tracer: RayTracer,
    samples: Samples,
    normals: Float[np.ndarray, "triangles 3"],
    one_sided: Bool[np.ndarray, "triangles"],
) -> Float32[np.ndarray, "samples 3"]:
    """Origins of rays, moved to the front of the one-sided surfaces in which they lie.

    Otherwise rounding would decide on which side of the surface they are. Nobody sees the samples
    on its back.

    Args:
        tracer: the scene, centred coordinates.
        samples: on the scene's surface, which their origins have left already.
        normals: of the tracer's triangles, on their front.
        one_sided: which triangles have a back that is never shown.
    """
    found = [np.zeros((0, 3), np.float32)]
    for part, rays, hits in look_around(tracer, samples):
        shape = rays.shape[:2]
        step = np.linalg.norm(part.origins.astype(np.float64) - part.positions, axis=-1)
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
            part.frames[touching, 2],
        )
        origins = part.origins.copy()
        origins[touching] += shift.astype(np.float32)
        found.append(origins)
    return np.concatenate(found)


def _shift(
    height: Float[np.ndarray, "samples planes"],
    plane: Float[np.ndarray, "samples planes 3"],
    least: Float[np.ndarray, "samples"],
    normal: Float[np.ndarray, "samples 3"],
) -> Float[np.ndarray, "samples 3"]:
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
