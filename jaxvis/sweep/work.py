"""What a worker of a sweep does: one row."""

import math
import os
import platform
import time
from functools import lru_cache
from typing import Any, NamedTuple

from jaxvis import methods
from jaxvis.compare.compilation import use_compilation_cache
from jaxvis.compare.measurement import Prepared, Yardstick, prepared
from jaxvis.compare.run import method_row, render_reference
from jaxvis.compare.setting import Setting, prepare
from jaxvis.image import exposure_of
from jaxvis.sweep.grid import Job
from jaxvis.sweep.store import TIMING, VALUES

KEPT = 2
"""Scenes under their lights, with references, that a worker keeps in memory."""


def run_job(job: Job, core: int | None = None) -> dict[str, Any]:
    """The row of a job.

    Args:
        core: which of the cores that this process may use it keeps to from now on; by default it
            uses all. Heard once, before anything is computed.

    Raises:
        ValueError, FileNotFoundError, OSError: the scene, the light or the reference cannot be
            made. What a method raises is in the row, as its ``error``.
    """
    if core is not None:
        _keep_to(core)
    use_compilation_cache()
    started = time.perf_counter()
    view = _view(job.view)
    method = methods.create(job.method)
    row, _ = method_row(
        job.method,
        method,
        view.setting,
        view.yardstick,
        job.seed,
        progress=False,
        curve=False,
        prepare=lambda: _prepared(job.method, method, job.view, view.setting),
    )
    row |= {"reference_error": view.reference_error, "machine": platform.node()}
    row["total_s"] = time.perf_counter() - started
    return {name: row.get(name) for name in (*VALUES, *TIMING)}


class _View(NamedTuple):
    setting: Setting
    yardstick: Yardstick
    reference_error: float | None


@lru_cache(maxsize=KEPT)
def _view(job: Job) -> _View:
    """The scene under its light, and its reference."""
    setting = prepare(
        job.scene,
        job.environment,
        job.size,
        rotate=math.radians(job.rotate),
        supersampling=job.supersampling,
        reflectance=job.reflectance,
    )
    truth = methods.create(job.reference)
    image, row = render_reference(truth, setting, job.seed, False)
    covered = setting.covered
    yardstick = Yardstick(image, covered, exposure_of(image, covered))
    return _View(setting, yardstick, row["relative_error"])


_PREPARED: dict[tuple[str, Job], Prepared] = {}
"""The visibility and light of the last row, which rows of other seeds share."""


def _prepared(label: str, method: methods.Method, view: Job, setting: Setting) -> Prepared:
    if (label, view) not in _PREPARED:
        _PREPARED.clear()  # first: both may not fit into memory
        _PREPARED[label, view] = prepared(method, setting, lambda verb: None, progress=False)
    return _PREPARED[label, view]


@lru_cache(maxsize=1)
def _keep_to(core: int) -> None:
    """Binds this thread, and those that it starts, to one core.

    Side by side, workers would otherwise start as many threads each as there are cores.
    """
    if hasattr(os, "sched_setaffinity"):
        cores = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {cores[core % len(cores)]})
