"""The first samples: vertices nearest the centres of clusters (paper 002, section 4.1; host)."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from jaxtyping import Float32, Int, Int32

from jaxvis.compiled import compiled
from jaxvis.methods.distance_field.neighbours import Places

ROUNDS = 8
"""Of assigning and averaging; more move the centres by less than the samples' spacing."""


def initial_samples(places: Places, count: int, seed: int = 0) -> Int32[np.ndarray, "samples"]:
    """Indices of ``count`` places, or fewer where clusters share one, ascending.

    k-means under e_g (eq. 6), started by k-means++ (Arthur and Vassilvitskii 2007); the centre of a
    cluster is the mean position with the mean normal, an empty cluster begins again at the place
    that is worst represented.

    Raises:
        ValueError: ``count`` is less than 1.
    """
    if count < 1:
        raise ValueError(f"count must be at least 1, got {count}")
    if count >= len(places.positions):
        return np.arange(len(places.positions), dtype=np.int32)
    centres = places.take(_spread(places, count, np.random.default_rng(seed)))
    for _ in range(ROUNDS):
        nearest, error = _assign(places, centres)
        centres = _means(places, nearest, error, count)
    _, owner = _assign(places, centres, reverse=True)
    return np.unique(owner).astype(np.int32)


def _spread(places: Places, count: int, random: np.random.Generator) -> Int[np.ndarray, "count"]:
    """k-means++: each start in proportion to the squared error of those before."""
    numbers = random.random(count)
    chosen = np.zeros(count, np.int64)
    _plus_plus(places.positions, places.normals, numbers, chosen)
    return chosen


def _assign(
    places: Places, centres: Places, reverse: bool = False
) -> tuple[Int32[np.ndarray, "places"], np.ndarray]:
    """(nearest centre of each place, its error); reversed, the second is the nearest place of
    each centre."""
    count = len(places.positions)
    nearest, error = np.empty(count, np.int32), np.empty(count, np.float32)

    def part(rows: slice) -> None:
        _nearest(
            places.positions[rows],
            places.normals[rows],
            centres.positions,
            centres.normals,
            nearest[rows],
            error[rows],
        )

    with ThreadPoolExecutor() as pool:
        list(pool.map(part, [slice(a, a + 1024) for a in range(0, count, 1024)]))
    if not reverse:
        return nearest, error
    order = np.lexsort((error, nearest))
    first = order[np.unique(nearest[order], return_index=True)[1]]
    return nearest, first


def _means(
    places: Places,
    nearest: Int32[np.ndarray, "places"],
    error: Float32[np.ndarray, "places"],
    count: int,
) -> Places:
    """Mean positions and normals of the clusters."""
    size = np.bincount(nearest, minlength=count)

    def mean(values: np.ndarray) -> np.ndarray:
        sums = [np.bincount(nearest, column, count) for column in values.T]
        return np.stack(sums, axis=-1) / np.maximum(size, 1)[:, None]

    position, normal = mean(places.positions), mean(places.normals)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = normal / np.where(length > 0.0, length, 1.0)
    empty = np.flatnonzero(size == 0)
    if len(empty):
        worst = np.argsort(-error, kind="stable")[: len(empty)]
        position[empty], normal[empty] = places.positions[worst], places.normals[worst]
    return Places.of(position, normal, 1.0)


@compiled
def _error(positions, normals, place, other_positions, other_normals, other):
    p = q = 0.0
    for axis in range(3):
        d = positions[place, axis] - other_positions[other, axis]
        e = normals[place, axis] - other_normals[other, axis]
        p += d * d
        q += e * e
    return np.sqrt(p) + np.sqrt(q)


@compiled
def _nearest(positions, normals, centre_positions, centre_normals, nearest, error):
    for place in range(len(positions)):
        best, least = 0, np.inf
        for centre in range(len(centre_positions)):
            found = _error(positions, normals, place, centre_positions, centre_normals, centre)
            if found < least:
                best, least = centre, found
        nearest[place] = best
        error[place] = least


@compiled
def _plus_plus(positions, normals, numbers, chosen):
    count = len(positions)
    square = np.full(count, np.inf)
    pick = int(numbers[0] * count)
    for start in range(len(chosen)):
        chosen[start] = pick
        total = 0.0
        for place in range(count):
            found = _error(positions, normals, place, positions, normals, pick)
            square[place] = min(square[place], found * found)
            total += square[place]
        if start + 1 == len(chosen):
            break
        target = numbers[start + 1] * total
        pick = count - 1
        for place in range(count):
            target -= square[place]
            if target < 0.0:
                pick = place
                break
