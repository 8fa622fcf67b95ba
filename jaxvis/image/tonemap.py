"""From linear radiance to what a display shows: one exposure, the sRGB curve, clipping."""

import numpy as np
from jaxtyping import Array, Bool, Float, Float32

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Weights of linear Rec. 709 red, green and blue in luminance (ITU-R BT.709)."""

WHITE_PERCENTILE = 99.5
"""The percentile of the reference's luminance that an exposure maps to 1."""


def luminance(
    radiance: Float[Array | np.ndarray, "*points 3"],
) -> Float[np.ndarray, "*points"]:
    """Luminance of linear Rec. 709 radiance, float64."""
    return np.asarray(radiance, np.float64) @ LUMINANCE


def exposure_of(
    reference: Float[Array | np.ndarray, "height width 3"],
    covered: Bool[Array | np.ndarray, "height width"],
) -> float:
    """The factor that maps the 99.5th percentile of the covered pixels' luminance to 1.

    It is 1 where that percentile is 0: a black image stays black.

    Raises:
        ValueError: no pixel is covered.
    """
    covered = np.asarray(covered)
    if not covered.any():
        raise ValueError("no pixel sees the scene: move the camera")
    white = np.percentile(luminance(reference)[covered], WHITE_PERCENTILE)
    return float(1.0 / white) if white > 0.0 else 1.0


def srgb_encode(linear: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """The sRGB transfer function (IEC 61966-2-1) of linear values, clipped to [0, 1]."""
    clipped = np.clip(linear, 0.0, 1.0)
    toe = 12.92 * clipped
    return np.where(clipped <= 0.0031308, toe, 1.055 * clipped ** (1.0 / 2.4) - 0.055)


def display(
    radiance: Float[Array | np.ndarray, "height width 3"], exposure: float
) -> Float32[np.ndarray, "height width 3"]:
    """Radiance times exposure, sRGB-encoded and clipped to [0, 1]: what a .png holds."""
    return srgb_encode(exposure * np.asarray(radiance, np.float64)).astype(np.float32)
