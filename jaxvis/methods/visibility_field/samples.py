"""Points on the surface, and the rays that leave from them to look around (host)."""

from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32

from jaxvis.compiled import compiled
from jaxvis.methods.visibility_field.grid import Grid, cell_of
from jaxvis.scene import Scene
from jaxvis.scene.rays import offset_origins

Sampling = Literal["random", "stratified"]

LONGEST_PIECE = 0.5
"""Longest edge of a piece, in cells: few pieces reach far into the next cell."""

MOST_PIECES = 1 << 23
"""Pieces take about 100 bytes each while they are sorted."""

PIECES_AT_ONCE = 1 << 17
"""Pieces whose cells are found together: bounds memory."""

EVEN = 0.5
"""Share of the stratified samples that goes to all cells alike, the rest going by area: cells with
little surface (leaves, chains, ornaments) need samples too."""

DEEPEST = 128
"""Pieces that wait to be cut; twice the bisections that take float32's range."""


class Pieces(NamedTuple):
    """Flat pieces of the surface to draw samples from.

    ``cumulative`` are the sampling weights of all pieces up to each, the last one 1.
    """

    corners: Float32[np.ndarray, "pieces 3 3"]
    triangle: Int32[np.ndarray, "pieces"]
    cumulative: Float64[np.ndarray, "pieces"]


class Samples(NamedTuple):
    """Surface points: where their rays start, the side they are on, and the turn (radians) of
    their rays about the normal. ``cells`` are the numbers of the cells that hold the origins."""

    origins: Float32[np.ndarray, "samples 3"]
    normals: Float32[np.ndarray, "samples 3"]
    angles: Float32[np.ndarray, "samples"]
    cells: Int32[np.ndarray, "samples"]

    def by_cell(self) -> "Samples":
        """Sorted by cell: neighbours meet the same triangles, which are then in cache."""
        order = np.argsort(self.cells, kind="stable")
        return Samples(*(array.take(order, axis=0) for array in self))


def surface_pieces(scene: Scene, grid: Grid, sampling: Sampling) -> Pieces:
    """What samples are drawn from.

    ``random``: the triangles, by area (paper 001, section 3.2). ``stratified``: triangles cut into
    pieces smaller than a cell, ordered by cell, weighted so that each cell gets its share.
    """
    corners = scene.positions[scene.triangles]
    if sampling == "random":
        triangle = np.arange(len(corners), dtype=np.int32)
        return Pieces(corners, triangle, _cumulative(areas(corners)))
    corners, triangle = cut(corners, LONGEST_PIECE * float(grid.edge), MOST_PIECES)
    cells = _cells(corners, grid)
    order = np.argsort(cells, kind="stable")
    corners, triangle = corners[order], triangle[order]
    return Pieces(corners, triangle, _cumulative(cell_weights(cells[order], areas(corners))))


def cell_weights(
    cells: Int32[np.ndarray, "pieces"], area: Float64[np.ndarray, "pieces"]
) -> Float64[np.ndarray, "pieces"]:
    """Share of the samples that each piece gets, pieces being ordered by cell.

    Uniform within a cell. The share :data:`EVEN` is divided evenly among the cells, the rest by
    area.
    """
    row = np.cumsum(np.diff(cells, prepend=cells[0]) != 0)
    in_cell = np.bincount(row, area)
    # Slivers may lose their area when they are cut.
    even = np.divide(EVEN / len(in_cell), in_cell, out=np.zeros_like(in_cell), where=in_cell > 0.0)
    return area * (even + (1.0 - EVEN) / in_cell.sum())[row]


def two_sided(scene: Scene) -> Bool[np.ndarray, "triangles"]:
    """Which triangles are seen, and sampled, from both sides."""
    return np.array([material.two_sided for material in scene.materials])[scene.material_ids]


class Surface(NamedTuple):
    """What :func:`draw` needs to know of a scene, collected once."""

    pieces: Pieces
    normals: Float32[np.ndarray, "triangles 3"]
    two_sided: Bool[np.ndarray, "triangles"]
    systematic: bool
    """Whether sample i of n falls into the i-th n-th of the weights."""

    @classmethod
    def of(cls, scene: Scene, grid: Grid, sampling: Sampling) -> "Surface":
        pieces = surface_pieces(scene, grid, sampling)
        sides = two_sided(scene)
        return cls(pieces, scene.geometric_normals, sides, sampling == "stratified")


def draw(surface: Surface, grid: Grid, first: int, last: int, *, total: int, seed: int) -> Samples:
    """Samples ``first`` up to ``last`` of ``total``, always the same for a ``seed`` and ``first``.

    Uniform over each piece; on two-sided materials a coin decides the side.
    """
    rng = np.random.default_rng((seed, first))
    count = last - first
    along = rng.random(count)
    u, v, turn, coin = rng.random((4, count), np.float32)
    if surface.systematic:
        along = (np.arange(first, last) + along) / total
    corners, triangle, cumulative = surface.pieces
    # Weights add up to 1 but for rounding.
    piece = np.minimum(np.searchsorted(cumulative, along, side="right"), len(cumulative) - 1)
    root = np.sqrt(u)
    barycentrics = np.stack([1.0 - root, root * (1.0 - v), root * v], axis=-1)
    points = np.einsum("nk,nka->na", barycentrics, corners.take(piece, axis=0))
    face = triangle.take(piece)
    normals = surface.normals.take(face, axis=0)
    normals[surface.two_sided.take(face) & (coin < 0.5)] *= -1.0
    origins = offset_origins(points, normals)
    return Samples(
        origins, normals, np.float32(2.0 * np.pi) * turn, np.asarray(cell_of(grid, origins))
    )


