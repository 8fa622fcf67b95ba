"""How far off neighbours are about a sample's visibility (paper 002, eqs. 7 and 8; host)."""

import functools
from concurrent.futures import ThreadPoolExecutor
from typing import Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Bool, Float, Float16, Float32

from jaxvis.compiled import compiled
from jaxvis.cores import core_count
from jaxvis.methods.distance_field.coefficients import (
    magnitude,
    map_coefficients,
    visibility_error,
)
from jaxvis.methods.distance_field.neighbours import Nearest
from jaxvis.sphere.hemisphere_grid import texel_directions, texel_solid_angles

Measure = Literal["distances", "coefficients"]

SIDE = 8
"""Directions along each side of the hemisphere grid in which distances are compared."""

BLUR = 0.5 * np.pi / SIDE
"""Width (radians) over which a direction goes from occluded to visible: half their spacing, so that
no boundary between them is missed."""

COARSE = 32
"""Texels a side of the maps that distances are read from; finer ones are skipped."""

SHARE = 0.2
"""Of the cosine-weighted hemisphere: misjudging it is an error of 100 %. With it about as many
samples are more than 10 % off as by eq. 7."""


class Foretold(NamedTuple):
    """Relative errors: 0.1 is the paper's 10 %."""

    error: Float32[np.ndarray, "samples"]
    """Of what all neighbours together say of a sample (eq. 8)."""
    pairs: Float32[np.ndarray, "samples near"]
    """Of what each says alone."""


class Seen(NamedTuple):
    """What samples know of their visibility."""

    maps: Bool[np.ndarray, "samples n n"]
    signed_distance: Float16[np.ndarray, "samples n n"]
    frames: Float32[np.ndarray, "samples 3 3"]


def check_measure(measure: str) -> None:
    """Raises ValueError unless it is one of :data:`Measure`."""
    if measure not in get_args(Measure):
        raise ValueError(f"measure must be {' or '.join(get_args(Measure))}, got {measure!r}")


def foretold(
    seen: Seen, near: Nearest, share: Float32[np.ndarray, "samples near"], measure: Measure
) -> Foretold:
    """Errors by ``share``, the weights of the neighbours.

    ``"coefficients"`` compares maps as 16 spherical harmonics (eq. 7). ``"distances"`` compares
    what shading interpolates, signed distances, along 64 directions: the share of the hemisphere
    that they put on the wrong side, weighted by the cosine. It notices what is too small or too
    sharp for the harmonics, as where surfaces touch, and nothing where they ring.
    """
    check_measure(measure)
    if measure == "coefficients":
        return _by_coefficients(map_coefficients(seen.maps, seen.frames), near, share)
    return _by_distances(seen, near, share)


def _by_coefficients(
    coefficients: Float[np.ndarray, "samples 16"], near: Nearest, share: np.ndarray
) -> Foretold:
    around = coefficients[np.maximum(near.samples, 0)]
    size = magnitude(coefficients)
    together = visibility_error(coefficients, np.einsum("sk,skb->sb", share, around)) / size
    pairs = visibility_error(coefficients[:, None], around) / size[:, None]
    return Foretold(together.astype(np.float32), pairs.astype(np.float32))


def _by_distances(seen: Seen, near: Nearest, share: np.ndarray) -> Foretold:
    coarse, grid = _coarse(seen)
    return _compared(coarse, grid, seen.frames, coarse, seen.frames, near, share)


def contested(
    seen: Seen,
    frames: Float32[np.ndarray, "places 3 3"],
    near: Nearest,
    share: Float32[np.ndarray, "places near"],
) -> Float32[np.ndarray, "places"]:
    """How far the samples near places that have no maps are from agreeing about them.

    The mean error, by distances, of what each sample says beside what all say together: large on
    the line between two samples that are divided by a wall, wherever the wall stands.
    """
    coarse, grid = _coarse(seen)
    found = _compared(coarse, grid, seen.frames, coarse[:0], frames, near, share)
    return np.sum(np.abs(share) * found.pairs, axis=1)


Grid = tuple[np.float32, np.float32, np.float32]


