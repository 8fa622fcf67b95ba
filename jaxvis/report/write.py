"""Writes the report of a comparison into a folder."""

import io
import os
from pathlib import Path

from matplotlib.figure import Figure

from jaxvis.cache import whole_file
from jaxvis.compare import Comparison, file_stem
from jaxvis.image import write_image
from jaxvis.report import figures
from jaxvis.report.page import html
from jaxvis.report.tables import csv, markdown


def write_report(comparison: Comparison, folder: str | os.PathLike) -> Path:
    """Writes tables, figures and the page; each file whole or not at all.

    The files: ``index.html`` (self-contained), ``results.md`` and ``results.csv`` (the table),
    ``psnr_over_time.png``, ``comparison.png`` (all images and error maps), and ``NAME.error.png``
    for each method. ``results.json`` and the images are :meth:`Comparison.save`'s.

    Returns:
        The path of the page.

    Raises:
        OSError: the folder cannot be written to.
    """
    folder = Path(folder)
    for row in comparison["results"]:
        if "error" not in row:
            label = row["label"]
            errors = figures.error_map(comparison.error(label), comparison.covered)
            write_image(folder / f"{file_stem(label)}.error.png", errors)
    _write(folder / "comparison.png", _png(figures.sheet(comparison), 130))
    plot = figures.psnr_over_time(comparison)
    plot.set_facecolor("white")
    _write(folder / "psnr_over_time.png", _png(plot, 160))
    _write(folder / "results.md", markdown(comparison).encode())
    _write(folder / "results.csv", csv(comparison).encode())
    page = folder / "index.html"
    _write(page, html(comparison).encode())
    return page


def _png(figure: Figure, dots_per_inch: int) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dots_per_inch)
    return buffer.getvalue()


def _write(path: Path, content: bytes) -> None:
    with whole_file(path) as temporary:
        temporary.write_bytes(content)
