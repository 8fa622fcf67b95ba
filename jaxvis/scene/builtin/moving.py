"""From bodies with a pose in every frame to an Animation (host)."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int

from jaxvis.reflectance import Material, Reflectance
from jaxvis.scene.animation import Animation, Pose
from jaxvis.scene.build import build_scene
from jaxvis.scene.builtin.mesh import POSITION_STEPS, grid, grid_normals, unit
from jaxvis.scene.camera import Camera
from jaxvis.scene.normals import area_vectors
from jaxvis.scene.weld import equal_rows

Points = Float64[np.ndarray, "vertices 3"]
GridPoints = Float64[np.ndarray, "rows columns 3"]
TriangleValues = Float64[np.ndarray, "triangles 2"]


class Grid(NamedTuple):
    """Points in rows and columns, and their texture coordinates."""

    points: GridPoints
    uvs: Float64[np.ndarray, "rows columns 2"]


@dataclass(frozen=True, eq=False)
class Body:
    """Triangles of a smooth surface, with texture coordinates per corner.

    Vertices that coincide at rest are one: triangles name the first of them only. The others are
    left over, so that a body made of grids takes the grids' points as its vertices.
    """

    triangles: Int[np.ndarray, "triangles 3"]
    uvs: Float64[np.ndarray, "triangles 3 2"]
    materials: Int[np.ndarray, "triangles"]

    def posed(self, positions: Points) -> Pose:
        """The positions, with the area-weighted normals of the triangles there."""
        area = np.repeat(area_vectors(positions[self.triangles]), 3, axis=0)
        corner = self.triangles.reshape(-1)
        total = [np.bincount(corner, area[:, k], len(positions)) for k in range(3)]
        return positions, unit(np.stack(total, axis=-1))


def body(
    grids: Iterable[Grid],
    material: int | Callable[[TriangleValues], Int[np.ndarray, "triangles"]],
    normals: Callable[[GridPoints], GridPoints] = grid_normals,
    closed: bool = False,
) -> Body:
    """A body of grids of points at rest.

    Args:
        grids: what it is made of. The vertices are the points of the first grid row by row, then
            those of the second, and so on.
        material: index of the material, or a function of the triangles' middle texture coordinates
            that gives it.
        normals: of a grid of points; they only say which side is the front.
        closed: the grids enclose a volume, and their outside is the front whatever ``normals`` say.
    """
    triangles, uvs, points = [], [], []
    start = 0
    for place in grids:
        faces = grid(place.points, normals(place.points)).triangles
        triangles.append(faces + start)
        uvs.append(place.uvs.reshape(-1, 2)[faces])
        points.append(place.points.reshape(-1, 3))
        start += points[-1].shape[0]
    rest, corners = np.concatenate(points), np.concatenate(uvs)
    first, same = equal_rows(*np.rint(rest * POSITION_STEPS).T)
    middle = corners.mean(axis=1)
    of = material(middle) if callable(material) else np.full(len(middle), material)
    faces = first[same][np.concatenate(triangles)]
    a, b, c = np.moveaxis(rest[faces], 1, 0)
    if closed and np.sum(a * np.cross(b, c)) < 0.0:
        faces, corners = faces[:, ::-1], corners[:, ::-1]
    return Body(faces, corners, np.asarray(of))


def animate(
    name: str,
    bodies: Sequence[Body],
    pose: Callable[[int], Sequence[Pose]],
    *,
    materials: Sequence[Material],
    reflectance: Reflectance,
    camera: Camera,
    frames: int,
    frames_per_second: float = 24.0,
) -> Animation:
    """An animation of bodies.

    Args:
        pose: positions and normals of each body's vertices in a frame, in world coordinates.

    Raises:
        ValueError: vertices of frame 0 coincide that are not the same.
    """

    def whole(frame: int) -> Pose:
        positions, normals = zip(*pose(frame), strict=True)
        return np.concatenate(positions), np.concatenate(normals)

    positions, normals = whole(0)
    counts = [len(place) for place, _ in pose(0)]
    starts = np.cumsum([0, *counts[:-1]])
    triangles = np.concatenate([b.triangles + s for b, s in zip(bodies, starts, strict=True)])
    base = build_scene(
        positions,
        triangles,
        normals=normals[triangles],
        uvs=np.concatenate([b.uvs for b in bodies]),
        materials=materials,
        material_ids=np.concatenate([b.materials for b in bodies]),
        reflectance=reflectance,
        camera=camera,
        name=name,
    )
    # The scene numbers its vertices anew. Frame 0 must not weld what parts later.
    corners = base.triangles.reshape(-1)
    source = np.zeros(len(base.positions), np.int64)
    source[corners] = triangles.reshape(-1)
    if base.notes or not np.array_equal(source[corners], triangles.reshape(-1)):
        raise ValueError(f"{name}: frame 0 joins vertices of different bodies or loses triangles")

    def of_vertices(frame: int) -> Pose:
        positions, normals = whole(frame)
        return positions[source], normals[source]

    part = np.repeat(np.arange(len(bodies)), counts)[source].astype(np.int32)
    return Animation(base, of_vertices, part, frames, frames_per_second)
