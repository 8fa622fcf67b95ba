"""Textures on the host: linear texels, looked up by texture coordinates."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32


@dataclass(frozen=True, eq=False)
class Texture:
    """An image of reflectance or roughness, LINEAR, in [0, 1]; row 0 is the top.

    Texture coordinates have their origin at the bottom left with v upwards (as trimesh gives them)
    and repeat. Lookup is bilinear between texel centres. Two textures are equal only if they are
    the same object. Read-only.
    """

    texels: Float32[np.ndarray, "height width channels"]

    def __post_init__(self) -> None:
        texels = np.array(self.texels, dtype=np.float32)
        if texels.ndim != 3 or texels.size == 0:
            raise ValueError(
                f"texture texels must be [height, width, channels], got shape {texels.shape}"
            )
        if not (texels.min() >= 0.0 and texels.max() <= 1.0):  # also catches NaN
            raise ValueError("texture texels must lie in [0, 1]: rescale the image first")
        texels.setflags(write=False)
        object.__setattr__(self, "texels", texels)

    @staticmethod
    def from_image(image: np.ndarray, srgb: bool) -> "Texture":
        """Texture of an image [height, width] or [height, width, 1 to 4]; alpha is dropped.

        Integers are scaled from their type's range to [0, 1]; floats must lie in [0, 1] already.
        ``srgb`` says that the values are sRGB-encoded (colours are; roughness is not).
        """
        if image.ndim not in (2, 3) or (image.ndim == 3 and not 1 <= image.shape[-1] <= 4):
            raise ValueError(
                f"texture image must be [height, width] or [height, width, 1 to 4], got shape "
                f"{image.shape}"
            )
        texels = image[..., None] if image.ndim == 2 else image
        if texels.shape[-1] in (2, 4):
            texels = texels[..., :-1]
        if np.issubdtype(texels.dtype, np.integer):
            texels = texels / np.float64(np.iinfo(texels.dtype).max)
        texels = texels.astype(np.float64)
        return Texture((srgb_to_linear(texels) if srgb else texels).astype(np.float32))

    @property
    def channels(self) -> int:
        return self.texels.shape[-1]

    def sample(self, uv: Float[np.ndarray, "points 2"]) -> Float32[np.ndarray, "points channels"]:
        """Bilinear values at ``uv``, which repeats with period 1 in both directions."""
        height, width, _ = self.texels.shape
        x = uv[:, 0].astype(np.float64) * width - 0.5
        y = (1.0 - uv[:, 1].astype(np.float64)) * height - 0.5
        column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
        fx, fy = (x - column)[:, None].astype(np.float32), (y - row)[:, None].astype(np.float32)
        left, right = column % width, (column + 1) % width
        top, bottom = row % height, (row + 1) % height
        upper = (1 - fx) * self.texels[top, left] + fx * self.texels[top, right]
        lower = (1 - fx) * self.texels[bottom, left] + fx * self.texels[bottom, right]
        return (1 - fy) * upper + fy * lower


def srgb_to_linear(encoded: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Exact sRGB decoding (IEC 61966-2-1) of values in [0, 1]."""
    curve = ((np.maximum(encoded, 0.0) + 0.055) / 1.055) ** 2.4
    return np.where(encoded <= 0.04045, encoded / 12.92, curve)
