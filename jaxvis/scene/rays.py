"""Ray tracing through Embree: closest hit and occlusion, in all threads.

Embree traces each ray alone, so the answers do not depend on how rays are shared among threads.
A tracer works in the scene's centred coordinates (float32).
"""

import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from jaxtyping import Bool, Float, Float32, Int32, Integer

from jaxvis.compiled import compiled
from jaxvis.cores import core_count

BLOCK = 1 << 14
"""Rays per call of Embree: small enough to share evenly, large enough to hide the call."""

OFFSET_SCALE = 2.0**-17
"""Distance by which a ray leaves its surface, in units of the position's largest coordinate.

64 float32 roundings: a point from barycentrics and Embree's own plane test err by a few each.
"""


class Hits(NamedTuple):
    """Closest hits. ``triangle`` is -1 and ``distance`` infinite where a ray misses."""

    triangle: Int32[np.ndarray, "rays"]
    barycentrics: Float32[np.ndarray, "rays 3"]
    distance: Float32[np.ndarray, "rays"]


def offset_origins(
    positions: Float[np.ndarray, "*points 3"],
    geometric_normals: Float[np.ndarray, "*points 3"],
) -> Float32[np.ndarray, "*points 3"]:
    """Positions moved off their surface, to the side of the normal, by a rounding-safe distance."""
    # Axis by axis: NumPy's maximum over a short last axis is ten times as slow.
    x, y, z = (np.abs(positions[..., axis : axis + 1]) for axis in range(3))
    scale = OFFSET_SCALE * np.maximum(np.maximum(x, y), z)
    moved = positions + np.maximum(scale, np.float32(1e-30)) * geometric_normals
    return np.ascontiguousarray(moved, np.float32)


