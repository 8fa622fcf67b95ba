"""Integrals over the outlines that sites see, in chunks of outlines of similar length.

A site is a place on the surface with up to three polygons; its value is the weighted sum of what
is integrated over each (paper 000, eq. 19). Where polygons correspond they are interpolated first,
and the site has one outline (eq. 21): see :mod:`.correspondence.interpolated`.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32, Int, Int32

from jaxvis.chunks import chunked_map
from jaxvis.devices import dealer, device_count, nearby
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
    outline: Int32[np.ndarray, "sites"]
    """Which list of triples joins the polygons to one outline; -1 where each is integrated."""

    @property
    def references(self) -> int:
        """Polygons and outlines that are integrated."""
        apart = np.count_nonzero(self.polygon >= 0, axis=1)
        return int(np.where(self.outline >= 0, 1, apart).sum())

    def take(self, chosen: Int[np.ndarray, "chosen"]) -> "Sites":
        """Some of the sites."""
        return Sites(*(field.take(chosen, axis=0) for field in self))


class References(NamedTuple):
    """Outlines, and from where they are seen."""

    polygon: Int[Array | np.ndarray, "references"]
    """Or, with weights, the list of triples that makes the outline."""
    position: Float[Array | np.ndarray, "references 3"]
    normal: Float[Array | np.ndarray, "references 3"]
    plane: Float[Array | np.ndarray, "references 3"]
    extra: Any
    """What else of their sites is needed: a pytree of [references, ...]."""
    weight: Float[Array | np.ndarray, "references 3"] | None = None
    """Of the corners whose polygons are interpolated; None where polygons are seen themselves."""


Integral = Callable[[References, int], Float[Array, "references channels"]]
"""(references, how many vectors of their outlines are used) -> integrals."""

Gather = Callable[[Int[np.ndarray, "rows"]], References]

Values = Callable[[], Float[Array | np.ndarray, "references channels"]]


class Part(NamedTuple):
    """References ``start`` to ``stop``, whose outlines have at most ``size`` vectors."""

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
    polygon = sites.polygon.reshape(-1).take(slots)

    def gather(rows: Int[np.ndarray, "rows"]) -> References:
        at = slots.take(rows) // 3
        position, normal, plane = (field.take(at, axis=0) for field in sites[:3])
        others = jax.tree.map(lambda leaf: leaf.take(at, axis=0), extra)
        return References(polygon.take(rows), position, normal, plane, others)

    values = integrals(
        integral,
        gather,
        polygon,
        np.asarray(visibility.counts),
        quarters(visibility.capacity),
        channels=channels,
        lookups_per_vector=lookups_per_vector,
        traced=traced,
        lookups_per_chunk=lookups_per_chunk,
    )()
    if not len(slots):
        return np.zeros((len(sites.polygon), channels), np.float32)
    place = np.zeros(sites.polygon.size, np.intp)
    place[slots] = np.arange(len(slots))
    weight = np.where(sites.polygon >= 0, sites.weight, np.float32(0.0))
    found = values.take(place.reshape(-1, 3), axis=0)
    return (weight[..., None] * found).sum(axis=1)


def integrals(
    integral: Integral,
    gather: Gather,
    outline: Int[np.ndarray, "references"],
    counts: Int[np.ndarray, "outlines"],
    sizes: Int[np.ndarray, "sizes"],
    *,
    channels: int,
    lookups_per_vector: int,
    traced: bool = False,
    lookups_per_chunk: int = LOOKUPS_PER_CHUNK,
) -> Values:
    """The integral over the outline of each reference, when it is asked for; threads begin at once.

    Args:
        integral: as for :func:`sum_over_polygons`.
        gather: makes some of the references.
        outline: which one each reference has. Those with the same one are integrated together.
        counts: vectors of each outline.
        sizes: as how long outlines may count, ascending; the last is the longest.
        channels, lookups_per_vector, traced, lookups_per_chunk: as for :func:`sum_over_polygons`.

    Returns:
        A function that waits for the integrals, [references, channels]
    """
    if not len(outline):
        return lambda: np.zeros((0, channels), np.float32)
    kind = np.searchsorted(sizes, counts).astype(np.int32).take(outline)
    order = np.lexsort((outline, -kind))
    parts = _parts(kind.take(order), sizes, lookups_per_chunk // lookups_per_vector)
    run = _in_a_loop if traced else _in_threads
    values = run(integral, parts, lambda rows: gather(order.take(rows)))
    place = np.empty(len(order), np.intp)
    place[order] = np.arange(len(order))
    return lambda: values().take(place, axis=0)


def fenced(function: Callable[..., Any], references: References, *arguments: Any) -> Any:
    """``function(*arguments)``, not to be computed again wherever it is used.

    In one compiled program XLA recomputes cheap steps in all that follow from them, and on the CPU
    drops optimisation barriers. It does keep a condition, if the outcome depends on data.
    """
    shapes = jax.eval_shape(function, *arguments)

    def never(*_: Any) -> Any:
        return jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)

    always = jnp.asarray(references.polygon)[0] >= 0
    return jax.lax.cond(always, function, never, *arguments)


def quarters(capacity: int) -> Int[np.ndarray, "sizes"]:
    """As how long polygons count: ``SIZES`` parts of the capacity, ascending."""
    steps = -(-capacity * np.arange(1, SIZES + 1) // SIZES)
    return np.unique(np.minimum(8 * -(-steps // 8), capacity))


def _parts(
    kind: Int32[np.ndarray, "references"], sizes: Int[np.ndarray, "sizes"], vectors: int
) -> list[Part]:
    """Whole chunks of each size, the longest outlines first.

    What is missing from one size's last chunk is taken from the next smaller size.
    """
    stops = np.cumsum(np.bincount(kind, minlength=len(sizes))[::-1])
    parts, start = [], 0
    for size, stop in zip(sizes[::-1], stops, strict=True):
        chunk = max(1, vectors // int(size))
        stop = min(len(kind), start + chunk * -(-(int(stop) - start) // chunk))
        if stop > start:
            parts.append(Part(int(size), start, stop, chunk))
            start = stop
    return parts


def _even(count: int, chunk: int) -> int:
    """Eighths of a chunk, as many as make all threads' chunks equally long."""
    rounds = -(-count // (THREADS * chunk))
    eighth = -(-chunk // 8)
    return min(chunk, eighth * -(-count // (THREADS * rounds * eighth)))


def _in_threads(integral: Integral, parts: list[Part], gather: Gather) -> Values:
    """The integrals of all references, chunk by chunk; chunks of a size have few shapes."""
    chunks = []
    for part in parts:
        length = _even(part.stop - part.start, part.chunk)
        starts = range(part.start, part.stop, length)
        chunks += [(part.size, start, min(start + length, part.stop), length) for start in starts]

    deal = dealer()

    def evaluate(index: int, chunk: tuple[int, int, int, int]) -> np.ndarray:
        size, start, stop, length = chunk
        rows = np.minimum(np.arange(start, start + length), stop - 1)
        with deal(index):
            return np.asarray(nearby(integral)(gather(rows), size))[: stop - start]

    found = _pool(max(THREADS, device_count())).map(evaluate, range(len(chunks)), chunks)
    return lambda: np.concatenate(list(found))


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="jaxvis-polygons")


def _in_a_loop(integral: Integral, parts: list[Part], gather: Gather) -> Values:
    """The same with one compiled loop over the chunks of a size."""
    values = []
    for part in parts:
        references = gather(np.arange(part.start, part.stop))
        references = jax.tree.map(jnp.asarray, references)
        size = part.size
        values.append(
            chunked_map(lambda chunk, size=size: integral(chunk, size), references, part.chunk)
        )
    return lambda: jnp.concatenate(values)
