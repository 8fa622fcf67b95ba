"""The environment seen through Phong lobes of every exponent: a ladder of prefiltered maps."""

import math
from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxvis.lighting.blur import phong_lobes
from jaxvis.sphere import latlong

LARGEST_EXPONENT = 20000.0
"""Sharper lobes count as this one; roughness 0.1, the least there is, has 19998."""

_GROUPS = (4, 3, 2, 2, 2, 1, 1, 1)  # exponents that are computed alike, by one compiled program
_STEP = math.log(LARGEST_EXPONENT + 1.0) / (sum(_GROUPS) - 1)  # of log(a + 1): a factor of 1.94
_ROWS = 16.0  # of a map to sqrt(a + 1)
_LARGEST_HEIGHT = 512


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PhongLobes:
    """Normalised-lobe radiance (a + 1) / 2 pi int max(r.l, 0)^a L dl over all r and a.

    ``texels`` are maps of ``heights`` x 2 ``heights`` points, one exponent after the other, of
    which a + 1 is a geometric sequence. Bilinear in direction, a map misses the peak of a point
    light's lobe by at most 1 %; cubic in log(a + 1), the sequence misses it by 0.6 %. Above
    a = 1023 the maps stay at 512 rows, and lights of a degree or less are blurred.
    """

    texels: Float[Array, "texels 3"]
    heights: tuple[int, ...] = field(metadata={"static": True})

    @staticmethod
    def build(radiance: Float[Array, "height width 3"]) -> "PhongLobes":
        """From a lat-long map. Differentiable."""
        maps, heights, first = [], [], 0
        for count in _GROUPS:
            exponents = [math.expm1(_STEP * k) for k in range(first, first + count)]
            rows = math.ceil(_ROWS * math.sqrt(exponents[-1] + 1.0))
            heights += [min(rows, _LARGEST_HEIGHT)] * count
            maps.append(phong_lobes(radiance, exponents, heights[-1]).reshape(-1, 3))
            first += count
        return PhongLobes(jnp.concatenate(maps), tuple(heights))

    def radiance(
        self, mirror: Float[Array, "*points 3"], exponent: Float[Array, "*points"]
    ) -> Float[Array, "*points 3"]:
        """Mean radiance over the lobe of each exponent about each direction ``mirror``.

        Paper 000, eq. 14's integral times (a + 1) / 2 pi.
        """
        rung = jnp.log1p(jnp.maximum(exponent, 0.0)) * (1.0 / _STEP)
        rung = jnp.clip(rung, 0.0, len(self.heights) - 1.0)
        first = jnp.clip(rung.astype(jnp.int32) - 1, 0, len(self.heights) - 4)
        u, theta = latlong.coordinates(mirror)
        values = [self._at(first + k, u, theta) for k in range(4)]
        weights = _lagrange(rung - first)
        total = sum(w[..., None] * v for w, v in zip(weights, values, strict=True))
        return jnp.maximum(total, 0.0)

    def _at(
        self,
        rung: Int[Array, "*points"],
        u: Float[Array, "*points"],
        theta: Float[Array, "*points"],
    ) -> Float[Array, "*points 3"]:
        """Bilinear between the points of one map each."""
        starts = np.concatenate([[0], np.cumsum(2 * np.square(self.heights))[:-1]])
        start = jnp.asarray(starts, jnp.int32)[rung]
        height = jnp.asarray(self.heights, jnp.int32)[rung]
        x, y = u * (2 * height) - 0.5, theta * (height * (1.0 / jnp.pi)) - 0.5
        column, row = jnp.floor(x).astype(jnp.int32), jnp.floor(y).astype(jnp.int32)
        across, down = (x - column)[..., None], (y - row)[..., None]

        def at(r: Int[Array, "..."], c: Int[Array, "..."]) -> Float[Array, "..."]:
            beyond = (r < 0) | (r >= height)
            r = jnp.where(r < 0, -1 - r, jnp.where(r >= height, 2 * height - 1 - r, r))
            c = jnp.mod(jnp.where(beyond, c + height, c), 2 * height)
            return jnp.take(self.texels, start + r * (2 * height) + c, axis=0, mode="clip")

        upper = (1.0 - across) * at(row, column) + across * at(row, column + 1)
        lower = (1.0 - across) * at(row + 1, column) + across * at(row + 1, column + 1)
        return (1.0 - down) * upper + down * lower


def _lagrange(x: Float[Array, "*points"]) -> tuple[Float[Array, "*points"], ...]:
    """Weights of values at 0, 1, 2 and 3 in the cubic through them, at x."""
    a, b, c = x - 1.0, x - 2.0, x - 3.0
    return -a * b * c / 6.0, 0.5 * x * b * c, -0.5 * x * a * c, x * a * b / 6.0
