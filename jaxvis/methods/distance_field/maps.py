"""Hemispherical visibility maps by rays: every texel, or boundaries only (paper 002, section 4.2).

Host. A map starts at ``coarsest`` texels along each side, all traced, and doubles until it has
``resolution``: the children of texels beside which the other class begins are traced, the others
inherit. Texels where neighbouring samples see a boundary are refined too, unless the sample knows
of one beside them: what is slim and falls between the first rays is found if any neighbour finds
it.
"""

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Int

from jaxvis.cluster import map_jobs
from jaxvis.compiled import compiled
from jaxvis.scene import RayTracer
from jaxvis.sphere.hemisphere_grid import texel_directions

SAMPLES_PER_JOB = 32
"""Samples whose rays a thread lists and traces at once: half a million at the most."""


HINTED = 32
"""Finest level at which neighbours' boundaries are looked at: beyond, own boundaries are known."""

BESIDE = 4
"""Texels within which an own boundary makes a hint unnecessary, since it leads there by itself; at
the finest level half of it, since what is missed there stays so (light leaks under what stands on
something). The nearer, the more rays are traced."""


class Views(NamedTuple):
    """Where maps are looked from."""

    origins: Float32[np.ndarray, "samples 3"]
    frames: Float32[np.ndarray, "samples 3 3"]
    """Rows: tangent, bitangent, normal."""

    def take(self, samples: Int[np.ndarray, "chosen"] | slice) -> "Views":
        """Some of them."""
        return Views(self.origins[samples], self.frames[samples])


class Known(NamedTuple):
    """What is known of maps before they are traced."""

    maps: Bool[np.ndarray, "samples n n"]
    stale: Bool[np.ndarray, "samples n n"]
    """Texels that may have changed; the others keep their values and cost no ray."""


class Traced(NamedTuple):
    """Maps and what they cost."""

    maps: Bool[np.ndarray, "samples n n"]
    """True where the sky is seen."""
    rays: int


class _Task(NamedTuple):
    """Maps of some samples, with ``level`` texels along each side, and which of them to trace."""

    views: Views
    level: int
    values: Bool[np.ndarray, "samples n n"]
    wanted: Bool[np.ndarray, "samples n n"]


def check_resolution(resolution: int, coarsest: int) -> None:
    """Raises ValueError unless the resolution is the coarsest level times a power of two."""
    ratio, rest = divmod(resolution, max(coarsest, 1))
    if coarsest < 2 or rest or ratio < 1 or ratio & (ratio - 1):
        raise ValueError(
            "resolution must be coarsest times a power of two and coarsest at least 2, "
            f"got {resolution} and {coarsest}"
        )


def dense_maps(tracer: RayTracer, views: Views, resolution: int) -> Traced:
    """Maps for which every texel's centre is traced."""
    return adaptive_maps(tracer, views, resolution, coarsest=resolution)


def adaptive_maps(
    tracer: RayTracer,
    views: Views,
    resolution: int = 128,
    coarsest: int = 16,
    *,
    neighbours: Int[np.ndarray, "samples near"] | None = None,
    known: Known | None = None,
) -> Traced:
    """Visibility maps of samples, refined where visibility changes.

    Args:
        tracer: the scene, centred coordinates.
        views: of the samples.
        resolution: texels along each side, ``coarsest`` times a power of two.
        coarsest: texels along each side of which all are traced.
        neighbours: samples whose boundaries hint at a sample's own; -1 is none.
        known: values that still hold (of the resolution asked for).

    Raises:
        ValueError: the resolution does not fit.
    """
    check_resolution(resolution, coarsest)
    count = len(views.origins)
    level = coarsest
    values = np.zeros((count, level, level), np.bool_)
    wanted = np.ones(values.shape, np.bool_)
    inherited = None
    rays = 0
    with ThreadPoolExecutor(tracer.threads, thread_name_prefix="jaxvis-maps") as pool:
        jobs = [slice(a, a + SAMPLES_PER_JOB) for a in range(0, count, SAMPLES_PER_JOB)]

        def in_jobs(function, *arrays: np.ndarray) -> None:
            for _ in pool.map(lambda job: function(*(array[job] for array in arrays)), jobs):
                pass

        while True:
            if known is not None:
                in_jobs(_keep, known.maps, known.stale, values, wanted)
            tasks = (_Task(views.take(job), level, values[job], wanted[job]) for job in jobs)
            found = map_jobs(_traced, (tracer,), tasks, threads=tracer.threads)
            for job, seen in zip(jobs, found, strict=True):
                values[job] = seen.maps
                rays += seen.rays
            if level == resolution:
                return Traced(values, rays)
            marked = np.zeros(values.shape, np.bool_)
            in_jobs(_mark_boundaries, values, marked)
            if inherited is not None:
                # What the coarser ray met and these rays miss is between them.
                marked |= values != inherited
            if neighbours is not None and level <= HINTED:
                own = marked
                marked = own.copy()
                hint = partial(_mark_hints, own, views.frames, texel_directions(level))
                in_jobs(hint, np.arange(count), neighbours, marked)
            level *= 2
            values, wanted = _doubled(values), _doubled(marked)
            inherited = values.copy() if level < resolution else None


