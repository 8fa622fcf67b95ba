"""Drawing directions in proportion to a lat-long map, by an alias table over its texels."""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxvis.sampling import latlong_texels
from jaxvis.sampling.alias import AliasTable
from jaxvis.sphere import latlong

_SPLIT = 2048.0


class EnvironmentSample(NamedTuple):
    """Directions drawn, the texels that hold them, and their density."""

    directions: Float[Array, "*points 3"]
    texel: Int[Array, "*points"]
    """row * width + column. Take the radiance with it rather than with the direction, which may
    round to the texel beside it."""
    pdf: Float[Array, "*points"]
    """Per steradian."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class EnvironmentSampler:
    """Texels in proportion to luminance times exact solid angle, directions uniform within them.

    The density is exactly constant in each texel. The fastest way to draw from a map; it does not
    keep the stratification of its uniforms, which :class:`LatLongDistribution` does.
    """

    table: AliasTable
    density: Float[Array, "*lights height width"]
    """Per steradian, in each texel."""
    bounds: Float[Array, "*lights height 2"]

    @staticmethod
    def build(luminance: Float[Array | np.ndarray, "height width"]) -> "EnvironmentSampler":
        """From each texel's average luminance, on the host in float64.

        Zero everywhere gives uniform directions.

        Raises:
            ValueError: a value is negative or not finite, or there are more than 2^23 texels.
        """
        weights, density = latlong_texels.normalised(luminance)
        return EnvironmentSampler(
            AliasTable.build(weights.reshape(-1)),
            jnp.asarray(density, jnp.float32),
            jnp.asarray(latlong_texels.row_bounds(density.shape[0])),
        )

    def sample(self, uniforms: Float[Array, "*points dimensions"]) -> EnvironmentSample:
        """Draws with 2, 3 or 4 uniforms in [0, 1) for each direction.

        The first two draw the texel. Position within it: with four, the last two; with three,
        what is left of the second (in u) and the third (in cos theta); with two, both come from
        what is left of the second, u from its leading and cos theta from its trailing digits.
        Fewer uniforms are cheaper to make and no less uniform down to about 1/1000 of a texel.
        """
        u1, u2 = uniforms[..., 0], uniforms[..., 1]
        if uniforms.shape[-1] == 4:
            texel = self.table.sample(u1, u2)
            across, down = uniforms[..., 2], uniforms[..., 3]
        elif uniforms.shape[-1] == 3:
            texel, across = self.table.sample_remainder(u1, u2)
            down = uniforms[..., 2]
        elif uniforms.shape[-1] == 2:
            texel, across = self.table.sample_remainder(u1, u2)
            down = across * _SPLIT
            down = down - jnp.floor(down)
        else:
            raise ValueError(f"uniforms: 2, 3 or 4 a direction, got {uniforms.shape[-1]}")
        return EnvironmentSample(self.inside(texel, across, down), texel, self.texel_pdf(texel))

    def inside(
        self,
        texel: Int[Array, "*points"],
        across: Float[Array, "*points"],
        down: Float[Array, "*points"],
    ) -> Float[Array, "*points 3"]:
        """Unit directions at fractions of u and of cos theta of texels row * width + column."""
        width = self.density.shape[1]
        row = texel // width
        return latlong_texels.inside(row, texel - row * width, across, down, self.bounds, width)

    def texel_pdf(self, texel: Int[Array, "*points"]) -> Float[Array, "*points"]:
        """Density per steradian in texels row * width + column."""
        return jnp.take(self.density.reshape(-1), texel, mode="clip")

    def pdf(self, directions: Float[Array, "*points 3"]) -> Float[Array, "*points"]:
        """Density per steradian at directions of any length but zero."""
        row, column = latlong.texel(directions, *self.density.shape)
        return self.texel_pdf(row * self.density.shape[1] + column)
