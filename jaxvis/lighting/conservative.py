"""From cubes and angular probes to lat-long maps without aliasing: exact areas of overlap.

In the plane of u and cos(theta) a lat-long texel is a rectangle and area is solid angle. The area
that a source texel shares with each rectangle is a line integral around the source texel, cut at
the rectangle's sides (P. W. Jones 1999, "First- and second-order conservative remapping schemes
for grids in spherical coordinates"). Neighbours walk their common edge in opposite directions over
the same points, so nothing is lost or counted twice, at whatever resolution. Host code in float64.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float, Int

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


def _overlaps(
    corners: Float[np.ndarray, "texels vertices 3"], height: int
) -> tuple[Int[np.ndarray, "overlaps"], Int[np.ndarray, "overlaps"], Float[np.ndarray, "overlaps"]]:
    """(lat-long texel, polygon, signed solid angle): to be added up."""
    u, along, cosines, normal, flat = _edges(corners)
    sides = u.shape[1]
    fine = 2 * height * -(-_FINE_WIDTH // (2 * height))

    # Cut the edges at the columns.
    start, end = u.ravel(), (u + along).ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    first = np.floor(low * fine).astype(np.int64)
    count = np.where(high > low, np.ceil(high * fine).astype(np.int64) - first, 0)
    edge, offset = _expand(count)
    column = first[edge] + offset
    left, right = np.maximum(low[edge], column / fine), np.minimum(high[edge], (column + 1) / fine)
    keep = right > left
    edge, column, left, right = edge[keep], column[keep], left[keep], right[keep]
    forward = end[edge] > start[edge]
    starting, ending = cosines[0].ravel()[edge], cosines[1].ravel()[edge]
    lowest = np.where(forward, starting, ending)
    highest = np.where(forward, ending, starting)
    plane = normal.reshape(-1, 3)[edge]
    level = flat.ravel()[edge]
    at_left = np.where(level | (left == low[edge]), lowest, _cosine_on(plane, left))
    at_right = np.where(level | (right == high[edge]), highest, _cosine_on(plane, right))
    signed = np.where(forward, left - right, right - left)

    # Between the top and the bottom row of its polygon, each piece has some area beneath it.
    polygon = edge // sides
    top = np.full(len(corners), -1.0)
    bottom = np.full(len(corners), 1.0)
    np.maximum.at(top, polygon, np.maximum(at_left, at_right))
    np.minimum.at(bottom, polygon, np.minimum(at_left, at_right))
    first_row, last_row = _row(top, height), _row(bottom, height)
    piece, offset = _expand((last_row - first_row + 1)[polygon])
    row = first_row[polygon[piece]] + offset
    lines = np.cos(np.pi * np.arange(height + 1) / height)
    mean = _mean_above(at_left[piece], at_right[piece], lines[row + 1], lines[row])
    column = (column * (2 * height) // fine) % (2 * height)
    return row * (2 * height) + column[piece], polygon[piece], 2.0 * np.pi * signed[piece] * mean


def _edges(
    corners: Float[np.ndarray, "texels vertices 3"],
) -> tuple[
    Float[np.ndarray, "texels sides"],
    Float[np.ndarray, "texels sides"],
    tuple[Float[np.ndarray, "texels sides"], Float[np.ndarray, "texels sides"]],
    Float[np.ndarray, "texels sides 3"],
    np.ndarray,
]:
    """Edges in the plane of u and cos(theta), with one more that closes polygons around a pole.

    Returns (u at the start, signed width in u, cosines at start and end, normal of the great
    circle, whether the edge runs along a pole, where the cosine is constant).
    """
    x, y, z = np.moveaxis(corners, -1, 0)
    pole = np.hypot(x, z) < 1e-9
    u = np.arctan2(x, -z) / (2.0 * np.pi)
    u = np.where(pole, np.roll(u, 1, axis=1), u)  # up a meridian, along the pole, down another
    width = np.roll(u, -1, axis=1) - u
    short = width - np.round(width)
    # Counter-clockwise polygons have the north pole above them and the south pole below.
    side = -np.sign(y)
    along = np.where(pole, side * np.mod(side * width, 1.0), short)
    following = np.roll(corners, -1, axis=1)
    normal = np.cross(corners, following)
    meridian = np.abs(normal[..., 1]) <= 1e-9 * np.linalg.norm(normal, axis=-1)
    along = np.where(meridian & ~pole, 0.0, along)

    turns = np.round(along.sum(axis=1, keepdims=True))  # of polygons with a pole inside
    closing = np.sign(y.sum(axis=1, keepdims=True))
    ends = np.where(pole, y, following[..., 1])
    return (
        np.append(u, u[:, :1] + turns, axis=1),
        np.append(along, -turns, axis=1),
        (np.append(y, closing, axis=1), np.append(ends, closing, axis=1)),
        np.append(normal, np.zeros_like(normal[:, :1]), axis=1),
        np.append(pole, np.ones_like(pole[:, :1]), axis=1),
    )


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
