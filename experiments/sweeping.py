"""Experiments that measure every combination of a grid: ``jaxvis.sweep`` under their settings."""

import contextlib
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from experiments.measuring import Image, Row
from experiments.output import Output
from experiments.settings import Common, setting
from jaxvis.compare import file_stem
from jaxvis.image import read_image
from jaxvis.sweep import Grid, run_grid

UNFINISHED = "unfinished"
"""Folder of the rows so far."""


@dataclass(frozen=True)
class Sweeping(Common):
    """Settings of such an experiment."""

    workers: int = setting(0, "processes of one core each; 0: this one, with all cores")
    scheduler: str | None = setting(None, "a Dask cluster instead: tcp://HOST:PORT")


@dataclass(frozen=True)
class Swept:
    """What a sweep found.

    Attributes:
        rows: as ``jaxvis.sweep.run_grid`` names their columns, in the grid's order.
        folder: where their images are.
    """

    rows: list[Row]
    folder: Path

    def image(self, row: Row) -> Image:
        """Linear radiance."""
        return read_image(self.folder / row["image"])

    def reference(self, row: Row) -> Image:
        """Linear radiance of what the row was measured against."""
        return read_image(self.folder / row["reference_image"])

    def write_pictures(self, output: Output, row: Row, name: str) -> None:
        """The row's picture as ``SCENE/NAME.png`` and its reference's as ``SCENE/reference.png``,
        if files are wanted; over their environment, at the reference's exposure."""
        for column, stem in (("image", name), ("reference_image", "reference")):
            path = output.path(f"{folder_of(row['scene'])}/{file_stem(stem)}.png")
            if path is not None:
                shutil.copyfile((self.folder / row[column]).with_suffix(".png"), path)


def folder_of(scene: str) -> str:
    """Of a scene's pictures, by its name or file."""
    return file_stem(Path(scene).name)


@contextlib.contextmanager
def swept(grid: Grid, settings: Sweeping, output: Output, *, images: bool) -> Iterator[Swept]:
    """Measures a grid. With a folder for files, a run that was killed goes on where it stopped.

    The images are there within the block; when it succeeds, only what it wrote itself stays.

    Raises:
        ValueError: a method failed; says which one and how.
    """
    with contextlib.ExitStack() as stack:
        if output.folder is None:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        else:
            folder = output.folder / UNFINISHED
        frame = run_grid(
            grid,
            folder,
            workers=None if settings.scheduler else settings.workers,
            scheduler=settings.scheduler,
            images=images,
            retry=True,
        )
        rows: list[dict[str, Any]] = frame.to_dict("records")
        for row in rows:
            if isinstance(row["error"], str):
                raise ValueError(f"{row['method']} failed on {row['scene']}: {row['error']}")
        yield Swept(rows, folder)
        shutil.rmtree(folder, ignore_errors=True)
