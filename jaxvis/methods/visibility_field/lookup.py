"""From a cell's number to the row of its masks: buckets of cells, then bisection of their keys."""

from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

BUCKET_BITS = 16
"""At most two to this power of buckets: a table that stays in cache."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Lookup:
    """The occupied cells' numbers, ascending, and where those of each 2^``shift`` cells begin."""

    keys: Int[Array, "cells"]
    starts: Int[Array, "buckets"]
    shift: int = field(metadata={"static": True})

    @classmethod
    def of(cls, keys: Int[Array | np.ndarray, "cells"], cells: int) -> "Lookup":
        """For sorted ``keys`` of a grid of as many ``cells``."""
        shift = max(0, (cells - 1).bit_length() - BUCKET_BITS)
        counts = np.bincount(np.asarray(keys) >> shift, minlength=((cells - 1) >> shift) + 1)
        starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
        return cls(jnp.asarray(keys), jnp.asarray(starts), shift)


def row_of(lookup: Lookup, cells: Int[Array | np.ndarray, "*points"]) -> Int[Array, "*points"]:
    """The row of each cell; -1 for cells without and for -1, which is no cell (jitted)."""
    keys = lookup.keys
    if not keys.shape[0]:
        return jnp.full(cells.shape, -1, jnp.int32)
    bucket = jnp.maximum(jnp.asarray(cells), 0) >> lookup.shift
    low, high = jnp.take(lookup.starts, bucket), jnp.take(lookup.starts, bucket + 1)
    for _ in range(lookup.shift + 1):
        middle = (low + high) // 2
        below = (low < high) & (jnp.take(keys, middle, mode="clip") < cells)
        low, high = jnp.where(below, middle + 1, low), jnp.where(below, high, middle)
    found = jnp.take(keys, low, mode="clip") == cells
    return jnp.where(found, jnp.minimum(low, keys.shape[0] - 1), -1)
