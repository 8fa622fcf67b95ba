"""What the textured built-in scenes share: texels' places, blends, materials of three textures."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Float64

from jaxvis.reflectance import Material, Texture

Image = Float[np.ndarray, "height width"]
ColourImage = Float[np.ndarray, "height width 3"]


def texel_places(texels: int) -> Float64[np.ndarray, "texels texels 2"]:
    """Texture coordinates of the centres of a square texture's texels, row 0 on top (v = 1)."""
    u = (np.arange(texels) + 0.5) / texels
    return np.stack(np.meshgrid(u, 1.0 - u), axis=-1)


def blend(
    share: Image,
    one: Sequence[float] | Float[np.ndarray, "..."],
    other: Sequence[float] | Float[np.ndarray, "..."],
) -> ColourImage:
    """``one`` where the share is 0, ``other`` where it is 1; colours or images of them."""
    weight = share[..., None]
    return (1.0 - weight) * np.asarray(one) + weight * np.asarray(other)


def textured(
    name: str, base: ColourImage, specular: ColourImage, roughness: Image, model: int = 0
) -> Material:
    """A material whose three values are images; clipped to [0, 1]."""

    def texture(values: Float[np.ndarray, "height width channels"]) -> Texture:
        return Texture(np.clip(values, 0.0, 1.0).astype(np.float32))

    return Material(
        base_colour=(1.0, 1.0, 1.0),
        specular=(1.0, 1.0, 1.0),
        roughness=1.0,
        base_colour_texture=texture(base),
        specular_texture=texture(specular),
        roughness_texture=texture(roughness[..., None]),
        name=name,
        model=model,
    )
