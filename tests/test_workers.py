"""Worker processes are forked from one that has imported what they need."""

import gc
import os
import subprocess
import sys
from pathlib import Path

import pytest

from jaxvis import workers
from jaxvis.cluster import client_of
from jaxvis.importing import uncollected_imports

FORKED = pytest.mark.skipif(workers.START_METHOD != "forkserver", reason="forked on Linux only")


def said_by(code, **environment):
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | environment,
    )
    assert done.stderr == ""
    return done.stdout.split()


def facts():
    """Of a worker: what it found imported, before this was run, and its variables."""
    found = [name in sys.modules for name in ("jaxvis.sweep.work", "scipy.stats", "trimesh")]
    return found, os.environ.get("OMP_NUM_THREADS"), os.environ.get("JAXVIS_CACHE"), gc.isenabled()


@FORKED
def test_workers_find_imported_what_they_need_and_the_variables_of_now(tmp_path, monkeypatch):
    for folder in ("first", "second"):
        monkeypatch.setenv("JAXVIS_CACHE", str(tmp_path / folder))
        with client_of(2, None) as client:
            found = client.run(facts)
        expected = ([True, True, True], "1", str(tmp_path / folder), True)
        assert list(found.values()) == [expected, expected]


def unoptimised():
    import jax

    return jax.config.values["jax_disable_most_optimizations"]


@pytest.mark.parametrize("now", ["false", "true"])
def test_workers_heed_settings_of_jax_that_have_changed(now, monkeypatch):
    workers.start_importing()
    monkeypatch.setenv("JAX_DISABLE_MOST_OPTIMIZATIONS", now)
    with client_of(1, None) as client:
        assert list(client.run(unoptimised).values()) == [now == "true"]


@FORKED
def test_starting_early_leaves_the_variables_alone(monkeypatch):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    workers.start_importing()
    workers.start_importing()
    assert "OMP_NUM_THREADS" not in os.environ
    assert os.environ["OPENBLAS_NUM_THREADS"] == "3"


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="/proc is missing")
def test_what_is_imported_before_forks_starts_no_thread_and_no_device():
    code = (
        "import os, jaxvis.preloaded; from jax._src import xla_bridge;"
        "print(len(os.listdir('/proc/self/task')), len(xla_bridge._backends))"
    )
    assert said_by(code, **workers.ONE_THREAD) == ["1", "0"]


def test_imports_are_kept_from_the_collector_which_goes_on():
    code = (
        "import gc; from jaxvis.importing import uncollected_imports\n"
        "with uncollected_imports():\n"
        "    during = gc.isenabled(); import jax\n"
        "print(during, gc.isenabled(), gc.get_freeze_count() > 10000)"
    )
    assert said_by(code) == ["False", "True", "True"]


def test_where_jax_is_imported_the_collector_is_left_alone():
    import jax  # noqa: F401 - as in a session in which somebody works

    frozen = gc.get_freeze_count()
    with uncollected_imports():
        assert gc.isenabled()
    assert gc.get_freeze_count() == frozen
