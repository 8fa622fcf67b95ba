"""Lowest and highest height over rectangles of a height map (paper 003, eqs. 13 and 14).

Height maps are square, [n, n] with n a power of two, rows along +z and columns along +x; heights
are normalised to (0, 1) and constant over a texel. Rectangles are given by two corners (x, z) in
texels: texel j covers j to j + 1. Parts outside the map count for nothing.

Two tables answer: :func:`pyramid` keeps exact minima and maxima, so that a range is never too
narrow, and reads one cell a query; :func:`hsat` is the paper's, means of powers from summed-area
tables, four cells a query and no bound. An empty rectangle has the range (1, 0) in both: nothing
is above its minimum or below its maximum.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float16, Float32, Float64, Int32

Corner = tuple[Float[Array, "*points"], Float[Array, "*points"]]
"""x and z, in texels."""

Range = tuple[Float32[Array, "*points"], Float32[Array, "*points"]]
"""Lowest and highest height."""

BLOCK = 4
"""Cells a side of the blocks whose ranges :func:`pyramid` keeps. More are tighter for rectangles
of many texels, by little, and looser for those of fewer."""

WIDENING = 0.05
"""By which the paper's ranges grow at either end, in units of their level's whole range: about
their worst error over 4 texels."""

WINDOW = 4.0
"""Texels across a rectangle at the level where :func:`hsat_range` looks it up."""


@jax.jit
def pyramid(heights: Float[Array, "n n"]) -> Float16[Array, "cells 2"]:
    """Minima and maxima over overlapping blocks, all levels one after another.

    Cell (i, j) of level l holds the range over the texels from (i, j) 2^l to (i + 4, j + 4) 2^l:
    over 4 x 4 cells of the ordinary mip chain, which has as many cells as this table. So the
    reads of all cells that a rectangle may straddle there are one here.

    Minima are rounded down to float16 and maxima up, which keeps every bound.

    Args:
        heights: in [0, 1].

    Raises:
        ValueError: the map is no square whose side is a power of two.
    """
    size = _checked_size(heights.shape)
    lowest = highest = heights.astype(jnp.float32)
    levels = []
    while True:
        pair = _down(_blocks(lowest, jnp.minimum)), _up(_blocks(highest, jnp.maximum))
        levels.append(jnp.stack(pair, axis=-1).reshape(-1, 2))
        if size == 1:
            return jnp.concatenate(levels)
        lowest, highest = _halved(lowest, jnp.minimum), _halved(highest, jnp.maximum)
        size //= 2


@partial(jax.jit, static_argnames="size")
def pyramid_range(table: Float[Array, "cells 2"], size: int, lo: Corner, hi: Corner) -> Range:
    """A range that contains those of all texels that a rectangle touches (jitted).

    Read at the finest level where one block holds the rectangle: a block at most 8/3 as wide as
    the rectangle's longer side (5/3 on average over all sizes), and 4 texels at least.

    Args:
        table: of :func:`pyramid`.
        size: n, texels a side of the map.
        lo: lower corner, texels.
        hi: upper corner, texels.
    """
    (x0, x1), (z0, z1), empty = _touched(lo, hi, size)
    # The longer side is of 2 to 4 cells of this level, and touches 3 to 5. Where it touches 5,
    # it touches 3 of the next.
    across = jnp.maximum(x1 - x0, z1 - z0)
    level = jnp.maximum(30 - jax.lax.clz(jnp.maximum(across, 1)), 0)
    fits = ((x1 >> level) - (x0 >> level) < BLOCK) & ((z1 >> level) - (z0 >> level) < BLOCK)
    level = jnp.where(fits, level, level + 1)
    width = size >> level
    # Levels before it hold size^2 + (size / 2)^2 + ... cells.
    offset = (4 * size * size - 4 * width * width) // 3
    cell = offset + (z0 >> level) * width + (x0 >> level)
    found = jnp.take(table, cell, axis=0, mode="clip").astype(jnp.float32)
    return jnp.where(empty, 1.0, found[..., 0]), jnp.where(empty, 0.0, found[..., 1])


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PowerSums:
    """Summed-area tables of x^p and (1 - x)^p at each level of a mip chain of heights x."""

    corners: Float32[Array, "corners 4"]
    """(high, low) of the sums of x^p, then of (1 - x)^p, high + low being a float64's value; the
    levels one after another, (n + 1)^2 corners each."""
    bounds: Float32[Array, "levels 2"]
    """Lowest and highest height of each level."""
    size: int = field(metadata={"static": True})
    power: int = field(metadata={"static": True})

    @property
    def nbytes(self) -> int:
        """Bytes of the tables."""
        return self.corners.nbytes + self.bounds.nbytes


def hsat(heights: Float[Array | np.ndarray, "n n"], power: int = 8) -> PowerSums:
    """The paper's hierarchical min-max summed-area tables (host).

    Sums are taken in float64 and kept as two float32 each: a single one loses small rectangles
    altogether among sums over the whole map.

    Args:
        heights: in (0, 1).
        power: p of eq. 14; larger ones come nearer to the maximum, and cancel in the differences.

    Raises:
        ValueError: the map is no square whose side is a power of two, or the power is below 1.
    """
    level = np.asarray(heights, np.float64)
    size = _checked_size(level.shape)
    if power < 1:
        raise ValueError(f"power must be at least 1, got {power}")
    corners, bounds = [], []
    while True:
        corners.append(
            np.concatenate([_split_sums(level**power), _split_sums((1 - level) ** power)], -1)
        )
        bounds.append((level.min(), level.max()))
        if len(level) == 1:
            break
        level = 0.25 * (level[::2, ::2] + level[1::2, ::2] + level[::2, 1::2] + level[1::2, 1::2])
    return PowerSums(
        jnp.asarray(np.concatenate(corners)), jnp.asarray(bounds, jnp.float32), size, power
    )


@partial(jax.jit, static_argnames=("window", "widening"))
def hsat_range(
    tables: PowerSums,
    lo: Corner,
    hi: Corner,
    window: float = WINDOW,
    widening: float = WIDENING,
) -> Range:
    """The paper's range over a rectangle, of power means (eqs. 13 and 14; jitted).

    A power mean lies between the maximum and N^(-1/p) of it, so this is no bound: it is too narrow
    by an amount that grows with the number of texels N. Hence a level is chosen where the rectangle
    is ``window`` texels across, and the range widened; what the mip chain averages away stays lost.

    Args:
        tables: of :func:`hsat`.
        lo: lower corner, texels of level 0.
        hi: upper corner, texels of level 0.
        window: infinite ones look everything up at level 0.
        widening: in units of the whole range of the level's heights.
    """
    size = tables.size
    across = jnp.maximum(hi[0] - lo[0], hi[1] - lo[1])
    level = jnp.round(jnp.log2(jnp.maximum(across, 1e-6) / window)).astype(jnp.int32)
    level = jnp.clip(level, 0, size.bit_length() - 1)
    scale = jnp.exp2(-level.astype(jnp.float32))
    width = size >> level
    low = lo[0] * scale, lo[1] * scale
    (x0, x1), (z0, z1), empty = _touched(low, (hi[0] * scale, hi[1] * scale), width)
    # Levels before it: the sum over (m + 1)^2 = m^2 + 2 m + 1.
    offset = (4 * size * size - 4 * width * width) // 3 + 4 * (size - width) + level
    stride = width + 1

    def corner(x: jax.Array, z: jax.Array) -> jax.Array:
        return jnp.take(tables.corners, offset + z * stride + x, axis=0, mode="clip")

    top = _difference(corner(x1 + 1, z1 + 1), corner(x0, z1 + 1))
    bottom = _difference(corner(x1 + 1, z0), corner(x0, z0))
    total = _difference(top, bottom)
    count = ((x1 - x0 + 1) * (z1 - z0 + 1)).astype(jnp.float32)
    means = jnp.maximum(total[..., 0::2] + total[..., 1::2], 0.0) / count[..., None]
    roots = means ** (1.0 / tables.power)
    bounds = jnp.take(tables.bounds, level, axis=0, mode="clip")
    margin = widening * (bounds[..., 1] - bounds[..., 0])
    lowest, highest = 1.0 - roots[..., 1] - margin, roots[..., 0] + margin
    return jnp.where(empty, 1.0, lowest), jnp.where(empty, 0.0, highest)


def _checked_size(shape: tuple[int, ...]) -> int:
    size = shape[0]
    if shape != (size, size) or size < 1 or size & (size - 1):
        raise ValueError(
            f"heights must be [n, n] with n a power of two, got {list(shape)}; resample them"
        )
    return size


def _touched(
    lo: Corner, hi: Corner, size: int | Int32[Array, "*points"]
) -> tuple[tuple[jax.Array, jax.Array], tuple[jax.Array, jax.Array], jax.Array]:
    """First and last texel of a rectangle along x and along z, and whether it is empty."""
    empty, pairs = jnp.zeros((), bool), []
    for low, high in zip(lo, hi, strict=True):
        low, high = jnp.maximum(low, 0.0), jnp.minimum(high, size)
        # NaN and what lies outside the map are empty too.
        empty = empty | ~(low < high)
        first = jnp.clip(jnp.floor(low).astype(jnp.int32), 0, size - 1)
        last = jnp.ceil(high).astype(jnp.int32) - 1
        pairs.append((first, jnp.clip(last, first, size - 1)))
    return pairs[0], pairs[1], empty


def _halved(values: jax.Array, join: Callable[..., jax.Array]) -> jax.Array:
    rows = join(values[::2], values[1::2])
    return join(rows[:, ::2], rows[:, 1::2])


def _blocks(values: jax.Array, join: Callable[..., jax.Array]) -> jax.Array:
    """Each cell joined with the 3 following rows and columns; there are none beyond the map."""
    for shift in (1, 2):
        values = join(values, jnp.pad(values, ((0, shift), (0, 0)), mode="edge")[shift:])
        values = join(values, jnp.pad(values, ((0, 0), (0, shift)), mode="edge")[:, shift:])
    return values


def _down(values: Float32[Array, "n n"]) -> Float16[Array, "n n"]:
    """The largest float16 that is not above a non-negative value."""
    near = values.astype(jnp.float16)
    bits = jax.lax.bitcast_convert_type(near, jnp.uint16)
    above = (near.astype(jnp.float32) > values) & (bits > 0)
    return jax.lax.bitcast_convert_type(bits - above.astype(jnp.uint16), jnp.float16)


def _up(values: Float32[Array, "n n"]) -> Float16[Array, "n n"]:
    """The smallest float16 that is not below a non-negative value."""
    near = values.astype(jnp.float16)
    bits = jax.lax.bitcast_convert_type(near, jnp.uint16)
    below = near.astype(jnp.float32) < values
    return jax.lax.bitcast_convert_type(bits + below.astype(jnp.uint16), jnp.float16)


def _split_sums(values: Float64[np.ndarray, "n n"]) -> Float32[np.ndarray, "corners 2"]:
    """Sums over the rows and columns before each corner, as (high, low)."""
    sums = np.pad(values.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0))).reshape(-1)
    high = sums.astype(np.float32)
    return np.stack([high, (sums - high).astype(np.float32)], axis=-1)


def _difference(a: Float32[Array, "*points 4"], b: Float32[Array, "*points 4"]) -> jax.Array:
    """Of numbers held as (high, low) pairs, the rounding of the high parts kept (Knuth)."""
    high = a[..., 0::2] - b[..., 0::2]
    other = a[..., 0::2] - high
    lost = (other - b[..., 0::2]) + (a[..., 0::2] - (high + other))
    low = (a[..., 1::2] - b[..., 1::2]) + lost
    return jnp.stack([high, low], axis=-1).reshape(a.shape)
