"""Tabulated distributions of directions with few knots: Lawrence, Rusinkiewicz and Ramamoorthi
2005, "Adaptive Numerical Cumulative Distribution Functions for Efficient Importance Sampling".
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxvis.compiled import compiled
from jaxvis.sampling.sequences import BELOW_ONE
from jaxvis.sphere import latlong
from jaxvis.sphere.angles import sine_cosine
from jaxvis.sphere.components import join

FEWEST_KNOTS = 1 << 12
"""Knots are padded to a power of two from here on, so that few shapes are compiled."""


def compress(
    places: Float[np.ndarray, "knots"],
    values: Float[np.ndarray, "curves knots"],
    tolerance: float,
) -> Bool[np.ndarray, "curves knots"]:
    """Which knots of each piecewise linear curve to keep: Douglas and Peucker 1973.

    The curve through those that are kept stays within ``tolerance`` of the curve's values (maximum
    norm). The end points are kept. Host.

    Raises:
        ValueError: ``tolerance`` is negative or not finite.
    """
    if not 0.0 <= tolerance < np.inf:
        raise ValueError(f"tolerance must be a number of at least 0, got {tolerance}")
    kept = np.zeros(values.shape, bool)
    _keep(
        np.ascontiguousarray(places, np.float64),
        np.ascontiguousarray(values, np.float64),
        float(tolerance),
        kept,
    )
    return kept


def cumulative(weights: Float[np.ndarray, "curves n"]) -> Float[np.ndarray, "curves knots"]:
    """Sums of non-negative weights from 0 to 1, as float32 holds them; even where all are 0."""
    values = np.empty((len(weights), weights.shape[1] + 1))
    _sum_up(np.ascontiguousarray(weights, np.float64), values)
    return values


def slopes(
    places: Float[np.ndarray, "knots"],
    values: Float[np.ndarray, "curves knots"],
    kept: Bool[np.ndarray, "curves knots"],
) -> Float[np.ndarray, "curves n"]:
    """In each interval the slope of the curve through the knots that are kept."""
    result = np.empty((len(values), len(places) - 1))
    _slopes(places, values, kept, result)
    return result


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class AdaptiveCdfs:
    """Several distributions of directions, each by compressed cumulative distributions.

    The marginal one is over height, x = (1 - cos theta) / 2 in [0, 1], the conditional ones, one
    for each row of the lat-long table that it was made from, are over u. Compressed or not they are
    piecewise linear, so that densities are constant in each cell of the table: sampling inverts the
    knots that are kept, and :meth:`pdf` looks up the exact density of what is so drawn.
    """

    places: Float[Array, "knots"]
    """Where the knots are, one curve after another: of each table the marginal, then its rows."""
    values: Float[Array, "knots"]
    """The cumulative distribution there."""
    starts: Int[Array, "tables curves"]
    """First knot of each curve; ``curves`` is 1 + rows."""
    counts: Int[Array, "tables curves"]
    """Knots of each curve."""
    density: Float[Array, "tables rows columns"]
    """Per steradian, in each cell of the table."""

    @staticmethod
    def build(tables: Float[np.ndarray, "tables rows columns"], tolerance: float) -> "AdaptiveCdfs":
        """From densities (in any unit) in the texels of lat-long tables, on the host in float64.

        A table of zeros gives uniform directions. Densities stay positive where
        they are: but for intervals of a probability below 6e-8, which float32 does not hold.

        Args:
            tolerance: largest error of a cumulative distribution.

        Raises:
            ValueError: a value is negative or not finite.
        """
        if not np.all(np.isfinite(tables)) or np.any(tables < 0.0):
            raise ValueError("tables: must be finite and non-negative")
        empty = ~tables.any(axis=(1, 2), keepdims=True)
        if empty.any():
            tables = np.where(empty, 1.0, tables)
        count, rows, columns = tables.shape
        heights = 0.5 - 0.5 * np.cos(np.pi * np.arange(rows + 1) / rows)
        turns = np.linspace(0.0, 1.0, columns + 1)
        marginal = cumulative(tables.sum(axis=2) * np.diff(heights))
        conditional = cumulative(tables.reshape(-1, columns))
        kept = compress(heights, marginal, tolerance), compress(turns, conditional, tolerance)
        density = (
            slopes(heights, marginal, kept[0]).reshape(count, rows, 1)
            * slopes(turns, conditional, kept[1]).reshape(count, rows, columns)
            / (4.0 * np.pi)
        )
        # One curve after another, padded to the longer kind: what is not kept drops out.
        shape = (count, 1 + rows, max(rows, columns) + 1)
        keep, place, value = np.zeros(shape, bool), np.zeros(shape), np.zeros(shape)
        for curves, length, where, levels, which in (
            (slice(0, 1), rows + 1, heights, marginal, kept[0]),
            (slice(1, None), columns + 1, turns, conditional, kept[1]),
        ):
            keep[:, curves, :length] = which.reshape(count, -1, length)
            place[:, curves, :length] = where
            value[:, curves, :length] = levels.reshape(count, -1, length)
        counts = keep.sum(axis=2)
        starts = (np.cumsum(counts) - counts.reshape(-1)).reshape(counts.shape)
        capacity = max(FEWEST_KNOTS, 1 << int(counts.sum() - 1).bit_length())
        return AdaptiveCdfs(
            jnp.asarray(_padded(place[keep], capacity)),
            jnp.asarray(_padded(value[keep], capacity)),
            jnp.asarray(starts, jnp.int32),
            jnp.asarray(counts, jnp.int32),
            jnp.asarray(density, jnp.float32),
        )

    @property
    def knots(self) -> int:
        """Knots that are kept, of all curves."""
        return int(jnp.sum(self.counts))

    def sample(
        self, table: Int[Array, "*points"], uniforms: Float[Array, "*points 2"]
    ) -> Float[Array, "*points 3"]:
        """Unit directions of these tables; the first uniform goes along u, the second along x."""
        x, u, _ = self._draw(table, uniforms)
        sine, cosine = 2.0 * jnp.sqrt(jnp.maximum(x * (1.0 - x), 0.0)), 1.0 - 2.0 * x
        sine_phi, cosine_phi = sine_cosine(u)
        return join(sine * sine_phi, cosine, -sine * cosine_phi)

    def sample_cell(
        self, table: Int[Array, "*points"], uniforms: Float[Array, "*points 2"]
    ) -> Int[Array, "*points"]:
        """The cells (row * columns + column) of what :meth:`sample` gives."""
        columns = self.density.shape[2]
        _, u, row = self._draw(table, uniforms)
        return row * columns + jnp.minimum((u * columns).astype(jnp.int32), columns - 1)

    def pdf(
        self, table: Int[Array, "*#points"], directions: Float[Array, "*#points 3"]
    ) -> Float[Array, "..."]:
        """Density per steradian of these tables at directions of any length but zero."""
        _, rows, columns = self.density.shape
        row, column = latlong.texel(directions, rows, columns)
        return self.cell_pdf(table, row * columns + column)

    def cell_pdf(
        self, table: Int[Array, "*#points"], cell: Int[Array, "*#points"]
    ) -> Float[Array, "..."]:
        """Density per steradian of these tables in their cells."""
        _, rows, columns = self.density.shape
        return jnp.take(self.density.reshape(-1), table * (rows * columns) + cell, mode="clip")

    def _draw(
        self, table: Int[Array, "*points"], uniforms: Float[Array, "*points 2"]
    ) -> tuple[Float[Array, "*points"], Float[Array, "*points"], Int[Array, "*points"]]:
        """Height x, u and row."""
        _, rows, columns = self.density.shape
        curve = table * (1 + rows)
        x = self._invert(curve, uniforms[..., 1], rows)
        # Half the angle from +Y has the sine sqrt(x).
        half = jnp.arctan2(jnp.sqrt(x), jnp.sqrt(1.0 - x))
        row = jnp.minimum((half * (2.0 * rows / jnp.pi)).astype(jnp.int32), rows - 1)
        return x, self._invert(curve + 1 + row, uniforms[..., 0], columns), row

    def _invert(
        self, curve: Int[Array, "*points"], uniform: Float[Array, "*points"], intervals: int
    ) -> Float[Array, "*points"]:
        """Where the curve has the value ``uniform``, by bisection."""
        uniform = jnp.minimum(uniform, BELOW_ONE)
        start = jnp.take(self.starts.reshape(-1), curve, mode="clip")
        last = start + jnp.take(self.counts.reshape(-1), curve, mode="clip") - 2
        steps = intervals.bit_length()

        def halve(step: jax.Array, low: jax.Array) -> jax.Array:
            middle = jnp.minimum(low + (1 << (steps - 1 - step)), last)
            return jnp.where(jnp.take(self.values, middle, mode="clip") <= uniform, middle, low)

        knot = jax.lax.fori_loop(0, steps, halve, start)
        low, high = (jnp.take(self.values, knot + k, mode="clip") for k in (0, 1))
        left, right = (jnp.take(self.places, knot + k, mode="clip") for k in (0, 1))
        extent = high - low
        fraction = (uniform - low) / jnp.where(extent > 0.0, extent, 1.0)
        return left + jnp.clip(fraction, 0.0, BELOW_ONE) * (right - left)


def _padded(knots: Float[np.ndarray, "knots"], capacity: int) -> Float[np.ndarray, "capacity"]:
    return np.pad(knots, (0, capacity - len(knots)), constant_values=1.0).astype(np.float32)


@compiled
def _keep(places, values, tolerance, kept):
    """Marks the knots: splits at the farthest one until none is farther than the tolerance."""
    last = values.shape[1] - 1
    stack = np.empty((values.shape[1] + 1, 2), np.int64)
    for curve in range(values.shape[0]):
        kept[curve, 0] = kept[curve, last] = True
        stack[0, 0], stack[0, 1] = 0, last
        waiting = 1
        while waiting:
            waiting -= 1
            first, end = stack[waiting, 0], stack[waiting, 1]
            low, x = values[curve, first], places[first]
            slope = (values[curve, end] - low) / (places[end] - x)
            farthest, distance = -1, tolerance
            for knot in range(first + 1, end):
                apart = abs(values[curve, knot] - low - slope * (places[knot] - x))
                if apart > distance:
                    farthest, distance = knot, apart
            if farthest >= 0:
                kept[curve, farthest] = True
                stack[waiting, 0], stack[waiting, 1] = first, farthest
                stack[waiting + 1, 0], stack[waiting + 1, 1] = farthest, end
                waiting += 2


@compiled
def _sum_up(weights, values):
    """Cumulative sums from 0 to 1, rounded to float32."""
    count = weights.shape[1]
    for curve in range(weights.shape[0]):
        total = 0.0
        for knot in range(count):
            total += weights[curve, knot]
        upto = 0.0
        values[curve, 0] = 0.0
        for knot in range(count):
            if total > 0.0:
                upto += weights[curve, knot] / total
            else:
                upto = (knot + 1) / count
            values[curve, knot + 1] = np.float32(min(upto, 1.0))
        values[curve, count] = 1.0


@compiled
def _slopes(places, values, kept, result):
    """Between each two knots that are kept, the slope for every interval."""
    for curve in range(values.shape[0]):
        before = 0
        for knot in range(1, values.shape[1]):
            if kept[curve, knot]:
                rise = values[curve, knot] - values[curve, before]
                result[curve, before:knot] = rise / (places[knot] - places[before])
                before = knot
