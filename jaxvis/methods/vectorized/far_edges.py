"""Silhouettes of surfaces that a sample sees edge-on, as those around its own vertex (host).

A ray that grazes a surface meets it at an arbitrary distance. From a shading point beside the
sample the surface is no longer edge-on, and its silhouette is where it ends.
"""

import numpy as np
from jaxtyping import Bool, Float, Float64, Int

from jaxvis.methods.vectorized.hemisphere_map import Samples
from jaxvis.scene import Hits, RayTracer
from jaxvis.scene.rays import OFFSET_SCALE

GRAZING = 2e-3
"""Sine of the angle below which a ray runs along the triangle that it hits."""

INTERVAL = 4e-4
"""Radians within which the rays follow the boundary."""

HOPS = 8
"""Triangles one behind the other that a ray is followed along."""


def far_edges(
    tracer: RayTracer,
    samples: Samples,
    owner: Int[np.ndarray, "rays"],
    hits: Hits,
    corners: Float[np.ndarray, "triangles 3 3"],
    free: Float[np.ndarray, "rays 3"],
    reach: Float[np.ndarray, "rays 3"],
) -> Float64[np.ndarray, "rays 3"]:
    """Moves points that rays met on surfaces edge-on to where these surfaces end.

    Three cases. A triangle at the sample's own vertex that falls off from the tangent plane: a ray
    from beside the vertex may meet it steeply, but it only bounds sight; the point goes to the side
    opposite the vertex. Such a triangle that rises: the same, if the ray runs along it. Any other
    surface: while the ray runs along it, on to the next triangle.

    Args:
        tracer: the scene, centred coordinates.
        samples: whose rays they are.
        owner: sample of each ray.
        hits: what the last blocked ray met.
        corners: of the tracer's triangles.
        free: unit directions of the rays that just clear all surfaces.
        reach: from the sample to the point met, along the boundary.
    """
    reach = reach.astype(np.float64)
    met = np.flatnonzero(hits.triangle >= 0)
    length = np.linalg.norm(reach[met], axis=-1)
    met, length = met[length > 0.0], length[length > 0.0]
    along = free[met].astype(np.float64)
    triangle, sample = hits.triangle[met], owner[met]
    own, first, second = _sides(samples.positions[sample], corners.take(triangle, axis=0))
    far, sine = _opposite(first, second, along)
    height = np.sum((first + second) * samples.frames[sample, 2], axis=-1)
    falls = own & (height <= 0.0)
    side = np.where(own & (sine < GRAZING), np.linalg.norm(far, axis=-1), 0.0)
    end = _follow(
        tracer, samples.origins[sample], along, triangle, corners, np.maximum(length, side), ~falls
    )
    reach[met] = np.where(falls[:, None], far, (end / length)[:, None] * reach[met])
    return reach


def _follow(
    tracer: RayTracer,
    origins: Float[np.ndarray, "rays 3"],
    along: Float[np.ndarray, "rays 3"],
    triangle: Int[np.ndarray, "rays"],
    corners: Float[np.ndarray, "triangles 3 3"],
    length: Float[np.ndarray, "rays"],
    chosen: Bool[np.ndarray, "rays"],
) -> Float[np.ndarray, "rays"]:
    """Distances at which the chosen rays leave the surfaces that they run along.

    From where it leaves a triangle a ray goes on, tilted towards the surface by as much as counts
    as grazing, as long as it meets another triangle at once.
    """
    length = length.copy()
    clearance = 4.0 * OFFSET_SCALE * np.abs(origins).max(axis=-1, initial=0.0)
    rays = np.flatnonzero(chosen)
    triangle = triangle[rays]
    for _ in range(HOPS):
        place = origins[rays] + length[rays, None] * along[rays]
        normal, leave = _leave(corners.take(triangle, axis=0), place, along[rays])
        sine = np.sum(normal * along[rays], axis=-1)
        grazing = (np.abs(sine) < GRAZING) & np.isfinite(leave)
        rays, normal, leave, sine = rays[grazing], normal[grazing], leave[grazing], sine[grazing]
        if not len(rays):
            break
        length[rays] += leave
        downwards = np.where(sine > 0.0, 1.0, -1.0)[:, None] * normal
        start = origins[rays] + length[rays, None] * along[rays]
        onward = tracer.closest_hit(start, along[rays] + GRAZING * downwards)
        height = clearance[rays] + INTERVAL * length[rays]
        near = (onward.triangle >= 0) & (GRAZING * onward.distance < 4.0 * height)
        rays, triangle = rays[near], onward.triangle[near]
        length[rays] += onward.distance[near]
    return length


