"""How far a mesh is from the height field of its topmost points (paper 003, eq. 5; host)."""

from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Bool, Float, Float64, Int, Int32, Integer

from jaxvis.compiled import compiled
from jaxvis.scene.normals import area_vectors
from jaxvis.scene.rays import RayTracer

RESOLUTIONS = 16, 512
"""Least and most samples a side of the height field of a mesh; in between about one a triangle."""

POINTS = 128, 65536
"""Least and most points at which a mesh is compared with its height field; in between one per four
triangles."""

STEEP = 4.0
"""Cells by which two neighbouring samples may differ in height and have surface between them. A
steeper step is a wall: no ray from above meets it, so no texel would hold its light."""

APART = 4.0
"""Distance between meshes, in units of their size, when they are laid out beside each other."""

LIFT = 0.5
"""Height above a mesh of unit size from which rays start."""

ROUNDING = 1e-5
"""Of a mesh's size: hits this near are the point itself."""

DOWN = np.array([0.0, -1.0, 0.0], np.float32)


def height_field_distance(
    positions: Float[np.ndarray, "vertices 3"],
    triangles: Integer[np.ndarray, "triangles 3"],
    resolution: int = 512,
) -> float:
    """How far a mesh is from the height field of its topmost points (eq. 5, spec 4.2).

    The mean over its surface of the distance to the height field's surface, over the diagonal of
    its bounding box: 0 for whatever can be seen whole from straight above. Infinite where no ray
    from above meets anything (an upright plane).

    Points are spread evenly by area, and not the vertices, so that a box does not count as eight
    corners. The height field is sampled at ``resolution``^2 centres of cells of the box's bottom
    and is connected between them but for steps; over a point itself one more ray samples it, so
    that neither slopes nor the outline are judged by how fine the cells are.

    Args:
        positions: any coordinates and scale, +y up.
        triangles: vertex indices.
        resolution: cells along the longer side of the bottom.

    Raises:
        ValueError: no triangles or no area, or a resolution below 2.
    """
    if resolution < 2:
        raise ValueError(f"resolution must be at least 2, got {resolution}")
    if not len(triangles):
        raise ValueError("the mesh has no triangles; leave it out")
    ids = np.zeros(len(triangles), np.int32)
    laid = lay_out(positions, triangles, ids)
    tops = Tops.above(laid, sample_surface(laid))
    return float(distances(laid, tops, np.array([resolution]))[0])


class Layout(NamedTuple):
    """Meshes side by side, so that one tracer sees each of them alone.

    Each is scaled to unit size (the longest side of its box) and moved apart from the others.
    """

    ids: Int32[np.ndarray, "triangles"]
    corners: Float64[np.ndarray, "triangles 3 3"]
    areas: Float64[np.ndarray, "triangles"]
    low: Float64[np.ndarray, "meshes 3"]
    """Lower corner of each box, as laid out."""
    extent: Float64[np.ndarray, "meshes 3"]
    size: Float64[np.ndarray, "meshes"]
    """Longest side of each box before, and thus the factor between lengths."""
    came: Float64[np.ndarray, "meshes 3"]
    """Lower corner of each box before."""
    tracer: RayTracer

    @property
    def diagonal(self) -> Float64[np.ndarray, "meshes"]:
        """Length of each box's diagonal."""
        return np.linalg.norm(self.extent, axis=-1)

    def heights(
        self, x: Float64[np.ndarray, "rays"], z: Float64[np.ndarray, "rays"]
    ) -> tuple[Float64[np.ndarray, "rays"], Int32[np.ndarray, "rays"]]:
        """Topmost height (-inf without a hit) and its triangle (-1) in each column."""
        origins = np.stack([x, np.full(len(x), 1.0 + LIFT), z], axis=-1)
        hits = self.tracer.closest_hit(origins, np.broadcast_to(DOWN, origins.shape))
        return 1.0 + LIFT - hits.distance.astype(np.float64), hits.triangle


