"""Selection of triples across the mesh, with shared partial triples (host, compiled by Numba).

Paper 000, sections III-C and III-D, up to the relaxed stage. Its Algorithm 1 accepts only links
that lie both before and behind a pair; here the pair is told by the cyclic interval.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Int, Int8, Int16, Int32

from jaxvis.compiled import compiled
from jaxvis.methods.vectorized.correspondence.candidates import Candidates, Layout
from jaxvis.methods.vectorized.correspondence.links import (
    LINKED,
    NO_SLOT,
    Lists,
    ahead,
    gap,
    insert,
    known_link,
    nearest_on_guide,
    slot_along_guide,
    slot_in_cyclic_order,
    unknown,
)
from jaxvis.methods.vectorized.mesh import inner_edges

MOST_TRIES = 8
"""Entities tried to complete a partial triple."""

FARTHEST = 0.3
"""Radians from a partial triple's two entities, summed, within which it is completed."""


class Neighbours(NamedTuple):
    """Faces across edges."""

    face: Int32[np.ndarray, "faces 3"]
    """Across the edge opposite each corner; -1 at borders and where more than two faces meet."""
    corners: Int8[np.ndarray, "faces 3 2"]
    """Which of its corners are this face's corners k + 1 and k + 2."""


def neighbours(
    polygons: Int[np.ndarray, "faces 3"], edges: Int[np.ndarray, "faces 3"]
) -> Neighbours:
    """The neighbours of each face.

    Args:
        polygons: of the faces' corners; -1 at faces without polygons.
        edges: the number of the edge opposite each corner.
    """
    count = len(polygons)
    one, other = inner_edges(polygons, edges).T
    face = np.full(3 * count, -1, np.int32)
    face[one], face[other] = other // 3, one // 3
    face = face.reshape(count, 3)
    # Faces that share two edges would get two partial triples of one triple.
    for k in range(1, 3):
        again = (face[:, k, None] == face[:, :k]).any(axis=1)
        face[again, k] = -1
    corners = np.zeros((count, 3, 2), np.int8)
    for k in range(3):
        other = polygons[face[:, k]]
        for end in range(2):
            own = polygons[:, (k + 1 + end) % 3]
            corners[:, k, end] = (other == own[:, None]).argmax(axis=1)
    # What one face does not share, the other must not either.
    some = face >= 0
    back = np.zeros_like(some)
    for k in range(3):
        back[:, k] = (face[face[:, k]] == np.arange(count)[:, None]).any(axis=1)
    return Neighbours(np.where(some & back, face, np.int32(-1)), corners)


class Guides(NamedTuple):
    """A closed staircase for each face, near which its links must lie."""

    triples: Int16[np.ndarray, "faces room 3"]
    sizes: Int32[np.ndarray, "faces"]
    """0 where anything goes."""
    slack: int
    """Entities by which links may lie off it."""


def select(
    layout: Layout, candidates: Candidates, around: Neighbours, guides: Guides, *, seed: int
) -> Lists:
    """Links by the strict rules, shared across edges as partial triples, and completed.

    Args:
        layout: of the faces.
        candidates: of the faces.
        around: who shares edges.
        guides: of the faces.
        seed: of the order in which faces nominate.
    """
    faces, _, capacity, _ = layout.directions.shape
    lists = Lists.empty(faces, capacity)
    nominations = np.repeat(np.arange(faces, dtype=np.int32), np.diff(candidates.starts))
    order = np.random.default_rng(seed).permutation(nominations)
    _nominate(order, candidates, layout, lists, around, guides)
    _complete(layout, lists, around, guides)
    return lists


@compiled
def _place(f, triple, layout, lists, guides):
    """(slot for a triple in the list of face f by Rules 1 and 2, its place along the guide).

    LINKED if a link has these entities already, NO_SLOT if a rule forbids it.
    """
    known, taken = 0, 0
    for k in range(3):
        if triple[k] >= 0:
            known += 1
            taken += lists.used[f, k, triple[k]]
    links, length, counts = lists.links[f], lists.lengths[f], layout.counts[f]
    if taken:
        k = 0 if triple[0] >= 0 else 1
        i = known_link(links, length, k, triple[k])
        if i < 0 or known == 3 or taken == 1:
            return NO_SLOT, 0
        for k in range(3):
            if triple[k] >= 0 and links[i, k] != triple[k]:
                return NO_SLOT, 0
        return LINKED, 0
    if length == len(links):
        return NO_SLOT, 0
    size = guides.sizes[f]
    if size == 0:
        return slot_in_cyclic_order(links, length, triple, counts), 0
    guide = guides.triples[f, :size]
    place, off = nearest_on_guide(guide, triple, counts)
    if off > guides.slack:
        return NO_SLOT, 0
    return slot_along_guide(links, lists.places[f], length, triple, place, guide, counts), place


