"""How badly polygons at samples interpolate what places between them see (host)."""

import jax
import numpy as np
from jaxtyping import Array, Float, Float32, Int

from jaxvis.methods.vectorized.plan import renormalised
from jaxvis.methods.vectorized.refine.samples import Traced
from jaxvis.sphere.polygons import (
    clamp_to_hemisphere,
    normalized,
    seen_from,
    vector_irradiance,
)

VECTORS_PER_CHUNK = 1 << 17
"""Bounds memory."""


def interpolation_errors(
    table: Traced,
    corners: Int[np.ndarray, "probes corners"],
    own: Traced,
    planes: Float[np.ndarray, "probes 3"],
) -> Float32[np.ndarray, "probes"]:
    """Error of a uniform sky's irradiance at probes midway between samples, by pi.

    It is that of the vector irradiance, the integral of the direction over the sky that is seen:
    the largest error for any normal nearby, of which there is more under a sky that is not uniform.
    Buried corners do not count where others do (as in shading), and probes that are buried have no
    error: nobody sees them.

    Args:
        table: samples.
        corners: those between which each probe lies, with equal weights (paper 000, eq. 19).
        own: the probes as samples.
        planes: unit normals of triangles in which they lie, below which nothing is seen.
    """
    weights = np.full(corners.shape, 1.0 / corners.shape[1], np.float32)
    weights = renormalised(weights, ~table.buried[corners])
    place = own.positions, own.normals, planes
    difference = -sky_vectors(own.vectors, np.arange(len(corners)), *place)
    for corner, weight in zip(corners.T, weights.T, strict=True):
        difference += weight[:, None] * sky_vectors(table.vectors, corner, *place)
    error = np.linalg.norm(difference, axis=-1) / np.pi
    return np.where(own.buried, 0.0, error).astype(np.float32)


def sky_vectors(
    vectors: Float32[np.ndarray, "samples 4 capacity"],
    polygon: Int[np.ndarray, "references"],
    positions: Float[np.ndarray, "references 3"],
    normals: Float[np.ndarray, "references 3"],
    planes: Float[np.ndarray, "references 3"],
) -> Float32[np.ndarray, "references 3"]:
    """Integral of the direction over what a place sees of a polygon above two planes."""
    chunk = max(1, VECTORS_PER_CHUNK // vectors.shape[-1])
    found = np.empty((len(polygon), 3), np.float32)
    for start in range(0, len(polygon), chunk):
        # Every chunk has one shape: XLA compiles once.
        rows = np.minimum(np.arange(start, start + chunk), len(polygon) - 1)
        parts = _sky_vectors(
            vectors.take(polygon[rows], axis=0),
            positions[rows].astype(np.float32),
            normals[rows].astype(np.float32),
            planes[rows].astype(np.float32),
        )
        found[start : start + chunk] = np.asarray(parts)[: len(polygon) - start]
    return found


@jax.jit
def _sky_vectors(
    vectors: Float[Array, "chunk 4 capacity"],
    position: Float[Array, "chunk 3"],
    normal: Float[Array, "chunk 3"],
    plane: Float[Array, "chunk 3"],
) -> Float[Array, "chunk 3"]:
    above = clamp_to_hemisphere(seen_from(vectors, position), plane)
    return vector_irradiance(normalized(clamp_to_hemisphere(above, normal)))
