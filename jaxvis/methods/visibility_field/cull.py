"""Which rays a field answers and which it leaves to be traced (paper 001, Algorithm 2)."""

from dataclasses import dataclass, field
from functools import partial
from typing import Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int, UInt8, UInt32

from jaxvis.methods.traced import Components, ShadingPoints
from jaxvis.methods.visibility_field.field import (
    OCCLUDED,
    TEXELS_PER_WORD,
    VISIBLE,
    FieldVisibility,
)
from jaxvis.methods.visibility_field.grid import Grid, cell_of
from jaxvis.methods.visibility_field.lookup import Lookup, row_of
from jaxvis.methods.visibility_field.masks import labels as occlusion_labels
from jaxvis.sphere import octahedral

Labels = Literal["four-state", "paper", "balanced", "visible"]

DROP, ACCEPT, TRACE = 0, 1, 2
"""What becomes of a ray: it is blocked; it reaches the sky; only tracing tells."""

UNKNOWN, BOTH = 0, VISIBLE | OCCLUDED
"""The other two states of a texel: no sample looked there; samples disagree."""


def rule(unknown: int, visible: int, occluded: int, both: int) -> int:
    """Decisions for the four states of a texel as one number, two bits each."""
    decisions = {UNKNOWN: unknown, VISIBLE: visible, OCCLUDED: occluded, BOTH: both}
    return sum(decision << (2 * state) for state, decision in decisions.items())


TRACE_ALL = rule(TRACE, TRACE, TRACE, TRACE)


def rules(
    stored: FieldVisibility, labels: Labels, *, conservative: bool, inverted: bool = True
) -> tuple[UInt32[Array, "rows"], Bool[Array, "rows"]]:
    """(decisions of each cell's masks, whether the cell's label is 0), one row more than cells.

    The last row is for cells without masks: there everything is traced.

    ``four-state``: what is visible only is accepted, what is occluded only is dropped, the rest is
    traced. The others follow a label: where it is 1, what may be visible is traced and the rest
    dropped; where it is 0, what may be occluded is traced and the rest accepted. The label is 1
    where more than half of the occlusion mask is set (``paper``, eqs. 7 and 8), where that has
    more bits than the visibility mask (``balanced``), or always (``visible``, and wherever
    ``inverted`` is false: glossy rays, section 6).

    ``conservative`` traces texels that no sample looked at, which labels take for blocked or free.
    """
    cells = len(stored.keys)
    if labels == "four-state":
        chosen = jnp.full(cells, rule(TRACE, ACCEPT, DROP, TRACE), jnp.uint32)
        label = jnp.ones(cells, bool)
    else:
        counts = jnp.asarray(stored.visible), jnp.asarray(stored.occluded)
        label = occlusion_labels(*counts, stored.size, labels if inverted else "visible")
        unknown = (TRACE, TRACE) if conservative else (DROP, ACCEPT)
        one = rule(unknown[0], TRACE, DROP, TRACE)
        zero = rule(unknown[1], ACCEPT, TRACE, TRACE)
        chosen = jnp.where(label, jnp.uint32(one), jnp.uint32(zero))
    everything = jnp.full(1, TRACE_ALL, jnp.uint32)
    return jnp.concatenate([chosen, everything]), jnp.concatenate([~label, jnp.zeros(1, bool)])


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Table:
    """What decisions need of a field, on the device: masks and their cells, and each row's rule."""

    grid: Grid
    lookup: Lookup
    words: UInt32[Array, "cells words"]
    rules: UInt32[Array, "rows"]
    size: int = field(metadata={"static": True})

    @classmethod
    def of(cls, stored: FieldVisibility, chosen: UInt32[Array, "rows"]) -> "Table":
        """Of a field and its :func:`rules`."""
        grid = jax.tree.map(jnp.asarray, stored.grid)
        lookup = Lookup.of(stored.keys, stored.grid.cells)
        return cls(grid, lookup, jnp.asarray(stored.words), chosen, stored.size)


@partial(jax.jit, static_argnames="size")
def decide(
    words: UInt32[Array, "cells words"],
    row: Int[Array, "points"],
    chosen: UInt32[Array, "points"],
    above: Bool[Array, "points samples"],
    directions: Components,
    *,
    size: int,
) -> UInt8[Array, "points samples"]:
    """What becomes of each ray, from the masks of its point's cell (lines 5 to 11).

    Args:
        row: of the masks; any for points whose rule does not look at them.
        chosen: the rule of each point, of :func:`rules`.
        above: rays above the plane of their triangle; the others are dropped.
    """
    i, j = octahedral.texel_of_components(*directions, size)
    texel = i * size + j
    per_cell = words.shape[1]
    place = (row * per_cell)[:, None] + texel // TEXELS_PER_WORD
    word = words.reshape(-1).at[place].get(mode="promise_in_bounds")
    state = (word >> (2 * (texel % TEXELS_PER_WORD)).astype(jnp.uint32)) & 3
    decision = (chosen[:, None] >> (2 * state)) & 3
    return jnp.where(above, decision, DROP).astype(jnp.uint8)


@jax.jit
def locate(table: Table, points: ShadingPoints) -> Int[Array, "points"]:
    """The row of the masks of each point; -1 where the field has none."""
    return row_of(table.lookup, cell_of(table.grid, points.origin))


@jax.jit
def above_plane(points: ShadingPoints, directions: Components) -> Bool[Array, "points samples"]:
    """Rays above the plane of their own triangle, which blocks the others."""
    normal = points.geometric_normal
    x, y, z = directions
    return normal[:, 0:1] * x + normal[:, 1:2] * y + normal[:, 2:3] * z > 0.0


@jax.jit
def decision_of(
    table: Table | None, points: ShadingPoints, directions: Components
) -> UInt8[Array, "points samples"]:
    """Decisions for a block of rays; without a field every ray above its plane is traced."""
    above = above_plane(points, directions)
    if table is None or not table.lookup.keys.shape[0]:
        return jnp.where(above, TRACE, DROP).astype(jnp.uint8)
    row = locate(table, points)
    chosen = jnp.take(table.rules, row, mode="wrap")  # -1 is the last row
    words, size = table.words, table.size
    return decide(words, jnp.maximum(row, 0), chosen, above, directions, size=size)
