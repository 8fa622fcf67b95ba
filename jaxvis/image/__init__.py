"""Images: how far from the reference, how to show them, how to store them."""

from jaxvis.image.io import read_image, write_image
from jaxvis.image.metrics import displayed_error, flip, psnr, relative_rmse, relmse, rmse
from jaxvis.image.tonemap import display, exposure_of, luminance, srgb_encode

__all__ = [
    "display",
    "displayed_error",
    "exposure_of",
    "flip",
    "luminance",
    "psnr",
    "read_image",
    "relative_rmse",
    "relmse",
    "rmse",
    "srgb_encode",
    "write_image",
]
