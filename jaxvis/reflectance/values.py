"""What a reflectance model needs to know of the material at each point."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

MINIMUM_ROUGHNESS = 0.1
"""Smaller roughness counts as this (a = 0.01, half a degree): no model is a mirror."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class MaterialValues:
    """Base colour, specular colour and roughness at each point: what every file comes down to.

    ``base_colour`` is the diffuse albedo, ``specular`` the colour of the specular lobe (its normal
    incidence reflectance in microfacet models, k_s in Phong's), both linear Rec. 709 in [0, 1];
    ``roughness`` is perceptual, in [0, 1]: the microfacet width is a = roughness^2 and the Phong
    exponent 2 / a^2 - 2 (DESIGN §3). ``model`` is the number of each point's model under
    :class:`~jaxvis.reflectance.mixed.Mixed`, which the other models ignore; None stands for 0
    everywhere.
    """

    base_colour: Float[Array, "*points 3"]
    specular: Float[Array, "*points 3"]
    roughness: Float[Array, "*points"]
    model: Int[Array, "*points"] | None = None

    @property
    def microfacet_width(self) -> Float[Array, "*points"]:
        """a = roughness^2, kept at or above that of :data:`MINIMUM_ROUGHNESS`."""
        return jnp.square(jnp.maximum(self.roughness, MINIMUM_ROUGHNESS))

    @property
    def exponent(self) -> Float[Array, "*points"]:
        """Phong and Blinn-Phong exponent of equal width."""
        return 2.0 / jnp.square(self.microfacet_width) - 2.0
