"""Where a scene's visibility is sampled: its vertices, on the front and where needed the back."""

from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Float, Float32, Int, Int32

from jaxvis.scene import Scene
from jaxvis.scene.rays import OFFSET_SCALE
from jaxvis.scene.weld import equal_rows

LARGEST_DIP = 0.6
"""Most that a sample's domain reaches below its tangent plane, as a sine (37 degrees)."""

FLAT = 1e-3
"""Sine below which a vertex normal counts as that of its triangles."""

LEAST_RISE = 0.1
"""Cosine with the normals of the vertex' own triangles that an origin's offset keeps."""


LEAST_SCALE = 0.05
"""Of the scene's diagonal: least distance from the centre to which offsets are scaled."""


class Around(NamedTuple):
    """The triangles round samples: a row for each triangle at each sample."""

    sample: Int[np.ndarray, "rows"]
    plane: Float[np.ndarray, "rows 3"]
    """The triangle's unit normal on the sample's side."""
    centre: Float[np.ndarray, "rows 3"]
    """The triangle's."""


class Placed(NamedTuple):
    """How samples see."""

    normals: Float32[np.ndarray, "samples 3"]
    origins: Float32[np.ndarray, "samples 3"]
    dips: Float32[np.ndarray, "samples"]


class VertexSamples(NamedTuple):
    """Samples at vertices, and which of them are the corners of each triangle's two sides."""

    positions: Float32[np.ndarray, "samples 3"]
    normals: Float32[np.ndarray, "samples 3"]
    origins: Float32[np.ndarray, "samples 3"]
    dips: Float32[np.ndarray, "samples"]
    triangles: Int32[np.ndarray, "triangles 3"]
    backs: Int32[np.ndarray, "backs 3"]
    """One for each triangle, -1 where it has one side; none at all if that holds for every one."""


def vertex_samples(scene: Scene, *, largest_dip: float = LARGEST_DIP) -> VertexSamples:
    """The vertices that the scene's triangles use, and again, turned over, those of two-sided ones.

    A sample's domain reaches below its tangent plane as far as the planes of its own triangles do:
    shading points in them see that part of the sky.
    """
    both = np.array([m.two_sided for m in scene.materials])[scene.material_ids]
    front, triangles = np.unique(scene.triangles, return_inverse=True)
    back, turned = np.unique(scene.triangles[both], return_inverse=True)
    triangles = triangles.reshape(-1, 3).astype(np.int32)
    backs = np.full((len(both) if both.any() else 0, 3), -1, np.int32)
    sides = both[: len(backs)]
    backs[sides] = len(front) + turned.reshape(-1, 3)
    vertex = np.concatenate([front, back])
    side = np.where(np.arange(len(vertex)) < len(front), 1.0, -1.0)[:, None]
    corner = np.concatenate([triangles.reshape(-1), backs[sides].reshape(-1)])
    faces = np.arange(len(scene.triangles))
    face = np.repeat(np.concatenate([faces, faces[both]]), 3)
    centre = scene.positions[scene.triangles].mean(axis=1, dtype=np.float64)
    around = Around(corner, side[corner] * scene.geometric_normals[face], centre[face])
    positions = scene.positions[vertex]
    placed = placed_samples(
        positions,
        side * scene.normals[vertex],
        around,
        diagonal=scene.diagonal,
        largest_dip=largest_dip,
    )
    return VertexSamples(positions, *placed, triangles, backs)


def connected_surfaces(placed: VertexSamples) -> Int32[np.ndarray, "samples"]:
    """Numbers of the connected surfaces that samples are on; the sides of a sheet are two."""
    count = len(placed.positions)
    sides = [placed.triangles, placed.backs[placed.backs[:, 0] >= 0]]
    edges = [corners[:, pair] for corners in sides for pair in ([0, 1], [1, 2])]
    # Vertices at one position are one point of the surface, whatever their normals.
    for corners in sides:
        used = np.unique(corners)
        first, number = equal_rows(*placed.positions[used].T)
        edges.append(np.column_stack([used, used[first[number]]]))
    row, column = np.concatenate(edges).T
    graph = scipy.sparse.csr_array(
        (np.ones(len(row), np.int8), (row, column)), shape=(count, count)
    )
    return scipy.sparse.csgraph.connected_components(graph, directed=False)[1].astype(np.int32)


