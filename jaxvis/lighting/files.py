"""Pixels of .hdr, .exr and .pfm files, and the six files of a cube."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jaxvis.errors import InvalidEnvironment
from jaxvis.pixels import read_stored

SUFFIXES = (".hdr", ".exr", ".pfm")

_FACE_NAMES = (
    ("px", "nx", "py", "ny", "pz", "nz"),
    ("posx", "negx", "posy", "negy", "posz", "negz"),
    ("right", "left", "top", "bottom", "front", "back"),
    ("right", "left", "up", "down", "front", "back"),
)


def read_pixels(path: Path) -> Float[np.ndarray, "height width 3"]:
    """Linear RGB of a file as stored (float64, top row first); grey is repeated, alpha dropped.

    Raises:
        FileNotFoundError: there is no such file.
        InvalidEnvironment: an unknown format, a damaged or truncated file, or channels that are
            not colours.
    """
    if path.is_file() and path.suffix.lower() not in SUFFIXES:
        raise InvalidEnvironment(
            f"{path}: not a light probe; give one of {', '.join(SUFFIXES)} (linear radiance)"
        )
    try:
        stored = read_stored(path)
    except ValueError as error:
        raise InvalidEnvironment(str(error)) from error
    height, width = stored.pixels.shape[:2]
    if stored.picture != (width, height):
        raise InvalidEnvironment(
            f"{path}: holds {width} x {height} pixels of a {stored.picture[0]} x "
            f"{stored.picture[1]} picture; save it without crop or overscan"
        )
    pixels = _upright(stored.pixels.astype(np.float64), stored.orientation)
    return as_rgb(pixels[..., _colour_channels(stored.channels, path)], str(path))


def as_rgb(pixels: Float[np.ndarray, "..."], what: str) -> Float[np.ndarray, "height width 3"]:
    """Three channels from a grey, grey and alpha, RGB or RGBA picture."""
    pixels = pixels[..., None] if pixels.ndim == 2 else pixels
    if pixels.ndim != 3 or pixels.shape[2] not in (1, 2, 3, 4) or pixels.size == 0:
        raise InvalidEnvironment(
            f"{what}: shape {pixels.shape} is not a picture; give [height, width] grey or "
            "[height, width, 3] colours"
        )
    return np.repeat(pixels[..., :1], 3, axis=2) if pixels.shape[2] < 3 else pixels[..., :3]


def find_faces(place: Path) -> list[Path]:
    """The six files of a folder, of a pattern with ``*``, or of a name with ``{}`` for the face.

    Faces are called px, nx, py, ny, pz, nz, or posx ..., or right, left, top, bottom, front, back.

    Raises:
        FileNotFoundError: no such folder or files.
        InvalidEnvironment: the six faces cannot be told.
    """
    if "{}" in place.name:
        pattern = place.name.replace("{}", "*")
        candidates = place.parent.glob(pattern) if place.parent.is_dir() else ()
    elif "*" in place.name:
        candidates = place.parent.glob(place.name) if place.parent.is_dir() else ()
    else:
        candidates = place.iterdir()
    files = [path for path in candidates if path.suffix.lower() in SUFFIXES]
    if not files:
        raise FileNotFoundError(f"{place}: no {', '.join(SUFFIXES)} files there")
    for names in _FACE_NAMES:
        found = [[path for path in files if _shows(path, face)] for face in names]
        if all(len(paths) == 1 for paths in found):
            return [paths[0] for paths in found]
    raise InvalidEnvironment(
        f"{place}: the six faces cannot be told; end the files' names in "
        f"{', '.join(_FACE_NAMES[0])}, or give a list of six files in this order"
    )


def _shows(path: Path, face: str) -> bool:
    return re.search(rf"(^|[^a-z]){face}$", path.stem.lower()) is not None


def _colour_channels(names: Sequence[str], path: Path) -> list[int]:
    """Indices of the colours: R, G, B by name (of the first layer that has them), or grey."""
    lowered = [name.lower() for name in names]
    if "ry" in lowered:
        raise InvalidEnvironment(f"{path}: stored as luminance and chroma; save it as RGB")
    last = [name.rpartition(".")[2] for name in lowered]
    for found in (lowered, last):
        if all(colour in found for colour in "rgb"):
            return [found.index(colour) for colour in "rgb"]
    if "y" in last:
        return [last.index("y")]
    if len(names) in (1, 3):
        return list(range(len(names)))
    raise InvalidEnvironment(f"{path}: channels {', '.join(names)} hold no R, G, B and no grey")


def _upright(
    pixels: Float[np.ndarray, "height width channels"], orientation: int
) -> Float[np.ndarray, "height width channels"]:
    """Undoes an Exif orientation, as .hdr files have with +Y or -X in their last header line."""
    if orientation >= 5:
        pixels = pixels.transpose(1, 0, 2)
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    return pixels