def lay_out(
    positions: Float[np.ndarray, "vertices 3"],
    triangles: Integer[np.ndarray, "triangles 3"],
    ids: Int32[np.ndarray, "triangles"],
) -> Layout:
    """Meshes by their numbers, of which no two share a vertex.

    Raises:
        ValueError: a mesh has no area.
    """
    count = int(ids.max()) + 1
    owner = np.zeros(len(positions), np.int32)
    owner[triangles] = ids[:, None]
    used = np.zeros(len(positions), bool)
    used[triangles] = True
    number = np.flatnonzero(used)
    # Sorted by mesh, the vertices of each are one run.
    order = number[np.argsort(owner[number], kind="stable")]
    starts = np.searchsorted(owner[order], np.arange(count))
    points = positions.astype(np.float64)
    low = np.minimum.reduceat(points[order], starts)
    extent = np.maximum.reduceat(points[order], starts) - low
    size = np.maximum(extent.max(axis=-1, keepdims=True), np.finfo(np.float64).tiny)
    rows = int(np.ceil(np.sqrt(count)))
    mesh = np.arange(count)
    shift = APART * np.stack([mesh % rows, np.zeros(count), mesh // rows], axis=-1)
    points = (points - low[owner]) / size[owner] + shift[owner]
    corners = points[triangles]
    areas = 0.5 * np.linalg.norm(area_vectors(corners), axis=-1)
    if not np.all(np.bincount(ids, areas) > 0.0):
        raise ValueError("a mesh has no area; leave triangles without area out")
    tracer = RayTracer(points, triangles)
    return Layout(ids, corners, areas, shift, extent / size, size[:, 0], low, tracer)


class SurfacePoints(NamedTuple):
    """Points on the surfaces of laid-out meshes."""

    position: Float64[np.ndarray, "points 3"]
    triangle: Int[np.ndarray, "points"]
    mesh: Int32[np.ndarray, "points"]


def sample_surface(laid: Layout) -> SurfacePoints:
    """Points spread evenly over the area of each mesh."""
    count = np.clip(np.bincount(laid.ids) // 4, *POINTS)
    order = np.argsort(laid.ids, kind="stable")
    running = np.cumsum(laid.areas[order])
    starts = np.searchsorted(laid.ids[order], np.arange(len(count)))
    before = running[starts] - laid.areas[order][starts]
    total = np.bincount(laid.ids, laid.areas)
    mesh = np.repeat(np.arange(len(count), dtype=np.int32), count)
    rank = np.arange(len(mesh)) - np.repeat(np.cumsum(count) - count, count)
    # One point in each of ``count`` equal parts of the area.
    where = before[mesh] + total[mesh] * (rank + 0.5) / count[mesh]
    ends = np.append(starts[1:], len(order)) - 1
    place = np.clip(np.searchsorted(running, where), starts[mesh], ends[mesh])
    triangle = order[place]
    # Roberts' R2 sequence, folded into the triangle.
    u, v = ((0.5 + rank * step) % 1.0 for step in (0.7548776662466927, 0.5698402909980532))
    outside = u + v > 1.0
    u, v = np.where(outside, 1.0 - u, u)[:, None], np.where(outside, 1.0 - v, v)[:, None]
    a, b, c = np.moveaxis(laid.corners[triangle], 1, 0)
    return SurfacePoints(a + u * (b - a) + v * (c - a), triangle, mesh)


class Tops(NamedTuple):
    """What lies topmost in the columns of points of the surface."""

    points: SurfacePoints
    gap: Float64[np.ndarray, "points"]
    """Height of the topmost point above the point itself; infinite if the ray slips past."""
    triangle: Int32[np.ndarray, "points"]

    @classmethod
    def above(cls, laid: Layout, points: SurfacePoints) -> "Tops":
        """Traced from above."""
        x, y, z = points.position.T
        top, triangle = laid.heights(x, z)
        gap = np.where(triangle >= 0, np.abs(top - y), np.inf)
        return cls(points, np.where(gap < ROUNDING, 0.0, gap), triangle)


def bound(laid: Layout, tops: Tops) -> Float64[np.ndarray, "meshes"]:
    """Mean distances straight up, over the diagonals: never below :func:`distances`."""
    return _mean(tops.points.mesh, tops.gap) / laid.diagonal


def _mean(mesh: np.ndarray, values: np.ndarray) -> Float64[np.ndarray, "meshes"]:
    return np.bincount(mesh, values) / np.bincount(mesh)


def distances(
    laid: Layout,
    tops: Tops,
    resolution: Int[np.ndarray, "meshes"],
    wanted: Bool[np.ndarray, "meshes"] | None = None,
) -> Float64[np.ndarray, "meshes"]:
    """Mean distances to the height fields; those of meshes not wanted are upper bounds."""
    distance = tops.gap.copy()
    hidden = np.flatnonzero(
        (distance > 0.0) if wanted is None else (distance > 0.0) & wanted[tops.points.mesh]
    )
    if len(hidden):
        distance[hidden] = _from_samples(laid, tops, hidden, resolution)
    return _mean(tops.points.mesh, distance) / laid.diagonal


def _from_samples(
    laid: Layout, tops: Tops, hidden: np.ndarray, resolution: np.ndarray
) -> Float64[np.ndarray, "hidden"]:
    """Distances to the sampled height fields, or to the point above where that is nearer."""
    mesh = tops.points.mesh[hidden]
    meshes = np.unique(mesh)
    field = _sampled(laid, meshes, resolution[meshes])
    gap = tops.gap[hidden]
    met = np.flatnonzero(np.isfinite(field.height))
    if not len(met):
        return gap
    # The nearest sample leads to the nearest surface: that of the cells around it.
    position = tops.points.position[hidden]
    tree = scipy.spatial.KDTree(np.stack([field.x[met], field.height[met], field.z[met]], axis=-1))
    near, sample = tree.query(position, workers=-1)
    sample = met[sample]
    near = np.minimum(near, gap)
    row = np.searchsorted(meshes, mesh)
    found = np.where(field.mesh[sample] == row, near, gap)
    grid = field.starts, field.columns, field.rows, field.cell
    _to_surface(position, sample, row, field.mesh, *grid, field.x, field.height, field.z, found)
    return found


class _Samples(NamedTuple):
    """Height fields of several meshes, sampled at the centres of cells, row after row."""

    mesh: Int[np.ndarray, "samples"]
    x: Float64[np.ndarray, "samples"]
    z: Float64[np.ndarray, "samples"]
    height: Float64[np.ndarray, "samples"]
    starts: Int[np.ndarray, "meshes"]
    rows: Int[np.ndarray, "meshes"]
    columns: Int[np.ndarray, "meshes"]
    cell: Float64[np.ndarray, "meshes"]
    """Width of a cell."""


def _sampled(laid: Layout, meshes: np.ndarray, resolution: np.ndarray) -> _Samples:
    extent, low = laid.extent[meshes], laid.low[meshes]
    cell = np.maximum(extent[:, 0], extent[:, 2]) / resolution
    cell = np.maximum(cell, 1e-12)  # an upright line has no bottom
    columns = np.maximum(np.ceil(extent[:, 0] / cell - 1e-9).astype(np.int64), 1)
    rows = np.maximum(np.ceil(extent[:, 2] / cell - 1e-9).astype(np.int64), 1)
    count = rows * columns
    starts = np.cumsum(count) - count
    mesh = np.repeat(np.arange(len(meshes)), count)
    row, column = np.divmod(np.arange(len(mesh)) - starts[mesh], columns[mesh])
    x = low[mesh, 0] + extent[mesh, 0] * (column + 0.5) / columns[mesh]
    z = low[mesh, 2] + extent[mesh, 2] * (row + 0.5) / rows[mesh]
    height, _ = laid.heights(x, z)
    return _Samples(mesh, x, z, height, starts, rows, columns, cell)


@compiled
def _to_surface(position, sample, row_of, mesh, starts, columns, rows, cell, x, height, z, found):
    """Lowers ``found`` to the distances from the triangles between samples, near the nearest."""
    for point in range(len(position)):
        own = row_of[point]
        if mesh[sample[point]] != own:
            continue
        p = (position[point, 0], position[point, 1], position[point, 2])
        wide, first = columns[own], starts[own]
        i, j = divmod(sample[point] - first, wide)
        for row in range(max(i - 1, 0), min(i + 1, rows[own] - 1)):
            for column in range(max(j - 1, 0), min(j + 1, wide - 1)):
                corner = first + row * wide + column
                a = (x[corner], height[corner], z[corner])
                last = corner + wide + 1
                c = (x[last], height[last], z[last])
                for other in (corner + 1, corner + wide):
                    b = (x[other], height[other], z[other])
                    drop = max(a[1], b[1], c[1]) - min(a[1], b[1], c[1])
                    # False for samples without a hit, too.
                    if drop <= STEEP * cell[own]:
                        found[point] = min(found[point], _to_triangle(p, a, b, c))


@compiled
def _to_triangle(p, a, b, c):
    """Distance from a point to a triangle: to its plane inside of it, else to its sides."""
    ab, ac, ap = _minus(b, a), _minus(c, a), _minus(p, a)
    across, down, skew = _dot(ab, ab), _dot(ac, ac), _dot(ab, ac)
    first, second = _dot(ap, ab), _dot(ap, ac)
    area = across * down - skew * skew
    v, w = down * first - skew * second, across * second - skew * first
    if area > 0.0 and v >= 0.0 and w >= 0.0 and v + w <= area:
        left = _dot(ap, ap) - (v * first + w * second) / area
        return np.sqrt(max(left, 0.0))
    return min(_to_side(p, a, b), _to_side(p, b, c), _to_side(p, c, a))


@compiled
def _to_side(p, a, b):
    side, off = _minus(b, a), _minus(p, a)
    length = _dot(side, side)
    along = min(max(_dot(off, side) / length, 0.0), 1.0) if length > 0.0 else 0.0
    left = (off[0] - along * side[0], off[1] - along * side[1], off[2] - along * side[2])
    return np.sqrt(_dot(left, left))


@compiled
def _minus(a, b):
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@compiled
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def resolutions(ids: np.ndarray) -> Int[np.ndarray, "meshes"]:
    """About one sample a triangle, as powers of two."""
    side = np.sqrt(np.bincount(ids))
    return np.clip(2 ** np.ceil(np.log2(side)).astype(np.int64), *RESOLUTIONS)
