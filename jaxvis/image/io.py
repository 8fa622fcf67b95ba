"""Image files through OpenImageIO: .exr, .hdr and .pfm hold linear radiance, .png what is shown."""

import os
from pathlib import Path

import numpy as np
from jaxtyping import Array, Float, Float32

from jaxvis.cache import whole_file
from jaxvis.pixels import first_line, read_stored

FORMATS = (".exr", ".hdr", ".pfm", ".png")


def write_image(
    path: str | os.PathLike, pixels: Float[Array | np.ndarray, "height width channels"]
) -> None:
    """Writes an image, whole or not at all; the suffix of ``path`` says in which format.

    Args:
        path: .exr (float32, lossless), .hdr (shared exponent), .pfm (float32) or .png (8 bits).
        pixels: row 0 on top; 1, 3 or 4 channels (.hdr: 3). For .png, display values in [0, 1]
            (see :func:`jaxvis.image.display`), the fourth channel being opacity.

    Raises:
        ValueError: another suffix, or channels that the format cannot hold.
        OSError: the file cannot be written.
    """
    import OpenImageIO as oiio

    path = Path(path)
    suffix = _known_suffix(path)
    values = np.ascontiguousarray(pixels, np.float32)
    height, width, channels = values.shape
    if channels not in ((3,) if suffix == ".hdr" else (1, 3) if suffix == ".pfm" else (1, 3, 4)):
        raise ValueError(f"{path}: {suffix} does not hold {channels} channels")
    if suffix == ".png":
        values = np.rint(255.0 * np.clip(values, 0.0, 1.0)).astype(np.uint8)
    spec = oiio.ImageSpec(width, height, channels, oiio.TypeFloat)
    if suffix == ".png":
        spec.set_format(oiio.TypeUInt8)
        spec.attribute("oiio:UnassociatedAlpha", 1)
    elif suffix == ".exr":
        spec.attribute("compression", "zip")
    elif suffix == ".pfm":
        # Rows go from bottom to top. OpenImageIO 3.2 turns a tall image over in blocks only, so it
        # is told to leave the rows alone, as for reading.
        spec.attribute("pnm:pfmflip", 0)
        values = np.ascontiguousarray(values[::-1])
    with whole_file(path) as temporary:
        output = oiio.ImageOutput.create(str(temporary))
        if output is None:
            raise OSError(f"{path}: cannot be written ({first_line(oiio.geterror())})")
        if not (
            output.open(str(temporary), spec) and output.write_image(values) and output.close()
        ):
            raise OSError(f"{path}: cannot be written ({first_line(output.geterror())})")


def read_image(path: str | os.PathLike) -> Float32[np.ndarray, "height width channels"]:
    """The pixels of an image file as stored, row 0 on top; those of a .png in [0, 1].

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: another suffix, or a file that is damaged.
    """
    path = Path(path)
    _known_suffix(path)
    return read_stored(path).pixels


def _known_suffix(path: Path) -> str:
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise ValueError(f"{path}: unknown image format; use one of {', '.join(FORMATS)}")
    return suffix
