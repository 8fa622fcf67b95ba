"""Where light changes fast: paper 000's Delta (eq. 17), on the host."""

import numpy as np
from jaxtyping import Float, Float32

WHITE_PERCENTILE = 99.5
"""Of the sites' luminance: what a display shows as white."""

VISIBLE = 0.25
"""Difference of CIE 1976 lightness (black is 0, white 100) that counts. One is just noticeable, but
inside a triangle the light may change more than blurring shows at its corners."""


def contrast(
    sharp: Float[np.ndarray, "sites 3"], blurred: Float[np.ndarray, "sites 3"]
) -> Float32[np.ndarray, "sites"]:
    """How different the light is from that of a blurred environment: 0, to 1 where it is visible.

    The paper takes the difference of radiances without saying in which unit. Here it is that of
    lightness on a display whose white is the brightest site, in parts of :data:`VISIBLE`: the same
    for every exposure, and as large in shadows as in the light.

    Args:
        sharp: irradiance or radiance under the environment.
        blurred: the same under the blurred one.
    """
    luminance = [np.maximum(part @ _LUMINANCE, 0.0) for part in (sharp, blurred)]
    white = np.percentile(luminance[0], WHITE_PERCENTILE) if len(sharp) else 0.0
    if not white > 0.0:
        return np.zeros(len(sharp), np.float32)
    a, b = (_lightness(part / white) for part in luminance)
    return np.minimum(np.abs(a - b) / VISIBLE, 1.0).astype(np.float32)


_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def _lightness(relative: Float[np.ndarray, "sites"]) -> Float[np.ndarray, "sites"]:
    """CIE 1976 L*."""
    toe = (29.0 / 3.0) ** 3 * relative
    return np.where(relative > (6.0 / 29.0) ** 3, 116.0 * np.cbrt(relative) - 16.0, toe)
