"""Distributions over the sky's cells for blocks of pixels, from what their pilot rays saw."""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Int32, UInt32

from jaxvis.compiled import compiled
from jaxvis.lighting import Environment
from jaxvis.methods.estimators import Drawn, random_numbers
from jaxvis.methods.monte_carlo.cell_light import OTHER_NUMBERS, CellLight, place_in_texel
from jaxvis.methods.traced import ShadingPoints
from jaxvis.sampling import CellTexels
from jaxvis.sampling.sequences import BELOW_ONE
from jaxvis.scene import Surface
from jaxvis.sphere import latlong

MOST_ENTRIES = 1 << 24
"""Entries (tables x cells) that a frame's distributions may take, 4 bytes each and as much twice
for what is counted."""

LEAST_COSINE = 0.1
"""Cosines to a cell's centre count as this where they are smaller: cells are wide, and normals of
a block differ."""

PRIOR = 1.0
"""Rays for which the whole frame's visibility of a cell counts in each block."""

TABLES_PER_TILE = 4
"""For which there is room, or twice, four times as many: most tiles of large images have one or two
blocks, so that no other camera needs other programs."""

FEW_TABLES = 1 << 10
"""Up to which there is room for the 12 that a tile may have."""


class Blocks(NamedTuple):
    """Blocks of neighbouring pixels of like normals; host.

    Tables 2 k and 2 k + 1 belong to the halves of block k. ``normals`` is the mean of each block.
    On the device there is ``room`` for so many tables.
    """

    table_of_pixel: Int32[np.ndarray, "pixels"]
    normals: Float[np.ndarray, "blocks 3"]
    room: int

    @property
    def tables(self) -> int:
        """Two a block."""
        return 2 * len(self.normals)


class Tally(NamedTuple):
    """How many rays each table's pixels sent to each cell, and how many of them were free; host."""

    sent: Int32[np.ndarray, "tables cells"]
    free: Int32[np.ndarray, "tables cells"]

    @classmethod
    def empty(cls, tables: int, cells: int) -> "Tally":
        return cls(np.zeros((tables, cells), np.int32), np.zeros((tables, cells), np.int32))

    def add(
        self,
        table: Int[np.ndarray, "points"],
        cell: Int[np.ndarray, "points samples"],
        active: Bool[np.ndarray, "points samples"],
        visible: Bool[np.ndarray, "points samples"],
    ) -> None:
        """Counts the active rays of these points."""
        _add(self.sent, self.free, table, cell, active, visible)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class BlockLight:
    """Directions from each pixel's own distribution over cells; their density is that of the
    mixture with the luminance alone."""

    plain: CellLight
    cdfs: Float[Array, "tables edges"]
    """Of each table the probability up to each cell's edge, 0 to 1."""
    table_of_pixel: Int[Array, "pixels"]
    share: Float[Array, ""]
    """Of the adapted rays among those that :meth:`density` speaks of; the rest is ``plain``'s."""

    @property
    def environment(self) -> Environment:
        return self.plain.environment

    def draw(self, words: UInt32[Array, "2"], points: ShadingPoints, samples: int) -> Drawn:
        """``samples`` directions for each point, stratified over the cells."""
        numbers = random_numbers(words, points, first=0, samples=samples)
        within = random_numbers(words + OTHER_NUMBERS, points, first=0, samples=samples)
        texel = _texel(self, points, numbers)
        return Drawn(place_in_texel(self.plain.cells, texel, *within[2:]), texel)

    def density(self, points: ShadingPoints, drawn: Drawn) -> Float[Array, "points samples"]:
        """Density per steradian of the mixture."""
        cells = self.plain.cells
        cell = cells.cell_of(drawn.texel)
        own = self._edge(points, cell + 1) - self._edge(points, cell)
        plain = jnp.take(self.plain.table.pmf, cell, mode="clip")
        mixed = self.share * own + (1.0 - self.share) * plain
        return mixed * cells.pdf_within(drawn.texel)

    def _edge(
        self, points: ShadingPoints, edge: Int[Array, "points samples"]
    ) -> Float[Array, "points samples"]:
        table = jnp.take(self.table_of_pixel, points.pixel, mode="clip")
        return jnp.take(
            self.cdfs.reshape(-1), table[:, None] * self.cdfs.shape[1] + edge, mode="clip"
        )


