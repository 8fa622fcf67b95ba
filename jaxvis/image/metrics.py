"""How far an image is from the reference. Host code; sums are float64.

Every metric looks only at the pixels that see the scene (``covered``). PSNR and FLIP compare what
a display shows after one exposure for all images, taken from the reference; the others compare
linear radiance.
"""

import numpy as np
from jaxtyping import Array, Bool, Float

from jaxvis.image.tonemap import display, exposure_of, srgb_encode

Image = Float[Array | np.ndarray, "height width 3"]
Mask = Bool[Array | np.ndarray, "height width"]

RELMSE_EPSILON = 0.01
"""Added to the squared exposed reference in :func:`relmse` (Rousselle et al. 2011)."""

FLIP_PIXELS_PER_DEGREE = 67.0
"""FLIP's viewing condition: a 0.7 m wide 4K display seen from 0.7 m (its default)."""


def psnr(image: Image, reference: Image, covered: Mask, exposure: float | None = None) -> float:
    """Peak signal-to-noise ratio in dB between the displayed images; infinite if they are equal.

    Both images are multiplied by ``exposure`` (by default the one that maps the 99.5th percentile
    of the reference's luminance to 1), sRGB-encoded and clipped to [0, 1]; the peak is 1.
    """
    error = displayed_error(image, reference, covered, exposure)[np.asarray(covered)]
    mean = np.mean(np.square(error))
    return float(-10.0 * np.log10(mean)) if mean > 0.0 else float("inf")


def displayed_error(
    image: Image, reference: Image, covered: Mask, exposure: float | None = None
) -> Float[np.ndarray, "height width"]:
    """Per pixel, the root mean square over the channels of the displayed images' difference.

    In display units (1 is white), 0 where a pixel does not see the scene. The mean of its square
    over the covered pixels is the error that :func:`psnr` measures.
    """
    x, y, covered = _checked(image, reference, covered)
    exposure = exposure_of(y, covered) if exposure is None else exposure
    difference = srgb_encode(exposure * x) - srgb_encode(exposure * y)
    return np.where(covered, np.sqrt(np.mean(np.square(difference), axis=-1)), 0.0)


def rmse(image: Image, reference: Image, covered: Mask) -> float:
    """Root mean square difference of linear radiance, over covered pixels and channels."""
    x, y, covered = _checked(image, reference, covered)
    return float(np.sqrt(np.mean(np.square(x - y)[covered])))


def relative_rmse(image: Image, reference: Image, covered: Mask) -> float:
    """:func:`rmse` over the mean radiance of the reference; infinite where that is 0."""
    error = rmse(image, reference, covered)
    mean = float(np.mean(np.asarray(reference, np.float64)[np.asarray(covered)]))
    return error / mean if mean > 0.0 else (float("inf") if error > 0.0 else 0.0)


def relmse(image: Image, reference: Image, covered: Mask, exposure: float | None = None) -> float:
    """Mean of squared error relative to the squared reference, per pixel and channel, linear.

    mean((x - y)² / (y² + ε / exposure²)) with ε = 0.01 as in Rousselle et al. 2011: dividing by the
    exposure states ε for an image whose white is 1, so that the light's unit does not matter.
    """
    x, y, covered = _checked(image, reference, covered)
    exposure = exposure_of(y, covered) if exposure is None else exposure
    relative = np.square(x - y) / (np.square(y) + RELMSE_EPSILON / exposure**2)
    return float(np.mean(relative[covered]))


def flip(
    image: Image, reference: Image, covered: Mask, exposure: float | None = None
) -> float | None:
    """Mean FLIP error (Andersson et al. 2020) of the displayed images, in [0, 1].

    Pixels that do not see the scene are black in both images and left out of the mean.
    None without the optional package flip-evaluator (``pip install jaxvis[metrics]``).
    """
    try:
        import flip_evaluator
    except ImportError:
        return None
    x, y, covered = _checked(image, reference, covered)
    exposure = exposure_of(y, covered) if exposure is None else exposure
    shown, wanted = (
        np.where(covered[..., None], display(pixels, exposure), np.float32(0.0))
        for pixels in (x, y)
    )
    error, _, _ = flip_evaluator.evaluate(
        wanted,
        shown,
        "LDR",
        applyMagma=False,
        computeMeanError=False,
        parameters={"ppd": FLIP_PIXELS_PER_DEGREE},
    )
    return float(np.mean(np.asarray(error, np.float64).reshape(covered.shape)[covered]))


def _checked(
    image: Image, reference: Image, covered: Mask
) -> tuple[
    Float[np.ndarray, "height width 3"],
    Float[np.ndarray, "height width 3"],
    Bool[np.ndarray, "height width"],
]:
    x, y = np.asarray(image, np.float64), np.asarray(reference, np.float64)
    covered = np.asarray(covered)
    if x.shape != y.shape or covered.shape != y.shape[:2]:
        raise ValueError(
            f"image {x.shape}, reference {y.shape} and coverage {covered.shape} differ in size"
        )
    if not covered.any():
        raise ValueError("no pixel sees the scene: move the camera")
    return x, y, covered
