"""Sweeps on one worker process and on several: seconds, their ratio, and whether the tables match.

Each sweep is a ``jaxvis sweep`` of its own with an empty cache: starting the processes, loading,
compiling, precomputing and the references are all in the seconds. Target: 200 rows take two
workers at most 0.6 of the time of one.
"""

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from experiments.output import Output, Row
from experiments.settings import Common, execute, setting
from jaxvis.sweep import variants
from jaxvis.sweep.store import TABLE

METHODS = (
    *variants("vectorized", vectors=32, resolution=32, zeta=(0, 0.5, 1, 1.5, 2)),
    *variants("mc-mis", spp=(1, 2, 4, 8, 16)),
)


@dataclass(frozen=True)
class Settings(Common):
    scene: tuple[str, ...] = setting(("sphere-on-plane", "box-on-plane"), "what is lit")
    environment: tuple[str, ...] = setting(("windows", "uniform"), "what lights it")
    method: tuple[str, ...] = setting(METHODS, "methods")
    size: tuple[int, int] = setting((64, 48), "of the images", metavar=("W", "H"))
    seeds: int = setting(5, "rows of each method on each scene under each light")
    workers: tuple[int, ...] = setting((1, 2), "processes")
    pairs: int = setting(3, "times that each is run, taking turns")


def grid_of(settings: Settings) -> str:
    """The sweep's TOML."""
    parts = {
        "scene": settings.scene,
        "environment": settings.environment,
        "methods": settings.method,
        "size": settings.size,
        "seed": range(settings.seeds),
    }
    return "".join(f"{name} = {list(values)}\n" for name, values in parts.items())


def seconds_of_sweep(grid: Path, out: Path, workers: int) -> float:
    """A whole process, with a cache of its own.

    Raises:
        ValueError: the sweep failed; says how it ended.
    """
    command = [sys.executable, "-m", "jaxvis.cli", "sweep", str(grid), "--out", str(out)]
    # What `python -m experiments` shares between its processes would be a full cache.
    outer = {k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"}
    start = time.perf_counter()
    done = subprocess.run(
        [*command, "--workers", str(workers)],
        env=outer | {"JAXVIS_CACHE": str(out / "cache")},
        capture_output=True,
        text=True,
    )
    if done.returncode:
        raise ValueError(f"the sweep failed: {(done.stderr.splitlines() or ['?'])[-1]}")
    return time.perf_counter() - start


def rows_of(settings: Settings, folder: Path) -> list[Row]:
    """A row for each run."""
    grid = folder / "grid.toml"
    grid.write_text(grid_of(settings))
    rows: list[Row] = []
    first = None
    for pair in range(settings.pairs):
        one = None
        for workers in settings.workers:
            out = folder / f"{pair}-{workers}"
            seconds = seconds_of_sweep(grid, out, workers)
            table = (out / TABLE).read_bytes()
            first, one = first or table, one or seconds
            rows.append(
                {
                    "pair": pair + 1,
                    "workers": workers,
                    "rows": len(table.splitlines()) - 1,
                    "seconds": seconds,
                    "of the first's": seconds / one,
                    "same table": table == first,
                }
            )
    return rows


def run(settings: Settings, output: Output) -> None:
    """Sweeps in a folder that is removed afterwards."""
    with tempfile.TemporaryDirectory() as folder:
        output.table("sweeps", "Sweeps with empty caches", rows_of(settings, Path(folder)))


if __name__ == "__main__":
    execute(Settings, run, __doc__)