def placed_samples(
    positions: Float[np.ndarray, "samples 3"],
    normals: Float[np.ndarray, "samples 3"],
    around: Around,
    *,
    diagonal: float,
    largest_dip: float = LARGEST_DIP,
) -> Placed:
    """Normals, origins of rays and domains of samples on a surface.

    Args:
        positions: of the samples, centred coordinates.
        normals: of any length; where one is zero, it becomes that of one of the triangles.
        around: the triangles of which the samples are corners, or on whose edges they lie.
        diagonal: of the scene.
        largest_dip: most that a domain reaches below the tangent plane, as a sine.
    """
    corner, plane, centre = around
    unit = _mended(normals, corner, plane)
    towards = _unit(centre - positions[corner])
    offset = _offsets(unit, corner, plane, towards)
    farthest = np.max(np.abs(positions), axis=-1, keepdims=True, initial=0.0)
    # Near the origin float32 is finer than the rays' directions are over the scene's extent.
    scale = np.maximum(farthest, LEAST_SCALE * diagonal)
    return Placed(
        unit.astype(np.float32),
        (positions + OFFSET_SCALE * scale * offset).astype(np.float32),
        _dips(unit, corner, plane, largest_dip),
    )


def _mended(
    normals: Float[np.ndarray, "samples 3"],
    corner: Int[np.ndarray, "corners"],
    plane: Float[np.ndarray, "corners 3"],
) -> Float[np.ndarray, "samples 3"]:
    """Unit normals; where one is zero, that of one of the triangles."""
    normals = _unit(normals)
    any_plane = np.zeros_like(normals)
    any_plane[corner] = plane
    return np.where(np.any(normals != 0.0, axis=-1, keepdims=True), normals, any_plane)


def _dips(
    normals: Float[np.ndarray, "samples 3"],
    corner: Int[np.ndarray, "corners"],
    plane: Float[np.ndarray, "corners 3"],
    largest: float,
) -> Float32[np.ndarray, "samples"]:
    """Sines of the largest angles between the vertex normals and those of their triangles."""
    chord = np.linalg.norm(normals[corner] - plane, axis=-1)
    sine = np.where(
        chord < np.sqrt(2.0), chord * np.sqrt(1.0 - np.square(0.5 * np.minimum(chord, 2.0))), 1.0
    )
    dips = np.zeros(len(normals))
    np.maximum.at(dips, corner, sine)
    return np.where(dips < FLAT, 0.0, np.minimum(dips, largest)).astype(np.float32)


def _offsets(
    normals: Float[np.ndarray, "samples 3"],
    corner: Int[np.ndarray, "corners"],
    plane: Float[np.ndarray, "corners 3"],
    towards: Float[np.ndarray, "corners 3"],
) -> Float[np.ndarray, "samples 3"]:
    """Which way the rays' origins leave the vertices.

    Along the normal, and at a border or crease also into the surface that the sample stands for:
    what meets it there, like the wall beside a floor, is then in front of the origin and not
    through it. Own triangles that rise steeply above the tangent plane push the origin out.
    """
    mean = np.zeros_like(normals)
    np.add.at(mean, corner, towards)
    mean /= np.maximum(np.bincount(corner, minlength=len(normals)), 1)[:, None]
    mean -= np.sum(mean * normals, axis=-1, keepdims=True) * normals
    offset = normals + mean
    for _ in range(4):
        lacking = LEAST_RISE - np.sum(offset[corner] * plane, axis=-1)
        push = np.zeros_like(normals)
        np.add.at(push, corner, np.maximum(lacking, 0.0)[:, None] * plane)
        offset = offset + push
    return offset


def _unit(vectors: Float[np.ndarray, "vectors 3"]) -> Float[np.ndarray, "vectors 3"]:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0.0, length, 1.0)
