"""The outcome of a comparison: results.json's content, with the images it is about."""

import contextlib
import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float32

from jaxvis.cache import HELD, lock, remove_leftovers, whole_file
from jaxvis.image import display, displayed_error, write_image

if TYPE_CHECKING:
    import pandas

REFERENCE = "reference"
"""The label of the reference's image."""

Pixels = Float32[np.ndarray, "height width 3"]


class Comparison(dict):
    """What ``results.json`` holds (DESIGN §5), and the images.

    Attributes:
        images: linear radiance by label, 0 where no scene is seen; ``"reference"`` among them.
        coverage: share of each pixel's rays that hit the scene. Pixels above 0 are compared.
        background: radiance of the environment behind each pixel.
    """

    def __init__(
        self,
        results: dict[str, Any],
        images: dict[str, Pixels],
        coverage: Float32[np.ndarray, "height width"],
        background: Pixels,
    ) -> None:
        super().__init__(results)
        self.images = images
        self.coverage = coverage
        self.background = background

    @property
    def covered(self) -> Bool[np.ndarray, "height width"]:
        """The pixels that see the scene."""
        return self.coverage > 0.0

    @property
    def failed(self) -> list[dict[str, Any]]:
        """The rows of methods that raised an error."""
        return [row for row in self["results"] if "error" in row]

    def shown(self, label: str) -> Pixels:
        """The image over the environment as a display shows it, in [0, 1]: the .png's content."""
        return composite(
            self.images[label], self.coverage, self.background, self["display"]["exposure"]
        )

    def error(self, label: str) -> Float32[np.ndarray, "height width"]:
        """Difference from the reference per pixel, in display units (see ``displayed_error``)."""
        exposure = self["metric"]["exposure"]
        reference = self.images[REFERENCE]
        error = displayed_error(self.images[label], reference, self.covered, exposure)
        return error.astype(np.float32)

    def to_frame(self) -> "pandas.DataFrame":
        """One row per method; parameters as ``name=value`` text, no curves.

        The PSNR of an image equal to the reference, null in JSON, is infinite here.
        """
        import pandas

        rows = []
        for row in self["results"]:
            row = {key: value for key, value in row.items() if key not in ("curve", "notes")}
            row["parameters"] = ", ".join(f"{k}={v}" for k, v in row["parameters"].items())
            if row.get("rmse") == 0.0:
                row["psnr_db"] = float("inf")
            rows.append(row)
        return pandas.DataFrame(rows)

    def save(self, folder: str | os.PathLike) -> None:
        """Writes every image as .exr (linear, background 0) and .png (as shown), the coverage, and
        ``results.json``.
        """
        folder = Path(folder)
        for label, radiance in self.images.items():
            write_image(folder / f"{file_stem(label)}.exr", radiance)
            write_image(folder / f"{file_stem(label)}.png", self.shown(label))
        write_image(folder / "coverage.exr", self.coverage[..., None])
        with whole_file(folder / "results.json") as temporary:
            temporary.write_text(self.to_json() + "\n")

    def to_json(self) -> str:
        """Strict JSON: no NaN, no Infinity."""
        return json.dumps(self, indent=2, allow_nan=False)


def composite(
    radiance: Pixels,
    coverage: Float32[np.ndarray, "height width"],
    background: Pixels,
    exposure: float,
) -> Pixels:
    """The scene over its environment, as a display shows it. Host; blends linear radiance."""
    share = coverage[..., None]
    return display(share * radiance + (1.0 - share) * background, exposure)


def file_stem(label: str) -> str:
    """``correspondence:vectors=96`` as the stem of a file's name: ``correspondence-vectors-96``."""
    return re.sub(r"[^A-Za-z0-9.+_-]+", "-", label).strip("-.")


UNFINISHED = ".unfinished-"
"""How the names of temporary folders begin."""


@contextlib.contextmanager
def output_folder(path: str | os.PathLike) -> Iterator[Path]:
    """Yields a temporary folder whose files move to ``path`` if the block succeeds.

    ``results.json`` moves last, so that its presence says that what it names is there. If the block
    fails nothing changes: folders that were made for it are removed again.

    Raises:
        OSError: ``path`` cannot be made or written to; before the block is entered.
    """
    folder = Path(path)
    made = [p for p in (folder, *folder.parents) if not p.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        remove_leftovers(folder, UNFINISHED)
        staging = Path(tempfile.mkdtemp(prefix=UNFINISHED, dir=folder))
    except OSError as error:
        _remove_empty(made)
        reason = f"cannot write to this folder ({error.strerror})"
        raise type(error)(error.errno, reason, str(folder)) from error
    try:
        with (staging / HELD).open("wb") as held:
            lock(held, wait=False)
            yield staging
            files = (file for file in staging.iterdir() if file.name != HELD)
            for file in sorted(files, key=lambda file: file.name == "results.json"):
                os.replace(file, folder / file.name)
    except BaseException:
        shutil.rmtree(staging, ignore_errors=True)
        _remove_empty(made)
        raise
    shutil.rmtree(staging, ignore_errors=True)


def _remove_empty(folders: list[Path]) -> None:
    for folder in folders:
        with contextlib.suppress(OSError):
            folder.rmdir()