def blocks_of(surface: Surface, points: ShadingPoints, tile: int, cells: int) -> Blocks:
    """The blocks of a surface: ``tile`` pixels wide and high, and of one dominant axis of the
    normals. Tiles double until their tables fit :data:`MOST_ENTRIES`.
    """
    columns = surface.mask.shape[1]
    pixel = np.asarray(points.pixel)
    row, column = np.divmod(pixel, columns)
    normal = np.asarray(points.normal, np.float64)
    x, y, z = normal.T
    size = np.abs(normal)
    axis = np.where(
        (size[:, 0] >= size[:, 1]) & (size[:, 0] >= size[:, 2]),
        np.where(x > 0.0, 0, 1),
        np.where(size[:, 1] >= size[:, 2], np.where(y > 0.0, 2, 3), np.where(z > 0.0, 4, 5)),
    )
    tile = tile * surface.supersampling
    while True:
        wide = columns // tile + 1
        name = ((row // tile) * wide + column // tile) * 6 + axis
        present = np.bincount(name) > 0
        count = int(present.sum())
        if 2 * count * cells <= MOST_ENTRIES or tile >= max(surface.mask.shape):
            break
        tile *= 2
    block = (np.cumsum(present) - 1)[name]
    tiles = wide * (surface.mask.shape[0] // tile + 1)
    room = min(12 * tiles, max(TABLES_PER_TILE * tiles, FEW_TABLES))
    while room < 2 * count:
        room *= 2
    mean = np.stack([np.bincount(block, c, count) for c in (x, y, z)], axis=-1)
    length = np.linalg.norm(mean, axis=-1, keepdims=True)
    table = np.zeros(surface.mask.size, np.int32)
    table[pixel] = 2 * block + (row + column) % 2
    return Blocks(table, mean / np.where(length > 0.0, length, 1.0), room)


def cumulative_distributions(
    tally: Tally, blocks: Blocks, cells: CellTexels, least: float
) -> Float[Array, "tables edges"]:
    """For each table, what its pixels draw cells from: by what the *other* half of its block saw.

    Cells in proportion to luminance x cosine to the block's mean normal x root of the visibility:
    the density of least variance where a cell is either free or hidden. Visibility is the share of
    free rays, with :data:`PRIOR` rays' worth of what the other halves of all blocks saw, and at
    least ``least``.
    """
    power = np.asarray(cells.power, np.float64)
    centres = latlong.texel_directions(*cells.shape).reshape(-1, 3)
    everywhere = np.empty((2, power.size))
    for half in (0, 1):  # of the other one
        sent, free = (counts[1 - half :: 2].sum(axis=0) for counts in tally)
        everywhere[half] = (free + 0.5) / (sent + 1.0)
    cdfs = np.zeros((blocks.room, power.size + 1), np.float32)
    _accumulate(
        *(tally.sent, tally.free, everywhere, power.reshape(-1), centres),
        *(np.ascontiguousarray(blocks.normals), least, cdfs),
    )
    return jnp.asarray(cdfs)


@jax.jit
def _texel(
    light: BlockLight,
    points: ShadingPoints,
    numbers: tuple[Float[Array, "points samples"], ...],
) -> Int[Array, "points samples"]:
    samples = numbers[0].shape[1]
    place = (jnp.arange(samples) + numbers[0]) * (1.0 / samples)
    cell = _bisected(light, points, jnp.minimum(place, BELOW_ONE))
    return light.plain.cells.sample(cell, numbers[2], numbers[3])


def _bisected(
    light: BlockLight, points: ShadingPoints, uniform: Float[Array, "points samples"]
) -> Int[Array, "points samples"]:
    """The cell in whose interval of the point's table each number lies."""
    count = light.cdfs.shape[1] - 1
    steps = (count - 1).bit_length()

    def halve(step: jax.Array, low: jax.Array) -> jax.Array:
        middle = jnp.minimum(low + (1 << (steps - 1 - step)), count - 1)
        return jnp.where(light._edge(points, middle) <= uniform, middle, low)

    return jax.lax.fori_loop(0, steps, halve, jnp.zeros(uniform.shape, jnp.int32))


@compiled
def _add(sent, free, table, cell, active, visible):
    """Counts rays by table and cell."""
    for point in range(active.shape[0]):
        for sample in range(active.shape[1]):
            if active[point, sample]:
                sent[table[point], cell[point, sample]] += 1
                if visible[point, sample]:
                    free[table[point], cell[point, sample]] += 1


@compiled
def _accumulate(sent, free, everywhere, power, centres, normals, least, cdfs):
    """Cumulative distributions over cells, each from the counts of the other half."""
    cells = power.shape[0]
    weights = np.empty(cells)
    for table in range(sent.shape[0]):
        other, normal = table ^ 1, normals[table // 2]
        total = 0.0
        for cell in range(cells):
            seen = (free[other, cell] + PRIOR * everywhere[table % 2, cell]) / (
                sent[other, cell] + PRIOR
            )
            cosine = (
                normal[0] * centres[cell, 0]
                + normal[1] * centres[cell, 1]
                + normal[2] * centres[cell, 2]
            )
            weight = power[cell] * max(cosine, LEAST_COSINE) * np.sqrt(max(seen, least))
            weights[cell] = weight
            total += weight
        upto = 0.0
        for cell in range(cells):
            upto += weights[cell]
            cdfs[table, cell + 1] = upto / total
        cdfs[table, cells] = 1.0
