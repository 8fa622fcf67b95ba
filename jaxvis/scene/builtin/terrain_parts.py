"""Closed solids that the open world is built of: blocks, prisms, strips, turned ones (host)."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float64, Int

from jaxvis.scene.builtin.mesh import Mesh, join, unit
from jaxvis.scene.builtin.parameters import Number
from jaxvis.scene.normals import area_vectors, crease_normals
from jaxvis.scene.weld import equal_rows

Points = Float[np.ndarray, "points 2"] | Sequence[tuple[Number, Number]]


class Solid(NamedTuple):
    """A mesh and the material of each of its triangles."""

    mesh: Mesh
    materials: Int[np.ndarray, "triangles"]

    def placed(self, place: Sequence[Number], turn: Number = 0.0) -> "Solid":
        """Turned about +Y (+Z to +X) by radians, then moved."""
        one = np.ones(1)
        return instances(self, np.array([place], np.float64), turn * one, one, one)


def join_solids(solids: Iterable[Solid]) -> Solid:
    """One of several; vertices stay as they are."""
    solids = list(solids)
    materials = np.concatenate([solid.materials for solid in solids])
    return Solid(join(solid.mesh for solid in solids), materials)


def solid(
    corners: Float[np.ndarray, "triangles 3 3"],
    materials: Int[np.ndarray, "triangles"] | int,
    crease_angle: float = 0.6,
) -> Solid:
    """Loose triangles, welded where positions are equal to the last bit; those without area go.

    Args:
        corners: counter-clockwise seen from outside.
        materials: of each triangle, or of all.
        crease_angle: dihedral angle in radians from which an edge is sharp.
    """
    areas = area_vectors(corners)
    kept = np.linalg.norm(areas, axis=-1) > 1e-9
    corners, areas = corners[kept], areas[kept]
    materials = np.broadcast_to(materials, kept.shape)[kept]
    first, place = equal_rows(*corners.reshape(-1, 3).T)
    normals = crease_normals(place.reshape(-1, 3), areas, crease_angle).reshape(-1, 3)
    points = corners.reshape(-1, 3)[first][place]
    first, vertex = equal_rows(place, *np.rint(4096 * normals).T)
    return Solid(Mesh(points[first], normals[first], vertex.reshape(-1, 3)), materials)


def quads(
    a: Float[np.ndarray, "quads 3"],
    b: Float[np.ndarray, "quads 3"],
    c: Float[np.ndarray, "quads 3"],
    d: Float[np.ndarray, "quads 3"],
) -> Float64[np.ndarray, "triangles 3 3"]:
    """Two triangles of each quadrilateral a b c d, counter-clockwise."""
    return np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3, 3)


def block(
    xs: Sequence[Number] | Float64[np.ndarray, "xs"],
    ys: Sequence[Number] | Float64[np.ndarray, "ys"],
    zs: Sequence[Number] | Float64[np.ndarray, "zs"],
    filled: Bool[np.ndarray, "columns rows"] | None = None,
) -> tuple[Float64[np.ndarray, "triangles 3 3"], Int[np.ndarray, "triangles 4"]]:
    """Upright walls, floor and ceiling around the filled cells of a grid: a box, an L, a U.

    Args:
        xs, ys, zs: increasing cuts. Every face is cut alike, so that the surface is closed.
        filled: which cells of the plan [x, z] are solid; all if None. No two filled cells may meet
            in a corner alone.

    Returns:
        (corners, cells): of each triangle, and its cell's x, y and z numbers and the axis that it
        faces (0, 1 or 2; for axis 0 the x number counts cuts, not cells, and likewise).
    """
    xs, ys, zs = (np.asarray(cuts, np.float64) for cuts in (xs, ys, zs))
    if filled is None:
        filled = np.ones((len(xs) - 1, len(zs) - 1), bool)
    body = np.repeat(filled[:, None, :], len(ys) - 1, axis=1).astype(np.int8)
    corners, cells = [], []
    for axis in range(3):
        # From nothing to solid along the axis the face looks back, from solid to nothing ahead.
        step = np.diff(np.pad(body, [(int(axis == k),) * 2 for k in range(3)]), axis=axis)
        index = np.argwhere(step != 0)
        ahead = step[tuple(index.T)] < 0
        one, other = (axis + 1) % 3, (axis + 2) % 3
        face = []
        for du, dv in ((0, 0), (1, 0), (1, 1), (0, 1)):
            at = index.copy()
            at[:, one] += du
            at[:, other] += dv
            face.append(np.stack([xs[at[:, 0]], ys[at[:, 1]], zs[at[:, 2]]], axis=-1))
        a, b, c, d = face
        turned = ahead[:, None]
        corners.append(quads(a, np.where(turned, b, d), c, np.where(turned, d, b)))
        labels = np.concatenate([index, np.full((len(index), 1), axis)], axis=1)
        cells.append(np.repeat(labels, 2, axis=0))
    return np.concatenate(corners), np.concatenate(cells)


def box(size: Sequence[Number], place: Sequence[Number], material: int) -> Solid:
    """A closed box that stands on y = place[1], centred on place in x and z."""
    return boxes([size], [place], material)


def boxes(
    sizes: Sequence[Sequence[Number]], places: Sequence[Sequence[Number]], material: int
) -> Solid:
    """Boxes as in :func:`box`, each of its own, together."""
    unit_box = block([-0.5, 0.5], [0.0, 1.0], [-0.5, 0.5])[0]
    stretched = unit_box * np.asarray(sizes, np.float64)[:, None, None, :]
    moved = stretched + np.asarray(places, np.float64)[:, None, None, :]
    return solid(moved.reshape(-1, 3, 3), material)


def prism(
    profile: Points,
    ends: tuple[Number, Number],
    materials: Sequence[int],
    cap: int,
    inset: Sequence[Number] | None = None,
) -> Solid:
    """A convex profile (z, y) carried along x, closed at both ends.

    Args:
        profile: corners, clockwise with z to the right and y up.
        ends: least and greatest x.
        materials: of the side from each corner to the next.
        cap: material of the ends.
        inset: by how much the ends stay back at each corner (a hipped roof's ridge).
    """
    zy = np.asarray(profile, np.float64)
    back = np.zeros(len(zy)) if inset is None else np.asarray(inset, np.float64)
    low = np.stack([ends[0] + back, zy[:, 1], zy[:, 0]], axis=-1)
    high = np.stack([ends[1] - back, zy[:, 1], zy[:, 0]], axis=-1)
    sides = quads(low, np.roll(low, -1, 0), np.roll(high, -1, 0), high)
    fans = [
        np.stack([np.broadcast_to(end[0], end[1:-1].shape), *pair], axis=1)
        for end, pair in ((low, (low[2:], low[1:-1])), (high, (high[1:-1], high[2:])))
    ]
    ids = np.concatenate([np.repeat(materials, 2), np.full(2 * (len(zy) - 2), cap)])
    return solid(np.concatenate([sides, *fans]), ids)


def strip(
    x: Float[np.ndarray, "stations"],
    low: Float[np.ndarray, "stations"],
    high: Float[np.ndarray, "stations"],
    sides: tuple[Number, Number],
    materials: tuple[int, int],
) -> Solid:
    """What lies between two curves over x, closed: a bridge, its parapets.

    Args:
        x: increasing.
        low, high: heights of the underside and the top.
        sides: least and greatest z.
        materials: of the top, and of all else.
    """
    (near, far), ids = sides, []
    a, b, c, d = (
        np.stack([x, y, np.full_like(x, z)], axis=-1)
        for y, z in ((low, near), (low, far), (high, far), (high, near))
    )
    faces = [
        quads(b[:-1], b[1:], c[1:], c[:-1]),
        quads(a[1:], a[:-1], d[:-1], d[1:]),
        quads(a[:-1], a[1:], b[1:], b[:-1]),
        quads(a[:1], b[:1], c[:1], d[:1]),
        quads(b[-1:], a[-1:], d[-1:], c[-1:]),
        quads(c[:-1], c[1:], d[1:], d[:-1]),
    ]
    for number, face in enumerate(faces):
        ids.append(np.full(len(face), materials[0] if number == 5 else materials[1]))
    return solid(np.concatenate(faces), np.concatenate(ids))


def turned(profile: Points, around: int, material: int, crease_angle: float = 0.9) -> Solid:
    """A closed solid of revolution about +Y.

    Args:
        profile: (radius, y) from the axis below, outside, to the axis above.
        around: segments of the full turn.
        material: of all triangles.
        crease_angle: as in :func:`solid`.
    """
    radius, height = np.asarray(profile, np.float64).T[..., None]
    angle = 2.0 * np.pi * (np.arange(around + 1) % around) / around
    rings = np.stack(
        [
            radius * np.cos(angle),
            np.broadcast_to(height, (len(radius), around + 1)),
            radius * np.sin(angle),
        ],
        axis=-1,
    )
    below, above = rings[:-1], rings[1:]
    faces = quads(
        *(
            ring.reshape(-1, 3)
            for ring in (below[:, 1:], below[:, :-1], above[:, :-1], above[:, 1:])
        )
    )
    return solid(faces, material, crease_angle)


def instances(
    prototype: Solid,
    places: Float[np.ndarray, "copies 3"],
    turns: Float[np.ndarray, "copies"],
    widths: Float[np.ndarray, "copies"],
    heights: Float[np.ndarray, "copies"],
) -> Solid:
    """Copies of a solid, each stretched, turned about +Y and moved, all at once."""
    mesh = prototype.mesh
    x, y, z = mesh.positions.T
    nx, ny, nz = mesh.normals.T
    cosine, sine = np.cos(turns)[:, None], np.sin(turns)[:, None]
    wide, high = widths[:, None], heights[:, None]
    positions = np.stack(
        [wide * (cosine * x + sine * z), high * y, wide * (cosine * z - sine * x)], axis=-1
    )
    normals = np.stack(
        [(cosine * nx + sine * nz) / wide, ny / high, (cosine * nz - sine * nx) / wide], axis=-1
    )
    starts = len(x) * np.arange(len(places))
    triangles = mesh.triangles[None] + starts[:, None, None]
    return Solid(
        Mesh(
            (positions + places[:, None, :]).reshape(-1, 3),
            unit(normals).reshape(-1, 3),
            triangles.reshape(-1, 3),
        ),
        np.tile(prototype.materials, len(places)),
    )
