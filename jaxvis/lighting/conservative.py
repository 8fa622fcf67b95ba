"""From cubes and angular probes to lat-long maps without aliasing: exact areas of overlap.

In the plane of u and cos(theta) a lat-long texel is a rectangle and area is solid angle. The area
that a source texel shares with each rectangle is a line integral around the source texel, cut at
the rectangle's sides (P. W. Jones 1999, "First- and second-order conservative remapping schemes
for grids in spherical coordinates"). Neighbours walk their common edge in opposite directions over
the same points, so nothing is lost or counted twice, at whatever resolution. Host code in float64.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxvis.lighting.projections import Projection

_BLOCK = 1 << 14  # source texels handled at a time
_FINE_WIDTH = 2048  # arcs are cut into chords at least this fine (columns of the full turn)


def to_latlong(
    values: Float[np.ndarray, "texels channels"], projection: Projection, height: int
) -> tuple[Float[np.ndarray, "height width channels"], Float[np.ndarray, "texels"]]:
    """Averages over the texels of a lat-long map (width = 2 ``height``), and the solid angle (sr)
    of each source texel.

    A constant stays that constant to rounding and every source texel keeps its energy, wherever it
    is and whether the map becomes finer or coarser.
    """
    cells, channels = 2 * height * height, values.shape[1]
    energy = np.zeros((cells, channels))
    area = np.zeros(cells)
    solid_angles = np.zeros(len(values))
    for texels, corners in _polygons(projection):
        cell, texel, overlap = _overlaps(corners, height)
        area += np.bincount(cell, overlap, cells)
        solid_angles[texels] += np.bincount(texel, overlap, len(corners))
        light = values[texels][texel] * overlap[:, None]
        for channel in range(channels):
            energy[:, channel] += np.bincount(cell, light[:, channel], cells)
    averages = np.maximum(energy / area[:, None], 0.0)  # signed areas leave -1e-17 behind
    return averages.reshape(height, 2 * height, channels), np.maximum(solid_angles, 0.0)


def _polygons(
    projection: Projection,
) -> Iterator[tuple[Int[np.ndarray, "texels"], Float[np.ndarray, "texels vertices 3"]]]:
    """Texels, a block at a time, with their vertices: counter-clockwise in the picture."""
    size, pieces = projection.size, projection.edge_pieces
    place = 2.0 * np.arange(size * pieces + 1) / (size * pieces) - 1.0
    along, zero, full = np.arange(pieces), np.zeros(pieces, int), np.full(pieces, pieces)
    around_row = np.concatenate([along, full, full - along, zero])
    around_column = np.concatenate([zero, along, full, full - along])
    step = max(1, _BLOCK // size)
    for face in range(projection.faces):
        for first in range(0, size, step):
            rows = np.arange(first, min(first + step, size))
            lines = np.arange(rows[0] * pieces, (rows[-1] + 1) * pieces + 1)
            up, right = np.meshgrid(-place[lines], place, indexing="ij")
            grid = projection.directions(face, right, up)
            row = (rows - first)[:, None, None] * pieces + around_row
            column = np.arange(size)[None, :, None] * pieces + around_column
            corners = grid[row, column].reshape(-1, 4 * pieces, 3)
            yield (face * size + rows[0]) * size + np.arange(len(corners)), corners


class _Edges(NamedTuple):
    """Sides of polygons in the plane of u and cos(theta), polygon by polygon, ``[edges]``."""

    polygon: Int[np.ndarray, "edges"]
    start: Float[np.ndarray, "edges"]
    end: Float[np.ndarray, "edges"]
    cosine_at_start: Float[np.ndarray, "edges"]
    cosine_at_end: Float[np.ndarray, "edges"]
    normal: Float[np.ndarray, "edges 3"]
    level: Bool[np.ndarray, "edges"]  # along a pole, not on a great circle


class _Chords(NamedTuple):
    """Pieces of edges within one fine column, straight from left to right, ``[chords]``."""

    polygon: Int[np.ndarray, "chords"]
    column: Int[np.ndarray, "chords"]
    width: Float[np.ndarray, "chords"]  # negative where the walk goes to the left
    at_left: Float[np.ndarray, "chords"]
    at_right: Float[np.ndarray, "chords"]


def _overlaps(
    corners: Float[np.ndarray, "texels vertices 3"], height: int
) -> tuple[Int[np.ndarray, "overlaps"], Int[np.ndarray, "overlaps"], Float[np.ndarray, "overlaps"]]:
    """(lat-long texel, polygon, signed solid angle): to be added up."""
    width = 2 * height
    per_column = -(-_FINE_WIDTH // width)
    chords = _chords(_edges(corners), width * per_column)

    # Each chord has some area beneath it in every row from its polygon's top to its bottom.
    top, bottom = np.full(len(corners), -1.0), np.full(len(corners), 1.0)
    np.maximum.at(top, chords.polygon, np.maximum(chords.at_left, chords.at_right))
    np.minimum.at(bottom, chords.polygon, np.minimum(chords.at_left, chords.at_right))
    first, last = _row(top, height), _row(bottom, height)
    chord, offset = _expand((last - first + 1)[chords.polygon])
    polygon = chords.polygon[chord]
    row = first[polygon] + offset
    lines = np.cos(np.pi * np.arange(height + 1) / height)
    mean = _mean_above(chords.at_left[chord], chords.at_right[chord], lines[row + 1], lines[row])
    # Counter-clockwise, a polygon's upper side is walked to the left and adds.
    overlap = -2.0 * np.pi * chords.width[chord] * mean
    column = (chords.column // per_column) % width
    return row * width + column[chord], polygon, overlap


def _edges(corners: Float[np.ndarray, "texels vertices 3"]) -> _Edges:
    """The polygons' sides, with one more for each that closes it around a pole."""
    x, y, z = np.moveaxis(corners, -1, 0)
    pole = np.hypot(x, z) < 1e-9
    u = np.arctan2(x, -z) / (2.0 * np.pi)
    u = np.where(pole, np.roll(u, 1, axis=1), u)  # up a meridian, along the pole, down another
    width = np.roll(u, -1, axis=1) - u
    # Counter-clockwise polygons pass the north pole to the left and the south pole to the right.
    onward = -np.sign(y)
    along = np.where(pole, onward * np.mod(onward * width, 1.0), width - np.round(width))
    following = np.roll(corners, -1, axis=1)
    normal = np.cross(corners, following)
    meridian = np.abs(normal[..., 1]) <= 1e-9 * np.linalg.norm(normal, axis=-1)
    along = np.where(meridian & ~pole, 0.0, along)

    turns = np.round(along.sum(axis=1, keepdims=True))  # a full one around a pole inside
    nearest_pole = np.sign(y.sum(axis=1, keepdims=True))
    start = np.append(u, u[:, :1] + turns, axis=1)
    end = start + np.append(along, -turns, axis=1)
    at_end = np.where(pole, y, following[..., 1])
    return _Edges(
        np.repeat(np.arange(len(corners)), start.shape[1]),
        start.ravel(),
        end.ravel(),
        np.append(y, nearest_pole, axis=1).ravel(),
        np.append(at_end, nearest_pole, axis=1).ravel(),
        np.append(normal, np.zeros_like(normal[:, :1]), axis=1).reshape(-1, 3),
        np.append(pole, np.ones_like(turns, bool), axis=1).ravel(),
    )


