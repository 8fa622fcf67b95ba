"""The uniform grid whose cells hold masks."""

from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

SHIFT = 0.63
"""Where the grid begins before the scene, in cells: floors and walls that stand on round
coordinates would otherwise lie in the faces of cells, where rounding decides."""

MOST_CELLS = 2**31 - 1
"""Cells are numbered in int32."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Grid:
    """A uniform grid over a scene: ``shape`` cubes of ``edge`` (scene units) from ``origin`` on.

    Coordinates are the scene's centred ones. Cell (x, y, z) has number
    (x * shape[1] + y) * shape[2] + z.
    """

    origin: Float[Array | np.ndarray, "3"]
    edge: Float[Array | np.ndarray, ""]
    shape: tuple[int, int, int] = field(metadata={"static": True})

    @classmethod
    def covering(cls, positions: Float[np.ndarray, "vertices 3"], edge: float) -> "Grid":
        """The grid over vertices, one cell wider than they are on each side.

        Raises:
            ValueError: cells are not positive, or so small that they cannot be numbered.
        """
        if not (np.isfinite(edge) and edge > 0.0):
            raise ValueError(f"cell must be a positive length, got {edge}")
        low, high = positions.min(axis=0).astype(np.float64), positions.max(axis=0)
        sides = np.ceil((high - low) / edge) + 2.0
        if sides.prod() > MOST_CELLS:
            raise ValueError(
                f"cell {edge:g} makes {sides.prod():.3g} cells, more than can be numbered; "
                f"the scene is {(high - low).max():g} long"
            )
        x, y, z = (int(side) for side in sides)
        origin = (low - SHIFT * edge).astype(np.float32)
        return cls(origin, np.asarray(edge, np.float32), (x, y, z))

    @property
    def cells(self) -> int:
        """How many cells, empty ones included."""
        x, y, z = self.shape
        return x * y * z


def cell_of(
    grid: Grid, points: Float[Array | np.ndarray, "*points 3"]
) -> Int[Array | np.ndarray, "*points"]:
    """Number of the cell that holds each point; -1 outside the grid. Jitted and NumPy alike."""
    numpy = np if isinstance(points, np.ndarray) else jnp
    index = numpy.floor((points - grid.origin) * (np.float32(1.0) / grid.edge)).astype(np.int32)
    x, y, z = index[..., 0], index[..., 1], index[..., 2]
    nx, ny, nz = grid.shape
    inside = (x >= 0) & (y >= 0) & (z >= 0) & (x < nx) & (y < ny) & (z < nz)
    return numpy.where(inside, (x * ny + y) * nz + z, -1)
