"""The signed hemispherical distance transform on the host, for thousands of stored maps.

The same distances as :func:`jaxvis.sphere.distance_transform.hemispherical_distance`, from the
same split into rows (see there), with less work than an array program can do: each texel holds the
nearest texel of the other class in its row, for either sign at once, and a row asks its
neighbours from near to far only until none can be nearer. Where occluders are many and small a few
rows are enough; where most of the hemisphere is open, many are asked and little is gained.
"""

import functools
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from jaxtyping import Bool, Float16

from jaxvis.compiled import compiled
from jaxvis.cores import core_count

_FAR = 1e6
"""Stands for a row of one class: more than any sum, and small enough to add to."""

# asin(s) / s as a polynomial in s^2 for 0 <= s <= 1/2 (Lawson's iteration in float64): 1.5e-6.
_ARCSINE = (0.999998491, 0.166852195, 0.071484006, 0.065067569)

_MAPS_A_CALL = 16
"""Few enough to share evenly among threads."""


def signed_distances(visible: Bool[np.ndarray, "*maps n n"]) -> Float16[np.ndarray, "*maps n n"]:
    """Signed angle (radians) to the other class of texel in hemisphere maps (paper 002, eq. 4).

    As :func:`jaxvis.sphere.distance_transform.hemispherical_distance`, rounded to half precision
    as the paper stores it (steps of 0.001 above 1 rad), in all threads.

    Raises:
        ValueError: the maps are not square.
    """
    if visible.ndim < 2 or visible.shape[-1] != visible.shape[-2]:
        raise ValueError(f"hemisphere maps are square [..., n, n], got shape {visible.shape}")
    distance = np.empty(visible.shape, np.float16)
    size = visible.shape[-1]
    if distance.size == 0:
        return distance
    maps = np.ascontiguousarray(visible, np.bool_).reshape(-1, size, size)
    bits = distance.view(np.uint16).reshape(maps.shape)
    tables = _tables(size)

    def transform(part: slice) -> None:
        _transform(maps[part], *tables, bits[part])

    count = len(maps)
    parts = [slice(k, k + _MAPS_A_CALL) for k in range(0, count, _MAPS_A_CALL)]
    if len(parts) == 1:
        transform(parts[0])
    else:
        list(_pool().map(transform, parts))
    return distance


@functools.cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(core_count(), thread_name_prefix="jaxvis-distances")


@functools.lru_cache(maxsize=8)
def _tables(size: int) -> tuple[np.ndarray, np.ndarray]:
    """(sin^2 of half of 0 to ``size`` texels' angle, sin theta of each row)."""
    steps = np.arange(size + 1)
    gap = np.sin(0.5 * np.pi * steps / size) ** 2
    ring = np.sin(np.pi * (steps[:-1] + 0.5) / size)
    return gap.astype(np.float32), ring.astype(np.float32)


@compiled
def _transform(visible: np.ndarray, gap: np.ndarray, ring: np.ndarray, bits: np.ndarray) -> None:
    """Writes the signed distances of [maps, n, n] as half-precision numbers' bits."""
    size = ring.shape[0]
    across = np.empty((size, size), np.float32)
    sign = np.empty(size, np.float32)
    nearest = np.empty(size, np.float32)
    for m in range(visible.shape[0]):
        for i in range(size):
            _other_class_in_row(visible[m, i], gap, ring[i], across[i])
        for i in range(size):
            for j in range(size):
                nearest[j] = abs(across[i, j])
                sign[j] = np.float32(1.0) if visible[m, i, j] else np.float32(-1.0)
            _from_other_rows(across, gap, np.float32(1.0) / ring[i], i, sign, nearest)
            _write_half(nearest, sign, ring[i], bits[m, i])


