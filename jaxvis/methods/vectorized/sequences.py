"""From loops to one cyclic sequence a sample: loops joined by double bridges of no area (host)."""

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int32

BATCH = 64
"""Samples of several loops joined together: bounds the table of distances."""


def sequences(
    vectors: Float32[np.ndarray, "points 4"],
    directions: Float[np.ndarray, "points 3"],
    sample: Int[np.ndarray, "points"],
    loop: Int[np.ndarray, "points"],
    empty: Float32[np.ndarray, "samples 4"],
    capacity: int,
) -> tuple[Float32[np.ndarray, "samples 4 capacity"], Int32[np.ndarray, "samples"]]:
    """One padded cyclic sequence of position vectors for each sample.

    Loop after loop is spliced into the sequence where two of their points are closest, the closest
    loop first: ..., p, r, ..., r, p, ... The two bridges cancel in every contour integral.

    Args:
        vectors: position vectors, loop after loop, the loops of a sample one after the other.
        directions: unit directions in which the sample sees them.
        sample: whose they are, ascending.
        loop: number of the loop, ascending.
        empty: what stands for a sample without points, repeated.
        capacity: entries of a sequence; the last one repeats.

    Raises:
        ValueError: a sample's loops and bridges need more entries.
    """
    count = len(empty)
    first_of_loop = np.diff(loop, prepend=-1) != 0
    points = np.bincount(sample, minlength=count)
    loops = np.bincount(sample[first_of_loop], minlength=count)
    counts = np.where(points > 0, points + 2 * np.maximum(loops - 1, 0), 1)
    if np.any(counts > capacity):
        raise ValueError(f"a polygon needs {counts.max()} vectors, not {capacity}; raise vectors")
    starts = np.cumsum(points) - points
    place = np.minimum(np.arange(capacity), np.maximum(points - 1, 0)[:, None])
    order = (starts[:, None] + place) % max(len(sample), 1)
    several = np.flatnonzero(loops > 1)
    for begin in range(0, len(several), BATCH):
        chosen = several[begin : begin + BATCH]
        joined = _join(directions, loop, order[chosen], points[chosen])
        order[chosen] = np.take_along_axis(order[chosen], joined, axis=1)
    table = vectors[order] if len(vectors) else np.zeros((count, capacity, 4), np.float32)
    table[points == 0] = empty[points == 0, None]
    return np.ascontiguousarray(np.moveaxis(table, 1, 2)), counts.astype(np.int32)


def _join(
    directions: Float[np.ndarray, "points 3"],
    loop: Int[np.ndarray, "points"],
    order: Int[np.ndarray, "samples capacity"],
    points: Int[np.ndarray, "samples"],
) -> Int[np.ndarray, "samples capacity"]:
    """The order in which the samples' points follow each other, as places in ``order``."""
    count, capacity = order.shape
    every = np.arange(count)
    valid = np.arange(capacity) < points[:, None]
    place = np.broadcast_to(np.arange(capacity), order.shape)
    own = np.where(valid, loop[order], -1)
    first = np.concatenate([np.ones((count, 1), bool), own[:, 1:] != own[:, :-1]], axis=1) & valid
    last = np.concatenate([first[:, 1:] | ~valid[:, 1:], np.ones((count, 1), bool)], axis=1) & valid
    start = np.maximum.accumulate(np.where(first, place, 0), axis=1)
    following = np.where(last, start, place + 1)
    # Entries that bridges add come after the points; ``source`` tells which point each copies.
    source, used = place.copy(), points.copy()
    unit = directions[order].astype(np.float32)
    closeness = unit @ np.swapaxes(unit, 1, 2)
    merged = own == _largest(own, valid)[:, None]
    while True:
        open_ = valid & ~merged
        active = np.flatnonzero(open_.any(axis=1))
        if not len(active):
            break
        pairs = merged[active, :, None] & open_[active, None, :] & valid[active, :, None]
        best = np.where(pairs, closeness[active], -2.0).reshape(len(active), -1).argmax(axis=1)
        here, there = np.divmod(best, capacity)
        _splice(following, source, used, active, here, there)
        merged[active] |= own[active] == own[active, there][:, None]
    return _walk(following, source, used, merged, every)


def _largest(
    own: Int[np.ndarray, "samples capacity"], valid: Bool[np.ndarray, "samples capacity"]
) -> Int[np.ndarray, "samples"]:
    """The loop with the most points."""
    same = (own[:, :, None] == own[:, None, :]).sum(axis=2)
    return np.take_along_axis(own, np.where(valid, same, 0).argmax(axis=1)[:, None], axis=1)[:, 0]


def _splice(
    following: Int[np.ndarray, "samples capacity"],
    source: Int[np.ndarray, "samples capacity"],
    used: Int[np.ndarray, "samples"],
    active: Int[np.ndarray, "chosen"],
    here: Int[np.ndarray, "chosen"],
    there: Int[np.ndarray, "chosen"],
) -> None:
    """Inserts the loop of ``there`` after ``here``, in place: here, there, ..., there, here."""
    end = np.argmax(following[active] == there[:, None], axis=1)
    again, back = used[active], used[active] + 1
    source[active, again], source[active, back] = there, here
    following[active, back] = following[active, here]
    following[active, again] = back
    following[active, end] = again
    following[active, here] = there
    used[active] += 2


def _walk(
    following: Int[np.ndarray, "samples capacity"],
    source: Int[np.ndarray, "samples capacity"],
    used: Int[np.ndarray, "samples"],
    merged: Bool[np.ndarray, "samples capacity"],
    every: Int[np.ndarray, "samples"],
) -> Int[np.ndarray, "samples capacity"]:
    """The points in the order of the linked lists, the last one repeated."""
    here = merged.argmax(axis=1)
    walked = np.empty_like(source)
    for step in range(source.shape[1]):
        walked[:, step] = source[every, here]
        here = np.where(step < used - 1, following[every, here], here)
    return walked
