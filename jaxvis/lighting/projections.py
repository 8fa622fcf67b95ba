"""Cubes and angular probes: where their texels lie on the sphere.

A file's front is the middle of the panorama, which DESIGN §3 puts at +Z; seen from inside, what is
to the right of the front lies towards -X. All layouts of one probe therefore give one lat-long map.
Host code in float64.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float

FACES = ("px", "nx", "py", "ny", "pz", "nz")

# Forward, right and up of each face's picture in the world. The six names are those of OpenGL and
# DirectX, whose cubes are left-handed: x changes its sign on the way into a right-handed world
# (as in three.js), or the sky would be mirrored.
_AXES = np.array(
    [
        [[-1, 0, 0], [0, 0, -1], [0, 1, 0]],
        [[1, 0, 0], [0, 0, 1], [0, 1, 0]],
        [[0, 1, 0], [-1, 0, 0], [0, 0, -1]],
        [[0, -1, 0], [-1, 0, 0], [0, 0, 1]],
        [[0, 0, 1], [-1, 0, 0], [0, 1, 0]],
        [[0, 0, -1], [1, 0, 0], [0, 1, 0]],
    ],
    np.float64,
)


@dataclass(frozen=True)
class Projection(ABC):
    """Square pictures, ``[faces, size, size]``, that show the whole sphere from inside."""

    size: int

    faces: ClassVar[int]
    smallest: ClassVar[int]
    """The least size with which texels are small enough to be polygons."""

    @property
    @abstractmethod
    def edge_pieces(self) -> int:
        """Great-circle arcs that stand for one texel edge. Poles never lie within one."""

    @property
    @abstractmethod
    def native_height(self) -> int:
        """Rows of the lat-long map that keeps the detail."""

    @abstractmethod
    def directions(
        self, face: int, right: Float[np.ndarray, "*points"], up: Float[np.ndarray, "*points"]
    ) -> Float[np.ndarray, "*points 3"]:
        """Unit directions at places of a picture, -1 to 1 from left to right and bottom to top."""


@dataclass(frozen=True)
class Cube(Projection):
    """Six faces in the order of :data:`FACES`; texel edges are great circles."""

    faces = 6
    smallest = 1

    @property
    def edge_pieces(self) -> int:
        # One would do, but chords of short pieces give solid angles to 2e-4 even where an edge
        # runs almost along a meridian.
        return 3

    @property
    def native_height(self) -> int:
        return 2 * self.size

    def directions(
        self, face: int, right: Float[np.ndarray, "*points"], up: Float[np.ndarray, "*points"]
    ) -> Float[np.ndarray, "*points 3"]:
        forward, to_right, to_up = _AXES[face]
        vector = forward + right[..., None] * to_right + up[..., None] * to_up
        return vector / np.sqrt(right * right + up * up + 1.0)[..., None]


@dataclass(frozen=True)
class Angular(Projection):
    """Debevec's angular map: the angle from the front grows linearly with the distance from the
    centre and reaches pi on the inscribed circle. All that is outside lies at the back point, so
    that the void corners have no solid angle.
    """

    faces = 1
    smallest = 4

    @property
    def edge_pieces(self) -> int:
        # An even size puts edges through the poles, a quarter of the picture above and below the
        # centre: up to four pieces to an edge give them a vertex there. Edges are curved; more
        # pieces in a small map follow them.
        exact = 4 // math.gcd(self.size, 4) if self.size % 2 == 0 else 1
        return exact * -(-512 // (self.size * exact))

    @property
    def native_height(self) -> int:
        return max(1, self.size // 2)

    def directions(
        self, face: int, right: Float[np.ndarray, "*points"], up: Float[np.ndarray, "*points"]
    ) -> Float[np.ndarray, "*points 3"]:
        radius = np.hypot(right, up)
        ratio = np.where(radius < 1.0, np.pi * np.sinc(radius), 0.0)  # sin(pi radius) / radius
        forward = np.cos(np.pi * np.minimum(radius, 1.0))
        return np.stack([-right * ratio, up * ratio, forward], axis=-1)