class RayTracer:
    """A triangle mesh in an Embree acceleration structure.

    Args:
        positions: vertices, centred coordinates.
        triangles: vertex indices.
        threads: how many threads trace; all cores if None. Results do not depend on it.

    ``rays_traced`` and ``embree_seconds`` count the rays so far and the time in Embree's own calls,
    added up over the threads.
    """

    def __init__(
        self,
        positions: Float[np.ndarray, "vertices 3"],
        triangles: Integer[np.ndarray, "triangles 3"],
        threads: int | None = None,
    ) -> None:
        self.threads = core_count() if threads is None else threads
        if self.threads < 1:
            raise ValueError(f"threads must be at least 1, got {threads}")
        self._mesh = positions, triangles
        self._lock = threading.Lock()
        self.rays_traced = 0
        self.embree_seconds = 0.0
        self._scene = EmbreeScene(robust=True)
        TriangleMesh(
            self._scene,
            np.ascontiguousarray(positions, np.float32),
            np.ascontiguousarray(triangles, np.int32),
        )
        # Embree builds its hierarchy in the first query, which must not run in two threads.
        self._scene.run(np.zeros((1, 3), np.float32), np.eye(3, dtype=np.float32)[:1])

    def __reduce__(self) -> tuple[Any, ...]:
        """Another process builds its own tree, traces in its own threads, and counts for itself."""
        return RayTracer, self._mesh

    def occluded(
        self,
        origins: Float[np.ndarray, "rays 3"],
        directions: Float[np.ndarray, "rays 3"],
        max_distance: Float[np.ndarray, "rays"] | None = None,
    ) -> Bool[np.ndarray, "rays"]:
        """Whether anything lies on each ray (within ``max_distance`` times its direction)."""
        origins, directions = _contiguous(origins), _contiguous(directions)
        result = np.empty(len(origins), bool)
        # Embree overwrites the distances that it is given.
        limits = None if max_distance is None else np.array(max_distance, np.float32)

        def trace(rays: slice) -> float:
            options = {} if limits is None else {"dists": limits[rays]}
            answer, seconds = self._run(
                origins[rays], directions[rays], query="OCCLUDED", **options
            )
            np.equal(answer, 0, out=result[rays])
            return seconds

        self._in_threads(trace, len(origins))
        return result

    def occluded_block(
        self,
        origins: Float32[np.ndarray, "rays 3"],
        directions: Float32[np.ndarray, "rays 3"],
    ) -> Bool[np.ndarray, "rays"]:
        """Whether anything lies on each ray. Traces in the calling thread and in one call, for
        callers that keep several threads busy; the arrays must be contiguous."""
        answer, seconds = self._run(origins, directions, query="OCCLUDED")
        self._count(len(origins), seconds)
        return answer == 0

    def visible(
        self,
        origins: Float32[np.ndarray, "points 3"],
        directions: Sequence[Float32[np.ndarray, "points samples"]],
        active: Bool[np.ndarray, "points samples"],
        limits: Float32[np.ndarray, "points samples"] | None = None,
    ) -> Bool[np.ndarray, "points samples"]:
        """Which of the active rays leave the scene, or meet nothing within their ``limits`` (in
        lengths of their directions). Only active rays are traced; others are false.

        ``directions`` are three arrays, one a component, as array code makes them fastest. Traces
        in the calling thread, for callers that keep several threads busy; the rays are compacted
        block by block, while a block is in cache.
        """
        points, samples = active.shape
        result = np.zeros((points, samples), bool)
        left = np.count_nonzero(active)
        step = max(1, BLOCK * points // max(left, 1))
        traced, seconds = 0, 0.0
        for first in range(0, points, step):
            part = slice(first, first + step)
            count = int(np.count_nonzero(active[part]))
            if not count:
                continue
            starts = np.empty((count, 3), np.float32)
            along = np.empty((count, 3), np.float32)
            x, y, z = (axis[part] for axis in directions)
            _compact(origins[part], x, y, z, active[part], starts, along)
            # A copy: Embree overwrites the distances that it is given.
            options = {} if limits is None else {"dists": limits[part][active[part]]}
            answer, elapsed = self._run(starts, along, query="OCCLUDED", **options)
            _spread(answer, active[part], result[part])
            traced, seconds = traced + count, seconds + elapsed
        self._count(traced, seconds)
        return result

    def closest_hit(
        self,
        origins: Float[np.ndarray, "rays 3"],
        directions: Float[np.ndarray, "rays 3"],
    ) -> Hits:
        """Triangle, barycentrics (of its three vertices) and distance of the first hit."""
        origins, directions = _contiguous(origins), _contiguous(directions)
        count = len(origins)
        hits = Hits(
            np.empty(count, np.int32), np.empty((count, 3), np.float32), np.empty(count, np.float32)
        )

        def trace(rays: slice) -> float:
            answer, seconds = self._run(origins[rays], directions[rays], output=1)
            triangle = answer["primID"]
            missed = triangle < 0
            hits.triangle[rays] = triangle
            u, v = answer["u"], answer["v"]
            hits.barycentrics[rays, 0] = np.where(missed, 0.0, 1.0 - u - v)
            hits.barycentrics[rays, 1] = np.where(missed, 0.0, u)
            hits.barycentrics[rays, 2] = np.where(missed, 0.0, v)
            hits.distance[rays] = np.where(missed, np.inf, answer["tfar"])
            return seconds

        self._in_threads(trace, count)
        return hits

    def _run(self, origins: np.ndarray, directions: np.ndarray, **query: Any) -> tuple[Any, float]:
        """Embree's answer and the seconds it took."""
        started = time.perf_counter()
        answer = self._scene.run(origins, directions, **query)
        return answer, time.perf_counter() - started

    def _in_threads(self, trace: Callable[[slice], float], count: int) -> None:
        """Calls ``trace`` for each block of rays; it returns the seconds spent in Embree."""
        blocks = [slice(start, min(start + BLOCK, count)) for start in range(0, count, BLOCK)]
        if self.threads == 1 or len(blocks) < 2:
            seconds = sum(map(trace, blocks), 0.0)
        else:
            seconds = sum(_pool(self.threads).map(trace, blocks), 0.0)
        self._count(count, seconds)

    def _count(self, rays: int, seconds: float) -> None:
        with self._lock:
            self.rays_traced += rays
            self.embree_seconds += seconds


@compiled
def _compact(origins, x, y, z, active, starts, along):
    """Origins and directions of the active rays, in order."""
    ray = 0
    for point in range(active.shape[0]):
        for sample in range(active.shape[1]):
            if active[point, sample]:
                for axis in range(3):
                    starts[ray, axis] = origins[point, axis]
                along[ray, 0] = x[point, sample]
                along[ray, 1] = y[point, sample]
                along[ray, 2] = z[point, sample]
                ray += 1


@compiled
def _spread(answer, active, result):
    """Embree's answers where rays were active: 0 is a hit."""
    ray = 0
    for point in range(active.shape[0]):
        for sample in range(active.shape[1]):
            if active[point, sample]:
                result[point, sample] = answer[ray] != 0
                ray += 1


def _contiguous(array: Float[np.ndarray, "rays 3"]) -> Float32[np.ndarray, "rays 3"]:
    return np.ascontiguousarray(array, np.float32)


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="jaxvis-rays")
