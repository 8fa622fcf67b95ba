"""Pixels as image files store them, through OpenImageIO."""

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from jaxtyping import Float32


def read_stored(path: Path) -> tuple[Float32[np.ndarray, "height width channels"], oiio.ImageSpec]:
    """The pixels of a file, row 0 on top, integers as parts of 1, and what the file says of them.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it cannot be read, or is truncated or damaged.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file")
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
    return pixels[::-1] if path.suffix.lower() == ".pfm" else pixels, spec


def first_line(text: str) -> str:
    """Of what OpenImageIO says was wrong."""
    return text.strip().splitlines()[0] if text.strip() else "no reason given"