def _sides(
    positions: Float[np.ndarray, "rays 3"], corners: Float[np.ndarray, "rays 3 3"]
) -> tuple[Bool[np.ndarray, "rays"], Float64[np.ndarray, "rays 3"], Float64[np.ndarray, "rays 3"]]:
    """Whether each triangle has a corner in the position, and its two sides from there."""
    same = np.all(corners == positions[:, None], axis=-1)
    corner, ray = same.argmax(axis=1), np.arange(len(positions))
    exact = corners.astype(np.float64)
    here = exact[ray, corner]
    first = exact[ray, (corner + 1) % 3] - here
    return same.any(axis=1), first, exact[ray, (corner + 2) % 3] - here


def _opposite(
    first: Float[np.ndarray, "rays 3"],
    second: Float[np.ndarray, "rays 3"],
    along: Float[np.ndarray, "rays 3"],
) -> tuple[Float64[np.ndarray, "rays 3"], Float64[np.ndarray, "rays"]]:
    """From a triangle's corner along a direction projected into it to the opposite side, and the
    sine of the angle between direction and triangle. Directions beside it go along its sides.
    """
    normal = np.cross(first, second)
    square = _positive(np.sum(normal * normal, axis=-1))
    a = np.maximum(np.sum(np.cross(along, second) * normal, axis=-1), 0.0)
    b = np.maximum(np.sum(np.cross(first, along) * normal, axis=-1), 0.0)
    behind = a + b <= 0.0
    total = _positive(a + b)
    a, b = np.where(behind, 0.5, a / total), np.where(behind, 0.5, b / total)
    sine = np.abs(np.sum(normal * along, axis=-1)) / np.sqrt(square)
    return a[:, None] * first + b[:, None] * second, sine


def _leave(
    corners: Float[np.ndarray, "rays 3 3"],
    places: Float[np.ndarray, "rays 3"],
    along: Float[np.ndarray, "rays 3"],
) -> tuple[Float64[np.ndarray, "rays 3"], Float64[np.ndarray, "rays"]]:
    """Unit normals of triangles, and how far it is along rays in them to their edges."""
    a, b, c = np.moveaxis(corners.astype(np.float64), 1, 0)
    first, second = b - a, c - a
    normal = np.cross(first, second)
    square = _positive(np.sum(normal * normal, axis=-1))

    def shares(vector: Float[np.ndarray, "rays 3"]) -> Float64[np.ndarray, "rays 2"]:
        at_b = np.sum(np.cross(vector, second) * normal, axis=-1)
        at_c = np.sum(np.cross(first, vector) * normal, axis=-1)
        return np.stack([at_b, at_c], axis=-1) / square[:, None]

    here, rates = shares(places - a), shares(along)
    here = np.concatenate([1.0 - here.sum(axis=1, keepdims=True), here], axis=1)
    rates = np.concatenate([-rates.sum(axis=1, keepdims=True), rates], axis=1)
    falling = rates < 0.0
    ends = np.where(falling, -here / np.where(falling, rates, -1.0), np.inf)
    return normal / np.sqrt(square)[:, None], np.maximum(ends.min(axis=-1, initial=np.inf), 0.0)


def _positive(values: Float[np.ndarray, "rays"]) -> Float[np.ndarray, "rays"]:
    """The values, ones in place of zeros: to divide by."""
    return np.where(values > 0.0, values, 1.0)