def hemisphere_rays(
    samples: Samples, block: slice, local: Float32[np.ndarray, "directions 3"]
) -> tuple[Float32[np.ndarray, "rays 3"], Float32[np.ndarray, "rays 3"]]:
    """Origins and directions of the rays of a block of samples: ``local`` directions of the
    hemisphere about +z, turned by each sample's angle and into its frame."""
    origins, normals = samples.origins[block], samples.normals[block]
    rays = np.empty((2, len(origins) * len(local), 3), np.float32)
    _turn(origins, normals, samples.angles[block], local, rays[0], rays[1])
    return rays[0], rays[1]


@compiled
def _turn(origins, normals, angles, local, starts, directions):
    """Fills ``starts`` and ``directions``; frames are those of jaxvis.sphere.frames."""
    one = np.float32(1.0)
    rays = len(local)
    for sample in range(len(normals)):
        # Components one by one: taking rows of arrays is ten times as slow.
        x, y, z = normals[sample, 0], normals[sample, 1], normals[sample, 2]
        sign = one if z >= 0.0 else -one
        a = -one / (sign + z)
        b = x * y * a
        tx, ty, tz = one + sign * x * x * a, sign * b, -sign * x
        bx, by, bz = b, sign + y * y * a, -y
        cosine, sine = np.cos(angles[sample]), np.sin(angles[sample])
        ux, uy, uz = cosine * tx + sine * bx, cosine * ty + sine * by, cosine * tz + sine * bz
        vx, vy, vz = cosine * bx - sine * tx, cosine * by - sine * ty, cosine * bz - sine * tz
        for ray in range(rays):
            p, q, r = local[ray, 0], local[ray, 1], local[ray, 2]
            k = sample * rays + ray
            directions[k, 0] = p * ux + q * vx + r * x
            directions[k, 1] = p * uy + q * vy + r * y
            directions[k, 2] = p * uz + q * vz + r * z
            for axis in range(3):
                starts[k, axis] = origins[sample, axis]


@compiled
def areas(corners):
    """Areas (float64) of triangles [pieces, 3, 3]."""
    area = np.empty(len(corners), np.float64)
    edges = np.empty((2, 3), np.float64)
    for t in range(len(corners)):
        for k in range(2):
            for axis in range(3):
                edges[k, axis] = np.float64(corners[t, k + 1, axis]) - corners[t, 0, axis]
        (ax, ay, az), (bx, by, bz) = edges[0], edges[1]
        x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        area[t] = 0.5 * np.sqrt(x * x + y * y + z * z)
    return area


def cut(
    corners: Float32[np.ndarray, "triangles 3 3"], length: float, most: int
) -> tuple[Float32[np.ndarray, "pieces 3 3"], Int32[np.ndarray, "pieces"]]:
    """Bisects longest edges until none is longer than ``length``.

    Doubles the length for as long as that would make more than ``most`` pieces and more than there
    are triangles.

    Returns:
        (corners of the pieces, the triangle that each is of)
    """
    most = max(most, len(corners))
    # Memory that is not written to is not taken.
    pieces, triangle = np.empty((most, 3, 3), np.float32), np.empty(most, np.int32)
    while (count := _bisect(corners, length, pieces, triangle)) > most:
        length *= 2.0
    return pieces[:count], triangle[:count]


@compiled
def _bisect(corners, length, pieces, triangle):
    """Writes the pieces of all triangles and returns their number; one more than there is room
    for where there are more."""
    waiting = np.empty((DEEPEST, 3, 3), np.float64)
    count = 0
    for t in range(len(corners)):
        waiting[0] = corners[t]
        left = 1
        while left > 0:
            piece = waiting[left - 1]
            longest, edge = length * length, -1
            for k in range(3):
                squared = 0.0
                for axis in range(3):
                    squared += (piece[(k + 1) % 3, axis] - piece[k, axis]) ** 2
                if squared > longest:
                    longest, edge = squared, k
            if edge < 0:
                if count == len(pieces):
                    return count + 1
                pieces[count], triangle[count] = piece, t
                count += 1
                left -= 1
            else:
                after = (edge + 1) % 3
                waiting[left] = piece
                for axis in range(3):
                    middle = 0.5 * (piece[edge, axis] + piece[after, axis])
                    waiting[left, edge, axis] = middle
                    piece[after, axis] = middle
                left += 1
    return count


def _cells(corners: Float32[np.ndarray, "pieces 3 3"], grid: Grid) -> Int32[np.ndarray, "pieces"]:
    """The cells that hold the pieces' centroids."""
    cells = np.empty(len(corners), np.int32)
    for start in range(0, len(corners), PIECES_AT_ONCE):
        part = slice(start, start + PIECES_AT_ONCE)
        a, b, c = np.moveaxis(corners[part], 1, 0)
        cells[part] = cell_of(grid, (a + b + c) * np.float32(1.0 / 3.0))
    return cells


def _cumulative(weights: Float64[np.ndarray, "pieces"]) -> Float64[np.ndarray, "pieces"]:
    cumulative = np.cumsum(weights)
    cumulative /= cumulative[-1]
    return cumulative
