"""Drawing directions in proportion to a lat-long map, by inverting its cumulative distribution."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxvis.sampling import latlong_texels
from jaxvis.sampling.sequences import BELOW_ONE
from jaxvis.sphere import latlong
from jaxvis.sphere.components import join


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LatLongDistribution:
    """Piecewise constant over the texels: a marginal over rows, a conditional over columns.

    A continuous map of the unit square to the sphere, so that stratified or low-discrepancy
    uniforms stay so; it has an inverse. Two binary searches make it slower than
    :class:`EnvironmentSampler`.
    """

    rows: Float[Array, "*lights row_edges"]
    """Cumulative probability at each row's upper edge, 0 to 1."""
    columns: Float[Array, "*lights height column_edges"]
    """Within each row, the cumulative probability at each column's left edge, 0 to 1."""
    density: Float[Array, "*lights height width"]
    """Per steradian, in each texel."""
    bounds: Float[Array, "*lights height 2"]

    @staticmethod
    def build(luminance: Float[Array | np.ndarray, "height width"]) -> "LatLongDistribution":
        """From each texel's average luminance, on the host in float64.

        Zero everywhere gives uniform directions.

        Raises:
            ValueError: a value is negative or not finite.
        """
        weights, density = latlong_texels.normalised(luminance)
        in_row = weights.sum(axis=1)
        conditional = np.where(in_row[:, None] > 0.0, weights, 1.0)
        return LatLongDistribution(
            jnp.asarray(_cumulative(in_row), jnp.float32),
            jnp.asarray(_cumulative(conditional), jnp.float32),
            jnp.asarray(density, jnp.float32),
            jnp.asarray(latlong_texels.row_bounds(density.shape[0])),
        )

    def sample(self, uniforms: Float[Array, "*points 2"]) -> Float[Array, "*points 3"]:
        """Unit directions: the first uniform goes along u, the second along theta."""
        width = self.density.shape[1]
        row, down = _invert(self.rows, jnp.zeros(uniforms.shape[:-1], jnp.int32), uniforms[..., 1])
        start = row * (width + 1)
        place, across = _invert(self.columns.reshape(-1), start, uniforms[..., 0], width)
        return latlong_texels.inside(row, place - start, across, down, self.bounds, width)

    def pdf(self, directions: Float[Array, "*points 3"]) -> Float[Array, "*points"]:
        """Density per steradian at directions of any length but zero."""
        return latlong.nearest(self.density, directions)

    def inverse(self, directions: Float[Array, "*points 3"]) -> Float[Array, "*points 2"]:
        """The uniforms at which :meth:`sample` gives these unit directions.

        A whole texel of density zero goes to one value, at which another texel is drawn.
        """
        width = self.density.shape[1]
        row, column, across, down = latlong_texels.locate(directions, self.bounds, width)
        edge = row * (width + 1) + column
        return join(
            _between(self.columns.reshape(-1), edge, across), _between(self.rows, row, down)
        )


def _cumulative(weights: Float[np.ndarray, "*rows n"]) -> Float[np.ndarray, "*rows edges"]:
    total = np.cumsum(weights, axis=-1)
    start = np.zeros_like(total[..., :1])
    return np.concatenate([start, total], axis=-1) / total[..., -1:]


def _between(
    edges: Float[Array, "edges"], index: Int[Array, "*points"], fraction: Float[Array, "*points"]
) -> Float[Array, "*points"]:
    low, high = jnp.take(edges, index, mode="clip"), jnp.take(edges, index + 1, mode="clip")
    return low + fraction * (high - low)


def _invert(
    edges: Float[Array, "edges"],
    start: Int[Array, "*points"],
    uniform: Float[Array, "*points"],
    count: int | None = None,
) -> tuple[Int[Array, "*points"], Float[Array, "*points"]]:
    """(the last edge at or below ``uniform`` that has probability after it, how far beyond it).

    Searches the ``count`` intervals from index ``start`` of ``edges``.
    """
    uniform = jnp.minimum(uniform, BELOW_ONE)
    count = edges.shape[0] - 1 if count is None else count
    steps = (count - 1).bit_length()
    last = start + count - 1

    def halve(step: jax.Array, low: Int[Array, "*points"]) -> Int[Array, "*points"]:
        middle = jnp.minimum(low + (1 << (steps - 1 - step)), last)
        return jnp.where(jnp.take(edges, middle, mode="clip") <= uniform, middle, low)

    index = jax.lax.fori_loop(0, steps, halve, start)
    low, high = jnp.take(edges, index, mode="clip"), jnp.take(edges, index + 1, mode="clip")
    extent = high - low
    fraction = (uniform - low) / jnp.where(extent > 0.0, extent, 1.0)
    return index, jnp.clip(fraction, 0.0, BELOW_ONE)
