"""Precomputing a discrete visibility field (paper 001, Algorithm 1), in a stream of batches."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, NamedTuple, get_args

import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8
from tqdm.auto import tqdm

from jaxvis.cluster import cluster_size, map_jobs
from jaxvis.methods.traced import RayVisibility
from jaxvis.methods.visibility_field.field import OCCLUDED, VISIBLE, FieldVisibility, packed
from jaxvis.methods.visibility_field.grid import Grid
from jaxvis.methods.visibility_field.masks import (
    Dilation,
    dilated,
    half_dilated,
    halved,
    merge,
    with_neighbours,
)
from jaxvis.methods.visibility_field.samples import (
    Samples,
    Sampling,
    Surface,
    draw,
    hemisphere_rays,
)
from jaxvis.sampling import hammersley
from jaxvis.sampling.hemisphere import sample_uniform
from jaxvis.scene import RayTracer, Scene

DRAWN = 1 << 12
"""Samples with random numbers of their own."""

BATCH = 64 * DRAWN
"""Samples that are sorted by cell and then traced: about 20 MB."""

CELLS_AT_ONCE = 1 << 13
"""Cells whose masks are unpacked together: bounds memory."""

TRACED = 1 << 16
"""Rays that a thread traces at once: those of whole samples."""


PARTS = 4
"""Of the samples, for each thread of a cluster's workers."""


class Settings(NamedTuple):
    """How a field is computed.

    ``edge`` of the cells in scene units; ``size`` of the octahedral maps; ``samples`` on the whole
    surface, each with ``rays`` over its hemisphere; ``sampling`` as in
    :func:`jaxvis.methods.visibility_field.samples.surface_pieces`.
    """

    edge: float
    size: int = 18
    samples: int = 1_000_000
    rays: int = 128
    sampling: Sampling = "stratified"
    seed: int = 0

    def check(self) -> None:
        """Raises ValueError if a setting is out of range."""
        if not (np.isfinite(self.edge) and self.edge > 0.0):
            raise ValueError(f"edge must be a positive length, got {self.edge}")
        if not 1 <= self.size <= 255:
            raise ValueError(f"size must be from 1 to 255 texels, got {self.size}")
        if self.samples < 1:
            raise ValueError(f"samples must be at least 1, got {self.samples}")
        if self.rays < 1:
            raise ValueError(f"rays must be at least 1, got {self.rays}")
        if self.sampling not in get_args(Sampling):
            names = " or ".join(get_args(Sampling))
            raise ValueError(f"sampling must be {names}, got {self.sampling!r}")
        if self.seed < 0:
            raise ValueError(f"seed must not be negative, got {self.seed}")


class Masks(NamedTuple):
    """What the samples of each cell saw. ``keys`` are the cells' numbers, ascending; ``counts``
    how many samples each has. Cells without samples are not there.

    Masks are kept a bit a texel (:func:`numpy.packbits`): fine ones fill the memory otherwise.
    """

    keys: Int32[np.ndarray, "cells"]
    counts: Int32[np.ndarray, "cells"]
    visible_bits: UInt8[np.ndarray, "cells bytes"]
    occluded_bits: UInt8[np.ndarray, "cells bytes"]
    size: int

    @property
    def visible(self) -> Bool[np.ndarray, "cells texels"]:
        """Texels in which some sample saw the sky (eq. 5), all unpacked."""
        return np.unpackbits(self.visible_bits, axis=1, count=self.size**2).view(bool)

    @property
    def occluded(self) -> Bool[np.ndarray, "cells texels"]:
        """Texels in which something blocked some sample (eq. 6), all unpacked."""
        return np.unpackbits(self.occluded_bits, axis=1, count=self.size**2).view(bool)

    def part(self, cells: slice) -> "Masks":
        """Those of some cells."""
        keys, counts, visible, occluded, size = self
        return Masks(keys[cells], counts[cells], visible[cells], occluded[cells], size)

    def texels(self) -> UInt8[np.ndarray, "cells texels"]:
        """Both bits of every texel: VISIBLE and OCCLUDED."""
        seen = np.where(self.visible, np.uint8(VISIBLE), np.uint8(0))
        seen |= np.where(self.occluded, np.uint8(OCCLUDED), np.uint8(0))
        return seen