def _chords(edges: _Edges, columns: int) -> _Chords:
    """The edges cut at the sides of so many columns."""
    low, high = np.minimum(edges.start, edges.end), np.maximum(edges.start, edges.end)
    first = np.floor(low * columns).astype(np.int64)
    count = np.where(high > low, np.ceil(high * columns).astype(np.int64) - first, 0)
    edge, offset = _expand(count)
    column = first[edge] + offset
    left = np.maximum(low[edge], column / columns)
    right = np.minimum(high[edge], (column + 1) / columns)
    keep = right > left
    edge, column, left, right = edge[keep], column[keep], left[keep], right[keep]

    forward = (edges.end > edges.start)[edge]
    begin, finish = edges.cosine_at_start[edge], edges.cosine_at_end[edge]
    level, normal = edges.level[edge], edges.normal[edge]
    at_low, at_high = np.where(forward, begin, finish), np.where(forward, finish, begin)
    at_left = np.where(level | (left == low[edge]), at_low, _cosine_on(normal, left))
    at_right = np.where(level | (right == high[edge]), at_high, _cosine_on(normal, right))
    width = np.where(forward, right - left, left - right)
    return _Chords(edges.polygon[edge], column, width, at_left, at_right)


def _cosine_on(
    normal: Float[np.ndarray, "pieces 3"], u: Float[np.ndarray, "pieces"]
) -> Float[np.ndarray, "pieces"]:
    """cos(theta) of great circles at the meridian ``u``."""
    phi = 2.0 * np.pi * u
    rise = normal[:, 2] * np.cos(phi) - normal[:, 0] * np.sin(phi)
    y = normal[:, 1]
    return rise * np.sign(y) / np.maximum(np.hypot(rise, y), 1e-300)


def _mean_above(
    begin: Float[np.ndarray, "pieces"],
    end: Float[np.ndarray, "pieces"],
    low: Float[np.ndarray, "pieces"],
    high: Float[np.ndarray, "pieces"],
) -> Float[np.ndarray, "pieces"]:
    """Mean of clip(c, low, high) - low while c runs linearly from ``begin`` to ``end``."""
    slope = end - begin
    level = np.abs(slope) < 1e-6 * (high - low)
    integral = _integral_above(end, low, high) - _integral_above(begin, low, high)
    middle = np.clip(0.5 * (begin + end), low, high) - low
    return np.where(level, middle, integral / np.where(level, 1.0, slope))


def _integral_above(
    c: Float[np.ndarray, "pieces"],
    low: Float[np.ndarray, "pieces"],
    high: Float[np.ndarray, "pieces"],
) -> Float[np.ndarray, "pieces"]:
    inside = np.clip(c, low, high) - low
    return 0.5 * inside * inside + (high - low) * np.maximum(c - high, 0.0)


def _row(cosine: Float[np.ndarray, "texels"], height: int) -> Int[np.ndarray, "texels"]:
    theta = np.arccos(np.clip(cosine, -1.0, 1.0))
    return np.clip((theta * (height / np.pi)).astype(np.int64), 0, height - 1)


def _expand(
    counts: Int[np.ndarray, "items"],
) -> tuple[Int[np.ndarray, "copies"], Int[np.ndarray, "copies"]]:
    """Each item as often as its count says: (item, 0 ... count - 1)."""
    item = np.repeat(np.arange(len(counts)), counts)
    return item, np.arange(len(item)) - np.repeat(np.cumsum(counts) - counts, counts)
