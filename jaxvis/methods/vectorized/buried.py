"""Samples that lie behind surfaces, as where one body stands in another (host)."""

import numpy as np
from jaxtyping import Bool, Float

from jaxvis.methods.vectorized.hemisphere_map import Samples, look_around
from jaxvis.scene import RayTracer

LEAST_SHARE = 0.25
"""Of a sample's directions that must meet backs."""


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
    found = [np.zeros(0, bool)]
    for _, rays, hits in look_around(tracer, samples):
        shape = rays.shape[:2]
        hit = (hits.triangle >= 0).reshape(shape)
        plane = normals.take(hits.triangle, axis=0).reshape(rays.shape)
        back = hit & (np.sum(plane * rays, axis=-1) > 0.0)
        back &= one_sided.take(hits.triangle).reshape(shape)
        backs, fronts = back.mean(axis=1), (hit & ~back).mean(axis=1)
        found.append((backs >= LEAST_SHARE) & (backs > fronts))
    return np.concatenate(found)