def _traced(tracer: RayTracer, task: _Task) -> Traced:
    """The maps with their wanted texels filled, and how many there were."""
    values, wanted = task.values.copy(), task.wanted
    count = int(np.count_nonzero(wanted))
    if count:
        origins = np.empty((count, 3), np.float32)
        directions = np.empty((count, 3), np.float32)
        local = texel_directions(task.level)
        _list_rays(task.views.origins, task.views.frames, local, wanted, origins, directions)
        values[wanted] = ~tracer.occluded_block(origins, directions)
    return Traced(values, count)


def _doubled(maps: Bool[np.ndarray, "samples n n"]) -> Bool[np.ndarray, "samples m m"]:
    return np.repeat(np.repeat(maps, 2, axis=1), 2, axis=2)


@compiled
def _list_rays(starts, frames, local, wanted, origins, directions):
    ray = 0
    for sample in range(wanted.shape[0]):
        frame = frames[sample]
        for row in range(wanted.shape[1]):
            for column in range(wanted.shape[2]):
                if wanted[sample, row, column]:
                    x, y, z = local[row, column, 0], local[row, column, 1], local[row, column, 2]
                    for axis in range(3):
                        origins[ray, axis] = starts[sample, axis]
                        directions[ray, axis] = (
                            x * frame[0, axis] + y * frame[1, axis] + z * frame[2, axis]
                        )
                    ray += 1


@compiled
def _keep(maps, stale, values, wanted):
    """Takes over the texels none of whose finest parts is stale, from the one at their middle."""
    side = values.shape[1]
    ratio = maps.shape[1] // side
    for sample in range(values.shape[0]):
        for row in range(side):
            for column in range(side):
                fresh = True
                for i in range(row * ratio, (row + 1) * ratio):
                    for j in range(column * ratio, (column + 1) * ratio):
                        fresh = fresh and not stale[sample, i, j]
                if fresh:
                    middle = ratio // 2
                    values[sample, row, column] = maps[
                        sample, row * ratio + middle, column * ratio + middle
                    ]
                    wanted[sample, row, column] = False


@compiled
def _mark_boundaries(values, marked):
    """Texels one of whose eight neighbours is of the other class."""
    side = values.shape[1]
    for sample in range(values.shape[0]):
        for row in range(side):
            for column in range(side):
                own = values[sample, row, column]
                for i in range(max(row - 1, 0), min(row + 2, side)):
                    for j in range(max(column - 1, 0), min(column + 2, side)):
                        if values[sample, i, j] != own:
                            marked[sample, row, column] = True


@compiled
def _any_beside(own, row, column):
    """Whether a texel within :data:`BESIDE` is marked."""
    side = own.shape[0]
    reach = BESIDE // 2 if side >= HINTED else BESIDE
    for i in range(max(row - reach, 0), min(row + reach + 1, side)):
        for j in range(max(column - reach, 0), min(column + reach + 1, side)):
            if own[i, j]:
                return True
    return False


@compiled
def _mark_hints(own, frames, local, samples, neighbours, marked):
    """Texels at which neighbours, that look the same way, have a boundary texel."""
    side = marked.shape[1]
    scale = side / np.pi
    for sample in range(neighbours.shape[0]):
        frame = frames[samples[sample]]
        for place in range(neighbours.shape[1]):
            other = neighbours[sample, place]
            if other < 0:
                continue
            turn = np.zeros((3, 3), np.float32)
            for a in range(3):
                for b in range(3):
                    for c in range(3):
                        turn[a, b] += frame[a, c] * frames[other, b, c]
            for row in range(side):
                for column in range(side):
                    if own[other, row, column]:
                        u = local[row, column]
                        z = turn[2, 0] * u[0] + turn[2, 1] * u[1] + turn[2, 2] * u[2]
                        if z <= 0.0:
                            continue
                        x = turn[0, 0] * u[0] + turn[0, 1] * u[1] + turn[0, 2] * u[2]
                        y = turn[1, 0] * u[0] + turn[1, 1] * u[1] + turn[1, 2] * u[2]
                        i = int(scale * np.arccos(min(max(x, -1.0), 1.0)))
                        j = int(scale * np.arctan2(z, y))
                        i, j = min(i, side - 1), min(j, side - 1)
                        if not _any_beside(own[samples[sample]], i, j):
                            marked[sample, i, j] = True
