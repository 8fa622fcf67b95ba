"""The triangles that polygons belong to: sides, edges and the polygons at their ends (host)."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Int, Int32

from jaxvis.methods.vectorized.polygons import VisibilityPolygons
from jaxvis.methods.vectorized.refine.locate import Forest, locate
from jaxvis.scene import Surface


class Mesh(NamedTuple):
    """Faces: the fronts of all triangles, then their backs."""

    faces: Int32[np.ndarray, "faces 3"]
    """Polygons at the corners; -1 at backs that have none."""
    edges: Int32[np.ndarray, "faces 3"]
    """The k-th lies opposite the k-th corner. Faces that share it have both its polygons."""
    edge_count: int
    planes: Float32[np.ndarray, "triangles 3"]
    """Unit normals of the fronts."""
    forest: Forest | None
    """From the scene's triangles to these, where they are their parts."""

    @staticmethod
    def of(visibility: VisibilityPolygons) -> "Mesh":
        """The mesh of polygons, which is kept with them."""
        known = vars(visibility)
        if "_mesh" not in known:
            known["_mesh"] = _build(visibility)
        return known["_mesh"]


class Pixels(NamedTuple):
    """The shaded pixels of a surface."""

    index: Int32[np.ndarray, "pixels"]
    """In the flat image."""
    face: Int32[np.ndarray, "pixels"]
    barycentrics: Float32[np.ndarray, "pixels 3"]


def shaded_pixels(mesh: Mesh, surface: Surface) -> Pixels:
    """Which face each shaded pixel sees, and where.

    Raises:
        ValueError: pixels see triangles, or backs of triangles, that have no polygons.
    """
    index = np.flatnonzero(np.asarray(surface.mask)).astype(np.int32)
    triangle = np.asarray(surface.triangle).reshape(-1).take(index)
    count = len(mesh.planes)
    roots = count if mesh.forest is None else mesh.forest.roots
    if len(triangle) and triangle.max() >= roots:
        raise ValueError("the surface was traced in another scene than the visibility's")
    barycentrics = np.asarray(surface.barycentrics).reshape(-1, 3).take(index, axis=0)
    if mesh.forest is not None:
        triangle, barycentrics = locate(mesh.forest, triangle, barycentrics)
    normal = np.asarray(surface.geometric_normal).reshape(-1, 3).take(index, axis=0)
    behind = np.einsum("pc,pc->p", normal, mesh.planes.take(triangle, axis=0)) < 0.0
    face = triangle + np.where(behind, np.int32(count), np.int32(0))
    if len(face) and mesh.faces[face, 0].min() < 0:
        raise ValueError(
            "the surface shows backs of triangles without visibility: make their materials "
            "two-sided before precomputing"
        )
    return Pixels(index, face, barycentrics)


def places_in_faces(
    polygons: VisibilityPolygons,
    face: Int[np.ndarray, "places"],
    weight: Float32[np.ndarray, "places 3"],
) -> tuple[
    Float32[np.ndarray, "places 3"],
    Float32[np.ndarray, "places 3"],
    Float32[np.ndarray, "places 3"],
]:
    """(positions, unit normals, unit normals of the faces' planes) at barycentrics in faces.

    Normals are interpolated; where they cancel, the plane's will do.
    """
    mesh = Mesh.of(polygons)
    corners = mesh.faces.take(face, axis=0)
    position, normal = (
        np.einsum("pk,pkc->pc", weight, np.asarray(field).take(corners, axis=0))
        for field in (polygons.positions, polygons.normals)
    )
    side = np.where(face < len(mesh.planes), np.float32(1.0), np.float32(-1.0))[:, None]
    plane = mesh.planes.take(face % len(mesh.planes), axis=0) * side
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = np.where(length > 1e-6, normal / np.maximum(length, 1e-6), plane)
    return position, normal, plane


def inner_edges(
    polygons: Int[np.ndarray, "faces 3"], edges: Int[np.ndarray, "faces 3"]
) -> Int[np.ndarray, "inner 2"]:
    """Edges at which just two faces meet: twice 3 x face + the corner that lies opposite.

    Args:
        polygons: of the faces' corners; -1 at faces without polygons.
        edges: the number of the edge opposite each corner.
    """
    slots = np.flatnonzero((polygons >= 0).all(axis=1).repeat(3))
    slots = slots[np.argsort(edges.reshape(-1)[slots], kind="stable")]
    edge = edges.reshape(-1)[slots]
    first = np.flatnonzero(np.diff(edge, prepend=-1) != 0)
    two = first[np.diff(first, append=len(edge)) == 2]
    return np.stack([slots[two], slots[two + 1]], axis=-1)


def faces_in_view(mesh: Mesh, pixels: Pixels) -> Int32[np.ndarray, "visible"]:
    """The faces that pixels see, ascending."""
    return np.flatnonzero(_marked(len(mesh.faces), pixels.face)).astype(np.int32)


def polygons_in_view(
    mesh: Mesh, faces: Int32[np.ndarray, "visible"], count: int
) -> Int32[np.ndarray, "corners"]:
    """The polygons at the corners of faces, ascending, each once."""
    return np.flatnonzero(_marked(count, mesh.faces.take(faces, axis=0))).astype(np.int32)


def _marked(count: int, index: Int32[np.ndarray, "*indices"]) -> Bool[np.ndarray, "count"]:
    marked = np.zeros(count, bool)
    marked[index.reshape(-1)] = True
    return marked


def _build(visibility: VisibilityPolygons) -> Mesh:
    triangles, backs = np.asarray(visibility.triangles), np.asarray(visibility.backs)
    if not len(backs):
        backs = np.full_like(triangles, -1)
    faces = np.concatenate([triangles, backs])
    positions = np.asarray(visibility.positions, np.float64)
    a, b, c = np.moveaxis(positions[triangles], 1, 0)
    cross = np.cross(b - a, c - a)
    length = np.linalg.norm(cross, axis=-1, keepdims=True)
    start, end = np.roll(faces, -1, axis=1), np.roll(faces, -2, axis=1)
    keys = np.minimum(start, end).astype(np.int64) * (len(positions) + 1) + np.maximum(start, end)
    found, edges = np.unique(keys, return_inverse=True)
    splits, children = np.asarray(visibility.splits), np.asarray(visibility.children)
    return Mesh(
        faces,
        edges.reshape(-1, 3).astype(np.int32),
        len(found),
        (cross / np.where(length > 0.0, length, 1.0)).astype(np.float32),
        Forest(splits, children) if len(splits) else None,
    )
