"""Samples that stand exactly in another surface, as on a floor at the foot of a wall (host)."""

import numpy as np
from jaxtyping import Bool, Float, Float32

from jaxvis.methods.vectorized.hemisphere_map import Samples, grid
from jaxvis.scene import RayTracer

CELLS = 10
"""Along each edge of the grid of directions: some 60 rays a sample."""

REACH = 4.0
"""How far away a surface is looked for, in units of the distance by which the rays' origin
leaves the sample; this and the next two."""

ON = 0.05
"""Height above a surface that is none."""

CLEAR = 0.5
"""Height to which the origin is moved."""

SAMPLES_AT_ONCE = 4096
"""Bounds the rays' memory to some 20 MB."""


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
    nodes = grid(CELLS)
    nodes = nodes[np.sum(nodes * nodes, axis=-1) < 1.0]
    parts = range(0, len(samples.origins), SAMPLES_AT_ONCE)
    found = [
        _cleared(tracer, samples.take(slice(i, i + SAMPLES_AT_ONCE)), normals, one_sided, nodes)
        for i in parts
    ]
    return np.concatenate([np.zeros((0, 3), np.float32), *found])


def _cleared(
    tracer: RayTracer,
    samples: Samples,
    normals: Float[np.ndarray, "triangles 3"],
    one_sided: Bool[np.ndarray, "triangles"],
    nodes: Float[np.ndarray, "nodes 2"],
) -> Float32[np.ndarray, "samples 3"]:
    count = len(samples.origins)
    owner = np.repeat(np.arange(count), len(nodes))
    rays = samples.directions(owner, np.tile(nodes, (count, 1)))
    step = np.linalg.norm(samples.origins.astype(np.float64) - samples.positions, axis=-1)
    triangle, _, distance = tracer.closest_hit(samples.origins.take(owner, axis=0), rays)
    plane = normals.take(triangle, axis=0).astype(np.float64)
    near = (triangle >= 0) & one_sided.take(triangle) & (distance < REACH * step[owner])
    height = -np.where(near, distance, 0.0) * np.sum(plane * rays, axis=-1)
    near &= height < ON * step[owner]
    height = np.where(near, height, np.inf).reshape(count, -1)
    touching = np.flatnonzero(np.isfinite(height).any(axis=1))
    shift = _shift(
        height[touching],
        plane.reshape(count, -1, 3)[touching],
        CLEAR * step[touching],
        samples.frames[touching, 2],
    )
    origins = samples.origins.copy()
    origins[touching] += shift.astype(np.float32)
    return origins


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
