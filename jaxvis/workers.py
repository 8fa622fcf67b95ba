"""This machine's worker processes: forked from one that has imported what they need."""

import multiprocessing
import os
import sys

START_METHOD = "forkserver" if sys.platform == "linux" else "spawn"
"""As Dask and multiprocessing name it. Elsewhere forks are missing, or unsafe."""

_imported_under: list[dict[str, str]] = []
"""The settings of JAX that the process which is forked was started with."""

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""A worker has one core."""


def start_importing() -> str:
    """Starts the process that is forked, unless it runs.

    Returns at once: on another core it imports while this process does. Workers have the
    environment variables of this moment unless they are given others.

    Returns:
        How workers should be started. JAX reads its settings when it is imported: under others
        than when that process was started, workers must import it themselves.
    """
    if START_METHOD != "forkserver":
        return START_METHOD
    settings = {k: v for k, v in os.environ.items() if k.startswith(("JAX_", "XLA_"))}
    if _imported_under and _imported_under[0] != settings:
        return "spawn"
    _imported_under[:] = [settings]
    from multiprocessing import forkserver

    multiprocessing.get_context(START_METHOD).set_forkserver_preload(["jaxvis.preloaded"])
    outer = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        forkserver.ensure_running()
    finally:
        for name, value in outer.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
    return START_METHOD
