"""Pixels as image files store them, through OpenImageIO."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32


@dataclass(frozen=True, eq=False)
class Stored:
    """The pixels of a file, and what it says of them."""

    pixels: Float32[np.ndarray, "height width channels"]
    """Row 0 on top; integers as parts of 1."""
    channels: tuple[str, ...]
    picture: tuple[int, int]
    """Width and height of the picture that the pixels are of: all, unless it is cropped."""
    orientation: int
    """As Exif numbers them; 1 is upright."""


def read_stored(path: Path) -> Stored:
    """Reads the first picture of a file.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it cannot be read, or is truncated or damaged.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file")
    try:
        return _read(path)
    except UnicodeDecodeError as error:  # of names in the file
        raise ValueError(f"{path}: damaged (a name in it is no text)") from error


def _read(path: Path) -> Stored:
    import OpenImageIO as oiio

    config = oiio.ImageSpec()
    # OpenImageIO 3.2 turns only some .pfm files over, by their size: it shall leave them alone.
    config.attribute("pnm:pfmflip", 0)
    source = oiio.ImageInput.open(str(path), config)
    if source is None:
        raise ValueError(f"{path}: cannot be read ({first_line(oiio.geterror())})")
    spec = source.spec()
    pixels = source.read_image(0, 0, 0, spec.nchannels, oiio.FLOAT)
    problem = source.geterror()
    source.close()
    if pixels is None or problem:
        raise ValueError(f"{path}: truncated or damaged ({first_line(problem)})")
    pixels = np.asarray(pixels, np.float32).reshape(spec.height, spec.width, spec.nchannels)
    return Stored(
        pixels[::-1] if path.suffix.lower() == ".pfm" else pixels,
        tuple(spec.channelnames),
        (spec.full_width, spec.full_height),
        spec.get_int_attribute("Orientation", 1),
    )


def first_line(text: str) -> str:
    """Of what OpenImageIO says was wrong."""
    return text.strip().splitlines()[0] if text.strip() else "no reason given"
