"""Sums over the polygons that sites see, in chunks of polygons of similar size.

A site is a place on the surface with up to three polygons; its value is the weighted sum of what
is integrated over each (paper 000, eq. 19).
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32, Int, Int32, UInt8

from jaxvis.chunks import chunked_map
from jaxvis.methods.vectorized.polygons import VisibilityPolygons

LOOKUPS_PER_CHUNK = 1 << 17
"""Lookups that are made before they are looked up: what stays in the cache."""

SIZES = 4
"""Polygons count as a quarter, a half, ... of the capacity long, or all of it."""

THREADS = min(2, os.cpu_count() or 1)
"""Chunks under way: while one is looked up, the next one's lookups are made."""


class Sites(NamedTuple):
    """Places where light is integrated, and over which polygons. Host."""

    position: Float32[np.ndarray, "sites 3"]
    normal: Float32[np.ndarray, "sites 3"]
    plane: Float32[np.ndarray, "sites 3"]
    """Normal of the plane below which nothing is seen, besides the normal's own."""
    polygon: Int32[np.ndarray, "sites 3"]
    """-1 where there are fewer than three."""
    weight: Float32[np.ndarray, "sites 3"]

    @property
    def references(self) -> int:
        """Polygons that are integrated."""
        return int(np.count_nonzero(self.polygon >= 0))

    def take(self, chosen: Int[np.ndarray, "chosen"]) -> "Sites":
        """Some of the sites."""
        return Sites(*(field.take(chosen, axis=0) for field in self))


class References(NamedTuple):
    """Polygons, and from where they are seen."""

    polygon: Int[Array | np.ndarray, "references"]
    position: Float[Array | np.ndarray, "references 3"]
    normal: Float[Array | np.ndarray, "references 3"]
    plane: Float[Array | np.ndarray, "references 3"]
    extra: Any
    """What else of their sites is needed: a pytree of [references, ...]."""


Integral = Callable[[References, int], Float[Array, "references channels"]]
"""(references, how many vectors of their polygons are used) -> integrals."""

Gather = Callable[[Int[np.ndarray, "rows"]], References]


class Part(NamedTuple):
    """References ``start`` to ``stop``, whose polygons have at most ``size`` vectors."""

    size: int
    start: int
    stop: int
    chunk: int


def sum_over_polygons(
    integral: Integral,
    visibility: VisibilityPolygons,
    sites: Sites,
    *,
    channels: int,
    lookups_per_vector: int,
    extra: Any = (),
    traced: bool = False,
    lookups_per_chunk: int = LOOKUPS_PER_CHUNK,
) -> Float[Array | np.ndarray, "sites channels"]:
    """Sum over each site's polygons of weight times integral.

    Args:
        integral: of each reference alone; two jitted calls, if XLA shall not make the lookups
            again for every channel.
        visibility: the polygons; ``counts`` must be known on the host.
        sites: where.
        channels: of the integral.
        lookups_per_vector: how many the integral makes.
        extra: what else of the sites the integral needs: a pytree of [sites, ...].
        traced: whether grad, vmap or jit follow the integral. The chunks then run in one compiled
            loop, and gradients compute what they need of them again.
        lookups_per_chunk: bounds memory; results do not depend on it beyond rounding.
    """
    slots = np.flatnonzero(sites.polygon.reshape(-1) >= 0)
    if not len(slots):
        return np.zeros((len(sites.polygon), channels), np.float32)
    polygon = sites.polygon.reshape(-1).take(slots)
    sizes = _sizes(visibility.capacity)
    kind = np.searchsorted(sizes, np.asarray(visibility.counts)).astype(np.uint8).take(polygon)
    order = np.argsort(kind, kind="stable")
    slots, polygon = slots.take(order), polygon.take(order)

    def gather(rows: Int[np.ndarray, "rows"]) -> References:
        at = slots.take(rows) // 3
        position, normal, plane = (field.take(at, axis=0) for field in sites[:3])
        others = jax.tree.map(lambda leaf: leaf.take(at, axis=0), extra)
        return References(polygon.take(rows), position, normal, plane, others)

    parts = _parts(kind, sizes, lookups_per_chunk // lookups_per_vector)
    values = (_in_a_loop if traced else _in_threads)(integral, parts, gather)
    place = np.zeros(sites.polygon.size, np.intp)
    place[slots] = np.arange(len(slots))
    weight = np.where(sites.polygon >= 0, sites.weight, np.float32(0.0))
    found = values.take(place.reshape(-1, 3), axis=0)
    return (weight[..., None] * found).sum(axis=1)


def _sizes(capacity: int) -> Int[np.ndarray, "sizes"]:
    """Vectors that polygons are taken to have, ascending."""
    steps = -(-capacity * np.arange(1, SIZES + 1) // SIZES)
    return np.unique(np.minimum(8 * -(-steps // 8), capacity))


def _parts(
    kind: UInt8[np.ndarray, "references"], sizes: Int[np.ndarray, "sizes"], vectors: int
) -> list[Part]:
    """Whole chunks of each size; what remains of one joins the next size, the last is padded."""
    counts = np.bincount(kind, minlength=len(sizes))
    parts, start = [], 0
    for size, stop in zip(sizes, np.cumsum(counts), strict=True):
        chunk = max(1, vectors // int(size))
        if size < sizes[-1]:
            stop -= (stop - start) % chunk
        if stop > start:
            parts.append(Part(int(size), start, int(stop), chunk))
        start = int(stop)
    return parts


def _in_threads(integral: Integral, parts: list[Part], gather: Gather) -> np.ndarray:
    """The integrals of all references, chunk by chunk; every chunk of a size has one shape."""
    chunks = [(part, start) for part in parts for start in range(part.start, part.stop, part.chunk)]

    def evaluate(chunk: tuple[Part, int]) -> np.ndarray:
        part, start = chunk
        rows = np.minimum(np.arange(start, start + part.chunk), part.stop - 1)
        values = np.asarray(integral(gather(rows), part.size))
        return values[: part.stop - start]

    with ThreadPoolExecutor(THREADS, thread_name_prefix="jaxvis-polygons") as pool:
        return np.concatenate(list(pool.map(evaluate, chunks)))


def _in_a_loop(integral: Integral, parts: list[Part], gather: Gather) -> Array:
    """The same with one compiled loop over the chunks of a size."""
    values = []
    for part in parts:
        references = gather(np.arange(part.start, part.stop))
        references = jax.tree.map(jnp.asarray, references)
        size = part.size
        values.append(
            chunked_map(lambda chunk, size=size: integral(chunk, size), references, part.chunk)
        )
    return jnp.concatenate(values)
