"""A pinhole camera."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

Vector = Sequence[Any] | np.ndarray
"""Three numbers."""


@dataclass(frozen=True)
class Camera:
    """Pinhole camera in world coordinates (those of the mesh file).

    ``eye``, ``target`` and ``up`` are three numbers each, kept as tuples of floats;
    ``field_of_view`` is vertical, in radians.

    Raises:
        ValueError: a vector is not three finite numbers, the field of view is not in (0, pi), or
            the view has no direction or no upright.
    """

    eye: Vector
    target: Vector
    up: Vector = (0.0, 1.0, 0.0)
    field_of_view: float | int = 0.6

    def __post_init__(self) -> None:
        for name in ("eye", "target", "up"):
            vector = np.asarray(getattr(self, name), np.float64)
            if vector.shape != (3,) or not np.all(np.isfinite(vector)):
                raise ValueError(f"camera {name} must be three finite numbers, got {vector}")
            object.__setattr__(self, name, tuple(vector.tolist()))
        object.__setattr__(self, "field_of_view", float(self.field_of_view))
        if not 0.0 < self.field_of_view < np.pi:
            raise ValueError(f"field_of_view must be in (0, pi), got {self.field_of_view}")
        forward = np.subtract(self.target, self.eye)
        if not np.linalg.norm(np.cross(forward, self.up)) > 1e-9 * np.linalg.norm(forward):
            raise ValueError("camera: eye and target coincide, or the view is parallel to up")

    def axes(self) -> Float[np.ndarray, "3 3"]:
        """Rows: unit right, up and forward (float64)."""
        forward = np.subtract(self.target, self.eye)
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, self.up)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(right, forward), forward])

    def directions(
        self, width: int, height: int, rows: slice = slice(None)
    ) -> Float[np.ndarray, "rows columns 3"]:
        """Unit directions (float64) through the pixel centres of some rows (all by default).

        Row 0 is the top of the image; column 0 is on the camera's left.
        """
        scale = np.tan(0.5 * self.field_of_view)
        x = (2.0 * (np.arange(width) + 0.5) / width - 1.0) * scale * width / height
        y = (1.0 - 2.0 * (np.arange(height)[rows] + 0.5) / height) * scale
        right, up, forward = self.axes()
        rays = x[None, :, None] * right + y[:, None, None] * up + forward
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)