def _coarse(seen: Seen) -> tuple[Float32[np.ndarray, "samples m m"], Grid]:
    """Every few texels of the maps, and their centres in texels of the whole ones."""
    size = seen.signed_distance.shape[-1]
    step = max(size // COARSE, 1)
    first = step // 2
    coarse = seen.signed_distance[:, first::step, first::step].astype(np.float32)
    return coarse, (np.float32(size / np.pi), np.float32(first + 0.5), np.float32(1.0 / step))


def _compared(
    maps: Float32[np.ndarray, "samples m m"],
    grid: Grid,
    frames: Float32[np.ndarray, "samples 3 3"],
    own_maps: Float32[np.ndarray, "own m m"],
    own_frames: Float32[np.ndarray, "places 3 3"],
    near: Nearest,
    share: Float32[np.ndarray, "places near"],
) -> Foretold:
    """Errors beside the places' own maps, or beside what all say together if they have none."""
    count = len(own_frames)
    error, pairs = np.zeros(count, np.float32), np.zeros(near.samples.shape, np.float32)

    def part(rows: slice) -> None:
        _misjudged(
            maps,
            frames,
            own_maps[rows],
            own_frames[rows],
            near.samples[rows],
            share[rows],
            *_directions(),
            *grid,
            error[rows],
            pairs[rows],
        )

    size = -(-count // core_count()) or 1
    with ThreadPoolExecutor() as pool:
        list(pool.map(part, [slice(a, a + size) for a in range(0, count, size)]))
    return Foretold(error / np.float32(SHARE), pairs / np.float32(SHARE))


@functools.cache
def _directions() -> tuple[Float32[np.ndarray, "directions 3"], Float32[np.ndarray, "directions"]]:
    """Local directions and their parts of the cosine-weighted hemisphere."""
    local = texel_directions(SIDE).reshape(-1, 3).astype(np.float32)
    weight = np.repeat(texel_solid_angles(SIDE), SIDE) * local[:, 2]
    return local, (weight / weight.sum()).astype(np.float32)


@compiled
def _misjudged(
    maps,
    frames,
    own_maps,
    own_frames,
    near,
    share,
    local,
    weight,
    scale,
    first,
    inverse,
    error,
    pairs,
):
    distance = np.zeros(near.shape[1], np.float32)
    for place in range(len(own_frames)):
        f = own_frames[place]
        for k in range(len(local)):
            u = local[k]
            world = (
                u[0] * f[0, 0] + u[1] * f[1, 0] + u[2] * f[2, 0],
                u[0] * f[0, 1] + u[1] * f[1, 1] + u[2] * f[2, 1],
                u[0] * f[0, 2] + u[1] * f[1, 2] + u[2] * f[2, 2],
            )
            together = 0.0
            for j in range(near.shape[1]):
                if near[place, j] < 0:
                    continue
                g = frames[near[place, j]]
                x = g[0, 0] * world[0] + g[0, 1] * world[1] + g[0, 2] * world[2]
                y = g[1, 0] * world[0] + g[1, 1] * world[1] + g[1, 2] * world[2]
                z = g[2, 0] * world[0] + g[2, 1] * world[1] + g[2, 2] * world[2]
                distance[j] = _distance(maps[near[place, j]], x, y, z, scale, first, inverse)
                together += share[place, j] * distance[j]
            own = together
            if len(own_maps):
                own = _distance(own_maps[place], u[0], u[1], u[2], scale, first, inverse)
            covered = _coverage(own)
            error[place] += weight[k] * abs(_coverage(together) - covered)
            for j in range(near.shape[1]):
                if near[place, j] >= 0:
                    pairs[place, j] += weight[k] * abs(_coverage(distance[j]) - covered)


@compiled
def _coverage(distance):
    return min(max(0.5 + distance / BLUR, 0.0), 1.0)


@compiled
def _distance(map, x, y, z, scale, first, inverse):
    """As jaxvis.sphere.hemisphere_grid.distance_at, in every ``1 / inverse``-th texel."""
    last = map.shape[0] - 1
    above = max(z, 0.0)
    theta = np.arctan2(np.sqrt(y * y + above * above), x)
    phi = np.arctan2(above, y)
    row = min(max((theta * scale - first) * inverse, 0.0), last)
    column = min(max((phi * scale - first) * inverse, 0.0), last)
    i = min(int(row), max(last - 1, 0))
    j = min(int(column), max(last - 1, 0))
    s = row - i
    t = column - j
    k = min(i + 1, last)
    m = min(j + 1, last)
    upper = map[i, j] + t * (map[i, m] - map[i, j])
    lower = map[k, j] + t * (map[k, m] - map[k, j])
    depth = np.arcsin(min(max(-z, 0.0), 1.0))
    return upper + s * (lower - upper) - depth