@compiled
def _other_class_in_row(
    visible: np.ndarray, gap: np.ndarray, ring: np.float32, across: np.ndarray
) -> None:
    """sin(theta) sin^2(phi' - phi over 2) to the nearest texel of the row of the other class, with
    the texel's sign. Runs of one class end at a texel of the other, or at the map's edge.
    """
    size = visible.shape[0]
    start = 0
    while start < size:
        here = visible[start]
        end = start + 1
        while end < size and visible[end] == here:
            end += 1
        scale = ring if here else -ring
        length = end - start
        if length == size:
            across[:] = np.float32(_FAR) if here else np.float32(-_FAR)
        elif start == 0:
            for t in range(length):
                across[t] = scale * gap[length - t]
        elif end == size:
            for t in range(length):
                across[start + t] = scale * gap[t + 1]
        else:
            half = (length + 1) // 2
            for t in range(half):
                value = scale * gap[t + 1]
                across[start + t] = value
                across[end - 1 - t] = value
        start = end


@compiled
def _from_other_rows(
    across: np.ndarray,
    gap: np.ndarray,
    scale: np.float32,
    i: int,
    sign: np.ndarray,
    nearest: np.ndarray,
) -> None:
    """Lowers row ``i``'s ``nearest`` to what other rows offer, all over sin(theta).

    Where another row's texel is of the other class itself, its product with the sign is negative,
    and only the gap between the rows counts. Rows are taken eight at a time, four on each side,
    as plain statements: only so does LLVM make vectors of them. A row beyond the map is replaced
    by its last, which is nearer than it claims to be: harmless.
    """
    size = across.shape[0]
    zero, last = np.float32(0.0), size - 1
    for step in range(1, size, 4):
        g0 = gap[step] * scale
        open_texels = 0
        for j in range(size):
            open_texels += 1 if nearest[j] > g0 else 0
        if open_texels == 0:
            break
        g1 = gap[min(step + 1, size)] * scale
        g2 = gap[min(step + 2, size)] * scale
        g3 = gap[min(step + 3, size)] * scale
        a0, b0 = max(i - step, 0), min(i + step, last)
        a1, b1 = max(i - step - 1, 0), min(i + step + 1, last)
        a2, b2 = max(i - step - 2, 0), min(i + step + 2, last)
        a3, b3 = max(i - step - 3, 0), min(i + step + 3, last)
        for j in range(size):
            s = sign[j]
            a, b = s * across[a0, j], s * across[b0, j]
            c, d = s * across[a1, j], s * across[b1, j]
            a, c = a if a < b else b, c if c < d else d
            a, c = (a if a > zero else zero) + g0, (c if c > zero else zero) + g1
            v = a if a < c else c
            a, b = s * across[a2, j], s * across[b2, j]
            c, d = s * across[a3, j], s * across[b3, j]
            a, c = a if a < b else b, c if c < d else d
            a, c = (a if a > zero else zero) + g2, (c if c > zero else zero) + g3
            w = a if a < c else c
            v = v if v < w else w
            w = nearest[j]
            nearest[j] = v if v < w else w


@compiled
def _write_half(nearest: np.ndarray, sign: np.ndarray, ring: np.float32, bits: np.ndarray) -> None:
    """The bits of the angles d with sin^2(d / 2) = ring nearest, rounded to half precision."""
    c0, c1, c2, c3 = _ARCSINE
    a0, a1, a2, a3 = np.float32(c0), np.float32(c1), np.float32(c2), np.float32(c3)
    one, half, quarter = np.float32(1.0), np.float32(0.5), np.float32(0.25)
    straight = np.float32(np.pi)
    for j in range(nearest.shape[0]):
        square = ring * nearest[j]
        square = square if square < one else one
        other = half - half * np.sqrt(square)  # asin(s) = pi / 2 - 2 asin(sqrt((1 - s) / 2))
        small = square if square < quarter else other
        arcsine = np.sqrt(small) * (a0 + small * (a1 + small * (a2 + small * a3)))
        nearest[j] = arcsine + arcsine if square < quarter else straight - np.float32(4.0) * arcsine
    words = nearest.view(np.int32)
    for j in range(nearest.shape[0]):
        word = words[j]
        # To the nearest, ties to even; below 2^-14 half precision has fixed steps.
        normal = (word + 0xFFF + ((word >> 13) & 1) - (112 << 23)) >> 13
        fixed = int(nearest[j] * np.float32(2.0**24) + half)
        value = normal if word >= (113 << 23) else fixed
        bits[j] = np.uint16(value | (0x8000 if sign[j] < 0.0 else 0))
