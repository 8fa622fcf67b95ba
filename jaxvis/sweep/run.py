"""Runs a grid in this process, on this machine's cores, or on a Dask cluster."""

import contextlib
import os
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED
from typing import TYPE_CHECKING, Any

from tqdm import tqdm

from jaxvis.cluster import client_of, worker_threads
from jaxvis.cores import core_count
from jaxvis.sweep.grid import Grid, Job, split
from jaxvis.sweep.store import Store, frame_of
from jaxvis.sweep.work import run_job

if TYPE_CHECKING:
    import pandas
    from distributed import Client, Future


def run_grid(
    grid: Grid,
    out: str | os.PathLike,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    retry: bool = False,
    progress: bool = True,
) -> "pandas.DataFrame":
    """Measures what is not in the folder yet, and writes the tables.

    Every finished row is kept at once (``rows.jsonl``): after a kill the same call goes on where it
    stopped. Rows of another grid stay, so a grid can grow. ``table.csv`` has what does not depend
    on the machine, ``times.csv`` the seconds: rows that differ in their seed alone share visibility
    and light, and what these took.

    Args:
        out: the folder.
        workers: processes on this machine, of one core each; by default as many as there are cores.
            0 works in this process, with all its cores and without Dask.
        scheduler: address of a Dask scheduler (``tcp://host:8786``), whose workers do the work, one
            row at a time each, with the threads that they may use. They must find the same files.
        retry: run rows again that failed.
        progress: show how far it is, and the time left, if standard error is a terminal.

    Returns:
        One row a combination, in the grid's order.

    Raises:
        ValueError, FileNotFoundError, OSError: bad input, or a cluster that does not answer; what
            was finished is kept.
        ModuleNotFoundError: Dask is needed and not installed; without it, take 0 workers.
    """
    if workers is not None and workers < 0:
        raise ValueError(f"workers must be at least 0, got {workers}")
    if workers is not None and scheduler is not None:
        raise ValueError("give workers or a scheduler, not both: a cluster has its own workers")
    jobs = grid.jobs()
    quiet = None if progress else True  # None is tqdm's word for: unless it is a terminal
    with Store(out) as store:
        left = [job for job in jobs if _is_left(store.rows.get(job.key), retry)]
        try:
            with tqdm(
                total=len(jobs), initial=len(jobs) - len(left), unit="row", disable=quiet
            ) as bar:

                def finished(job: Job, row: dict[str, Any]) -> None:
                    store.append(job, row)
                    bar.update()

                if left and workers == 0:
                    for job in left:
                        finished(job, run_job(job))
                elif left:
                    with client_of(min(workers or core_count(), len(left)), scheduler) as client:
                        _distribute(client, left, finished, bound=scheduler is None)
        finally:
            store.write_tables(jobs)
        return frame_of(store, jobs)


def _is_left(row: dict[str, Any] | None, retry: bool) -> bool:
    return row is None or (retry and row.get("error") is not None)


def _distribute(
    client: "Client",
    jobs: Sequence[Job],
    finished: Callable[[Job, dict[str, Any]], None],
    *,
    bound: bool,
) -> None:
    """Gives every free worker a job until all are done.

    Each worker goes through a part of the grid; who has done its own takes from the end of the
    longest one left. A job whose worker dies goes to another.

    Args:
        bound: keep each worker to a core of its own.
    """
    from distributed import KilledWorker, wait

    parts = split(jobs, len(worker_threads(client)))
    own: dict[str, int] = {}
    running: dict[Future, tuple[Job, str]] = {}
    done: list[Future] = []
    while any(parts) or running:
        alive = list(worker_threads(client))
        own = {address: part for address, part in own.items() if address in alive}
        for address in set(alive) - set(own):
            own[address] = min(set(range(len(alive))) - set(own.values()))
        busy = {address for _, address in running.values()}
        for address in alive:
            if address not in busy and (job := _next_job(parts, own[address])) is not None:
                future = client.submit(
                    run_job,
                    job,
                    own[address] if bound else None,
                    workers=[address],
                    allow_other_workers=True,
                    pure=False,
                )
                running[future] = job, address
        # Not before: Dask tells the scheduler at once, and what follows 10 ms later.
        done.clear()
        with contextlib.suppress(TimeoutError):
            wait(list(running), timeout=1.0, return_when=FIRST_COMPLETED)
        done = [future for future in running if future.done()]
        # Rows before errors: what is finished is kept.
        for future in sorted(done, key=lambda future: future.status != "finished"):
            job, _ = running.pop(future)
            try:
                row = future.result()
            except KilledWorker:
                row = {"error": "the worker died, again and again: out of memory?"}
            finished(job, row)


def _next_job(parts: list[list[Job]], own: int) -> Job | None:
    """From the front of a worker's own part, else from the back of the longest."""
    if own < len(parts) and parts[own]:
        return parts[own].pop(0)
    longest = max(parts, key=len)
    return longest.pop() if longest else None
