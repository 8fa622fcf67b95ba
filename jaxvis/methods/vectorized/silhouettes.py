"""Position vectors: the points on the occluders where sight becomes free (host)."""

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from jaxvis.methods.vectorized.contours import Contours
from jaxvis.methods.vectorized.far_edges import far_edges
from jaxvis.methods.vectorized.hemisphere_map import Samples, grid
from jaxvis.scene import RayTracer


def position_vectors(
    tracer: RayTracer,
    samples: Samples,
    contours: Contours,
    resolution: int,
    *,
    steps: int = 8,
    corners: Float[np.ndarray, "triangles 3 3"] | None = None,
) -> tuple[Float32[np.ndarray, "points 4"], Float32[np.ndarray, "points 3"]]:
    """Where the boundary crosses each contour point's grid edge.

    ``steps`` bisections between the free and the blocked node, all points in one batch a step. A
    boundary on an occluder becomes a point at the distance where the last blocked ray meets it
    (w = 1); one at the rim of the domain becomes its direction (w = 0).

    Args:
        tracer: the scene, centred coordinates.
        samples: whose contours they are.
        contours: of maps with ``resolution`` cells along each edge.
        resolution: of the maps.
        steps: each halves what is left of the grid's spacing.
        corners: of the tracer's triangles. Given them, the points of surfaces that rays run along,
            as the sample's own neighbours, move to their far edges (:func:`far_edges`).

    Returns:
        (homogeneous position vectors, local unit directions from the sample)
    """
    sample = contours.sample
    nodes = grid(resolution)
    free, blocked = nodes.take(contours.free, axis=0), nodes.take(contours.blocked, axis=0)
    at_rim, blocked = _rim(tracer, samples, sample, free, blocked)
    hidden = np.flatnonzero(~at_rim)
    owner = sample.take(hidden)
    low, high = _bisect(tracer, samples, owner, free[hidden], blocked[hidden], steps)
    local = samples.local(sample, blocked)
    local[hidden] = samples.local(owner, 0.5 * (low + high))
    _level(samples, sample, local, at_rim)
    world = samples.to_world(sample, local)

    origins = samples.origins.take(owner, axis=0)
    hits = tracer.closest_hit(origins, samples.directions(owner, high))
    met = np.isfinite(hits.distance)
    # From the vertex, not from the origin beside it: there the directions must be right.
    steps_out = np.where(met, hits.distance, 0.0)[:, None] * world[hidden]
    if corners is not None:
        clear = samples.directions(owner, low)
        steps_out = far_edges(tracer, samples, owner, hits, corners, clear, steps_out)
    vectors = np.concatenate([world, np.zeros_like(world[:, :1])], axis=1)
    solid = hidden[met]
    vectors[solid, :3] = (samples.positions.take(owner, axis=0) + steps_out)[met]
    vectors[solid, 3] = 1.0
    return vectors, local


def _rim(
    tracer: RayTracer,
    samples: Samples,
    sample: Int[np.ndarray, "points"],
    free: Float[np.ndarray, "points 2"],
    blocked: Float[np.ndarray, "points 2"],
) -> tuple[Bool[np.ndarray, "points"], Float[np.ndarray, "points 2"]]:
    """Whether sight is free up to the rim; blocked ends beyond the rim are moved onto it."""
    beyond = np.flatnonzero(np.sum(blocked * blocked, axis=-1) >= 1.0)
    start = free.take(beyond, axis=0)
    step = blocked.take(beyond, axis=0) - start
    a = np.sum(step * step, axis=-1)
    b = np.sum(start * step, axis=-1)
    c = np.sum(start * start, axis=-1) - 1.0
    root = (-b + np.sqrt(np.maximum(b * b - a * c, 0.0))) / a
    rim = start + np.clip(root, 0.0, 1.0)[:, None] * step
    owner = sample.take(beyond)
    stopped = tracer.occluded(samples.origins.take(owner, axis=0), samples.directions(owner, rim))
    at_rim = np.zeros(len(sample), bool)
    at_rim[beyond] = ~stopped
    blocked = blocked.copy()
    blocked[beyond] = rim
    return at_rim, blocked


def _bisect(
    tracer: RayTracer,
    samples: Samples,
    owner: Int[np.ndarray, "points"],
    low: Float[np.ndarray, "points 2"],
    high: Float[np.ndarray, "points 2"],
    steps: int,
) -> tuple[Float[np.ndarray, "points 2"], Float[np.ndarray, "points 2"]]:
    """Free and blocked ends of the interval in the chart that holds the boundary."""
    origins = samples.origins.take(owner, axis=0)
    for _ in range(steps):
        middle = 0.5 * (low + high)
        stopped = tracer.occluded(origins, samples.directions(owner, middle))[:, None]
        low, high = np.where(stopped, low, middle), np.where(stopped, middle, high)
    return low, high


def _level(
    samples: Samples,
    sample: Int[np.ndarray, "points"],
    local: Float32[np.ndarray, "points 3"],
    at_rim: Bool[np.ndarray, "points"],
) -> None:
    """Puts the points of the rim exactly there, in place: great circles must stay great circles."""
    dips = samples.dips.take(sample[at_rim]).astype(np.float64)
    flat = local[at_rim, :2].astype(np.float64)
    flat *= (np.sqrt(1.0 - dips * dips) / np.hypot(*flat.T))[:, None]
    local[at_rim] = np.concatenate([flat, -dips[:, None]], axis=-1)
