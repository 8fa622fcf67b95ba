"""Triangles as voxels: area, place, normal and colour of what lies in each (host)."""

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int, Int32, Int64

from jaxvis.compiled import compiled
from jaxvis.cores import core_count
from jaxvis.methods.cones.volume import FACES, Grid
from jaxvis.reflectance import evaluate_materials
from jaxvis.scene import Scene

SPACING = 0.35
"""Voxels between the samples of a triangle."""

AT_ONCE = 1 << 21
"""Samples looked at together: bounds the memory."""


class Patches(NamedTuple):
    """Parts of the surface: what lies in one voxel and faces one of six ways."""

    voxel: Int32[np.ndarray, "patches"]
    """x-major number of the voxel."""
    area: Float32[np.ndarray, "patches"]
    """In units of a voxel's side squared."""
    position: Float32[np.ndarray, "patches 3"]
    normal: Float32[np.ndarray, "patches 3"]
    """Unit."""
    albedo: Float32[np.ndarray, "patches 3"]
    two_sided: Bool[np.ndarray, "patches"]

    @property
    def nbytes(self) -> int:
        return sum(int(array.nbytes) for array in self)


class _Samples(NamedTuple):
    triangle: Int32[np.ndarray, "samples"]
    barycentrics: Float32[np.ndarray, "samples 3"]
    area: Float32[np.ndarray, "samples"]


def voxelize(scene: Scene, chosen: Bool[np.ndarray, "triangles"], grid: Grid) -> Patches:
    """The patches of some triangles in a grid that holds them.

    Triangles are cut into equal parts no wider than :data:`SPACING` voxels, and each part counts
    where its centre lies: areas are kept exactly.
    """
    ids = np.flatnonzero(chosen)
    corners = scene.positions[scene.triangles[ids]].astype(np.float64)
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max(axis=1)
    cuts = np.maximum(np.ceil(edges / (SPACING * float(grid.voxel))), 1).astype(np.int64)
    ends = np.cumsum(cuts**2)
    kinds: list[np.ndarray] = []
    sums: list[np.ndarray] = []
    first = 0
    while first < len(ids):
        before = ends[first - 1] if first else 0
        last = max(int(np.searchsorted(ends, before + AT_ONCE, side="right")), first + 1)
        samples = _samples(ids[first:last], cuts[first:last])
        key, values = _gathered(scene, samples, grid)
        kinds.append(key)
        sums.append(values)
        first = last
    if not kinds:
        return _patches(np.zeros(0, np.int64), np.zeros((0, VALUES)), grid)
    return _patches(*_added(np.concatenate(kinds), np.concatenate(sums)), grid)


def _samples(ids: Int[np.ndarray, "triangles"], cuts: Int64[np.ndarray, "triangles"]) -> _Samples:
    """Centres of the n x n equal parts of each triangle."""
    starts = np.concatenate([[0], np.cumsum(cuts**2)])
    triangle = np.empty(starts[-1], np.int32)
    barycentrics = np.empty((starts[-1], 3), np.float32)
    area = np.empty(starts[-1], np.float32)
    _divide(ids.astype(np.int32), cuts, starts, triangle, barycentrics, area)
    return _Samples(triangle, barycentrics, area)


VALUES = 11
"""Sums for each patch: area, area x (position, normal, albedo), area of what is two-sided."""


def _gathered(
    scene: Scene, samples: _Samples, grid: Grid
) -> tuple[Int64[np.ndarray, "patches"], Float64[np.ndarray, "patches values"]]:
    """Keys (voxel, way it faces), and the sums of what goes by them."""
    count = len(samples.triangle)
    key, values = np.empty(count, np.int64), np.empty((count, VALUES))

    def part(rows: slice) -> None:
        which, weights = samples.triangle[rows], samples.barycentrics[rows].astype(np.float64)
        normal = scene.geometric_normals[which].astype(np.float64)
        corners = scene.positions[scene.triangles[which]].astype(np.float64)
        at = np.einsum("sk,skc->sc", weights, corners)
        size = np.linalg.norm(
            np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=-1
        )
        area = 0.5 * size * samples.area[rows] / float(grid.voxel) ** 2
        cell = np.floor((at - grid.low) / float(grid.voxel)).astype(np.int64)
        cell = np.clip(cell, 0, grid.resolution - 1)
        axis = np.abs(normal).argmax(axis=1)
        way = 2 * axis + (np.take_along_axis(normal, axis[:, None], axis=1)[:, 0] < 0.0)
        number = (cell[:, 0] * grid.resolution + cell[:, 1]) * grid.resolution + cell[:, 2]
        key[rows] = number * FACES + way
        uv = None if scene.uvs is None else np.einsum("sk,skc->sc", weights, scene.uvs[which])
        paint = scene.colours
        colour = None if paint is None else np.einsum("sk,skc->sc", weights, paint[which])
        kind = scene.material_ids[which]
        albedo = evaluate_materials(scene.materials, kind, uv, colour).base_colour
        both = np.array([material.two_sided for material in scene.materials])[kind]
        ones = np.ones((len(which), 1))
        whole = np.concatenate([ones, at, normal, np.asarray(albedo), both[:, None]], axis=1)
        values[rows] = area[:, None] * whole

    step = 1 << 17
    with ThreadPoolExecutor(core_count()) as pool:
        list(pool.map(part, [slice(a, a + step) for a in range(0, count, step)]))
    return _added(key, values)


def _added(
    key: Int64[np.ndarray, "values"], values: Float64[np.ndarray, "values channels"]
) -> tuple[Int64[np.ndarray, "keys"], Float64[np.ndarray, "keys channels"]]:
    """Sums of the values of each key."""
    if not len(key):
        return key, values
    order = np.argsort(key, kind="stable")
    key = key[order]
    first = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]]))
    return key[first], np.add.reduceat(values[order], first, axis=0)


def _patches(
    key: Int64[np.ndarray, "patches"], values: Float64[np.ndarray, "patches values"], grid: Grid
) -> Patches:
    area = values[:, 0]
    mean = values[:, 1:] / np.maximum(area, 1e-300)[:, None]
    normal = mean[:, 3:6]
    length = np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    single = np.float32
    return Patches(
        (key // FACES).astype(np.int32),
        area.astype(single),
        mean[:, :3].astype(single),
        (normal / length).astype(single),
        mean[:, 6:9].astype(single),
        mean[:, 9] > 0.5,
    )


def projected_areas(patches: Patches) -> tuple[np.ndarray, np.ndarray]:
    """Areas [patches, 6] across the ways of :data:`FACES`: of fronts, and of backs."""
    fronts = np.empty((len(patches.area), FACES), np.float32)
    for axis in range(3):
        across = patches.area * patches.normal[:, axis]
        fronts[:, 2 * axis] = np.maximum(-across, 0.0)
        fronts[:, 2 * axis + 1] = np.maximum(across, 0.0)
    return fronts, fronts[:, [1, 0, 3, 2, 5, 4]]


@compiled
def _divide(ids, cuts, starts, triangle, barycentrics, area):
    for k in range(len(ids)):
        n = cuts[k]
        at = starts[k]
        share = 1.0 / (n * n)
        for i in range(n):
            for j in range(2 * (n - i) - 1):
                # Parts that point up and parts that point down take turns along a row.
                flipped = j % 2
                u = (i + (1.0 + flipped) / 3.0) / n
                v = (j // 2 + (1.0 + flipped) / 3.0) / n
                barycentrics[at, 0] = 1.0 - u - v
                barycentrics[at, 1] = u
                barycentrics[at, 2] = v
                triangle[at] = ids[k]
                area[at] = share
                at += 1
