"""What may stand for a light probe, read: names, files, six files, arrays."""

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Float

from jaxvis import datasets, specs
from jaxvis.errors import InvalidEnvironment
from jaxvis.lighting import files, layouts
from jaxvis.lighting.builtin import BUILTIN
from jaxvis.lighting.projections import FACES

Source = str | os.PathLike | np.ndarray | jax.Array | list | tuple


@dataclass(frozen=True)
class Probe:
    """Pictures as stored: one, or six faces; ``what`` names them in messages."""

    pictures: list[Float[np.ndarray, "height width 3"]]
    layout: str
    name: str
    what: str


def read_probe(source: Source, layout: str) -> Probe:
    """The pictures that ``source`` stands for, and their layout.

    Raises:
        FileNotFoundError, InvalidEnvironment, ValueError: see :func:`load_environment`.
    """
    name = what = label(source)
    if isinstance(source, (str, os.PathLike)):
        place = _locate(source)
        what = str(place)
        if place.is_dir() or _is_pattern(place):
            pictures = _six_faces(files.find_faces(place))
        else:
            pictures = [files.read_pixels(place)]
    elif isinstance(source, (np.ndarray, jax.Array)) and source.ndim != 4:
        pictures = [_from_array(np.asarray(source), what)]
    else:
        pictures = _six_faces(source)
    return Probe(pictures, layouts.choose_layout(pictures, layout, what), name, what)


def label(source: Source) -> str:
    """A short name: that of the data set, of the file without its suffix, or what it is."""
    if isinstance(source, (np.ndarray, jax.Array)):
        return "array"
    if isinstance(source, (list, tuple)):
        return "faces"
    if isinstance(source, str) and source in datasets.names("probe"):
        return source
    return Path(source).stem


def _locate(source: str | os.PathLike) -> Path:
    if isinstance(source, str) and source in datasets.names("probe"):
        return datasets.find(source)
    path = Path(source).expanduser()
    if path.exists() or _is_pattern(path):
        return path
    if specs.is_file_name(source):
        raise specs.no_such_file(path)
    known = (*BUILTIN, *datasets.names("probe"))
    unknown = specs.unknown(str(source), known, "environment")
    raise ValueError(f"{unknown}, and {', '.join(files.SUFFIXES)} files")


def _is_pattern(path: Path) -> bool:
    return "*" in path.name or "{}" in path.name


def _six_faces(faces: Iterable) -> list[Float[np.ndarray, "_ _ 3"]]:
    faces = list(faces)
    if len(faces) != 6:
        raise InvalidEnvironment(
            f"a cube has six faces ({', '.join(FACES)}), got {len(faces)}; give one for each"
        )
    pictures: list[np.ndarray] = []
    for face, name in zip(faces, FACES, strict=True):
        if isinstance(face, (str, os.PathLike)):
            what = str(face)
            picture = files.read_pixels(Path(face).expanduser())
        else:
            what = f"face {name}"
            picture = _from_array(np.asarray(face), what)
        height, width = picture.shape[:2]
        size = pictures[0].shape[0] if pictures else height
        if (height, width) != (size, size):
            raise InvalidEnvironment(
                f"{what}: {width} x {height}; the six faces must be squares of one size"
            )
        pictures.append(picture)
    return pictures


def _from_array(array: np.ndarray, what: str) -> Float[np.ndarray, "height width 3"]:
    if array.dtype.kind not in "fiub":
        raise InvalidEnvironment(f"{what}: holds {array.dtype}, not numbers; give linear radiance")
    return files.as_rgb(array.astype(np.float64), what)