class _Tables:
    """Masks of the cells met so far, in the order in which they were met."""

    def __init__(self, texels: int) -> None:
        self.seen: UInt8[np.ndarray, "cells 2 texels"] = np.zeros((0, 2, texels), np.uint8)
        self.keys = np.zeros(0, np.int32)
        self.counts = np.zeros(0, np.int32)
        self._order = np.zeros(0, np.int32)

    def rows(self, cells: Int32[np.ndarray, "samples"]) -> Int32[np.ndarray, "samples"]:
        """The row of each sample's cell; new cells get one. Counts the samples."""
        keys, places, counts = np.unique(cells, return_inverse=True, return_counts=True)
        self._add(np.setdiff1d(keys, self.keys, assume_unique=True))
        found = self._order[np.searchsorted(self.keys, keys, sorter=self._order)]
        self.counts[found] += counts.astype(np.int32)
        return found[places]

    def _add(self, keys: Int32[np.ndarray, "new"]) -> None:
        if not len(keys):
            return
        self.keys = np.concatenate([self.keys, keys])
        self.counts = np.concatenate([self.counts, np.zeros(len(keys), np.int32)])
        self._order = np.argsort(self.keys).astype(np.int32)
        # In place: tables may take a good part of the memory. Nothing else holds them meanwhile.
        self.seen.resize((len(self.keys), *self.seen.shape[1:]), refcheck=False)

    def masks(self, size: int) -> Masks:
        """Sorted by key."""
        bits = [
            np.concatenate(
                [
                    np.packbits(self.seen[part, kind], axis=1)
                    for part in np.array_split(self._order, 1 + len(self._order) // CELLS_AT_ONCE)
                ]
            )
            for kind in (0, 1)
        ]
        return Masks(self.keys[self._order], self.counts[self._order], bits[0], bits[1], size)


def trace_masks(scene: Scene, settings: Settings, *, progress: bool = True) -> Masks:
    """Traces the rays of all samples and merges what they saw, cell by cell (paper 001, eqs. 1 to
    6). The grid is ``Grid.covering(scene.positions, settings.edge)``.

    The same settings give the same bits, whatever the threads. An interrupt ends it within a few
    blocks of rays.

    Raises:
        ValueError: a setting is out of range.
    """
    settings.check()
    grid = Grid.covering(scene.positions, settings.edge)
    surface = Surface.of(scene, grid, settings.sampling)
    total = settings.samples
    with tqdm(total=total, desc="visibility field", unit="sample", disable=not progress) as bar:
        workers = cluster_size()
        if not workers:
            return _masks_of(scene.tracer, surface, grid, settings, range(total), bar.update)
        # In a few parts for each worker: what they see is one however they are cut.
        step = -(-total // (PARTS * workers * DRAWN)) * DRAWN
        parts = [range(start, min(start + step, total)) for start in range(0, total, step)]
        found = []
        for masks in map_jobs(_masks_of, (scene.tracer, surface, grid, settings), parts):
            found.append(masks)
            bar.update(int(masks.counts.sum()))
        return joined(found)


def _masks_of(
    tracer: RayTracer,
    surface: Surface,
    grid: Grid,
    settings: Settings,
    part: range,
    advance: Callable[[int], Any] = lambda samples: None,
) -> Masks:
    """What a part of the samples saw. It starts and ends at a multiple of :data:`DRAWN`, or with
    the last sample."""
    hemisphere = np.asarray(sample_uniform(hammersley(settings.rays)))
    tables = _Tables(settings.size**2)
    block = max(1, TRACED // settings.rays)
    pool = ThreadPoolExecutor(tracer.threads, thread_name_prefix="jaxvis-field")
    try:
        prepare = partial(_batch, surface, grid, settings, part.stop)
        upcoming = pool.submit(prepare, part.start)
        for start in range(part.start, part.stop, BATCH):
            samples = upcoming.result()
            if start + BATCH < part.stop:
                upcoming = pool.submit(prepare, start + BATCH)
            rows = tables.rows(samples.cells)
            trace = partial(_trace, tracer, hemisphere, settings.size, samples, rows, tables.seen)
            blocks = [slice(first, first + block) for first in range(0, len(rows), block)]
            for done in pool.map(trace, blocks):
                advance(done)
    finally:
        pool.shutdown(cancel_futures=True)
    return tables.masks(settings.size)


def joined(parts: Sequence[Masks]) -> Masks:
    """What all parts of the samples saw together (paper 001, eqs. 5 and 6)."""
    keys = np.unique(np.concatenate([part.keys for part in parts]))
    counts = np.zeros(len(keys), np.int32)
    bits = parts[0].visible_bits.shape[1]
    visible, occluded = (np.zeros((len(keys), bits), np.uint8) for _ in range(2))
    for part in parts:
        rows = np.searchsorted(keys, part.keys)
        counts[rows] += part.counts
        visible[rows] |= part.visible_bits
        occluded[rows] |= part.occluded_bits
    return Masks(keys, counts, visible, occluded, parts[0].size)


def _batch(surface: Surface, grid: Grid, settings: Settings, end: int, start: int) -> Samples:
    """The samples of the batch from ``start`` on, ``end`` at the most, sorted by cell."""
    total, stop = settings.samples, min(start + BATCH, end)
    parts = [
        draw(surface, grid, first, min(first + DRAWN, stop), total=total, seed=settings.seed)
        for first in range(start, stop, DRAWN)
    ]
    return Samples(*map(np.concatenate, zip(*parts, strict=True))).by_cell()


def _trace(
    tracer: RayTracer,
    hemisphere: Float32[np.ndarray, "rays 3"],
    size: int,
    samples: Samples,
    rows: Int32[np.ndarray, "samples"],
    seen: UInt8[np.ndarray, "cells 2 texels"],
    block: slice,
) -> int:
    """Traces the rays of a block of samples and merges the answers. Returns how many samples."""
    starts, directions = hemisphere_rays(samples, block, hemisphere)
    blocked = tracer.occluded_block(starts, directions)
    merge(seen, rows[block], directions, blocked, size)
    return len(rows[block])


def traced_size(size: int, dilation: Dilation) -> int:
    """Texels along the masks that are traced for masks of ``size``."""
    return 2 * size if dilation == "half" else size


def visibility_field(
    scene: Scene,
    grid: Grid,
    masks: Masks,
    *,
    size: int,
    dilation: Dilation = "full",
    neighbours: bool = False,
) -> FieldVisibility:
    """What is stored of the masks.

    Args:
        scene: whose rays are left to trace.
        grid: that of the masks.
        masks: as traced, with :func:`traced_size` texels along each.
        size: of the octahedral maps that are stored.
        dilation: how far masks grow, so that rays close to a seen one are not culled: by a texel
            in all eight directions (``full``, paper 001, section 4.1), by half a texel in four
            (``half``), or not (``none``).
        neighbours: joins each cell's masks with what the samples of the cells that share a face
            saw.

    Raises:
        ValueError: the masks do not have the right size.
    """
    fine = traced_size(size, dilation)
    if masks.size != fine:
        raise ValueError(f"the masks have {masks.size} x {masks.size} texels, not {fine} x {fine}")
    parts = [
        _grown(masks.part(slice(start, start + CELLS_AT_ONCE)).texels(), size, dilation)
        for start in range(0, len(masks.keys), CELLS_AT_ONCE)
    ]
    texels, seen = (np.concatenate(part) for part in zip(*parts, strict=True))
    if neighbours:
        texels |= with_neighbours(grid, masks.keys, seen)
    visible, occluded = (
        np.count_nonzero(texels & bit, axis=1).astype(np.uint16) for bit in (VISIBLE, OCCLUDED)
    )
    words = packed(texels.reshape(-1, size, size))
    rays = RayVisibility.of(scene)
    return FieldVisibility(grid, masks.keys, words, visible, occluded, rays, size)


def _grown(
    texels: UInt8[np.ndarray, "cells traced"], size: int, dilation: Dilation
) -> tuple[UInt8[np.ndarray, "cells texels"], UInt8[np.ndarray, "cells texels"]]:
    """(grown, as seen), of the size that is stored."""
    if dilation == "half":
        return half_dilated(texels, size), halved(texels, size)
    return dilated(texels, size, 1 if dilation == "full" else 0), texels
