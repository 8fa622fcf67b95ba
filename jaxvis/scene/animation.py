"""Scenes that move: the same vertices at other places in every frame."""

import contextlib
import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from numbers import Integral
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxvis.scene.scene import Scene

Pose = tuple[Float[np.ndarray, "vertices 3"], Float[np.ndarray, "vertices 3"]]
"""Positions in world coordinates, and unit normals, of a scene's vertices."""


@dataclass(frozen=True, eq=False)
class Animation:
    """A scene whose vertices move. Triangles, materials, camera and origin stay the same.

    A vertex keeps its number from frame to frame, so that what is stored for it can be carried
    over.
    """

    base: Scene
    """The scene of frame 0."""
    pose: Callable[[int], Pose]
    """Where the vertices of ``base`` are in a frame, in world coordinates. A pure function."""
    parts: Int[np.ndarray, "vertices"]
    """Which rigid or deforming body each vertex belongs to."""
    frames: int = 1
    frames_per_second: float = 24.0

    def scene(self, frame: int) -> Scene:
        """The scene of a frame, with its own tracer and bounds; frame 0 is ``base`` itself.

        Raises:
            ValueError: there is no such frame.
            InvalidScene: the pose is not finite, or flattens a triangle.
        """
        frame = self.checked(frame)
        if frame == 0:
            return self.base
        _return_freed_memory()
        positions, normals = self.pose(frame)
        return self.base.with_positions(positions - self.base.origin, normals)

    def moved(self, first: int, second: int) -> Bool[np.ndarray, "vertices"]:
        """Which vertices differ, in position or normal, between two frames."""
        return moved_vertices(self.scene(first), self.scene(second))

    def checked(self, frame: Any) -> int:
        """``frame`` as an integer.

        Raises:
            ValueError: the animation has no such frame.
        """
        whole = isinstance(frame, Integral) and not isinstance(frame, bool)
        if not whole or not 0 <= int(frame) < self.frames:
            name = self.base.name
            if self.frames == 1:
                raise ValueError(f"scene {name!r} does not move: only frame 0, got {frame!r}")
            raise ValueError(f"scene {name!r} has frames 0 to {self.frames - 1}, got {frame!r}")
        return int(frame)


def _return_freed_memory() -> None:
    """Gives what earlier frames have freed back to the system, where the C library can.

    Tracers of frame after frame leave glibc's heap in pieces that it does not use again: 1.8 MB a
    frame for 60,000 triangles, all of it free.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL("libc.so.6").malloc_trim(0)


def moved_vertices(one: Scene, other: Scene) -> Bool[np.ndarray, "vertices"]:
    """Which vertices of two frames of an animation differ in position or normal.

    Raises:
        ValueError: the scenes do not have the same number of vertices.
    """
    if one.positions.shape != other.positions.shape:
        raise ValueError(
            f"scenes {one.name!r} and {other.name!r} have {len(one.positions)} and "
            f"{len(other.positions)} vertices: they are no frames of one animation"
        )
    apart = (one.positions != other.positions) | (one.normals != other.normals)
    return np.any(apart, axis=-1)


def still(scene: Scene) -> Animation:
    """One frame of a scene that does not move."""
    pose = scene.positions + scene.origin, scene.normals
    return Animation(scene, lambda frame: pose, np.zeros(len(scene.positions), np.int32))
