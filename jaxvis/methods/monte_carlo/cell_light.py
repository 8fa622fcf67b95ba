"""An environment whose directions are drawn cell by cell of a coarse map."""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt32

from jaxvis.lighting import Environment
from jaxvis.methods.estimators import Drawn, random_numbers
from jaxvis.methods.traced import Components, ShadingPoints, components
from jaxvis.sampling import AliasTable, CellTexels

OTHER_NUMBERS = np.uint32(0x9E3779B9)
"""Added to the words of a key: numbers independent of those that the key itself gives."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class CellLight:
    """Cells by an alias table, and in each its texels in proportion to luminance x solid angle."""

    environment: Environment
    cells: CellTexels
    table: AliasTable

    @classmethod
    def of(cls, environment: Environment, rows: int, columns: int) -> "CellLight":
        """In proportion to luminance, with at most ``rows`` x ``columns`` cells."""
        luminance = np.asarray(environment.radiance, np.float64) @ [0.2126, 0.7152, 0.0722]
        cells = CellTexels.build(luminance, rows, columns)
        return cls(environment, cells, AliasTable.build(np.asarray(cells.power).reshape(-1)))

    def in_proportion(self, useful: Float[np.ndarray, "rows columns"]) -> "CellLight":
        """In proportion to luminance times a non-negative factor of each cell."""
        weights = np.asarray(self.cells.power) * useful
        return replace(self, table=AliasTable.build(weights.reshape(-1)))

    def draw(self, words: UInt32[Array, "2"], points: ShadingPoints, samples: int) -> Drawn:
        """``samples`` directions for each point."""
        numbers = random_numbers(words, points, first=0, samples=samples)
        within = random_numbers(words + OTHER_NUMBERS, points, first=0, samples=samples)
        texel = _texel(self, numbers)
        return Drawn(place_in_texel(self.cells, texel, *within[2:]), texel)

    def density(self, points: ShadingPoints, drawn: Drawn) -> Float[Array, "points samples"]:
        """Density per steradian with which :meth:`draw` gives these directions."""
        cell = self.cells.cell_of(drawn.texel)
        probability = jnp.take(self.table.pmf, cell, mode="clip")
        return probability * self.cells.pdf_within(drawn.texel)


@jax.jit
def place_in_texel(
    cells: CellTexels,
    texel: Int[Array, "points samples"],
    u: Float[Array, "points samples"],
    v: Float[Array, "points samples"],
) -> Components:
    """Directions uniform within texels."""
    return components(cells.inside(texel, u, v))


@jax.jit
def _texel(
    light: CellLight, numbers: tuple[Float[Array, "points samples"], ...]
) -> Int[Array, "points samples"]:
    return light.cells.sample(light.table.sample(numbers[0], numbers[1]), *numbers[2:])
