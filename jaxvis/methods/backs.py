"""Whether points lie behind surfaces: they see mostly backs that are never shown (host)."""

import numpy as np
from jaxtyping import Bool, Float

from jaxvis.scene import Hits

LEAST_SHARE = 0.25
"""Of a point's directions that must meet backs."""


def behind_surfaces(
    rays: Float[np.ndarray, "points rays 3"],
    hits: Hits,
    normals: Float[np.ndarray, "triangles 3"],
    one_sided: Bool[np.ndarray, "triangles"],
) -> Bool[np.ndarray, "points"]:
    """Whether points see more backs of one-sided triangles than other surfaces, and not few.

    Such a vertex is on the wrong side of a surface that passes through its triangles. What it sees
    says nothing about the places of those triangles that a camera can see.

    Args:
        rays: directions from each point.
        hits: what they meet, one point's rays after another's.
        normals: of the triangles, on their front.
        one_sided: which triangles have a back that is never shown.
    """
    shape = rays.shape[:2]
    hit = (hits.triangle >= 0).reshape(shape)
    plane = normals.take(hits.triangle, axis=0).reshape(rays.shape)
    back = hit & (np.sum(plane * rays, axis=-1) > 0.0)
    back &= one_sided.take(hits.triangle).reshape(shape)
    backs, fronts = back.mean(axis=1), (hit & ~back).mean(axis=1)
    return (backs >= LEAST_SHARE) & (backs > fronts)
