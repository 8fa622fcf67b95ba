"""Triangles divided where the light on them changes fast (paper 000, eqs. 17 and 18); host.

Every edge has a level L of its own, from its two ends alone, and is divided in 2^L parts; a
triangle has the highest of its three and is divided in 4^L. Where an edge is coarser than the
triangle beside it, what lies between the edge's points is interpolated: triangles that share an
edge have the same values along it.

A triangle's grid points are (i, j), with barycentrics ((n - i - j), i, j) / n for n = 2^L.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Int, Int32

from jaxvis.methods.vectorized.correspondence.interpolated import polygons_of
from jaxvis.methods.vectorized.correspondence.triples import CorrespondingPolygons
from jaxvis.methods.vectorized.evaluation import Sites
from jaxvis.methods.vectorized.mesh import Mesh, Pixels, places_in_faces
from jaxvis.methods.vectorized.plan import (
    Plan,
    Stencil,
    corner_sites,
    over_image,
    renormalised,
    room,
    sites_in_faces,
)
from jaxvis.methods.vectorized.polygons import VisibilityPolygons


class Levels(NamedTuple):
    """Logarithms of how many parts edges and faces in view have."""

    faces: Int32[np.ndarray, "visible"]
    """Faces in view, ascending: the rows of the others."""
    edge: Int32[np.ndarray, "visible 3"]
    face: Int32[np.ndarray, "visible"]


class Cells(NamedTuple):
    """Small triangles of faces' grids: (i, j), (i + 1, j), (i, j + 1), or the other way up
    (i + 1, j + 1), (i + 1, j), (i, j + 1).
    """

    row: Int32[np.ndarray, "cells"]
    """Of the face in :class:`Levels`."""
    i: Int32[np.ndarray, "cells"]
    j: Int32[np.ndarray, "cells"]
    turned: Bool[np.ndarray, "cells"]

    def take(self, chosen: Int[np.ndarray, "chosen"]) -> "Cells":
        """Some of the cells."""
        return Cells(*(field.take(chosen) for field in self))


class GridPoints(NamedTuple):
    """Points of faces' grids."""

    row: Int32[np.ndarray, "points"]
    i: Int32[np.ndarray, "points"]
    j: Int32[np.ndarray, "points"]

    def take(self, chosen: Int[np.ndarray, "chosen"]) -> "GridPoints":
        """Some of the points."""
        return GridPoints(*(field.take(chosen) for field in self))


class Border(NamedTuple):
    """Points on the edges of their faces."""

    point: Int32[np.ndarray, "border"]
    """Which points."""
    side: Int32[np.ndarray, "border"]
    """Which edge: that opposite this corner."""
    along: Int32[np.ndarray, "border"]
    """Steps of the face's grid from the edge's first end: see :data:`_ENDS`."""


_ENDS = np.array([[1, 2], [0, 2], [0, 1]], np.int32)
"""Corners from and to which the edge opposite each corner runs."""


def edge_levels(
    mesh: Mesh,
    faces: Int32[np.ndarray, "visible"],
    difference: Float32[np.ndarray, "polygons"],
    zeta: float,
) -> Levels:
    """Levels by eq. 18 for each edge: round(zeta Delta), Delta the larger of its ends'.

    Args:
        mesh: the triangles.
        faces: those in view.
        difference: Delta of eq. 17 at each polygon, in [0, 1].
        zeta: the level where it is 1.
    """
    ends = difference.take(mesh.faces.take(faces, axis=0))
    larger = np.stack([np.maximum(ends[:, a], ends[:, b]) for a, b in _ENDS], axis=-1)
    edge = np.rint(zeta * larger).astype(np.int32)
    return Levels(faces, edge, edge.max(axis=-1, initial=0))


