"""Removing noise from rendered images with Intel Open Image Denoise, an optional dependency.

Paper 000 (section IV-D) denoises its Monte Carlo images with OptiX's denoiser, which needs an
NVIDIA GPU; this one is as widely used and runs on any CPU.
"""

from types import ModuleType

import numpy as np
from jaxtyping import Array, Float, Float32

BORDER = 8
"""Pixels by which an image is continued, mirrored, beyond its edges: Open Image Denoise is up to
10 % off at the edges of a white image, 4 pixels further in less than 0.5 %."""


def denoiser() -> ModuleType:
    """The module that does it.

    Raises:
        ValueError: it is not installed, or of a version without what is needed.
    """
    try:
        import pyoidn
    except ImportError as error:
        raise ValueError(
            'denoising needs Open Image Denoise: pip install "jaxvis[denoise]"'
        ) from error
    if not hasattr(pyoidn, "denoise"):
        raise ValueError('pyoidn is too old to denoise: pip install --upgrade "jaxvis[denoise]"')
    return pyoidn


def denoise(
    radiance: Float[Array | np.ndarray, "height width 3"],
    albedo: Float[Array | np.ndarray, "height width 3"],
    normal: Float[Array | np.ndarray, "height width 3"],
) -> Float32[np.ndarray, "height width 3"]:
    """The image with its noise removed, linear radiance as before and non-negative. Host.

    Args:
        radiance: linear and unbounded; its unit does not matter.
        albedo: what the surface reflects, in [0, 1]; free of noise.
        normal: of length up to 1, zero where there is no surface; free of noise.

    Raises:
        ValueError: the extra ``denoise`` is missing, sizes differ or are 0, or a value is not
            finite.
        RuntimeError: Open Image Denoise fails.
    """
    module = denoiser()
    images = {
        name: np.ascontiguousarray(image, np.float32)
        for name, image in (("radiance", radiance), ("albedo", albedo), ("normal", normal))
    }
    if images["radiance"].size == 0:
        raise ValueError("radiance: an image without pixels cannot be denoised")
    for name, image in images.items():
        if image.shape != images["radiance"].shape:
            raise ValueError(
                f"{name} {image.shape} and radiance {images['radiance'].shape} differ in size"
            )
        if not np.all(np.isfinite(image)):
            raise ValueError(f"{name}: must be finite to be denoised")
    done = module.denoise(
        _mirrored(images["radiance"]),
        _mirrored(np.clip(images["albedo"], 0.0, 1.0)),
        _mirrored(np.clip(images["normal"], -1.0, 1.0)),
        hdr=True,
        clean_aux=True,
    )
    return np.maximum(done[BORDER:-BORDER, BORDER:-BORDER], np.float32(0.0))


def _mirrored(
    image: Float32[np.ndarray, "height width 3"],
) -> Float32[np.ndarray, "rows columns 3"]:
    return np.pad(image, ((BORDER, BORDER), (BORDER, BORDER), (0, 0)), mode="symmetric")
