"""Height fields in .npz files, as triangle meshes (host)."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from jaxvis.errors import InvalidScene
from jaxvis.npz import read_npz
from jaxvis.scene.build import build_scene
from jaxvis.scene.scene import Scene


def load_height_field(path: Path, name: str) -> Scene:
    """The terrain of an .npz file with heights ``z`` [rows, columns] and their spacing ``dx``.

    Both in one unit. Row 0 is north: columns run along +x (east), rows along +z (south), heights
    along +y. Smooth throughout.

    Raises:
        InvalidScene: the file is damaged, or has no such arrays.
    """
    try:
        arrays = read_npz(path)
        heights, spacing = arrays["z"].astype(np.float64), float(arrays["dx"])
    except KeyError as error:
        raise InvalidScene(f"{path}: a height field needs the arrays z and dx") from error
    except (ValueError, TypeError) as error:
        raise InvalidScene(f"{path}: damaged or not a NumPy .npz file") from error
    if heights.ndim != 2 or min(heights.shape) < 2:
        raise InvalidScene(f"{path}: z must be [rows, columns], got {list(heights.shape)}")
    if not (np.isfinite(spacing) and spacing > 0.0):
        raise InvalidScene(f"{path}: dx must be a positive length, got {spacing}")
    rows, columns = heights.shape
    row, column = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    positions = np.stack([spacing * column, heights, spacing * row], axis=-1).reshape(-1, 3)
    number = (row * columns + column)[:-1, :-1].reshape(-1)
    south, east = columns, 1
    triangles = np.stack(
        [
            number,
            number + south,
            number + south + east,
            number,
            number + south + east,
            number + east,
        ],
        axis=-1,
    )
    faces = triangles.reshape(-1, 3)
    return replace(build_scene(positions, faces, crease_angle=np.pi, name=str(path)), name=name)
