"""Pictures side by side, each above its error map on one fixed scale."""

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Array, Bool, Float
from matplotlib.figure import Figure

from jaxvis.compare import Comparison
from jaxvis.compare.result import REFERENCE
from jaxvis.image import display, displayed_error, exposure_of, psnr
from jaxvis.report import numbers
from jaxvis.report.figures import error_map, error_scale

CELL = 3.2
"""Inches from one picture to the next."""

LETTERS = 44
"""Of a title that fit between them."""


class Tile(NamedTuple):
    """A picture, its title, and its error map, which references lack."""

    title: str
    shown: Float[np.ndarray, "height width channels"]
    error: Float[np.ndarray, "height width 4"] | None = None


def sheet(comparison: Comparison, columns: int = 4) -> Figure:
    """Every image with its error map below, in rows of ``columns``, and the error scale."""
    tiles = [Tile(REFERENCE, comparison.shown(REFERENCE))]
    for row in comparison["results"]:
        if "error" not in row:
            label = row["label"]
            coloured = error_map(comparison.error(label), comparison.covered)
            tiles.append(Tile(f"{label}\n{_caption(row)}", comparison.shown(label), coloured))
    return sheet_of(tiles, columns)


def beside_errors(
    images: Mapping[str, Float[Array | np.ndarray, "height width 3"]],
    reference: Float[Array | np.ndarray, "height width 3"],
    covered: Bool[Array | np.ndarray, "height width"],
    *,
    exposure: float | None = None,
    brightness: float = 1.0,
    columns: int = 4,
) -> Figure:
    """The reference and each image, with its PSNR, above its error map.

    Args:
        images: linear radiance by title.
        reference: what they should be.
        covered: pixels that see the scene; the others are white.
        exposure: what radiance is multiplied by; by default :func:`jaxvis.image.exposure_of` the
            reference.
        brightness: a further factor for the pictures alone, not for what is measured: below 1,
            white things on white are told apart.
        columns: pictures in a row.
    """
    covered = np.asarray(covered)
    exposure = exposure_of(reference, covered) if exposure is None else exposure
    seen = brightness * exposure
    tiles = [Tile(REFERENCE, _shown(reference, covered, seen))]
    for title, image in images.items():
        quality = f"{title}\n{psnr(image, reference, covered, exposure):.1f} dB"
        error = displayed_error(image, reference, covered, exposure)
        tiles.append(Tile(quality, _shown(image, covered, seen), error_map(error, covered)))
    return sheet_of(tiles, columns)


def sheet_of(tiles: Sequence[Tile], columns: int) -> Figure:
    """Pictures in rows, error maps below them, and the scale of errors."""
    columns = min(columns, len(tiles))
    blocks = -(-len(tiles) // columns)
    height, width = tiles[0].shown.shape[:2]
    titles = [folded(tile.title) for tile in tiles]
    heading = 0.15 + 0.15 * max(title.count("\n") + 1 for title in titles)
    figure = Figure((CELL * columns, blocks * (2 * CELL * height / width + heading) + 0.75))
    figure.set_layout_engine("constrained", w_pad=0.03, h_pad=0.05, wspace=0, hspace=0)
    axes = figure.subplots(2 * blocks, columns, squeeze=False)
    for axis in axes.flat:
        axis.set_axis_off()
    for index, (tile, title) in enumerate(zip(tiles, titles, strict=True)):
        above, column = 2 * (index // columns), index % columns
        axes[above, column].imshow(tile.shown, interpolation="nearest")
        axes[above, column].set_title(title, fontsize=9, parse_math=False)
        if tile.error is not None:
            axes[above + 1, column].imshow(tile.error, interpolation="nearest")
    error_scale(figure, axes, shrink=min(1.0, 2.5 / columns), pad=0.01)
    return figure


def folded(title: str) -> str:
    """Its lines no wider than a picture: broken at spaces, and between a method's parameters."""
    lines = []
    for line in title.split("\n"):
        lines.append("")
        for piece in re.split(r"(?<=[ ,])(?=\S)", line):
            if lines[-1] and len(lines[-1] + piece.rstrip()) > LETTERS:
                lines.append("")
            lines[-1] += piece
    return "\n".join(line.rstrip() for line in lines)


def _shown(
    image: Float[Array | np.ndarray, "height width 3"],
    covered: Bool[np.ndarray, "height width"],
    exposure: float,
) -> Float[np.ndarray, "height width 3"]:
    return np.where(covered[..., None], display(image, exposure), 1.0)


def _caption(row: dict[str, Any]) -> str:
    return f"{numbers.decibels(row)} dB, {numbers.seconds(row['frame_s'])}"
