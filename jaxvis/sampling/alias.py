"""Alias tables: drawing from any discrete distribution in constant time."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt32

from jaxvis.sampling.sequences import BELOW_ONE

MAXIMUM_ENTRIES = 2**23


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class AliasTable:
    """A discrete distribution: Walker 1977 and Vose 1991.

    The number of cells is padded to a power of two with cells of weight zero. Scaling a float32
    uniform by it is then exact, every cell is hit by equally many of the 2^23 (or 2^24) values of a
    generator, and what is left of the uniform is itself uniform.

    What float32 uniforms can do: ``u1`` chooses the cell; for N cells 23 - log2 N random bits of
    it are left, 4 for a map of 512 x 1024 texels and none that matter above 2^20 cells, so that
    :meth:`sample` does not reuse it. ``u2`` chooses between a cell's two entries, and
    :meth:`sample_remainder` stretches it to a new uniform, of some 20 random bits for the entries
    that are drawn often. Its absolute error, 2^-24 / N of the total, also bounds the error of each
    entry's probability.
    """

    cells: UInt32[Array, "*lights cells 2"]
    """For each cell the bits of the float32 probability to keep it, and the other entry."""
    pmf: Float[Array, "*lights entries"]
    """The probability of each entry; they add up to 1."""

    @staticmethod
    def build(weights: Float[np.ndarray, "entries"]) -> "AliasTable":
        """From non-negative weights, on the host in float64.

        Raises:
            ValueError: a weight is negative or not finite, all are zero, there are none or more
                than 2^23.
        """
        weights = np.asarray(weights, np.float64)
        if not 1 <= weights.size <= MAXIMUM_ENTRIES:
            raise ValueError(
                f"weights: {weights.size} entries, where an alias table holds from 1 to "
                f"{MAXIMUM_ENTRIES}; resize what they come from"
            )
        if not np.all(np.isfinite(weights)) or np.any(weights < 0.0):
            raise ValueError("weights: must be finite and non-negative")
        # Dividing by the largest first keeps the sum from overflowing or vanishing.
        largest = float(weights.max())
        if largest == 0.0:
            raise ValueError("weights: all are zero, nothing can be drawn")
        pmf = weights / largest
        pmf /= pmf.sum()
        padded = np.zeros(1 << (weights.size - 1).bit_length())
        padded[: weights.size] = pmf
        probability, alias = _fill(padded * padded.size)
        kept = probability.astype(np.float32).view(np.uint32)
        cells = np.stack([kept, alias.astype(np.uint32)], axis=-1)
        return AliasTable(jnp.asarray(cells), jnp.asarray(pmf, jnp.float32))

    @property
    def probability(self) -> Float[Array, "cells"]:
        """The probability to keep each cell's own entry."""
        return jax.lax.bitcast_convert_type(self.cells[:, 0], jnp.float32)

    @property
    def alias(self) -> Int[Array, "cells"]:
        """The entry drawn where the cell's own is not kept."""
        return self.cells[:, 1].astype(jnp.int32)

    def sample(
        self, u1: Float[Array, "*points"], u2: Float[Array, "*points"]
    ) -> Int[Array, "*points"]:
        """Entries drawn with two uniforms in [0, 1)."""
        index, _, _, _ = self._draw(u1, u2)
        return index

    def sample_remainder(
        self, u1: Float[Array, "*points"], u2: Float[Array, "*points"]
    ) -> tuple[Int[Array, "*points"], Float[Array, "*points"]]:
        """(entries, what is left of ``u2`` as a new uniform in [0, 1), independent of the entry).

        Entries much less likely than the average keep fewer random bits.
        """
        index, kept, probability, u2 = self._draw(u1, u2)
        offset = jnp.where(kept, 0.0, probability)
        extent = jnp.where(kept, probability, 1.0 - probability)
        remainder = (u2 - offset) / jnp.where(extent > 0.0, extent, 1.0)
        return index, jnp.clip(remainder, 0.0, BELOW_ONE)

    def _draw(
        self, u1: Float[Array, "*points"], u2: Float[Array, "*points"]
    ) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
        count = self.cells.shape[0]
        cell = jnp.clip((u1 * count).astype(jnp.int32), 0, count - 1)
        row = jnp.take(self.cells, cell, axis=0, mode="clip")
        probability = jax.lax.bitcast_convert_type(row[..., 0], jnp.float32)
        kept = u2 < probability
        return jnp.where(kept, cell, row[..., 1].astype(jnp.int32)), kept, probability, u2


def _fill(scaled: Float[np.ndarray, "cells"]) -> tuple[np.ndarray, np.ndarray]:
    """(probability to keep, alias) of weights whose mean is 1.

    Vose's loop in order of index, done at once with prefix sums (the sweep of Hübschle-Schneider
    and Sanders 2022, "Parallel Weighted Random Sampling"): light cells take what they lack from the
    current heavy cell; a heavy cell that falls below 1 takes what it then lacks from the next.
    """
    probability, alias = np.ones(scaled.size), np.arange(scaled.size)
    heavy = np.flatnonzero(scaled >= 1.0)
    light = np.flatnonzero(scaled < 1.0)
    if heavy.size == 0 or light.size == 0:  # all equal, but for rounding
        return probability, alias
    lacking = np.cumsum(1.0 - scaled[light])
    surplus = np.cumsum(scaled[heavy] - 1.0)
    before = np.concatenate([[0.0], lacking[:-1]])
    giver = np.minimum(np.searchsorted(surplus, before, side="left"), heavy.size - 1)
    probability[light] = scaled[light]
    alias[light] = heavy[giver]
    # The light cell that takes each heavy one below 1; the last heavy one is left with exactly 1.
    taker = np.searchsorted(lacking, surplus[:-1], side="right")
    emptied = taker < light.size
    spent = heavy[:-1][emptied]
    probability[spent] = 1.0 + surplus[:-1][emptied] - lacking[taker[emptied]]
    alias[spent] = heavy[1:][emptied]
    return np.clip(probability, 0.0, 1.0), alias
