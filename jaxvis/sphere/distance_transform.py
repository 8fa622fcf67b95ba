"""Exact great-circle distances on grids of directions: how far is the edge of what is visible?

The transform of paper 002, section 5, on grids with rows of constant theta. Along a row, whatever
the row of the query, the distance grows with the difference in phi: only the nearest seed of each
row can win (phase 1). Between rows, half the chord's square, or sin^2(d / 2), splits into

    sin^2((theta - theta_k) / 2) + sin(theta) sin(theta_k) sin^2((phi - phi_k) / 2),

so that after a division by sin(theta) phase 2 is a product of matrices in which sums stand for
products and minima for sums. That is exact for the hemisphere's grid, where nothing wraps, and for
the whole sphere, where phi does (the other order, meridians first, is not), and unlike the cosine
it keeps small distances precise in float32.
"""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float32

from jaxvis.sphere.angles import sine_cosine, turns

_FAR = 1e6
"""Stands for a row without a seed: more than any sum, and small enough to add to."""

_BLOCK = 16
"""Maps transformed together: enough to outweigh a loop step's cost, few enough for the cache."""

_UNROLLED = 16
"""Rows of candidates in one step of phase 2."""


@jax.jit
def distance_to(seeds: Bool[Array, "*maps n n"]) -> Float32[Array, "*maps n n"]:
    """Angle (radians) from each texel centre of hemisphere maps to the nearest seed's; 0 on seeds.

    Rows are theta and columns phi, both over (0, pi) (:mod:`jaxvis.sphere.hemisphere_grid`). Maps
    without a seed are pi everywhere. Exact to float32's rounding.

    Raises:
        ValueError: the maps are not square.
    """
    _require_square(seeds.shape)
    return _in_blocks(functools.partial(_unsigned, wrap=False), seeds)


@jax.jit
def hemispherical_distance(visible: Bool[Array, "*maps n n"]) -> Float32[Array, "*maps n n"]:
    """Signed angle (radians) to the other class of texel in hemisphere maps (paper 002, eq. 4).

    Positive on visible texels: from their centre to that of the nearest occluded one; negative on
    occluded texels. Rows are theta and columns phi, both over (0, pi)
    (:mod:`jaxvis.sphere.hemisphere_grid`); the horizon is no edge. A map of one class is pi or -pi
    everywhere. Exact to float32's rounding.

    Raises:
        ValueError: the maps are not square.
    """
    _require_square(visible.shape)
    return _in_blocks(functools.partial(_signed, wrap=False), visible)


@jax.jit
def spherical_distance(
    visible: Bool[Array, "*maps height width"],
) -> Float32[Array, "*maps height width"]:
    """Signed angle (radians) to the other class of texel in lat-long maps of the whole sphere.

    As :func:`hemispherical_distance`, on the grid of :mod:`jaxvis.sphere.latlong`: theta over
    (0, pi) along the rows, columns that go round. Where the other class is within 0.01 rad of the
    antipode, rounding reaches 0.001 rad.

    Raises:
        ValueError: the maps have fewer than two axes.
    """
    if len(visible.shape) < 2:
        raise ValueError(f"maps need two axes [..., height, width], got shape {visible.shape}")
    return _in_blocks(functools.partial(_signed, wrap=True), visible)


def _require_square(shape: tuple[int, ...]) -> None:
    if len(shape) < 2 or shape[-1] != shape[-2]:
        raise ValueError(f"hemisphere maps are square [..., n, n], got shape {shape}")


