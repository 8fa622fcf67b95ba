"""Jobs in threads and on worker processes: the same results, in order, whatever dies."""

import os
import signal
import threading
import time
from collections import Counter

import jax
import numpy as np
import pytest
from distributed import Client, LocalCluster

import jaxvis
from jaxvis import cli
from jaxvis.cluster import AHEAD, cluster_size, map_jobs, on_cluster
from jaxvis.methods import create
from jaxvis.scene.builtin import builtin_scene

NAMES = (
    "vectorized:vectors=32,resolution=16",
    "vectorized:vectors=32,resolution=16,refine=0.1",
    "correspondence:vectors=32,resolution=16",
    "visibility-field:samples=50000,rays=16",
    "visibility-field:samples=50000,rays=16,sampling=random",
    "distance-field:resolution=16",
    "adaptive:resolution=32,coarsest=8,budget=0.5",
)


def scaled(factor, task):
    return factor[0] * task, os.getpid()


def wait_then(seconds, task):
    time.sleep(seconds)
    return task


def refuse(task):
    raise ValueError(f"no {task}")


def die(task):
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.fixture(scope="module")
def address():
    with LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=":0", memory_limit=0
    ) as cluster:
        yield cluster.scheduler_address


def jobs_of(number, function=scaled, shared=((3,),), **options):
    return list(map_jobs(function, shared, number, **options))


@pytest.mark.parametrize("threads", [1, 3, None])
def test_jobs_in_threads(threads):
    assert jobs_of(range(50), threads=threads) == [(3 * n, os.getpid()) for n in range(50)]
    assert jobs_of([], threads=threads) == []
    with pytest.raises(ValueError, match="no 0"):
        jobs_of(range(3), refuse, (), threads=threads)


def test_jobs_on_workers(address):
    assert cluster_size() == 0
    with on_cluster(address):
        assert cluster_size() == 2
        found = jobs_of(range(40))
        with pytest.raises(ValueError, match="no 0"):
            jobs_of(range(3), refuse, ())
    assert [value for value, _ in found] == [3 * n for n in range(40)]
    assert len({process for _, process in found} - {os.getpid()}) == 2
    assert cluster_size() == 0
    assert jobs_of(range(2)) == [(0, os.getpid()), (3, os.getpid())]


@pytest.mark.parametrize("spread", [False, True])
def test_tasks_are_made_as_they_are_needed(address, spread):
    """There may be more of them than fit into memory."""
    made, behind = [], []

    def tasks():
        for n in range(60):
            made.append(n)
            yield n

    def count():
        for done, n in enumerate(map_jobs(wait_then, (0.0,), tasks(), threads=2)):
            assert n == done
            behind.append(len(made) - done)

    if spread:
        with on_cluster(address):
            count()
    else:
        count()
    assert len(made) == 60
    assert max(behind) <= 2 * AHEAD + 1


def test_what_jobs_share_is_sent_once(address, monkeypatch):
    sent = Counter()
    scatter = Client.scatter
    monkeypatch.setattr(
        Client, "scatter", lambda *args, **kw: sent.update(n=1) or scatter(*args, **kw)
    )
    shared, other = (2,), (5,)
    with on_cluster(address):
        for value in (shared, shared, other, shared):
            assert jobs_of(range(3), shared=(value,))[2][0] == 2 * value[0]
    assert sent["n"] == 2


@pytest.mark.parametrize("name", NAMES)
def test_precomputation_on_workers_has_the_same_bits(name, address, monkeypatch, tmp_path):
    jobs, submit = Counter(), Client.submit
    monkeypatch.setattr(Client, "submit", lambda *a, **kw: jobs.update(n=1) or submit(*a, **kw))
    monkeypatch.setattr("jaxvis.methods.vectorized.precompute.BATCH", 32)
    scene, method = builtin_scene("box-on-plane"), create(name)
    monkeypatch.setenv("JAXVIS_CACHE", str(tmp_path / "here"))
    here = method.precompute(scene, progress=False)
    assert not jobs
    monkeypatch.setenv("JAXVIS_CACHE", str(tmp_path / "there"))
    with on_cluster(address):
        there = method.precompute(scene, progress=False)
    assert jobs["n"] > 1
    one, other = map(jax.tree.leaves_with_path, (here, there))
    assert len(one) == len(other) > 3
    for (path, values), (_, others) in zip(one, other, strict=True):
        np.testing.assert_array_equal(np.asarray(values), np.asarray(others), str(path))


def test_a_worker_that_is_killed_loses_nothing():
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster,
        Client(cluster) as client,
    ):
        process = next(iter(client.run(os.getpid).values()))
        threading.Timer(0.7, os.kill, (process, signal.SIGKILL)).start()
        with on_cluster(cluster.scheduler_address):
            assert jobs_of(range(40), wait_then, (0.1,)) == list(range(40))
        assert process not in client.run(os.getpid).values()


def test_workers_that_die_again_and_again_are_said():
    with (
        pytest.raises(OSError, match="workers died, again and again: out of memory"),
        on_cluster(workers=1),
    ):
        jobs_of(range(1), die, ())
    assert cluster_size() == 0


def test_bad_clusters_are_refused(monkeypatch):
    monkeypatch.setattr("jaxvis.cluster.WAIT", 1.0)
    with (
        pytest.raises(OSError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9"),
        jaxvis.on_cluster("tcp://127.0.0.1:9"),
    ):
        pass
    with pytest.raises(ValueError, match="workers must be at least 1"), on_cluster(workers=0):
        pass
    with pytest.raises(ValueError, match="not both"), on_cluster("tcp://127.0.0.1:9", workers=1):
        pass


def test_the_command_shares_out(address, tmp_path, monkeypatch, capsys):
    sizes = []
    precompute = type(create("vectorized")).precompute

    def noted(self, scene, progress=True):
        sizes.append(cluster_size())
        return precompute(self, scene, progress)

    monkeypatch.setattr(type(create("vectorized")), "precompute", noted)
    command = ["precompute", "vectorized:vectors=16,resolution=16", "--scene", "box-on-plane"]
    assert cli.main([*command, "--out", str(tmp_path / "a"), "--scheduler", address]) == 0
    assert cli.main([*command, "--out", str(tmp_path / "b")]) == 0
    assert sizes == [2, 0]
    assert cli.main([*command, "--out", str(tmp_path / "c"), "--workers", "0"]) == 2
    assert "workers must be at least 1" in capsys.readouterr().err
