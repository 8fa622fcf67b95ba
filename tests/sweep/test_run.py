"""Sweeps in this process, on worker processes and on a cluster: the same rows, whatever dies."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace

import pytest
from distributed import Client, LocalCluster

from jaxvis import cli
from jaxvis.compare.measurement import prepared
from jaxvis.methods import MonteCarlo
from jaxvis.sweep import Grid, run_grid, variants, work
from jaxvis.sweep import run as module
from jaxvis.sweep.store import LOG, TABLE

GRID = Grid(
    (*variants("mc-mis", spp=(1, 2)), "mc-environment:spp=2", "mc-brdf:spp=2"),
    scene=("sphere-on-plane",),
    environment=("uniform",),
    size=(12, 8),
    seed=(0, 1, 2),
    reference="reference:error=0.05",
)


@pytest.fixture(scope="module", autouse=True)
def as_here(own_caches):
    """Worker processes compile as this one does, so that their numbers can be the same bits."""
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_cpu_use_fusion_emitters=false"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XLA_FLAGS", flags)
        patch.setenv("JAX_DISABLE_MOST_OPTIMIZATIONS", "true")
        yield


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """The folder of a sweep in this process, and its frame."""
    folder = tmp_path_factory.mktemp("alone")
    return folder, run_grid(GRID, folder, workers=0)


def keys(folder):
    return [json.loads(line)["key"] for line in (folder / LOG).read_text().splitlines()]


def wait_for_rows(folder, count, seconds=120.0):
    end = time.monotonic() + seconds
    while not (folder / LOG).exists() or len((folder / LOG).read_bytes().splitlines()) < count:
        assert time.monotonic() < end, "no rows"
        time.sleep(0.02)


def assert_whole(folder, alone):
    """Every row is there once, with the numbers of the sweep in this process."""
    assert sorted(keys(folder)) == sorted(job.key for job in GRID.jobs())
    assert (folder / TABLE).read_bytes() == (alone[0] / TABLE).read_bytes()


def test_a_row_for_every_combination(alone):
    folder, frame = alone
    assert len(frame) == 12
    assert frame["error"].isna().all()
    assert frame["psnr_db"].between(3.0, 80.0).all()
    more = frame[frame["method"] == "mc-mis:spp=2"]["psnr_db"].mean()
    assert more > frame[frame["method"] == "mc-mis:spp=1"]["psnr_db"].mean()
    assert frame["psnr_db"].nunique() == 12  # seeds differ
    assert keys(folder) == [job.key for job in GRID.jobs()]


def test_a_finished_sweep_measures_nothing(alone, monkeypatch):
    monkeypatch.setattr(module, "run_job", pytest.fail)
    again = run_grid(GRID, alone[0], workers=0)
    assert again.equals(alone[1])


def test_a_grid_can_grow(tmp_path, alone):
    (tmp_path / LOG).write_bytes((alone[0] / LOG).read_bytes())
    frame = run_grid(replace(GRID, seed=(1, 3)), tmp_path, workers=0)
    assert frame["seed"].tolist() == [1, 3] * 4
    assert len(keys(tmp_path)) == 12 + 4


def test_a_method_that_fails_is_a_row_and_can_be_retried(tmp_path, monkeypatch):
    def refuse(self, environment):
        raise ValueError("too dark")

    grid = replace(GRID, methods=("mc-mis",), seed=(0,))
    with monkeypatch.context() as patch:
        patch.setattr(MonteCarlo, "light", refuse)
        frame = run_grid(grid, tmp_path, workers=0)
    assert frame["error"].tolist() == ["too dark"]
    assert run_grid(grid, tmp_path, workers=0)["error"].tolist() == ["too dark"]
    assert run_grid(grid, tmp_path, workers=0, retry=True)["error"].isna().all()


def test_bad_input_stops_and_keeps_what_was_finished(tmp_path):
    grid = replace(GRID, scene=("sphere-on-plane", "absent.obj"), seed=(0,))
    with pytest.raises(FileNotFoundError, match=r"absent\.obj"):
        run_grid(grid, tmp_path, workers=0)
    assert len(keys(tmp_path)) == 4
    assert len((tmp_path / TABLE).read_text().splitlines()) == 5
    with pytest.raises(ValueError, match="workers must be at least 0"):
        run_grid(GRID, tmp_path, workers=-1)
    with pytest.raises(ValueError, match="not both"):
        run_grid(GRID, tmp_path, workers=1, scheduler="tcp://127.0.0.1:1")


def test_a_scheduler_that_is_not_there_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr("jaxvis.cluster.WAIT", 1.0)
    with pytest.raises(OSError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9"):
        run_grid(GRID, tmp_path, scheduler="tcp://127.0.0.1:9")


def test_without_dask_it_says_what_to_install(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "distributed", None)
    (tmp_path / "grid.toml").write_text('methods = "mc-mis"')
    assert cli.main(["sweep", str(tmp_path / "grid.toml"), "--out", str(tmp_path / "out")]) == 2
    errors = capsys.readouterr().err
    assert errors.startswith("jaxvis: several processes need Dask: pip install")
    assert errors.count("\n") == 1


def test_seeds_share_visibility_and_light(tmp_path, monkeypatch):
    made = []
    monkeypatch.setattr(
        work, "prepared", lambda *args, **kw: made.append(args[0]) or prepared(*args, **kw)
    )
    monkeypatch.setattr(work, "_PREPARED", {})
    run_grid(replace(GRID, methods=("mc-mis:spp=1", "mc-mis:spp=3")), tmp_path, workers=0)
    per_view = len(GRID.scene) * len(GRID.environment)
    assert [method.spp for method in made] == [1, 3] * per_view
    assert len(work._PREPARED) == 1


def test_the_reference_comes_after_what_the_method_prepares(tmp_path, monkeypatch):
    """Workers that start together with different methods must not all compile it."""
    order = []
    for name in ("prepared", "render_reference"):
        known = getattr(work, name)
        monkeypatch.setattr(
            work, name, lambda *args, n=name, f=known, **kw: order.append(n) or f(*args, **kw)
        )
    monkeypatch.setattr(work, "_PREPARED", {})
    work._truth.cache_clear()
    grid = replace(GRID, scene=GRID.scene[:1], environment=GRID.environment[:1])
    run_grid(replace(grid, methods=("mc-mis:spp=1",)), tmp_path, workers=0)
    assert order == ["prepared", "render_reference"]


def test_two_processes_measure_the_same(tmp_path, alone):
    run_grid(GRID, tmp_path, workers=2)
    assert_whole(tmp_path, alone)


def test_a_worker_killed_in_mid_sweep_loses_no_row(tmp_path, alone):
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        process = next(iter(client.run(os.getpid).values()))
        address = cluster.scheduler_address
        sweep = threading.Thread(target=lambda: run_grid(GRID, tmp_path, scheduler=address))
        sweep.start()
        wait_for_rows(tmp_path, 3)
        assert len(keys(tmp_path)) < 12
        os.kill(process, signal.SIGKILL)
        sweep.join(timeout=180.0)
        assert not sweep.is_alive()
        assert process not in client.run(os.getpid).values()
    assert_whole(tmp_path, alone)


def test_a_cluster_that_dies_is_said_and_the_sweep_goes_on_later(tmp_path, alone):
    program = "import distributed, time; c = distributed.LocalCluster(n_workers=1, "
    program += "threads_per_worker=1, dashboard_address=':0', processes=False, protocol='tcp://'); "
    program += "print(c.scheduler_address, flush=True); time.sleep(600)"
    cluster = subprocess.Popen(
        [sys.executable, "-c", program],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    found = []

    def sweep():
        with pytest.raises(OSError, match=r"lost the cluster at tcp://.*run it again") as error:
            run_grid(GRID, tmp_path, scheduler=cluster.stdout.readline().strip())
        found.append(error.value)

    thread = threading.Thread(target=sweep)
    thread.start()
    wait_for_rows(tmp_path, 2)
    cluster.kill()
    thread.join(timeout=120.0)
    assert found, "it waits for a cluster that is gone"
    assert 2 <= len(keys(tmp_path)) < 12
    run_grid(GRID, tmp_path, workers=0)
    assert_whole(tmp_path, alone)


def test_a_sweep_killed_again_and_again_ends_whole(tmp_path, alone):
    text = f"""
        scene = "{GRID.scene[0]}"
        environment = "{GRID.environment[0]}"
        size = {list(GRID.size)}
        seed = {list(GRID.seed)}
        reference = "{GRID.reference}"
        methods = {list(GRID.methods)}
    """
    (tmp_path / "grid.toml").write_text(text)
    out = tmp_path / "out"
    command = [sys.executable, "-m", "jaxvis.cli", "sweep", str(tmp_path / "grid.toml")]
    command += ["--out", str(out), "--workers", "0"]
    for rows in (1, 5):
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        wait_for_rows(out, rows)
        process.kill()
        process.wait()
        assert len(set(keys_of_whole_lines(out))) == len(keys_of_whole_lines(out)) < 12
    finished = subprocess.run(command, capture_output=True, text=True, timeout=180)
    assert finished.returncode == 0, finished.stderr
    assert finished.stdout.strip().splitlines()[-1] == str(out / TABLE)
    assert finished.stdout.count("mc-mis:spp=1") == 3
    assert_whole(out, alone)


def keys_of_whole_lines(folder):
    content = (folder / LOG).read_bytes()
    lines = content[: content.rfind(b"\n") + 1].splitlines()
    return [json.loads(line)["key"] for line in lines]


def test_the_command_says_what_is_wrong(tmp_path, capsys):
    assert cli.main(["sweep", str(tmp_path / "absent.toml")]) == 2
    assert capsys.readouterr().err.startswith(f"jaxvis: {tmp_path}/absent.toml: no such file")
    (tmp_path / "grid.toml").write_text('methods = "mc-mis"\nscene = "absent.obj"')
    out = str(tmp_path / "out")
    assert cli.main(["sweep", str(tmp_path / "grid.toml"), "--out", out, "--workers", "0"]) == 2
    assert "absent.obj" in capsys.readouterr().err
