"""Drawing texels within the cells of a coarser map, where the cells are drawn in some other way."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxvis.compiled import compiled
from jaxvis.sampling import latlong_texels
from jaxvis.sphere import latlong


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class CellTexels:
    """The texels of a lat-long map by the cells of a coarser one, an alias table in each cell.

    A cell's texels are drawn in proportion to luminance times solid angle. What is drawn *of the
    cells* can then change with every frame or pixel, at the price of a table over cells: that is
    the same as a table over the texels of a map that is multiplied cell by cell. A texel belongs to
    the cell that holds its centre.
    """

    kept: Float[Array, "entries"]
    """For each slot of each cell (cells x capacity) the probability to keep its own texel."""
    texels: Int[Array, "choices"]
    """Of each slot its own texel and the other one (entries x 2)."""
    share: Float[Array, "texels"]
    """Density per steradian in each texel where its cell is given."""
    power: Float[Array | np.ndarray, "rows columns"]
    """Share of each cell in the luminance times solid angle of the sphere, float64, host."""
    bounds: Float[Array, "height 2"]

    @staticmethod
    def build(
        luminance: Float[Array | np.ndarray, "height width"], rows: int, columns: int
    ) -> "CellTexels":
        """From each texel's average luminance, on the host in float64.

        Zero everywhere gives uniform directions. There are no more rows and columns of cells than
        of texels: what is asked for above that is cut.

        Raises:
            ValueError: a value is negative or not finite, or ``rows`` or ``columns`` is below 1.
        """
        if rows < 1 or columns < 1:
            raise ValueError(f"rows and columns must be at least 1, got {rows} and {columns}")
        weights, _ = latlong_texels.normalised(luminance)
        height, width = weights.shape
        rows, columns = min(rows, height), min(columns, width)
        cell = _coarse(np.arange(height), height, rows)[:, None] * columns
        cell = (cell + _coarse(np.arange(width), width, columns)).reshape(-1)
        order = np.argsort(cell, kind="stable")
        counts = np.bincount(cell, minlength=rows * columns)
        capacity = 1 << int(counts.max() - 1).bit_length()
        kept, texels = np.ones((len(counts), capacity)), np.zeros((len(counts), capacity, 2), int)
        _alias_of_each(
            weights.reshape(-1)[order], order, np.cumsum(counts) - counts, counts, kept, texels
        )
        power = np.bincount(cell, weights.reshape(-1), len(counts))
        angles = np.repeat(latlong.row_solid_angles(height, width), width)
        in_cell = power[cell]
        share = weights.reshape(-1) / np.where(in_cell > 0.0, in_cell, 1.0) / angles
        return CellTexels(
            jnp.asarray(kept.reshape(-1), jnp.float32),
            jnp.asarray(texels.reshape(-1), jnp.int32),
            jnp.asarray(share, jnp.float32),
            power.reshape(rows, columns),
            jnp.asarray(latlong_texels.row_bounds(height)),
        )

    @property
    def height(self) -> int:
        """Rows of texels."""
        return self.bounds.shape[0]

    @property
    def width(self) -> int:
        """Columns of texels."""
        return self.share.shape[0] // self.height

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of cells."""
        rows, columns = self.power.shape
        return rows, columns

    @property
    def cells(self) -> int:
        """How many cells there are."""
        return self.power.size

    def sample(
        self,
        cell: Int[Array, "*points"],
        u: Float[Array, "*points"],
        v: Float[Array, "*points"],
    ) -> Int[Array, "*points"]:
        """Texels (row * width + column) of cells (row * columns + column), by two uniforms."""
        capacity = self.kept.shape[0] // self.cells
        slot = jnp.minimum((u * capacity).astype(jnp.int32), capacity - 1)
        entry = cell * capacity + slot
        other = (v >= jnp.take(self.kept, entry, mode="clip")).astype(jnp.int32)
        return jnp.take(self.texels, 2 * entry + other, mode="clip")

    def inside(
        self,
        texel: Int[Array, "*points"],
        across: Float[Array, "*points"],
        down: Float[Array, "*points"],
    ) -> Float[Array, "*points 3"]:
        """Unit directions at fractions of u and of cos theta of texels."""
        row = texel // self.width
        column = texel - row * self.width
        return latlong_texels.inside(row, column, across, down, self.bounds, self.width)

    def cell_of(self, texel: Int[Array, "*points"]) -> Int[Array, "*points"]:
        """The cell that each texel belongs to."""
        rows, columns = self.shape
        row = texel // self.width
        column = texel - row * self.width
        return _coarse(row, self.height, rows) * columns + _coarse(column, self.width, columns)

    def angle_of(self, cell: Int[Array, "*points"]) -> Float[Array, "*points"]:
        """Solid angle (sr) of each cell of the coarse map itself."""
        rows, columns = self.shape
        angles = jnp.asarray(latlong.row_solid_angles(rows, columns), jnp.float32)
        return jnp.take(angles, cell // columns, mode="clip")

    def pdf_within(self, texel: Int[Array, "*points"]) -> Float[Array, "*points"]:
        """Density per steradian where the cell is given: times its probability, the density."""
        return jnp.take(self.share, texel, mode="clip")


def _coarse(index, count: int, fewer: int):
    """Which of ``fewer`` intervals holds the middle of each of ``count``."""
    return (2 * index + 1) * fewer // (2 * count)


@compiled
def _alias_of_each(weights, texel, starts, counts, kept, texels):
    """Vose 1991 for each cell: slots whose own weight is below the mean are filled up by others.

    ``weights`` and ``texel`` are sorted by cell; slots after a cell's texels have weight zero.
    """
    capacity = kept.shape[1]
    scaled = np.empty(capacity)
    small, large = np.empty(capacity, np.int64), np.empty(capacity, np.int64)
    for cell in range(len(counts)):
        start, count = starts[cell], counts[cell]
        total = 0.0
        for slot in range(count):
            total += weights[start + slot]
        smalls, larges = 0, 0
        for slot in range(capacity):
            own = texel[start + min(slot, count - 1)]
            texels[cell, slot, 0], texels[cell, slot, 1] = own, own
            if total == 0.0:
                continue
            scaled[slot] = weights[start + slot] * capacity / total if slot < count else 0.0
            if scaled[slot] < 1.0:
                small[smalls] = slot
                smalls += 1
            else:
                large[larges] = slot
                larges += 1
        while smalls and larges:
            smalls -= 1
            lacking, giver = small[smalls], large[larges - 1]
            kept[cell, lacking] = scaled[lacking]
            texels[cell, lacking, 1] = texels[cell, giver, 0]
            scaled[giver] -= 1.0 - scaled[lacking]
            if scaled[giver] < 1.0:
                larges -= 1
                small[smalls] = giver
                smalls += 1
        # What is left is 1 but for rounding, unless it has no weight: it then takes the heaviest.
        while smalls:
            smalls -= 1
            if scaled[small[smalls]] < 0.5:
                heaviest = 0
                for slot in range(count):
                    if weights[start + slot] > weights[start + heaviest]:
                        heaviest = slot
                kept[cell, small[smalls]] = 0.0
                texels[cell, small[smalls], 1] = texels[cell, heaviest, 0]
