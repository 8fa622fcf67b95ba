"""Summed-area tables of lat-long maps: integrals over boxes of (phi, theta), seam included."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SummedAreaTable:
    """S[i, j] = sum of the values of rows before i and columns before j.

    The map it stands for has constant density in (phi, theta) within each texel; for it, bilinear
    interpolation of S is the exact integral from the north pole and column 0 to the point.

    Polygons: u runs to the right seen from *inside*, so contour integrals have the opposite sign
    of the usual ones. For points (u_i, v_i), counter-clockwise seen from outside, u unwrapped
    along the way, k = the whole turns from the first point to the last (which repeats the first),

        integral = max(k, 0) total - 1/2 sum_i [S(u_i+1, v_i) - S(u_i, v_i+1)]
                   - 1/2 [S(u_n, v_0) - S(u_0, v_0)]

    to the trapezoidal rule's error; the first term is there because S starts at the north pole.
    """

    corners: Float[Array, "*lights corner_rows corner_columns channels"]

    @staticmethod
    def build(values: Float[Array, "height width channels"]) -> "SummedAreaTable":
        """From each texel's integral (density times solid angle).

        Sums are carried in two float32 each, so that every corner is the rounded exact sum.
        Differentiable with respect to the values.
        """
        return SummedAreaTable(jnp.pad(_double_sum(values), ((1, 0), (1, 0), (0, 0))))

    @property
    def height(self) -> int:
        """Rows of the map."""
        return self.corners.shape[0] - 1

    @property
    def width(self) -> int:
        """Columns of the map."""
        return self.corners.shape[1] - 1

    @property
    def total(self) -> Float[Array, "channels"]:
        """The integral over the whole sphere."""
        return self.corners[-1, -1]

    def lookup(
        self, u: Float[Array, "*points"], v: Float[Array, "*points"]
    ) -> Float[Array, "*points channels"]:
        """S from column 0 to ``u`` and from the north pole to ``v``.

        Args:
            u: turns, unwrapped: any real number; each whole turn adds the rows' totals.
            v: rows, from 0 (north pole) to the map's height; v = theta height / pi.
        """
        turn = jnp.floor(u)
        x = (u - turn) * self.width
        column = jnp.clip(x.astype(jnp.int32), 0, self.width - 1)
        row = jnp.clip(v.astype(jnp.int32), 0, self.height - 1)
        fx, fy = (x - column)[..., None], (v - row)[..., None]
        stride, channels = self.width + 1, self.corners.shape[-1]
        flat = self.corners.reshape(-1, channels)
        first = row * stride + column

        def at(index: jax.Array) -> jax.Array:
            return jnp.take(flat, index, axis=0, mode="clip")

        upper = (1.0 - fx) * at(first) + fx * at(first + 1)
        lower = (1.0 - fx) * at(first + stride) + fx * at(first + stride + 1)
        end = row * stride + self.width
        whole = (1.0 - fy) * at(end) + fy * at(end + stride)
        return (1.0 - fy) * upper + fy * lower + turn[..., None] * whole

    def box(
        self,
        u0: Float[Array, "*points"],
        v0: Float[Array, "*points"],
        u1: Float[Array, "*points"],
        v1: Float[Array, "*points"],
    ) -> Float[Array, "*points channels"]:
        """The integral over u0 to u1 (turns, unwrapped) and v0 to v1 (rows)."""
        below = self.lookup(u1, v1) - self.lookup(u0, v1)
        return below - (self.lookup(u1, v0) - self.lookup(u0, v0))


@jax.custom_jvp
def _double_sum(
    values: Float[Array, "height width channels"],
) -> Float[Array, "height width channels"]:
    """Inclusive sums over rows and columns, each the exact sum rounded once or twice."""
    across = jnp.moveaxis(values, 1, 0)
    high, low = _running_sum(across, jnp.zeros_like(across))
    high, low = _running_sum(jnp.moveaxis(high, 0, 1), jnp.moveaxis(low, 0, 1))
    return high + low


@_double_sum.defjvp
def _double_sum_jvp(primals: tuple, tangents: tuple) -> tuple:
    """The sums are linear; derivatives do without the compensation."""
    return _double_sum(*primals), jnp.cumsum(jnp.cumsum(tangents[0], axis=0), axis=1)


def _running_sum(
    high: Float[Array, "steps *rest"], low: Float[Array, "steps *rest"]
) -> tuple[Float[Array, "steps *rest"], Float[Array, "steps *rest"]]:
    """Inclusive sums over the first axis of numbers held as high + low (Knuth's two-sum)."""

    def add(carry: tuple, term: tuple) -> tuple:
        total, rest = carry
        larger = total + term[0]
        added = larger - total
        error = (total - (larger - added)) + (term[0] - added)
        rest = rest + error + term[1]
        return (larger, rest), (larger, rest)

    start = (jnp.zeros_like(high[0]), jnp.zeros_like(low[0]))
    return jax.lax.scan(add, start, (high, low))[1]
