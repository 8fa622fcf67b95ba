"""The drawings of experiments.equal_time: curves over time, and pictures at equal time."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from experiments.contenders import Rendered
from experiments.crops import smooth_parts, strongest_boundaries
from experiments.curves import Curve, Frame
from jaxvis.image import display, exposure_of
from jaxvis.scene import Surface

Pixels = Float32[np.ndarray, "height width 3"]

MOST_COLUMNS = 5
"""Pictures side by side."""


class Tile(NamedTuple):
    """A picture with its name and what is said of it."""

    title: str
    picture: Pixels
    exposure: float


def draw_curves(path: Path, curves: Sequence[Curve], precomputed: set[str]) -> None:
    """PSNR over seconds, and MSE over seconds, both logarithmic (fig. 16): precomputed methods in
    solid lines, estimators in thin ones, denoised ones dashed.
    """
    figure = Figure((12.5, 5.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    colours = colormaps["tab20"].colors
    colours = [*colours[::2], *colours[1::2]]
    for number, curve in enumerate(curves):
        ours = curve.name in precomputed
        frames = sorted(curve.frames, key=lambda frame: frame.seconds)
        style = {
            "label": curve.name,
            "color": colours[number % len(colours)],
            "marker": "o" if ours else ".",
            "linewidth": 2.2 if ours else 1.2,
            "linestyle": "--" if curve.name.endswith("+denoise") else "-",
        }
        seconds = [frame.seconds for frame in frames]
        left.plot(seconds, [frame.decibels for frame in frames], **style)
        right.plot(seconds, [10.0 ** (-frame.decibels / 10.0) for frame in frames], **style)
    left.set_ylabel("PSNR, dB")
    right.set_ylabel("mean squared error, of the display's range")
    right.set_yscale("log")
    for axes in (left, right):
        axes.set_xscale("log")
        axes.set_xlabel("seconds a frame")
        axes.grid(alpha=0.3)
    right.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.01, 0.5))
    figure.savefig(path, dpi=120)


def at_seconds(rendered: Mapping[str, Rendered], curve: Curve, seconds: float) -> Frame:
    """The best frame of a method that is done in this time, or its quickest one.

    A twentieth more counts as in time: no timing is surer than that.
    """
    done = [frame for frame in curve.frames if frame.seconds <= 1.05 * seconds]
    if done:
        return max(done, key=lambda frame: frame.decibels)
    return min(curve.frames, key=lambda frame: frame.seconds)


def draw_equal_time(
    path: Path,
    results: tuple[Mapping[str, Mapping[str, Rendered]], Mapping[str, Pixels]],
    curves: Sequence[Curve],
    scene: tuple[Surface, Pixels, float],
    best: tuple[str, Frame],
    precomputed: set[str],
) -> None:
    """What each method has at the best frame's time (fig. 17), with two crops at shadows' ends."""
    (rendered, truths), (surface, reference, exposure) = results, scene
    name, frame = best
    covered = np.asarray(surface.coverage) > 0.0
    tiles = [Tile("reference", reference, exposure)]
    tiles.append(_tile(name, frame, rendered[name], exposure))
    for curve in curves:
        if curve.name not in precomputed:
            found = at_seconds(rendered[curve.name], curve, frame.seconds)
            own = exposure_of(truths[curve.name], covered)
            tiles.append(_tile(curve.name, found, rendered[curve.name], own))
    inside = smooth_parts(surface)
    side = min(covered.shape) // 5
    crops = strongest_boundaries(display(reference, exposure), inside, side, 2)
    _sheet(path, tiles, [(row, column, side) for row, column in crops])


def draw_samples(
    path: Path,
    rendered: Mapping[str, Rendered],
    reference: Pixels,
    covered: np.ndarray,
    exposure: float,
) -> None:
    """One method at every fourth number of samples (fig. 18), beside the reference."""
    chosen = list(rendered.items())[::2]
    tiles = [
        Tile(f"{setting}\n{each.decibels:.1f} dB, {_seconds(each):.3g} s", each.picture, exposure)
        for setting, each in chosen
    ]
    _sheet(path, [*tiles, Tile("reference", reference, exposure)], [])


def _tile(name: str, frame: Frame, rendered: Mapping[str, Rendered], exposure: float) -> Tile:
    said = f"{frame.setting}, {frame.seconds:.3g} s, {frame.decibels:.1f} dB"
    return Tile(f"{name}\n{said}", rendered[frame.setting].picture, exposure)


def _seconds(rendered: Rendered) -> float:
    return float(np.median(rendered.seconds))


def _sheet(path: Path, tiles: Sequence[Tile], crops: Sequence[tuple[int, int, int]]) -> None:
    """Pictures in rows; below each its crops (first row, first column, side)."""
    columns = min(MOST_COLUMNS, len(tiles))
    rows = -(-len(tiles) // columns)
    height, width = tiles[0].picture.shape[:2]
    tall = 3.0 * height / width
    figure = Figure(
        (3.0 * columns, rows * (tall + 0.5 + (1.5 if crops else 0.0))), layout="constrained"
    )
    for block, axes in zip(tiles, _blocks(figure, rows, columns, tall, len(crops)), strict=False):
        whole, *small = axes
        shown = display(block.picture, block.exposure)
        whole.imshow(shown)
        whole.set_title(block.title, fontsize=9)
        for axis, (row, column, side), colour in zip(
            small, crops, ("#ffb000", "#00b0ff"), strict=False
        ):
            axis.imshow(shown[row : row + side, column : column + side], interpolation="nearest")
            whole.add_patch(
                Rectangle((column - 0.5, row - 0.5), side, side, fill=False, edgecolor=colour)
            )
            axis.patch.set_edgecolor(colour)
    figure.savefig(path, dpi=110)


def _blocks(figure: Figure, rows: int, columns: int, tall: float, crops: int) -> list[list]:
    """For each tile an axis for the picture and one for each crop, without ticks."""
    outer = figure.add_gridspec(rows, columns)
    blocks = []
    for cell in outer:
        if crops:
            inner = cell.subgridspec(2, crops, height_ratios=(tall, 1.5))
            axes = [figure.add_subplot(inner[0, :])]
            axes += [figure.add_subplot(inner[1, i]) for i in range(crops)]
        else:
            axes = [figure.add_subplot(cell)]
        for axis in axes:
            axis.set_axis_off()
        blocks.append(axes)
    return blocks
