"""Samples that lie behind surfaces, as where one body stands in another (host)."""

import numpy as np
from jaxtyping import Bool, Float

from jaxvis.methods.vectorized.hemisphere_map import Samples, grid
from jaxvis.scene import RayTracer

CELLS = 10
"""Along each edge of the grid of directions: some 60 rays a sample."""

LEAST_SHARE = 0.25
"""Of a sample's directions that must meet backs."""

SAMPLES_AT_ONCE = 4096
"""Bounds the rays' memory to some 20 MB."""


def buried(
    tracer: RayTracer,
    samples: Samples,
    normals: Float[np.ndarray, "triangles 3"],
    one_sided: Bool[np.ndarray, "triangles"],
) -> Bool[np.ndarray, "samples"]:
    """Whether a sample sees mostly the backs of one-sided triangles.

    Such a vertex is on the wrong side of a surface that passes through its triangles. What it sees
    says nothing about the places of those triangles that a camera can see.

    Args:
        tracer: the scene, centred coordinates.
        samples: on the scene's vertices.
        normals: of the tracer's triangles, on their front.
        one_sided: which triangles have a back that is never shown.
    """
    nodes = grid(CELLS)
    nodes = nodes[np.sum(nodes * nodes, axis=-1) < 1.0]
    parts = range(0, len(samples.origins), SAMPLES_AT_ONCE)
    found = [
        _buried(tracer, samples.take(slice(i, i + SAMPLES_AT_ONCE)), normals, one_sided, nodes)
        for i in parts
    ]
    return np.concatenate([np.zeros(0, bool), *found])


def _buried(
    tracer: RayTracer,
    samples: Samples,
    normals: Float[np.ndarray, "triangles 3"],
    one_sided: Bool[np.ndarray, "triangles"],
    nodes: Float[np.ndarray, "nodes 2"],
) -> Bool[np.ndarray, "samples"]:
    count = len(samples.origins)
    owner = np.repeat(np.arange(count), len(nodes))
    rays = samples.directions(owner, np.tile(nodes, (count, 1)))
    triangle = tracer.closest_hit(samples.origins.take(owner, axis=0), rays).triangle
    hit = triangle >= 0
    away = np.sum(normals.take(triangle, axis=0) * rays, axis=-1) > 0.0
    back = hit & away & one_sided.take(triangle)
    backs = back.reshape(count, -1).mean(axis=1)
    fronts = (hit & ~back).reshape(count, -1).mean(axis=1)
    return (backs >= LEAST_SHARE) & (backs > fronts)
