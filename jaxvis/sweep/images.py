"""The images of a sweep's rows, and of their references, on disk."""

from pathlib import Path
from typing import NamedTuple

from jaxvis.compare.measurement import Pixels
from jaxvis.compare.result import file_stem
from jaxvis.image import write_image
from jaxvis.sweep.grid import Job

FOLDER = "images"

LONGEST = 120
"""Characters of a name that are kept; file systems allow 255 bytes."""


class Image(NamedTuple):
    """Linear radiance, 0 where no scene is seen, and the same over the environment as a display
    shows it.
    """

    radiance: Pixels
    shown: Pixels


def name_of(job: Job) -> str:
    """Of the file with the radiance, below the sweep's folder: readable, and the job's own."""
    what = f"{job.method}-{job.seed}" if job.method else "reference"
    turned = f"-{job.rotate:g}" if job.rotate else ""
    text = f"{Path(job.scene).name}-{Path(job.environment).name}{turned}-{what}"
    return f"{FOLDER}/{file_stem(text)[:LONGEST]}-{job.key[:8]}.exr"


def save_image(folder: Path, job: Job, image: Image) -> None:
    """Writes the radiance as .exr, and what is shown beside it as .png."""
    path = folder / name_of(job)
    write_image(path.with_suffix(".png"), image.shown)
    write_image(path, image.radiance)  # the last, by whose presence one knows


def has_image(folder: Path, job: Job) -> bool:
    return (folder / name_of(job)).exists()
