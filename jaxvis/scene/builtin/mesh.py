"""Meshes under construction: grids of quads, joined and welded into one (host)."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float64, Int

from jaxvis.scene.weld import equal_rows

POSITION_STEPS = 1e6 * np.sqrt(0.5)
"""Positions that agree when rounded to this fraction are one. Irrational, so that no coordinate
that a person would write lies on the edge between two steps, where rounding errors part equals."""

NORMAL_STEPS = 1e4 * np.sqrt(0.5)


Vector = Sequence[float | int] | Float64[np.ndarray, "3"]


class Mesh(NamedTuple):
    """Triangles with one normal per vertex; where normals differ, vertices are doubled."""

    positions: Float64[np.ndarray, "vertices 3"]
    normals: Float64[np.ndarray, "vertices 3"]
    triangles: Int[np.ndarray, "triangles 3"]

    def moved(self, offset: Vector, quarter_turns: int = 0) -> "Mesh":
        """Turned about +Y by quarter turns (+Z to +X), then translated. Turns are exact."""
        cosine, sine = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[quarter_turns % 4]
        turn = np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])
        positions = self.positions @ turn.T + np.asarray(offset, np.float64)
        return Mesh(positions, self.normals @ turn.T, self.triangles)

    def mirrored(self) -> "Mesh":
        """Reflected in the plane z = 0, its fronts still in front."""
        flip = np.array([1.0, 1.0, -1.0])
        return Mesh(self.positions * flip, self.normals * flip, self.triangles[:, ::-1])


def join(meshes: Iterable[Mesh]) -> Mesh:
    """One mesh of several; vertices stay as they are."""
    meshes = list(meshes)
    starts = np.cumsum([0, *(len(mesh.positions) for mesh in meshes[:-1])])
    return Mesh(
        np.concatenate([mesh.positions for mesh in meshes]),
        np.concatenate([mesh.normals for mesh in meshes]),
        np.concatenate(
            [mesh.triangles + start for mesh, start in zip(meshes, starts, strict=True)]
        ),
    )


def weld(mesh: Mesh) -> Mesh:
    """Makes equal what should be equal: positions first, then the normals at each position.

    Parts that meet along an edge compute it with different roundings; afterwards they share it to
    the last bit. Triangles stay in their order and none is dropped.
    """
    first, place = equal_rows(*np.rint(mesh.positions * POSITION_STEPS).T)
    positions = mesh.positions[first][place]
    first, vertex = equal_rows(place, *np.rint(mesh.normals * NORMAL_STEPS).T)
    return Mesh(positions[first], mesh.normals[first], vertex[mesh.triangles])


def unit(vectors: Float[np.ndarray, "*points axes"]) -> Float64[np.ndarray, "*points axes"]:
    """Vectors of length 1; zero stays zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros(vectors.shape), where=length > 0.0)


def grid(
    points: Float64[np.ndarray, "rows columns 3"], normals: Float64[np.ndarray, "rows columns 3"]
) -> Mesh:
    """Two triangles per quad of a grid of points, facing the way that most of the normals say.

    Each quad is cut along its shorter diagonal. Triangles that collapse because a row or a column
    of the grid is a single point are left out.

    Args:
        points: positions.
        normals: unit normals, on the front.
    """
    rows, columns = points.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    a, b, c, d = (corner.reshape(-1) for corner in (a, b, c, d))
    flat, flat_normals = points.reshape(-1, 3), normals.reshape(-1, 3)
    across = np.linalg.norm(flat[c] - flat[a], axis=-1)
    other = np.linalg.norm(flat[d] - flat[b], axis=-1)
    straight = (across <= other * (1.0 + 1e-9))[:, None]
    one = np.where(straight, np.stack([a, b, c], -1), np.stack([a, b, d], -1))
    two = np.where(straight, np.stack([a, c, d], -1), np.stack([b, c, d], -1))
    triangles = np.stack([one, two], axis=1).reshape(-1, 3)

    corners = flat[triangles]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    extent = float(np.max(np.ptp(flat, axis=0)))
    kept = np.linalg.norm(area, axis=-1) > 1e-12 * extent**2
    triangles, area = triangles[kept], area[kept]
    facing = np.sum(area * flat_normals[triangles].sum(axis=1))
    return Mesh(flat, flat_normals, triangles if facing > 0.0 else triangles[:, ::-1])


def grid_normals(
    points: Float64[np.ndarray, "rows columns 3"],
) -> Float64[np.ndarray, "rows columns 3"]:
    """Unit normals of a smooth grid from central differences: along the rows x down the columns."""
    down, along = np.gradient(points, axis=0), np.gradient(points, axis=1)
    return unit(np.cross(along, down))


def rectangle(
    corner: Vector,
    first: Vector,
    second: Vector,
    cells: tuple[int, int],
) -> Mesh:
    """A flat parallelogram from a corner along two edge vectors; its front is first x second."""
    u = np.linspace(0.0, 1.0, cells[0] + 1)[:, None, None]
    v = np.linspace(0.0, 1.0, cells[1] + 1)[None, :, None]
    points = np.asarray(corner, np.float64) + u * np.asarray(first) + v * np.asarray(second)
    normal = unit(np.cross(first, second))
    return grid(points, np.broadcast_to(normal, points.shape))


def fan(centre: Vector, ring: Float64[np.ndarray, "columns 3"], normal: Vector) -> Mesh:
    """A flat cap: triangles from a centre to a closed ring, whose last point repeats its first."""
    middle = np.broadcast_to(np.asarray(centre, np.float64), ring.shape)
    points = np.stack([middle, ring])
    return grid(points, np.broadcast_to(unit(np.asarray(normal, np.float64)), points.shape))
