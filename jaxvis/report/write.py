"""Writes the report of a comparison into a folder."""

import io
import os
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure
from tqdm import tqdm

from jaxvis.cache import whole_file
from jaxvis.compare import Comparison, file_stem
from jaxvis.image import write_image
from jaxvis.report import figures
from jaxvis.report.page import html
from jaxvis.report.sections import Section
from jaxvis.report.sheets import sheet
from jaxvis.report.tables import csv, markdown


def write_report(
    comparison: Comparison,
    folder: str | os.PathLike,
    sections: Sequence[Section] = (),
    *,
    progress: bool = True,
) -> Path:
    """Writes tables, figures and the page; each file whole or not at all.

    The files: ``index.html`` (self-contained), ``results.md`` and ``results.csv`` (the table),
    ``psnr_over_time.png``, ``comparison.png`` (all images and error maps), and ``NAME.error.png``
    for each method. ``results.json`` and the images are :meth:`Comparison.save`'s. ``sections`` are
    added to the page. ``progress`` shows a bar if standard error is a terminal.

    Returns:
        The path of the page.

    Raises:
        OSError: the folder cannot be written to.
    """
    folder = Path(folder)
    page = folder / "index.html"
    writers: list[Callable[[], None]] = [
        partial(_write_errors, comparison, row["label"], folder)
        for row in comparison["results"]
        if "error" not in row
    ]
    writers += [
        lambda: _write(folder / "comparison.png", _png(sheet(comparison), 130)),
        lambda: _write(folder / "psnr_over_time.png", _plot(comparison)),
        lambda: _write(folder / "results.md", markdown(comparison).encode()),
        lambda: _write(folder / "results.csv", csv(comparison).encode()),
        lambda: _write(page, html(comparison, sections).encode()),
    ]
    quiet = not (progress and sys.stderr.isatty())
    for write in tqdm(writers, desc="report", unit="file", leave=False, disable=quiet):
        write()
    return page


def _write_errors(comparison: Comparison, label: str, folder: Path) -> None:
    errors = figures.error_map(comparison.error(label), comparison.covered)
    write_image(folder / f"{file_stem(label)}.error.png", errors)


def _plot(comparison: Comparison) -> bytes:
    plot = figures.psnr_over_time(comparison)
    plot.set_facecolor("white")
    return _png(plot, 160)


def _png(figure: Figure, dots_per_inch: int) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dots_per_inch)
    return buffer.getvalue()


def _write(path: Path, content: bytes) -> None:
    with whole_file(path) as temporary:
        temporary.write_bytes(content)