def plan_tessellation(
    visibility: VisibilityPolygons | CorrespondingPolygons,
    mesh: Mesh,
    pixels: Pixels,
    corners: Int32[np.ndarray, "corners"],
    levels: Levels,
    size: int,
) -> Plan:
    """Sites at the corners in view, and at those grid points between which pixels lie.

    ``corners`` are the polygons of the faces in view: the first sites of the plan. ``size`` is how
    many pixels the image has, shaded or not.

    Raises:
        ValueError: more grid points than an index holds.
    """
    polygons, known = polygons_of(visibility), len(corners)
    cell_of, cells, weights = _cells(mesh, levels, pixels)
    step = cells.turned.astype(np.int32)
    points = GridPoints(
        np.repeat(cells.row, 3),
        np.stack([cells.i + step, cells.i + 1, cells.i], axis=-1).reshape(-1),
        np.stack([cells.j + step, cells.j, cells.j + 1], axis=-1).reshape(-1),
    )
    count = len(points.row)
    points, border, hanging, fraction = _beside_hanging(levels, points, _border(levels, points))
    site_of = _inverse(corners, len(polygons.positions))
    addresses, bound = _addresses(mesh, levels, points, border, site_of, known)
    site, first = _numbered(addresses, bound, known)
    grid = _grid_sites(visibility, mesh, levels, points.take(first))
    at_corners = corner_sites(polygons, corners)
    sites = Sites(*(np.concatenate(pair) for pair in zip(at_corners, grid, strict=True)))
    capacity = room(len(sites.normal))
    ends = np.stack([site.take(hanging), site[count:]], axis=-1)
    nodes = site[:count]
    nodes[hanging] = capacity + np.arange(len(hanging), dtype=np.int32)
    missing = room(len(ends)) - len(ends)
    stencil = Stencil(
        np.pad(ends, ((0, missing), (0, 0))),
        np.pad(fraction, (0, missing)),
        nodes.reshape(-1, 3).take(cell_of, axis=0),
        weights,
    )
    hidden = np.asarray(polygons.buried).take(corners)
    if hidden.any():
        stencil = _without_hidden_corners(stencil, capacity, hidden)
    stencil = stencil._replace(
        nodes=over_image(stencil.nodes, pixels, size),
        weights=over_image(stencil.weights, pixels, size),
    )
    return Plan(sites, capacity, stencil, False, sites.references)


def _without_hidden_corners(
    stencil: Stencil, capacity: int, hidden: Bool[np.ndarray, "corners"]
) -> Stencil:
    """Pixels and places between sites do without the corners that are hidden, if they can."""
    nodes = np.zeros(capacity + len(stencil.ends), bool)
    nodes[: len(hidden)] = hidden
    first, last = (nodes.take(stencil.ends[:, k]) for k in range(2))
    fraction = np.where(first, np.float32(1.0), np.where(last, np.float32(0.0), stencil.fraction))
    return stencil._replace(
        fraction=fraction, weights=renormalised(stencil.weights, ~nodes.take(stencil.nodes))
    )


def _inverse(chosen: Int32[np.ndarray, "chosen"], count: int) -> Int32[np.ndarray, "count"]:
    """The place of each number in ``chosen``."""
    place = np.zeros(count, np.int32)
    place[chosen] = np.arange(len(chosen), dtype=np.int32)
    return place


def _parts(level: Int32[np.ndarray, "*any"]) -> Int32[np.ndarray, "*any"]:
    return np.left_shift(np.int32(1), level)


def _cells(
    mesh: Mesh, levels: Levels, pixels: Pixels
) -> tuple[Int32[np.ndarray, "pixels"], Cells, Float32[np.ndarray, "pixels 3"]]:
    """(the cell of each pixel, the cells in which there are pixels, barycentrics in the cell)."""
    row = _inverse(levels.faces, len(mesh.faces)).take(pixels.face)
    n = _parts(levels.face)
    sizes = n.astype(np.int64) ** 2
    if sizes.sum() >= np.iinfo(np.int32).max:
        raise ValueError(f"{sizes.sum()} small triangles are too many; lower zeta")
    start = (np.cumsum(sizes) - sizes).astype(np.int32)
    parts = n.take(row)
    x, y = (parts * pixels.barycentrics[:, k] for k in (1, 2))
    i = np.clip(x.astype(np.int32), 0, parts - 1)
    j = np.clip(y.astype(np.int32), 0, parts - 1 - i)
    x, y = (x - i).astype(np.float32), (y - j).astype(np.float32)
    over = x + y - np.float32(1.0)
    turned = (over > 0.0) & (i + j + 2 <= parts)
    weights = np.empty((len(row), 3), np.float32)
    weights[:, 0] = np.where(turned, over, -over)
    weights[:, 1] = np.where(turned, 1.0 - y, x)
    weights[:, 2] = np.where(turned, 1.0 - x, y)
    # Rows of 2 n - 1, 2 n - 3, ... cells.
    address = start.take(row) + j * (2 * parts - j) + 2 * i + turned
    cell_of, first = _numbered(address, int(sizes.sum()))
    return cell_of, Cells(row, i, j, turned).take(first), weights


def _border(levels: Levels, points: GridPoints) -> Border:
    """The points on edges. Corners lie on two, and are given once."""
    k = _parts(levels.face).take(points.row) - points.i - points.j
    on = np.flatnonzero((k == 0) | (points.i == 0) | (points.j == 0)).astype(np.int32)
    i, j, k = points.i.take(on), points.j.take(on), k.take(on)
    side = np.where(k == 0, np.int32(0), np.where(i == 0, np.int32(1), np.int32(2)))
    return Border(on, side, np.where(side == 2, i, j))