def _in_blocks(transform: Callable[[Array], Array], maps: Array) -> Array:
    """A transform of [maps, height, width], a few maps at a time."""
    if maps.size == 0:
        return jnp.zeros(maps.shape, jnp.float32)
    height, width = maps.shape[-2:]
    flat = maps.reshape(-1, height, width)
    count = flat.shape[0]
    blocks = -(-count // _BLOCK)
    if blocks == 1:
        return transform(flat).reshape(maps.shape)
    block = -(-count // blocks)
    flat = jnp.pad(flat, ((0, blocks * block - count), (0, 0), (0, 0)))
    done = lax.map(transform, flat.reshape(blocks, block, height, width))
    return done.reshape(-1, height, width)[:count].reshape(maps.shape)


def _unsigned(seeds: Array, wrap: bool) -> Array:
    offset = _nearest_in_row(jnp.moveaxis(seeds, -1, 0), wrap)
    return _angle(_rows_first(_nearest_row(offset, wrap)))


def _signed(visible: Array, wrap: bool) -> Array:
    columns = jnp.moveaxis(visible, -1, 0)
    offset = _other_class_in_row(columns, wrap)
    to_occluded = _nearest_row(jnp.where(columns, offset, 0.0), wrap)
    to_visible = _nearest_row(jnp.where(columns, 0.0, offset), wrap)
    # Whatever the class, one of the two is 0.
    nearest = _rows_first(to_occluded + to_visible)
    return jnp.where(visible, 1.0, -1.0) * _angle(nearest)


def _rows_first(nearest: Array) -> Array:
    """[maps, rows, columns] of [maps, columns, rows], turned by itself: XLA would do what follows
    in the order of the one and store it in the order of the other.
    """
    return lax.optimization_barrier(jnp.swapaxes(nearest, -1, -2))


def _nearest_in_row(seeds: Array, wrap: bool) -> Array:
    """Columns from each texel to the nearest seed of its row, [columns, maps, rows], as floats.

    Columns lead, so that the steps of a scan work on whole vectors.
    """

    def forwards(before, seed):
        here = jnp.where(seed, 0.0, before + 1.0)
        return here, here

    def backwards(after, before):
        here = _smaller(before, after + 1.0)
        return here, here

    padded, kept = _round_the_circle(seeds, wrap)
    none = jnp.full(seeds.shape[1:], _FAR, jnp.float32)
    _, before = lax.scan(forwards, none, padded)
    _, nearest = lax.scan(backwards, none, before, reverse=True)
    return nearest[kept]


def _other_class_in_row(visible: Array, wrap: bool) -> Array:
    """As :func:`_nearest_in_row`, to the nearest texel of the row that is of the other class."""

    def forwards(before, here):
        distance, last = before
        distance = jnp.where(here == last, distance, 0.0) + 1.0
        return (distance, here), (distance, here)

    def backwards(after, here):
        (distance, last), (before, now) = after, here
        distance = jnp.where(now == last, distance, 0.0) + 1.0
        return (distance, now), _smaller(before, distance)

    padded, kept = _round_the_circle(visible, wrap)
    none = jnp.full(visible.shape[1:], _FAR, jnp.float32)
    _, before = lax.scan(forwards, (none, padded[0]), padded)
    _, nearest = lax.scan(backwards, (none, padded[-1]), before, reverse=True)
    return nearest[kept]


def _round_the_circle(columns: Array, wrap: bool) -> tuple[Array, slice]:
    """(columns continued by half a turn at either end if they wrap, where the given ones are)."""
    width = columns.shape[0]
    if not wrap:
        return columns, slice(0, width)
    border = (width + 1) // 2
    padded = jnp.pad(columns, ((border, border), (0, 0), (0, 0)), mode="wrap")
    return padded, slice(border, border + width)


def _smaller(a: Array, b: Array) -> Array:
    """The minimum for numbers: jnp.minimum takes twice as long, for it looks out for NaN."""
    return jnp.where(b < a, b, a)


def _nearest_row(offset: Array, wrap: bool) -> Array:
    """sin^2(d / 2) to the nearest seed, [maps, columns, rows], from the offsets within rows,
    [columns, maps, rows].
    """
    width, maps, height = offset.shape
    offset = jnp.moveaxis(offset, 0, 1)
    between, ring = _row_tables(height)
    sine, _ = sine_cosine(_smaller(offset, jnp.float32(width)) * ((0.5 if wrap else 0.25) / width))
    candidate = jnp.where(offset < width, ring * sine * sine, _FAR).reshape(-1, height)
    missing = -height % _UNROLLED
    candidate = jnp.pad(candidate, ((0, 0), (0, missing)), constant_values=_FAR)
    between = np.pad(between / ring[None, :], ((0, missing), (0, 0)))

    def step(nearest, rows):
        candidates, gaps = rows
        for k in range(_UNROLLED):
            nearest = _smaller(nearest, candidates[:, k, None] + gaps[k])
        return nearest, None

    steps = between.shape[0] // _UNROLLED
    candidates = jnp.moveaxis(candidate.reshape(-1, steps, _UNROLLED), 1, 0)
    gaps = jnp.asarray(between.reshape(steps, _UNROLLED, height), jnp.float32)
    start = jnp.full((maps * width, height), _FAR, jnp.float32)
    nearest, _ = lax.scan(step, start, (candidates, gaps))
    return _smaller(nearest * ring, jnp.float32(1.0)).reshape(maps, width, height)


@functools.lru_cache(maxsize=8)
def _row_tables(height: int) -> tuple[np.ndarray, np.ndarray]:
    """(sin^2 of half the angle between two rows [height, height], sin theta of each row)."""
    theta = np.pi * (np.arange(height) + 0.5) / height
    between = np.sin(0.5 * (theta[:, None] - theta[None, :])) ** 2
    return between.astype(np.float32), np.sin(theta).astype(np.float32)


def _angle(half_chord_square: Array) -> Array:
    """The angle d with this sin^2(d / 2)."""
    sine, cosine = jnp.sqrt(half_chord_square), jnp.sqrt(1.0 - half_chord_square)
    return (4.0 * jnp.pi) * turns(sine, cosine)
