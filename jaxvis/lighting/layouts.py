"""How a picture holds the sphere: layouts told apart by shape, and crosses cut into faces."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from jaxvis.errors import InvalidEnvironment
from jaxvis.lighting.projections import Angular, Cube, Projection

LAYOUTS = ("latlong", "vertical-cross", "horizontal-cross", "faces", "angular")

SHAPES = {
    "latlong": "width = 2 height",
    "vertical-cross": "3:4",
    "horizontal-cross": "4:3",
    "faces": "six squares, or a 6:1 or 1:6 strip of them",
    "angular": "a square",
}

# Where the faces px, nx, py, ny, pz, nz are, as (row, column) in faces.
_CROSSES = {
    "vertical-cross": ((1, 2), (1, 0), (0, 1), (2, 1), (1, 1), (3, 1)),
    "horizontal-cross": ((1, 2), (1, 0), (0, 1), (2, 1), (1, 1), (1, 3)),
}


def layout_of(height: int, width: int) -> str | None:
    """The layout that a picture of this shape has; None if there is none."""
    if width == 2 * height:
        return "latlong"
    if 4 * width == 3 * height:
        return "vertical-cross"
    if 3 * width == 4 * height:
        return "horizontal-cross"
    if width == 6 * height or height == 6 * width:
        return "faces"
    return "angular" if width == height else None


def choose_layout(pictures: Sequence[Float[np.ndarray, "..."]], layout: str, what: str) -> str:
    """The layout of one picture or of six faces: as asked for if it fits, or else by shape.

    Raises:
        InvalidEnvironment: no layout has this shape, or not the one asked for; names ``what``.
        ValueError: there is no layout of that name.
    """
    if layout != "auto" and layout not in LAYOUTS:
        raise ValueError(f"no layout {layout!r}: use auto, {', '.join(LAYOUTS)}")
    height, width = pictures[0].shape[:2]
    found = "faces" if len(pictures) == 6 else layout_of(height, width)
    if found is None:
        shapes = ", ".join(f"{name} ({shape})" for name, shape in SHAPES.items())
        raise InvalidEnvironment(
            f"{what}: {width} x {height} has the shape of no layout; there are {shapes}"
        )
    if layout not in ("auto", found):
        count = "six pictures" if len(pictures) == 6 else f"{width} x {height}"
        raise InvalidEnvironment(
            f"{what}: {count} cannot be {layout} ({SHAPES[layout]}); it looks like {found}"
        )
    return found


def unfold(
    pictures: Sequence[Float[np.ndarray, "height width 3"]], layout: str
) -> tuple[Float[np.ndarray, "texels 3"], Projection]:
    """Texel values in the order of a cube or an angular map, from any layout but a lat-long map."""
    picture = pictures[0]
    height, width = picture.shape[:2]
    if layout == "angular":
        return picture.reshape(-1, 3), Angular(width)
    if layout in _CROSSES:
        size = width // 3 if layout == "vertical-cross" else width // 4
        faces = [
            picture[row * size : (row + 1) * size, column * size : (column + 1) * size]
            for row, column in _CROSSES[layout]
        ]
        if layout == "vertical-cross":
            faces[5] = faces[5][::-1, ::-1]  # it hangs below the floor, head down
    elif len(pictures) == 6:
        faces = list(pictures)
    else:
        faces = np.split(picture, 6, axis=0 if height > width else 1)
    return np.concatenate([face.reshape(-1, 3) for face in faces]), Cube(faces[0].shape[0])
