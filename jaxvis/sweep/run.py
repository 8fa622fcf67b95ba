"""Runs a grid in this process, on this machine's cores, or on a Dask cluster."""

import contextlib
import os
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED
from typing import TYPE_CHECKING

from tqdm import tqdm

from jaxvis.cluster import client_of, worker_threads
from jaxvis.cores import core_count
from jaxvis.sweep.grid import Grid, Job, split
from jaxvis.sweep.images import has_image, name_of, save_image
from jaxvis.sweep.store import IMAGES, Store, frame_of
from jaxvis.sweep.work import Done, run_job

if TYPE_CHECKING:
    import pandas
    from distributed import Client, Future


def run_grid(
    grid: Grid,
    out: str | os.PathLike,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    images: bool = False,
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
        images: also keep the image of every row and every reference, in the folder ``images``:
            radiance as .exr, and as .png what a display shows at the exposure of the reference. The
            columns ``image`` and ``reference_image`` name the .exr. Rows that were measured without
            are measured again.
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
        left = [job for job in jobs if _is_left(job, store, images, retry)]
        try:
            with tqdm(
                total=len(jobs), initial=len(jobs) - len(left), unit="row", disable=quiet
            ) as bar:

                def wanted(job: Job) -> tuple[Job, ...]:
                    return _without_image(job, store) if images else ()

                def finished(job: Job, done: Done) -> None:
                    for whose, image in done.images.items():
                        save_image(store.folder, whose, image)
                    store.append(job, done.row | _names(job, store))
                    bar.update()

                if left and workers == 0:
                    for job in left:
                        finished(job, run_job(job, pictures=wanted(job)))
                elif left:
                    with client_of(min(workers or core_count(), len(left)), scheduler) as client:
                        _distribute(client, left, wanted, finished, bound=scheduler is None)
        finally:
            store.write_tables(jobs)
        return frame_of(store, jobs)


def _is_left(job: Job, store: Store, images: bool, retry: bool) -> bool:
    row = store.rows.get(job.key)
    if row is None:
        return True
    if row.get("error") is not None:
        return retry
    return images and bool(_without_image(job, store))


def _without_image(job: Job, store: Store) -> tuple[Job, ...]:
    """Of the job and its view, whose image there is not."""
    return tuple(whose for whose in (job, job.view) if not has_image(store.folder, whose))


def _names(job: Job, store: Store) -> dict[str, str]:
    """The columns that name the files which there are."""
    pairs = zip(IMAGES, (job, job.view), strict=True)
    return {name: name_of(whose) for name, whose in pairs if has_image(store.folder, whose)}


def _distribute(
    client: "Client",
    jobs: Sequence[Job],
    wanted: Callable[[Job], tuple[Job, ...]],
    finished: Callable[[Job, Done], None],
    *,
    bound: bool,
) -> None:
    """Gives every free worker a job until all are done.

    Each worker goes through a part of the grid; who has done its own takes from the end of the
    longest one left. A job whose worker dies goes to another.

    Args:
        wanted: whose images a job is to give.
        finished: hears of every job that is done.
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
                    wanted(job),
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
                result = future.result()
            except KilledWorker:
                result = Done({"error": "the worker died, again and again: out of memory?"}, {})
            finished(job, result)


def _next_job(parts: list[list[Job]], own: int) -> Job | None:
    """From the front of a worker's own part, else from the back of the longest."""
    if own < len(parts) and parts[own]:
        return parts[own].pop(0)
    longest = max(parts, key=len)
    return longest.pop() if longest else None
