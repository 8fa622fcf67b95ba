"""Samples that lie behind surfaces, as where one body stands in another (host)."""

import numpy as np
from jaxtyping import Bool, Float

from jaxvis.methods.backs import behind_surfaces
from jaxvis.methods.vectorized.hemisphere_map import Samples, look_around
from jaxvis.scene import RayTracer


def buried(
    tracer: RayTracer,
    samples: Samples,
    normals: Float[np.ndarray, "triangles 3"],
    one_sided: Bool[np.ndarray, "triangles"],
) -> Bool[np.ndarray, "samples"]:
    """Whether a sample sees mostly the backs of one-sided triangles (:func:`behind_surfaces`).

    Args:
        tracer: the scene, centred coordinates.
        samples: on the scene's vertices.
        normals: of the tracer's triangles, on their front.
        one_sided: which triangles have a back that is never shown.
    """
    found = [np.zeros(0, bool)]
    for _, rays, hits in look_around(tracer, samples):
        found.append(behind_surfaces(rays, hits, normals, one_sided))
    return np.concatenate(found)
