"""Samples that stand exactly in another surface, as on a floor at the foot of a wall (host)."""

import numpy as np
from jaxtyping import Bool, Float, Float32

from jaxvis.methods.touching import cleared_origins
from jaxvis.methods.vectorized.hemisphere_map import Samples, look_around
from jaxvis.scene import RayTracer


def clear_of_surfaces(
    tracer: RayTracer,
    samples: Samples,
    normals: Float[np.ndarray, "triangles 3"],
    one_sided: Bool[np.ndarray, "triangles"],
) -> Float32[np.ndarray, "samples 3"]:
    """Origins of rays, moved off the surfaces in which they lie (:func:`cleared_origins`).

    Args:
        tracer: the scene, centred coordinates.
        samples: on the scene's surface, which their origins have left already.
        normals: of the tracer's triangles, on their front.
        one_sided: which triangles have a back that is never shown.
    """
    found = [np.zeros((0, 3), np.float32)]
    for part, rays, hits in look_around(tracer, samples):
        upright = part.frames[:, 2]
        found.append(
            cleared_origins(part.positions, part.origins, upright, rays, hits, normals, one_sided)
        )
    return np.concatenate(found)
