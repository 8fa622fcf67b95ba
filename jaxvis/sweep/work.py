"""What a worker of a sweep does: one row."""

import contextlib
import math
import os
import platform
import time
from collections.abc import Collection
from functools import lru_cache
from typing import Any, NamedTuple

from jaxvis import methods
from jaxvis.compare.compilation import use_compilation_cache
from jaxvis.compare.measurement import Pixels, Prepared, Yardstick, prepared
from jaxvis.compare.result import composite
from jaxvis.compare.run import method_row, render_reference
from jaxvis.compare.setting import Setting, prepare
from jaxvis.image import exposure_of
from jaxvis.sweep.grid import Job
from jaxvis.sweep.images import Image
from jaxvis.sweep.store import TIMING, VALUES

KEPT = 2
"""Scenes under their lights, with references, that a worker keeps in memory."""


class Done(NamedTuple):
    """A row of a sweep, and the images that were asked for, by whose they are."""

    row: dict[str, Any]
    images: dict[Job, Image]


def run_job(job: Job, core: int | None = None, pictures: Collection[Job] = ()) -> Done:
    """The row of a job.

    Args:
        core: which of the cores that this process may use it keeps to from now on; by default it
            uses all. Heard once, before anything is computed.
        pictures: whose images are wanted: the job's, and that of its view, which is the reference.

    Raises:
        ValueError, FileNotFoundError, OSError: the scene, the light or the reference cannot be
            made. What a method raises is in the row, as its ``error``.
    """
    if core is not None:
        _keep_to(core)
    use_compilation_cache()
    started = time.perf_counter()
    setting = _setting(job.view)
    method = methods.create(job.method)
    # Before the reference: workers that start together with different methods compile these side by
    # side, and then one the reference's programs for all.
    with contextlib.suppress(Exception):  # the row meets it again, and has a place for it
        _prepared(job.method, method, job.view, setting)
    truth = _truth(job.view)
    row, image = method_row(
        job.method,
        method,
        setting,
        truth.yardstick,
        job.seed,
        progress=False,
        curve=False,
        prepare=lambda: _prepared(job.method, method, job.view, setting),
    )
    row |= {"reference_error": truth.error, "machine": platform.node()}
    row["total_s"] = time.perf_counter() - started
    images = {}
    for whose, radiance in ((job, image), (job.view, truth.yardstick.reference)):
        if whose in pictures and radiance is not None:
            images[whose] = Image(radiance, _shown(radiance, setting, truth.yardstick.exposure))
    return Done({name: row.get(name) for name in (*VALUES, *TIMING)}, images)


def _shown(radiance: Pixels, setting: Setting, exposure: float) -> Pixels:
    return composite(radiance, setting.coverage, setting.background, exposure)


@lru_cache(maxsize=KEPT)
def _setting(job: Job) -> Setting:
    """The scene under its light."""
    return prepare(
        job.scene,
        job.environment,
        job.size,
        rotate=math.radians(job.rotate),
        supersampling=job.supersampling,
        reflectance=job.reflectance,
        albedo=job.albedo,
    )


class _Truth(NamedTuple):
    yardstick: Yardstick
    error: float | None


@lru_cache(maxsize=KEPT)
def _truth(job: Job) -> _Truth:
    """The reference of the scene under its light."""
    setting = _setting(job)
    image, row = render_reference(methods.create(job.reference), setting, job.seed, False)
    covered = setting.covered
    yardstick = Yardstick(image, covered, exposure_of(image, covered))
    return _Truth(yardstick, row["relative_error"])


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
