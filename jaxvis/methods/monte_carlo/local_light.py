"""Directions by tables for normals: Lawrence, Rusinkiewicz and Ramamoorthi 2005, "Adaptive
Numerical Cumulative Distribution Functions for Efficient Importance Sampling", section 5.
"""

from dataclasses import dataclass
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt32

from jaxvis.lighting import Environment
from jaxvis.methods.estimators import Drawn, random_numbers
from jaxvis.methods.monte_carlo.cell_light import OTHER_NUMBERS, CellLight, place_in_texel
from jaxvis.methods.traced import ShadingPoints
from jaxvis.sampling import AdaptiveCdfs, CellTexels
from jaxvis.sphere import latlong

NORMALS = (10, 20)
"""Rows (theta) and columns (phi) of the normals that have a table."""

TABLE = (32, 64)
"""Rows and columns of a table; those of the environment where it has fewer."""

LEAST_COSINE = 0.05
"""Cosines count as this where they are smaller: pixels' normals lie between the tables', and what
is above their horizon must have a chance."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LocalLight:
    """An environment with distributions over its cells, one for each of :data:`NORMALS`.

    Within a cell texels are drawn by luminance: tables are too coarse for bright lamps and windows.
    """

    environment: Environment
    cells: CellTexels
    cdfs: AdaptiveCdfs

    @classmethod
    def of(
        cls, light: CellLight, useful: Float[np.ndarray, "rows columns"], tolerance: float
    ) -> "LocalLight":
        """For each normal in proportion to luminance x a factor of each cell x cosine.

        ``tolerance`` is the largest error of the cumulative distributions.
        """
        shape = light.cells.shape
        angles = latlong.row_solid_angles(*shape)[:, None]
        density = np.asarray(light.cells.power) * useful / angles
        tables = _cosines(*shape) * density
        return cls(light.environment, light.cells, AdaptiveCdfs.build(tables, tolerance))

    def draw(self, words: UInt32[Array, "2"], points: ShadingPoints, samples: int) -> Drawn:
        """``samples`` directions for each point, each from one of the four tables around it."""
        numbers = random_numbers(words, points, first=0, samples=samples)
        within = random_numbers(words + OTHER_NUMBERS, points, first=0, samples=samples)
        texel = _texel(self, points, numbers, within)
        return Drawn(place_in_texel(self.cells, texel, *within[2:]), texel)

    def density(self, points: ShadingPoints, drawn: Drawn) -> Float[Array, "points samples"]:
        """Density per steradian of the mixture of the four tables."""
        tables, shares = around(points.normal)
        cell = self.cells.cell_of(drawn.texel)
        mixed = sum(
            shares[:, k, None] * self.cdfs.cell_pdf(tables[:, k, None], cell) for k in range(4)
        )
        # In the cell's solid angle, where its texels take over.
        return mixed * self.cells.angle_of(cell) * self.cells.pdf_within(drawn.texel)


@jax.jit
def around(
    normal: Float[Array, "points 3"],
) -> tuple[Int[Array, "points 4"], Float[Array, "points 4"]]:
    """The four normals around each, and their bilinear weights, which add up to 1.

    Periodic in phi; across a pole the row continues half a turn away.
    """
    rows, columns = NORMALS
    u, theta = latlong.coordinates(normal)
    x, y = u * columns - 0.5, theta * (rows / jnp.pi) - 0.5
    column, row = jnp.floor(x).astype(jnp.int32), jnp.floor(y).astype(jnp.int32)
    across, down = x - column, y - row

    def table(r: Int[Array, "points"], c: Int[Array, "points"]) -> Int[Array, "points"]:
        beyond = (r < 0) | (r >= rows)
        r = jnp.where(r < 0, -1 - r, jnp.where(r >= rows, 2 * rows - 1 - r, r))
        return r * columns + jnp.mod(jnp.where(beyond, c + columns // 2, c), columns)

    tables = [table(row + i, column + j) for i in (0, 1) for j in (0, 1)]
    shares = [a * b for a in (1.0 - down, down) for b in (1.0 - across, across)]
    return jnp.stack(tables, axis=-1), jnp.stack(shares, axis=-1)


@jax.jit
def _texel(
    light: LocalLight,
    points: ShadingPoints,
    numbers: tuple[Float[Array, "points samples"], ...],
    within: tuple[Float[Array, "points samples"], ...],
) -> Int[Array, "points samples"]:
    tables, shares = around(points.normal)
    upto = jnp.cumsum(shares, axis=1)[:, None, :3]
    choice = jnp.sum(numbers[2][..., None] >= upto, axis=-1)
    table = jnp.take_along_axis(tables, choice, axis=1)
    cell = light.cdfs.sample_cell(table, jnp.stack(numbers[:2], axis=-1))
    return light.cells.sample(cell, within[0], within[1])


@cache
def _cosines(rows: int, columns: int) -> Float[np.ndarray, "normals rows columns"]:
    """Between each normal and the centres of a table's cells, at least :data:`LEAST_COSINE`."""
    normals = latlong.texel_directions(*NORMALS).reshape(-1, 3)
    cosine = normals @ latlong.texel_directions(rows, columns).reshape(-1, 3).T
    cosine = np.maximum(cosine, LEAST_COSINE).reshape(-1, rows, columns)
    cosine.setflags(write=False)
    return cosine
