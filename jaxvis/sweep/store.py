"""The rows of a sweep on disk: a log that each finished row is appended to, and tables of it."""

import csv
import io
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from jaxvis.cache import lock, whole_file
from jaxvis.sweep.grid import Job

LOG, TABLE, TIMES = "rows.jsonl", "table.csv", "times.csv"

VALUES = ("psnr_db", "rmse", "relative_rmse", "relmse", "flip", "visibility_bytes", "rays_traced")
VALUES += ("evaluations", "reference_error", "error")
"""Columns of the table: the same whichever way a sweep ran."""

IMAGES = ("image", "reference_image")
"""Further ones: files below the folder, where there are any."""

TIMING = ("precompute_s", "light_s", "compile_s", "frame_s", "frames_timed", "total_s", "machine")
"""Columns of the times, and what they were taken on."""

SETTINGS = ("scene", "environment", "rotate", "size", "method", "seed")


class Store:
    """The log of one folder, held by one sweep at a time.

    A row is one line, which is written at once and waits for the disk: what is killed loses nothing
    that was finished. The part of a line that a kill may leave behind is cut off.

    Attributes:
        rows: what is stored, by key of its job.

    Raises:
        OSError: the folder cannot be made or written to.
        ValueError: another sweep runs in it, or the log is damaged.
    """

    def __init__(self, folder: str | os.PathLike) -> None:
        self.folder = Path(folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        self._path = self.folder / LOG
        self._file = open(self._path, "a+b")  # noqa: SIM115 - closed by __exit__
        try:
            if not lock(self._file, wait=False):
                raise ValueError(f"{self.folder}: another sweep is writing here")
            self.rows: dict[str, dict[str, Any]] = self._read()
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> "Store":
        return self

    def __exit__(self, *raised: object) -> None:
        self._file.close()

    def _read(self) -> dict[str, dict[str, Any]]:
        self._file.seek(0)
        content = self._file.read()
        whole = content.rfind(b"\n") + 1
        if whole < len(content):
            self._file.truncate(whole)
        rows = {}
        for number, line in enumerate(content[:whole].splitlines(), 1):
            try:
                row = json.loads(line)
                rows[row["key"]] = row
            except (ValueError, KeyError, TypeError):
                raise ValueError(
                    f"{self._path}: line {number} is damaged; remove it and sweep again"
                ) from None
        return rows

    def append(self, job: Job, row: dict[str, Any]) -> None:
        """Keeps the row of a finished job."""
        row = {"key": job.key, **row}
        line = json.dumps(row, allow_nan=False) + "\n"
        self._file.write(line.encode())
        self._file.flush()
        os.fsync(self._file.fileno())
        self.rows[job.key] = row

    def write_tables(self, jobs: Sequence[Job]) -> None:
        """The finished rows of these jobs, in their order, as CSV: values, and times apart."""
        done = [(job, self.rows[job.key]) for job in jobs if job.key in self.rows]
        for name, columns in ((TABLE, (*VALUES, *IMAGES)), (TIMES, TIMING)):
            with whole_file(self.folder / name) as temporary:
                temporary.write_text(_csv(done, columns))


def _csv(done: Sequence[tuple[Job, dict[str, Any]]], columns: Sequence[str]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow((*SETTINGS, *columns))
    for job, row in done:
        settings = [_cell(getattr(job, name)) for name in SETTINGS]
        writer.writerow(settings + [_cell(row.get(name)) for name in columns])
    return text.getvalue()


def _cell(value: Any) -> Any:
    if isinstance(value, tuple):
        return "x".join(map(str, value))
    return value


def frame_of(store: Store, jobs: Sequence[Job]) -> Any:
    """The finished rows of these jobs as a pandas DataFrame."""
    import pandas

    rows = [
        {name: getattr(job, name) for name in SETTINGS} | store.rows[job.key]
        for job in jobs
        if job.key in store.rows
    ]
    return pandas.DataFrame(rows, columns=pandas.Index([*SETTINGS, *VALUES, *IMAGES, *TIMING]))