@compiled
def _add(f, triple, slot, place, lists):
    if slot == LINKED:
        return
    length = lists.lengths[f]
    insert(lists.links[f], lists.places[f], length, slot, triple, place)
    lists.lengths[f] = length + 1
    for k in range(3):
        if triple[k] >= 0:
            lists.used[f, k, triple[k]] = True


@compiled
def _across(f, k, triple, around, partial):
    """The part of a triple of face f that its neighbour opposite corner k shares."""
    partial[:] = -1
    partial[around.corners[f, k, 0]] = triple[(k + 1) % 3]
    partial[around.corners[f, k, 1]] = triple[(k + 2) % 3]


@compiled
def _nominate(order, candidates, layout, lists, around, guides):
    """Each nomination takes its face's best candidate left; one violation rejects all its parts."""
    faces = len(lists.lengths)
    nominated = candidates.starts[:faces].copy()
    partial = np.zeros((3, 3), np.int16)
    slots, places = np.zeros(3, np.int64), np.zeros(3, np.int64)
    for f in order:
        triple = candidates.triples[nominated[f]]
        nominated[f] += 1
        slot, place = _place(f, triple, layout, lists, guides)
        if slot == NO_SLOT:
            continue
        if _shareable(f, triple, 0, 3, layout, lists, around, guides, partial, slots, places):
            _add(f, triple, slot, place, lists)
            for k in range(3):
                if around.face[f, k] >= 0:
                    _add(around.face[f, k], partial[k], slots[k], places[k], lists)


@compiled
def _shareable(f, triple, first, count, layout, lists, around, guides, partial, slots, places):
    """Whether the neighbours opposite some corners accept their parts of a triple of face f."""
    for side in range(first, first + count):
        k = side % 3
        g = around.face[f, k]
        if g >= 0:
            _across(f, k, triple, around, partial[k])
            slots[k], places[k] = _place(g, partial[k], layout, lists, guides)
            if slots[k] == NO_SLOT:
                return False
    return True


@compiled
def _complete(layout, lists, around, guides):
    """Completes partial triples first come, first served, and hands on what that adds."""
    # A link is known by its face and one of its entities, which Rule 1 lets only it have.
    queue = [(0, 0, 0)]
    queue.pop()
    for f in range(len(lists.lengths)):
        for i in range(lists.lengths[f]):
            link = lists.links[f, i]
            if unknown(link) >= 0:
                colour = 0 if link[0] >= 0 else 1
                queue.append((f, colour, int(link[colour])))
    partial = np.zeros((3, 3), np.int16)
    slots, places = np.zeros(3, np.int64), np.zeros(3, np.int64)
    done = 0
    while done < len(queue):
        f, colour, entity = queue[done]
        done += 1
        i = known_link(lists.links[f], lists.lengths[f], colour, entity)
        missing = unknown(lists.links[f, i])
        if missing < 0:
            continue
        triple = lists.links[f, i].copy()
        for e in _nearest_unused(f, i, missing, layout, lists):
            triple[missing] = e
            if not _on_guide(f, triple, lists.places[f, i], layout, guides):
                continue
            if _shareable(
                f, triple, missing + 1, 2, layout, lists, around, guides, partial, slots, places
            ):
                lists.links[f, i] = triple
                lists.used[f, missing, e] = True
                for side in range(1, 3):
                    k = (missing + side) % 3
                    g = around.face[f, k]
                    if g >= 0 and slots[k] != LINKED:
                        _add(g, partial[k], slots[k], places[k], lists)
                        c = 0 if partial[k, 0] >= 0 else 1
                        queue.append((int(g), c, int(partial[k, c])))
                break


@compiled
def _on_guide(f, triple, place, layout, guides):
    """Whether a completed triple lies near where its partial one was put."""
    if guides.sizes[f] == 0:
        return True
    for k in range(3):
        if abs(ahead(triple[k], guides.triples[f, place, k], layout.counts[f, k])) > guides.slack:
            return False
    return True


@compiled
def _nearest_unused(f, i, missing, layout, lists):
    """Entities that could complete link i of face f without crossing, nearest first."""
    links, length = lists.links[f], lists.lengths[f]
    count = layout.counts[f, missing]
    start, size = gap(links, length, i, missing, count)
    x, y = (missing + 1) % 3, (missing + 2) % 3
    u = layout.directions[f, x, links[i, x]]
    v = layout.directions[f, y, links[i, y]]
    cost = np.full(size, np.inf)
    for step in range(size):
        e = (start + step) % count
        if not lists.used[f, missing, e]:
            d = layout.directions[f, missing, e]
            near = min(1.0, d[0] * u[0] + d[1] * u[1] + d[2] * u[2])
            far = min(1.0, d[0] * v[0] + d[1] * v[1] + d[2] * v[2])
            cost[step] = np.arccos(max(-1.0, near)) + np.arccos(max(-1.0, far))
    order = np.argsort(cost, kind="mergesort")[:MOST_TRIES]
    within = 0
    while within < len(order) and cost[order[within]] <= FARTHEST:
        within += 1
    return (start + order[:within]) % count
