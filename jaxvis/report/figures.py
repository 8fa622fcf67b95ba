"""Pictures of a comparison: error maps, a sheet of all images, and quality over time."""

import io
import math
from typing import Any

import numpy as np
from jaxtyping import Float, Float32
from matplotlib import colormaps, rc_context
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from jaxvis.compare import Comparison

ERROR_RANGE = (1.0 / 255.0, 1.0)
"""Ends of the error scale, in display units: from one step of an 8-bit display to black on white.

Fixed, so that error maps of any two reports can be compared. The scale is logarithmic.
"""

ERROR_TICKS = (1.0 / 255.0, 0.01, 0.03, 0.1, 0.3, 1.0)
ERROR_MAP = "magma"
ERROR_LABEL = "difference from the reference, display units (1 = white)"

COLOURS = (
    *("#4c78a8", "#f58518", "#54a24b", "#e45756", "#72b7b2"),
    *("#b279a2", "#d9a900", "#9d755d", "#ff9da6", "#8f8b88"),
)
"""One per method, in order: legible on white and on black."""

MARKERS = "osD^vP"


def colour_of(index: int) -> str:
    """The colour of the method at this place of the table."""
    return COLOURS[index % len(COLOURS)]


def error_map(
    error: Float[np.ndarray, "height width"], covered: np.ndarray
) -> Float32[np.ndarray, "height width 4"]:
    """Display-unit errors in colours, transparent where a pixel does not see the scene."""
    colours = colormaps[ERROR_MAP](LogNorm(*ERROR_RANGE, clip=True)(np.maximum(error, 1e-9)))
    colours[..., 3] = covered
    return colours.astype(np.float32)


def scale_position(value: float) -> float:
    """Where an error lies on the scale, 0 to 1."""
    low, high = (math.log(end) for end in ERROR_RANGE)
    return (math.log(value) - low) / (high - low)


def tick_text(value: float) -> str:
    """The label of a tick of the error scale."""
    return "1/255" if value == ERROR_TICKS[0] else f"{value:g}"


def error_scale(figure: Figure, axes: Any, **options: Any) -> None:
    """The colour bar of :func:`error_map` below the axes; ``options`` are matplotlib's."""
    scale = ScalarMappable(LogNorm(*ERROR_RANGE), ERROR_MAP)
    bar = figure.colorbar(scale, ax=axes, location="bottom", aspect=60, **options)
    bar.set_ticks(ERROR_TICKS, labels=[tick_text(tick) for tick in ERROR_TICKS], fontsize=8)
    bar.minorticks_off()
    bar.set_label(ERROR_LABEL, fontsize=8)


def psnr_over_time(comparison: Comparison, ink: str = "#222222") -> Figure:
    """PSNR of each method over the time of a frame; methods that sample have a curve.

    Each is named at the right edge, so that no name covers a point. ``ink`` colours axes and text.
    """
    series = [
        (row["label"], colour_of(i), MARKERS[i // len(COLOURS) % len(MARKERS)], points)
        for i, row in enumerate(comparison["results"])
        if (points := _points(row))
    ]
    with rc_context({"text.color": ink, "axes.edgecolor": ink, "axes.labelcolor": ink}):
        figure = Figure((8.4, 4.2))
        axes = figure.add_axes((0.085, 0.14, 0.655, 0.82))
    axes.set_xlabel("seconds per frame (warm)")
    axes.set_ylabel("PSNR (dB)")
    axes.tick_params(which="both", colors=ink, labelcolor=ink, length=4, pad=4)
    axes.set_facecolor("none")
    figure.set_facecolor("none")
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    if not series:
        axes.text(0.5, 0.5, "no method has a finite PSNR", ha="center", transform=axes.transAxes)
        return figure
    axes.set_xscale("log")
    for _, colour, marker, points in series:
        axes.plot(*zip(*points, strict=True), color=colour, marker=marker, ms=5, lw=1.6)
    low, high = axes.get_xlim()
    if high < 10.0 * low:  # at least a decade, or the axis has no ticks
        middle = math.sqrt(low * high)
        axes.set_xlim(middle / math.sqrt(10.0), middle * math.sqrt(10.0))
    low, high = axes.get_xlim()
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
    axes.xaxis.set_minor_formatter("{x:g}" if high < 150.0 * low else "")
    axes.margins(y=0.08)
    axes.grid(True, which="major", color=ink, alpha=0.12, lw=0.8)
    _name_at_the_edge(axes, series, ink)
    return figure


def _points(row: dict[str, Any]) -> list[tuple[float, float]]:
    """(seconds, dB) of a row's curve, or of the row alone; only finite ones."""
    points = [(p["frame_s"], p["psnr_db"]) for p in row.get("curve") or [row]]
    return sorted((s, db) for s, db in points if s and db is not None)


def _name_at_the_edge(axes: Axes, series: list[tuple[str, str, str, list]], ink: str) -> None:
    """Writes each name right of the axes at the height of its best point, spread apart."""
    low, high = axes.get_ylim()
    right = axes.get_xlim()[1]
    best = [(max(points, key=lambda p: p[1]), label, colour) for label, colour, _, points in series]
    best.sort(key=lambda entry: entry[0][1])
    gap = 0.052
    heights = np.array([(db - low) / (high - low) for (_, db), _, _ in best])
    for i in range(1, len(heights)):
        heights[i] = max(heights[i], heights[i - 1] + gap)
    heights -= max(0.0, heights[-1] - 1.0)
    for i in range(len(heights) - 2, -1, -1):
        heights[i] = min(heights[i], heights[i + 1] - gap)
    for ((seconds, db), label, colour), height in zip(best, heights, strict=True):
        start = axes.transAxes.inverted().transform(axes.transData.transform((seconds, db)))
        axes.plot(
            [start[0], 1.0, 1.03],
            [start[1], start[1], height],
            transform=axes.transAxes,
            color=colour,
            lw=0.8,
            alpha=0.6,
            clip_on=False,
        )
        axes.text(
            1.04,
            height,
            label if len(label) <= 30 else f"{label[:28]}…",
            transform=axes.transAxes,
            color=ink,
            va="center",
            fontsize=9.5,
            parse_math=False,
        )
    axes.set_xlim(right=right)


INK = "#010203"
"""Stands for the colour of the surrounding text in :func:`svg`."""


def svg(figure: Figure) -> str:
    """The figure as an SVG element; what is drawn in :data:`INK` takes the page's text colour."""
    buffer = io.StringIO()
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "jaxvis"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue().replace(INK, "currentColor")
    return text[text.index("<svg") :]
