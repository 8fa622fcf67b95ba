"""Cyclic lists of links between the entities of a face's three corners (host, compiled by Numba).

A link holds one entity of each colour, or -1 for one that is not known yet (a partial triple). The
links of a face are in cyclic order for every colour.

That order alone is not enough where links share no known colour, nor where one sequence is just
ahead of a link that all others are just behind. A guide, a closed staircase through all entities,
decides such cases: links are then sorted by their places along it.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int16, Int32

from jaxvis.compiled import compiled

NO_SLOT, LINKED = -1, -2


class Lists(NamedTuple):
    """The links of all faces."""

    links: Int16[np.ndarray, "faces room 3"]
    places: Int16[np.ndarray, "faces room"]
    """Along the guides."""
    lengths: Int32[np.ndarray, "faces"]
    used: Bool[np.ndarray, "faces 3 capacity"]
    """Entities that a link knows."""

    @staticmethod
    def empty(faces: int, capacity: int) -> "Lists":
        """No links, and room for as many as Rule 1 allows."""
        room = 3 * capacity
        return Lists(
            np.full((faces, room, 3), -1, np.int16),
            np.zeros((faces, room), np.int16),
            np.zeros(faces, np.int32),
            np.zeros((faces, 3, capacity), np.bool_),
        )


@compiled
def unknown(link):
    """The first colour that a link does not know; -1 if it is complete."""
    for k in range(3):
        if link[k] < 0:
            return k
    return -1


@compiled
def known_link(links, length, colour, entity):
    """The first link that knows an entity; -1 if none does."""
    for i in range(length):
        if links[i, colour] == entity:
            return i
    return -1


@compiled
def insert(links, places, length, slot, triple, place):
    """Puts a link before the one that is ``slot`` now."""
    for i in range(length, slot, -1):
        links[i], places[i] = links[i - 1], places[i - 1]
    links[slot], places[slot] = triple, place


@compiled
def ahead(entity, origin, count):
    """Steps from ``origin`` to an entity the shorter way round, negative if it lies behind."""
    return (entity - origin + count // 2) % count - count // 2


@compiled
def nearest_on_guide(guide, triple, counts):
    """(the place on a guide nearest to a triple, entities by which it lies off it)."""
    nearest, place = 1 << 30, 0
    for i in range(len(guide)):
        off = 0
        for k in range(3):
            if triple[k] >= 0:
                off = max(off, abs(ahead(triple[k], guide[i, k], counts[k])))
        if off < nearest:
            nearest, place = off, i
    return place, nearest


@compiled
def slot_along_guide(links, places, length, triple, place, guide, counts):
    """Where a new link belongs; NO_SLOT if it would cross another (Rule 2).

    Links are sorted by their places. Entities are counted on along the guide, so that a link that
    is only a little ahead in one colour and behind in another is told from one a turn ahead.
    """
    slot = 0
    while slot < length and places[slot] <= place:
        slot += 1
    for k in range(3):
        if triple[k] < 0:
            continue
        own = guide[place, k] + ahead(triple[k], guide[place, k], counts[k])
        for step in range(1, length + 1):
            i = (slot - step) % length
            if links[i, k] >= 0:
                at = guide[places[i], k] + ahead(links[i, k], guide[places[i], k], counts[k])
                if at - (counts[k] if step > slot else 0) >= own:
                    return NO_SLOT
                break
        for step in range(length):
            i = (slot + step) % length
            if links[i, k] >= 0:
                at = guide[places[i], k] + ahead(links[i, k], guide[places[i], k], counts[k])
                if at + (counts[k] if slot + step >= length else 0) <= own:
                    return NO_SLOT
                break
    return slot


@compiled
def slot_in_cyclic_order(links, length, triple, counts):
    """The first slot that keeps every known entity strictly in cyclic order; or NO_SLOT."""
    for slot in range(max(length, 1)):
        fits = True
        for k in range(3):
            if triple[k] < 0:
                continue
            low, high = -1, -1
            for step in range(1, length + 1):
                if low < 0:
                    low = links[(slot - step) % length, k]
                if high < 0:
                    high = links[(slot + step - 1) % length, k]
            if low >= 0 and low != high:
                fits = fits and 0 < (triple[k] - low) % counts[k] < (high - low) % counts[k]
        if fits:
            return slot
    return NO_SLOT


@compiled
def gap(links, length, i, colour, count):
    """Entities that a link could take without crossing: (first, how many), the ends included."""
    before, after = -1, -1
    for step in range(1, length):
        if before < 0:
            before = links[(i - step) % length, colour]
        if after < 0:
            after = links[(i + step) % length, colour]
    if before < 0:
        return 0, count
    return before, (after - before - 1) % count + 2
