"""Scenes in which cones must not see through thin things: a closed room, and a slab over ground.

Used by :mod:`experiments.cone_stages`.
"""

from typing import NamedTuple

import numpy as np
import trimesh

from jaxvis.reflectance import Material
from jaxvis.scene import Camera, Scene, build_scene


class Sheltered(NamedTuple):
    """A scene, what it hides from the sky, and what it does not."""

    scene: Scene
    inside: Camera
    """Sees hidden surfaces alone."""
    outside: Camera
    """Sees surfaces in the open alone."""


def room(side: float = 4.0, wall: float = 0.02, name: str = "room") -> Sheltered:
    """A closed box of walls, each with an inner and an outer face: no light can come in.

    Args:
        side: of the cube inside, in metres.
        wall: thickness of its walls, in metres.
    """
    inner = trimesh.creation.box((side,) * 3)
    inner.invert()
    outer = trimesh.creation.box((side + 2.0 * wall,) * 3)
    scene = _joined([inner, outer], name)
    inside = Camera((0.3 * side, 0.2 * side, 0.3 * side), (-side, -side, -side), (0, 1, 0), 1.2)
    outside = Camera((1.5 * side, 1.5 * side, 1.5 * side), (0, 0, 0), (0, 1, 0), 0.3)
    return Sheltered(scene, inside, outside)


def slab(
    width: float = 20.0,
    length: float = 20.0,
    height: float = 2.0,
    thickness: float = 0.1,
    extent: float = 60.0,
    name: str = "slab",
) -> Sheltered:
    """A thin plate over flat ground; much longer than wide, a bridge. All in metres."""
    count = 33
    steps = np.linspace(-0.5 * extent, 0.5 * extent, count)
    x, z = np.meshgrid(steps, steps, indexing="ij")
    points = np.stack([x, np.zeros_like(x), z], axis=-1).reshape(-1, 3)
    corner = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).reshape(-1)
    faces = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + count], axis=-1),
            np.stack([corner + 1, corner + count + 1, corner + count], axis=-1),
        ]
    )
    ground = trimesh.Trimesh(points, faces, process=False)
    plate = trimesh.creation.box((width, thickness, length))
    plate.apply_translation((0.0, height + 0.5 * thickness, 0.0))
    scene = _joined([ground, plate], name)
    inside = Camera((0.0, 0.4 * height, 0.4 * height), (0, 0, 0), (0, 1, 0), 0.6)
    far = 0.4 * extent
    outside = Camera((far, 0.4 * height, far + 0.4 * height), (far, 0, far), (0, 1, 0), 0.6)
    return Sheltered(scene, inside, outside)


def share_of_sky(width: float, length: float, height: float) -> float:
    """Irradiance from a uniform sky below the middle of a slab, as a share of that in the open: 1
    less the view factor of a rectangle from a place below its centre."""
    x, y = 0.5 * width / height, 0.5 * length / height
    a, b = np.hypot(1.0, x), np.hypot(1.0, y)
    return float(1.0 - 2.0 / np.pi * (x / a * np.arctan(y / a) + y / b * np.arctan(x / b)))


def _joined(parts: list[trimesh.Trimesh], name: str) -> Scene:
    positions, triangles, first = [], [], 0
    for part in parts:
        positions.append(np.asarray(part.vertices))
        triangles.append(np.asarray(part.faces) + first)
        first += len(part.vertices)
    return build_scene(
        np.concatenate(positions),
        np.concatenate(triangles),
        materials=(Material((0.8, 0.8, 0.8)),),
        crease_angle=0.0,
        name=name,
    )
