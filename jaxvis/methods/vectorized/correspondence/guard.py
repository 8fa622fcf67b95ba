"""Where interpolated polygons would be wrong: a comparison with rays at places in the faces.

Between corners that see different bodies, one polygon between theirs may be worse than the mean of
three integrals. Rays tell which is nearer to the truth.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32, Int, Int32

from jaxvis.methods.vectorized.correspondence.interpolated import (
    Interpolation,
    Outlines,
    TripleLists,
)
from jaxvis.methods.vectorized.correspondence.triples import CorrespondingPolygons
from jaxvis.methods.vectorized.evaluation import References
from jaxvis.methods.vectorized.hemisphere_map import Samples
from jaxvis.methods.vectorized.irradiance import outlines
from jaxvis.methods.vectorized.mesh import Mesh, places_in_faces
from jaxvis.methods.vectorized.plan import without_buried
from jaxvis.scene import RayTracer
from jaxvis.scene.rays import offset_origins
from jaxvis.sphere.polygons import Directions, normalized, vector_irradiance

RAYS = 32
"""Along each edge of the grid of directions: 1024 rays know an irradiance to about 1 %."""

PLACES = np.array([[4, 4, 4], [8, 2, 2], [2, 8, 2], [2, 2, 8]], np.float32) / 12.0
"""Barycentrics where the two are compared."""

FACES_AT_ONCE = 256


def excess_error(
    corresponding: CorrespondingPolygons,
    tracer: RayTracer,
    interpolation: Interpolation,
    faces: Int[np.ndarray, "chosen"],
) -> Float32[np.ndarray, "faces"]:
    """By how much eq. 21 is further from the truth than eq. 19, at the worst of a few places.

    Of a uniform sky's vector irradiance, relative to pi; negative where eq. 21 is nearer, 0 for
    faces that are not among the chosen. These must have triples.
    """
    faces = np.asarray(faces, np.int32)
    excess = np.full((len(PLACES), len(corresponding.separate)), 0.0, np.float32)
    for start in range(0, len(faces), FACES_AT_ONCE):
        # The last batch is as long as the others: XLA compiles once.
        rows = np.minimum(np.arange(start, start + FACES_AT_ONCE), len(faces) - 1)
        for excess_here, barycentrics in zip(excess, PLACES, strict=True):
            excess_here[faces[rows]] = _excess(
                corresponding, tracer, interpolation, faces[rows], barycentrics
            )
    return excess.max(axis=0)


def _excess(
    corresponding: CorrespondingPolygons,
    tracer: RayTracer,
    interpolation: Interpolation,
    faces: Int32[np.ndarray, "faces"],
    barycentrics: Float32[np.ndarray, "3"],
) -> Float32[np.ndarray, "faces"]:
    """The same at one place of some faces."""
    polygons, lists = corresponding.polygons, Outlines.of(corresponding)
    corners = Mesh.of(polygons).faces[faces]
    weight = np.tile(barycentrics, (len(faces), 1))
    place, normal, plane = places_in_faces(polygons, faces, weight)
    _, weight = without_buried(polygons, corners, weight)
    true = traced_irradiance(tracer, place, normal, plane)
    separately = np.zeros_like(true)
    for k in range(3):
        own = References(corners[:, k], place, normal, plane, (), weight)
        separately += weight[:, k, None] * np.asarray(_of_polygons(polygons.vectors, own))
    joint = References(lists.of_face[faces], place, normal, plane, (), weight)
    size = int(lists.sizes[-1])
    together = _of_lists(lists.lists, joint, size=size, interpolation=interpolation)
    errors = [np.linalg.norm(found - true, axis=-1) for found in (np.asarray(together), separately)]
    return errors[0] - errors[1]


def traced_irradiance(
    tracer: RayTracer,
    positions: Float32[np.ndarray, "faces 3"],
    normals: Float32[np.ndarray, "faces 3"],
    planes: Float32[np.ndarray, "faces 3"],
) -> Float32[np.ndarray, "faces 3"]:
    """Vector irradiance of a uniform sky over pi, by one ray in each cell of the hemisphere.

    Nothing is seen below the faces' planes; rays start on their upper sides.
    """
    cell = (np.arange(RAYS) + 0.5) / RAYS
    height, turn = (grid.reshape(-1) for grid in np.meshgrid(cell, cell))
    radius, angle = np.sqrt(1.0 - height * height), 2.0 * np.pi * turn
    local = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=-1)
    samples = Samples.of(positions, normals, offset_origins(positions, planes))
    directions = np.einsum("rk,fkc->frc", local, samples.frames).astype(np.float32)
    origins = np.broadcast_to(samples.origins[:, None], directions.shape)
    hidden = tracer.occluded(
        np.ascontiguousarray(origins.reshape(-1, 3), np.float32), directions.reshape(-1, 3)
    )
    free = ~hidden.reshape(directions.shape[:2])
    free &= np.einsum("frc,fc->fr", directions, planes) > 0.0
    return (2.0 / RAYS**2) * np.einsum("fr,frc->fc", free.astype(np.float32), directions)


@jax.jit
def _of_polygons(
    vectors: Float[Array, "polygons 4 capacity"], references: References
) -> Float[Array, "faces 3"]:
    return _sky(outlines(vectors, references, vectors.shape[-1]))


@partial(jax.jit, static_argnames=("size", "interpolation"))
def _of_lists(
    lists: TripleLists, references: References, *, size: int, interpolation: Interpolation
) -> Float[Array, "faces 3"]:
    return _sky(outlines(lists, references, size, interpolation))


def _sky(directions: Directions) -> Float[Array, "faces 3"]:
    """Vector irradiance of a uniform sky over pi."""
    return vector_irradiance(normalized(directions)) / jnp.pi
