"""Vertex normals: smoothed within creases, and turned to the front of their triangles (host)."""

import numpy as np
import scipy
from jaxtyping import Float, Float64, Integer

from jaxvis.scene.weld import edge_sides

LARGEST_FAN = 16
"""Triangles at one edge that are compared with each other. More only occur in broken meshes, where
some pairs then stay unsmoothed."""


def area_vectors(corners: Float[np.ndarray, "triangles 3 3"]) -> Float64[np.ndarray, "triangles 3"]:
    """Normals on the front of triangles, as long as twice their area.

    In float64: exactly zero for triangles without area whose corners are float32 numbers.
    """
    a, b, c = np.moveaxis(corners.astype(np.float64), 1, 0)
    return np.cross(b - a, c - a)


def crease_normals(
    triangles: Integer[np.ndarray, "triangles 3"],
    areas: Float64[np.ndarray, "triangles 3"],
    crease_angle: float,
) -> Float64[np.ndarray, "triangles 3 3"]:
    """Unit normals of the corners, area-weighted over the smooth part of the surface around each.

    Two corners at a vertex belong to the same smooth part if a path of triangles around the vertex
    joins them in which neighbours' normals differ by less than the crease angle.

    Args:
        triangles: vertices of each triangle, numbered by position alone.
        areas: normals as long as twice the triangle's area, none zero.
        crease_angle: radians; 0 gives flat triangles.
    """
    unit = areas / np.linalg.norm(areas, axis=-1, keepdims=True)
    sides = edge_sides(triangles)
    corners = triangles.size
    first, second = [], []
    for step in range(1, min(int(sides.count.max()), LARGEST_FAN + 1)):
        here, there = sides.side[:-step], sides.side[step:]
        pair = sides.edge[:-step] == sides.edge[step:]
        here, there = here[pair], there[pair]
        cosine = np.sum(unit[here // 3] * unit[there // 3], axis=-1)
        # Neighbours that wind alike run along their edge in opposite directions.
        opposed = triangles.reshape(-1)[here] != triangles.reshape(-1)[there]
        smooth = opposed & (cosine > np.cos(crease_angle))
        here, there = here[smooth], there[smooth]
        first += [here, _next_corner(here)]
        second += [_next_corner(there), there]
    rows = np.concatenate([np.zeros(0, np.int64), *first])
    columns = np.concatenate([np.zeros(0, np.int64), *second])
    graph = scipy.sparse.coo_array(
        (np.ones(len(rows), np.int8), (rows, columns)), shape=(corners, corners)
    )
    parts, part = scipy.sparse.csgraph.connected_components(graph, directed=False)
    weights = np.repeat(areas, 3, axis=0)
    total = np.stack([np.bincount(part, weights[:, axis], parts) for axis in range(3)], axis=-1)
    length = np.linalg.norm(total, axis=-1, keepdims=True)
    mean = np.divide(total, length, out=np.zeros_like(total), where=length > 0.0)[part]
    # Around a saddle tighter than the crease the mean may cancel or face backwards.
    flat = np.repeat(unit, 3, axis=0)
    usable = np.sum(mean * flat, axis=-1, keepdims=True) > 0.0
    return np.where(usable, mean, flat).reshape(-1, 3, 3)


def _next_corner(side: Integer[np.ndarray, "sides"]) -> Integer[np.ndarray, "sides"]:
    return np.where(side % 3 == 2, side - 2, side + 1)


def face_front(
    normals: Float64[np.ndarray, "triangles 3 3"], areas: Float64[np.ndarray, "triangles 3"]
) -> tuple[Float64[np.ndarray, "triangles 3 3"], int, int]:
    """Turns unit corner normals to the front that the triangles' winding says.

    Triangles whose mean normal points to the back have all three turned over; a single normal that
    still points to the back of its own triangle is replaced by the triangle's.

    Returns:
        (normals, triangles turned over, corners replaced).
    """
    unit = areas / np.linalg.norm(areas, axis=-1, keepdims=True)
    cosine = np.einsum("tkx,tx->tk", normals, unit)
    turned = cosine.sum(axis=-1) < 0.0
    normals = np.where(turned[:, None, None], -normals, normals)
    behind = np.where(turned[:, None], -cosine, cosine) <= 0.0
    normals = np.where(behind[..., None], unit[:, None, :], normals)
    return normals, int(turned.sum()), int(behind.sum())
