"""Adaptive partitions of lat-long maps: small cells where the light is."""

import heapq
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

COARSEST = 8
"""Cells of the partition that is refined: octants."""

Cell = tuple[int, int, int, int]
"""First row, row after the last, and so for the columns."""


def partition(
    brightness: Float[np.ndarray, "height width"], count: int
) -> Int[np.ndarray, "cells 4"]:
    """Cells (top, bottom, left, right) in texels, at most ``count``, that tile a lat-long map.

    From octants on, the cell with the most energy x angular extent is divided across its longer
    side at the median of its energy: bright spots and large dim areas are both resolved.
    ``brightness`` is energy, not radiance. A black map stays in octants. The result is ordered by
    place.

    Raises:
        ValueError: ``count`` below :data:`COARSEST`.
    """
    if count < COARSEST:
        raise ValueError(f"count must be at least {COARSEST}, got {count}")
    height, width = brightness.shape
    table = np.zeros((height + 1, width + 1))
    np.cumsum(np.cumsum(brightness, axis=0), axis=1, out=table[1:, 1:])
    edges = np.cos(np.pi * np.arange(height + 1) / height)
    sines = np.sin(np.pi * np.arange(height + 1) / height)
    whole = table[-1, -1] / (4.0 * np.pi)

    def entry(cell: Cell) -> tuple[float, Cell]:
        top, bottom, left, right = cell
        energy = table[bottom, right] - table[top, right] - table[bottom, left] + table[top, left]
        solid_angle = (edges[top] - edges[bottom]) * (right - left) * 2.0 * np.pi / width
        down, across = sides(cell)
        if bottom - top == 1 and right - left == 1:
            return 0.0, cell
        # A trace of the mean light, so that black areas are divided too when nothing else is left.
        return -(energy + 1e-6 * whole * solid_angle) * np.hypot(down, across), cell

    def sides(cell: Cell) -> tuple[float, float]:
        top, bottom, left, right = cell
        equator = min(max(height // 2, top), bottom)
        widest = max(sines[top], sines[bottom], sines[equator])
        return np.pi * (bottom - top) / height, 2.0 * np.pi * (right - left) / width * widest

    rows = sorted({0, max(height // 2, 1), height})
    columns = sorted({width * k // 4 for k in range(5)})
    heap = [
        entry((top, bottom, left, right))
        for top, bottom in pairwise(rows)
        for left, right in pairwise(columns)
    ]
    heapq.heapify(heap)
    while len(heap) < count and heap[0][0] < 0.0:
        _, cell = heapq.heappop(heap)
        top, bottom, left, right = cell
        down, across = sides(cell)
        if right - left == 1 or (bottom - top > 1 and down > across):
            line = table[top : bottom + 1, right] - table[top : bottom + 1, left]
            at = top + _median(line)
            parts = (top, at, left, right), (at, bottom, left, right)
        else:
            line = table[bottom, left : right + 1] - table[top, left : right + 1]
            at = left + _median(line)
            parts = (top, bottom, left, at), (top, bottom, at, right)
        for part in parts:
            heapq.heappush(heap, entry(part))
    return np.array(sorted(cell for _, cell in heap))


def _median(line: Float[np.ndarray, "edges"]) -> int:
    """Where a running sum comes nearest to half of its whole, not at an end."""
    line = line - line[0]
    last = len(line) - 1
    if line[-1] <= 0.0:
        return max(last // 2, 1)
    at = int(np.searchsorted(line, 0.5 * line[-1]))
    at = min(max(at, 1), last)
    if abs(line[at - 1] - 0.5 * line[-1]) < abs(line[at] - 0.5 * line[-1]):
        at -= 1
    return min(max(at, 1), last - 1)
