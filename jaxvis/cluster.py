"""Independent jobs: in this process's threads, or on the worker processes of a Dask cluster."""

import atexit
import contextlib
import logging
import os
import uuid
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextvars import ContextVar
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from jaxvis.cores import core_count
from jaxvis.workers import ONE_THREAD, start_importing

if TYPE_CHECKING:
    from distributed import Client, Future

LOCAL = {
    # Jobs may take long in compiled code, in which a worker cannot answer.
    "distributed.scheduler.worker-ttl": None,
    # Without Dask's own MALLOC_TRIM_THRESHOLD_: every array would be given back and fetched anew.
    "distributed.nanny.pre-spawn-environ": ONE_THREAD,
    # What Dask looks at a hundred times a second costs a worker that compiles a tenth of its core.
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
    "logging.distributed": "error",
}
"""Dask's settings for workers of one core each; their memory is limited by the machine alone."""

WAIT = 60.0
"""Seconds to wait for a cluster that has no worker."""

AHEAD = 4
"""Jobs for each thread of the workers that are sent before the first of them is done."""

KEPT = 8
"""Shared arguments of jobs that workers keep."""


class _Cluster:
    """A client, and what its workers have been sent."""

    def __init__(self, client: "Client") -> None:
        self.client = client
        self._sent: deque[tuple[Any, Future]] = deque(maxlen=KEPT)

    def send(self, value: Any) -> "Future":
        """To all workers, once for as long as they keep it."""
        for known, future in self._sent:
            if known is value:
                return future
        sent: Any = self.client.scatter([value], broadcast=True, hash=False)
        future = sent[0]
        self._sent.append((value, future))
        return future


_CLUSTER: ContextVar[_Cluster | None] = ContextVar("cluster", default=None)


@contextlib.contextmanager
def on_cluster(scheduler: str | None = None, *, workers: int | None = None) -> Iterator[None]:
    """Within it, precomputation is shared out among the workers of a Dask cluster.

        with jaxvis.on_cluster("tcp://host:8786"):
            visibility = method.precompute(scene)

    Visibility polygons and their correspondence, visibility fields and the maps of distance fields
    are, with the same bits as without. Workers need jaxvis and memory for the scene's triangles;
    the scene's files they need not. A job whose worker dies goes to another.

    Args:
        scheduler: address of the cluster's scheduler; None starts one on this machine.
        workers: processes on this machine, of one core each; by default as many as there are cores.

    Raises:
        ValueError: both are given, or fewer workers than 1.
        OSError: no scheduler or worker answers, or the cluster is lost.
        ModuleNotFoundError: Dask is not installed.
    """
    if workers is not None and workers < 1:
        raise ValueError(f"workers must be at least 1, got {workers}")
    if workers is not None and scheduler is not None:
        raise ValueError("give workers or a scheduler, not both: a cluster has its own workers")
    with client_of(workers or core_count(), scheduler) as client:
        worker_threads(client)
        token = _CLUSTER.set(_Cluster(client))
        try:
            yield
        finally:
            _CLUSTER.reset(token)


def cluster_size() -> int:
    """Threads of the workers of the cluster that is in use; 0 if there is none."""
    cluster = _CLUSTER.get()
    return 0 if cluster is None else sum(worker_threads(cluster.client).values())


def map_jobs(
    function: Callable[..., Any],
    shared: Sequence[Any],
    tasks: Iterable[Any],
    *,
    threads: int | None = None,
) -> Iterator[Any]:
    """``function(*shared, task)`` of each task, in order.

    In threads of this process, or within :func:`on_cluster` on its workers, with a few tasks for
    each thread in flight: there may be more than fit into memory.

    Args:
        function: that can be found by its name in its module.
        shared: sent to each worker once, for as long as it is the same objects.
        threads: of this process; as many as there are cores if None.

    Raises:
        OSError: the workers die, again and again.
    """
    cluster = _CLUSTER.get()
    if cluster is not None:
        yield from _on_workers(cluster, function, shared, tasks)
        return
    threads = core_count() if threads is None else threads
    call = partial(function, *shared)
    if threads == 1:
        yield from map(call, tasks)
        return
    with ThreadPoolExecutor(threads, thread_name_prefix="jaxvis-jobs") as pool:
        yield from _in_order(partial(pool.submit, call), tasks, AHEAD * threads)


@dataclass(frozen=True, eq=False)
class _Job:
    """A function with its task: one object, into which Dask does not look."""

    function: Callable[..., Any]
    task: Any

    def __call__(self, *shared: Any) -> Any:
        return self.function(*shared, self.task)


def _on_workers(
    cluster: _Cluster, function: Callable[..., Any], shared: Sequence[Any], tasks: Iterable[Any]
) -> Iterator[Any]:
    from distributed import KilledWorker

    sent = [cluster.send(value) for value in shared]

    def submit(task: Any) -> "Future":
        key = f"jaxvis-{uuid.uuid4()}"
        return cluster.client.submit(_Job(function, task), *sent, key=key, pure=False)

    try:
        yield from _in_order(submit, tasks, AHEAD * cluster_size())
    except KilledWorker as error:
        raise OSError("the cluster's workers died, again and again: out of memory?") from error


def _in_order(submit: Callable[[Any], Any], tasks: Iterable[Any], ahead: int) -> Iterator[Any]:
    """The results, ``ahead`` tasks being submitted at a time."""
    waiting: deque[Any] = deque()
    try:
        for task in tasks:
            if len(waiting) >= ahead:
                yield waiting.popleft().result()
            waiting.append(submit(task))
        while waiting:
            yield waiting.popleft().result()
    finally:
        for future in waiting:
            future.cancel()


@contextlib.contextmanager
def client_of(workers: int, scheduler: str | None) -> Iterator["Client"]:
    """A client of a cluster, or of ``workers`` processes of one core each, made for it.

    Raises:
        OSError: no scheduler answers, or the cluster is lost.
        ModuleNotFoundError: Dask is not installed.
    """
    start_method = start_importing() if scheduler is None else None
    try:
        import dask
        from distributed import Client, LocalCluster
        from distributed.comm import CommClosedError
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            'several processes need Dask: pip install "jaxvis[distributed]"'
        ) from error
    if scheduler is not None:
        try:
            client = Client(scheduler, timeout=WAIT)
        except (OSError, ValueError) as error:
            reason = " ".join(str(error).split())
            raise OSError(f"no Dask scheduler answers at {scheduler} ({reason})") from error
        logger = logging.getLogger("distributed.client")
        level = logger.level
        logger.setLevel(logging.CRITICAL)  # else a lost connection prints a traceback as well
        try:
            with client:
                yield client
        except (CancelledError, CommClosedError) as error:
            raise OSError(f"lost the cluster at {scheduler}; run it again") from error
        finally:
            logger.setLevel(level)
        return
    with (
        dask.config.set({**LOCAL, "distributed.worker.multiprocessing-method": start_method}),
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            memory_limit=0,
            dashboard_address=":0",
            silence_logs=50,
            env=dict(os.environ),  # of now: workers are forked from an older process
        ) as cluster,
        Client(cluster) as client,
    ):
        # At their end: else they spend a second on taking apart what the system takes back at once.
        client.run(atexit.register, os._exit, 0)
        yield client


def worker_threads(client: "Client") -> dict[str, int]:
    """How many threads each of the cluster's workers has, by address; waits for one.

    Raises:
        OSError: there is none.
    """
    try:
        client.wait_for_workers(1, timeout=WAIT)
    except TimeoutError:
        raise OSError(f"the cluster had no worker for {WAIT:.0f} s") from None
    found: Any = client.nthreads()
    return found