def _beside_hanging(
    levels: Levels, points: GridPoints, border: Border
) -> tuple[GridPoints, Border, Int32[np.ndarray, "hanging"], Float32[np.ndarray, "hanging"]]:
    """Replaces the points that their edge does not have by the edge's points beside them.

    Returns:
        (points, with the later one of each pair after all; their border; which are the earlier
        ones; how far from them to the later ones the replaced points lie)
    """
    row = points.row.take(border.point)
    coarser = levels.face.take(row) - levels.edge.reshape(-1).take(3 * row + border.side)
    rest = border.along & (_parts(coarser) - 1)
    chosen = np.flatnonzero(rest)
    hanging, side, row = border.point[chosen], border.side[chosen], row[chosen]
    step = _parts(coarser[chosen])
    before = border.along[chosen] - rest[chosen]
    n = _parts(levels.face).take(row)

    def at(along: Int32[np.ndarray, "hanging"]) -> tuple[np.ndarray, np.ndarray]:
        i = np.where(side == 0, n - along, np.where(side == 1, np.int32(0), along))
        return i, np.where(side == 2, np.int32(0), along)

    points.i[hanging], points.j[hanging] = at(before)
    border.along[chosen] = before
    after = GridPoints(row, *at(before + step))
    later = Border(len(points.row) + np.arange(len(hanging), dtype=np.int32), side, before + step)
    return (
        GridPoints(*(np.concatenate(pair) for pair in zip(points, after, strict=True))),
        Border(*(np.concatenate(pair) for pair in zip(border, later, strict=True))),
        hanging,
        (rest[chosen] / step).astype(np.float32),
    )


def _addresses(
    mesh: Mesh,
    levels: Levels,
    points: GridPoints,
    border: Border,
    site_of: Int32[np.ndarray, "polygons"],
    corners: int,
) -> tuple[Int32[np.ndarray, "points"], int]:
    """A number for every point, the same for the same place in two faces, and their bound.

    Corners have those of their sites, then come the points of edges, then those inside faces.
    """
    n = _parts(levels.face)
    edges = mesh.edges.take(levels.faces, axis=0)
    on_edge = np.zeros(mesh.edge_count, np.int32)
    on_edge[edges] = _parts(levels.edge) - 1
    inside = (n - 1) * (n - 2) // 2
    edge_start = corners + np.cumsum(on_edge, dtype=np.int32) - on_edge
    edge_stop = corners + int(on_edge.sum())
    face_start = edge_stop + np.cumsum(inside, dtype=np.int32) - inside
    # Rows of n - 2, n - 3, ... points inside the face, for j = 1, 2, ...
    m = n.take(points.row) - 1
    address = face_start.take(points.row) + (points.i - 1)
    address += (points.j - 1) * m - (points.j - 1) * points.j // 2
    row = points.row.take(border.point)
    flat = 3 * row + border.side
    level = levels.edge.reshape(-1).take(flat)
    parts = _parts(level)
    along = np.right_shift(border.along, levels.face.take(row) - level)
    own = mesh.faces.take(levels.faces, axis=0).reshape(-1)
    first, last = (own.take(3 * row + _ENDS[:, end].take(border.side)) for end in range(2))
    onward = np.where(first < last, along, parts - along)
    between = edge_start.take(edges.reshape(-1).take(flat)) + onward - 1
    corner = (along == 0) | (along == parts)
    end = site_of.take(np.where(along == 0, first, last))
    address[border.point] = np.where(corner, end, between)
    return address, edge_stop + int(inside.sum())


def _numbered(
    addresses: Int32[np.ndarray, "points"], size: int, corners: int = 0
) -> tuple[Int32[np.ndarray, "points"], Int32[np.ndarray, "sites"]]:
    """Numbers without gaps: (each point's, and a point for each new number).

    Addresses below ``corners`` keep theirs and are not returned as new.
    """
    table = np.full(size, -1, np.int32)
    table[addresses] = np.arange(len(addresses), dtype=np.int32)
    table[:corners] = -1
    used = np.flatnonzero(table >= 0)
    first = table.take(used)
    table[:corners] = np.arange(corners, dtype=np.int32)
    table[used] = np.arange(corners, corners + len(used), dtype=np.int32)
    return table.take(addresses), first


def _grid_sites(
    visibility: VisibilityPolygons | CorrespondingPolygons,
    mesh: Mesh,
    levels: Levels,
    points: GridPoints,
) -> Sites:
    """Sites on the flat faces, with the normalised interpolated normals.

    Points on edges are found in whichever of the edge's faces pixels see; where polygons
    correspond, their outline is nevertheless one: see :func:`joined_outlines`.
    """
    n = _parts(levels.face).take(points.row)
    weight = np.stack([n - points.i - points.j, points.i, points.j], axis=-1) / n[:, None]
    weight = weight.astype(np.float32)
    face = levels.faces.take(points.row)
    position, normal, _ = places_in_faces(polygons_of(visibility), face, weight)
    return sites_in_faces(visibility, mesh, face, weight, position, normal, normal)
