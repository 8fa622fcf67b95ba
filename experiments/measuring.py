"""What experiments share: ground truth from the disk, times, memory, pictures."""

import contextlib
import os
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest import mock

import jax
import numpy as np
from jaxtyping import Float

import jaxvis
from jaxvis.compare.result import composite
from jaxvis.compare.setting import Setting
from jaxvis.image import exposure_of, write_image
from jaxvis.methods import Reference
from jaxvis.scene import Scene, Surface

Image = Float[np.ndarray, "height width 3"]
Row = dict[str, Any]
"""Of a table: column -> value."""

WHITE = 0.8
"""Albedo of what shows the light alone."""

GAP = 4
"""Pixels between the pictures of a strip."""


def reference_image(
    scene: Scene, environment: jaxvis.Environment, surface: Surface, error: float
) -> Image:
    """Ground truth, from the disk if it was computed before."""
    truth = Reference(error=error)
    solution, _ = truth.solve_cached(truth.precompute(scene), truth.light(environment), surface)
    return np.asarray(solution.image)


def best_of(repeats: int, *functions: Callable[[], object]) -> list[float]:
    """Shortest time of each function, taking turns so that all meet the same machine."""
    best = [np.inf] * len(functions)
    for _ in range(repeats):
        for i, function in enumerate(functions):
            start = time.perf_counter()
            function()
            best[i] = min(best[i], time.perf_counter() - start)
    return best


def seconds_of(function: Callable[[], Any], repeats: int = 1) -> tuple[Any, float]:
    """(last result, median seconds), waiting for the device; the first call counts, too."""
    result, times = None, []
    for _ in range(repeats):
        start = time.perf_counter()
        result = jax.block_until_ready(function())
        times.append(time.perf_counter() - start)
    return result, statistics.median(times)


@contextlib.contextmanager
def stopwatch(module: ModuleType | SimpleNamespace, *names: str) -> Iterator[dict[str, float]]:
    """Seconds spent in functions of a module while it is entered, by name."""
    spent = dict.fromkeys(names, 0.0)

    def timed(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **options: Any) -> Any:
            start = time.perf_counter()
            try:
                return function(*arguments, **options)
            finally:
                spent[name] += time.perf_counter() - start

        return call

    with contextlib.ExitStack() as stack:
        for name in names:
            wrapped = timed(name, getattr(module, name))
            stack.enter_context(mock.patch.object(module, name, wrapped))
        yield spent


def resident_megabytes() -> float:
    """Memory that this process holds now (10^6 bytes); not a number where Linux does not tell."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return float("nan")
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def write_strip(path: Path, setting: Setting, images: Sequence[Image], exposed: Image) -> None:
    """Images side by side over the environment, with the exposure of one of them."""
    exposure = exposure_of(exposed, setting.covered)
    shown = [composite(i, setting.coverage, setting.background, exposure) for i in images]
    gap = np.ones((shown[0].shape[0], GAP, 3), np.float32)
    row = [part for picture in shown for part in (gap, picture)][1:]
    write_image(path, np.concatenate(row, axis=1))
