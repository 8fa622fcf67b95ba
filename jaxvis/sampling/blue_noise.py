"""A tile of blue noise: numbers whose neighbours differ, for the error between pixels."""

from functools import cache

import numpy as np
from jaxtyping import Float

SPREAD = 1.5
"""Standard deviation, in pixels, of the filter by which voids and clusters are found."""


@cache
def blue_noise(size: int = 64, seed: int = 0) -> Float[np.ndarray, "size size"]:
    """A tile that repeats, of numbers in (0, 1) that are each taken once (host, float32).

    Void and cluster: Ulichney 1993, "The Void-and-Cluster Method for Dither Array Generation".
    Read-only: it is made once.
    """
    if size < 4:
        raise ValueError(f"size must be at least 4, got {size}")
    count = size * size
    wrapped = np.minimum(np.arange(size), size - np.arange(size))
    bump = np.exp(-(wrapped[:, None] ** 2 + wrapped[None, :] ** 2) / (2.0 * SPREAD**2))
    shifted = np.lib.stride_tricks.sliding_window_view(np.tile(bump, (2, 2)), (size, size))

    def at(place: int | np.integer) -> np.ndarray:
        """The filter around a place, on the torus."""
        return shifted[(-(place // size)) % size, (-(place % size)) % size].reshape(-1)

    start = np.zeros(count, bool)
    start[np.random.default_rng(seed).choice(count, count // 10, replace=False)] = True
    energy = sum((at(place) for place in np.flatnonzero(start)), np.zeros(count))
    while True:  # moves the tightest cluster's point to the largest void until it is there
        cluster = int(np.argmax(np.where(start, energy, -np.inf)))
        start[cluster], energy = False, energy - at(cluster)
        void = int(np.argmin(np.where(start, np.inf, energy)))
        start[void], energy = True, energy + at(void)
        if void == cluster:
            break

    rank = np.zeros(count, np.int64)
    points, left = start.copy(), energy.copy()
    for order in range(int(start.sum()) - 1, -1, -1):
        cluster = int(np.argmax(np.where(points, left, -np.inf)))
        rank[cluster], points[cluster] = order, False
        left -= at(cluster)
    points, left = start.copy(), energy.copy()
    for order in range(int(start.sum()), count):
        void = int(np.argmin(np.where(points, np.inf, left)))
        rank[void], points[void] = order, True
        left += at(void)
    tile = ((rank + 0.5) / count).astype(np.float32).reshape(size, size)
    tile.setflags(write=False)
    return tile
