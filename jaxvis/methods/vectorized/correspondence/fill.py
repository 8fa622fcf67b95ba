"""The relaxed stage: every list becomes a closed staircase through all entities (host, Numba).

Paper 000, section III-D, end. Links that remain partial, and entities that no link visits, are
settled face by face: between links that are complete, the cheapest path through the lattice of the
three sequences is found by dynamic programming.
"""

import numpy as np

from jaxvis.compiled import compiled
from jaxvis.methods.vectorized.correspondence.links import gap

LARGEST_WHOLE = 1 << 16
"""Points of a lattice that is searched wholly; larger ones are searched near a coarse path."""

COARSE, MARGIN = 3, 6
"""Entities from one to the next on the coarse path, and around it to either side."""

_MOVES = np.array(
    [[1, 1, 1], [1, 1, 0], [1, 0, 1], [0, 1, 1], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.int8
)


@compiled
def fill_faces(faces, layout, links, lengths, step, triples, sizes):
    """Fills the lists of some faces.

    Args:
        faces: which.
        layout: of all faces.
        links: int16 [faces, room, 3], of all faces; they are not changed.
        lengths: of the lists.
        step: cost of a triple beside its distance, in radians: it makes lists shorter.
        triples: int16 [faces, 3 capacity, 3], where the staircases go, entities counted on beyond
            the polygon's end: they never fall from one triple to the next.
        sizes: int32 [faces], where their lengths go.
    """
    capacity = layout.directions.shape[2]
    moves = np.zeros((capacity + 1) ** 3, np.int8)
    for f in faces:
        directions, counts = layout.directions[f], layout.counts[f]
        own = links[f].copy()
        length = _anchored(own, lengths[f], directions, counts)
        sizes[f] = _staircase(own, length, directions, counts, step, moves, triples[f])


@compiled
def _angle(u, v):
    return np.arccos(max(-1.0, min(1.0, u[0] * v[0] + u[1] * v[1] + u[2] * v[2])))


@compiled
def _anchored(links, length, directions, counts):
    """Makes sure that a link is complete: the best partial one, or the closest entities."""
    best, chosen, entity = np.inf, -1, 0
    for i in range(length):
        if links[i].min() >= 0:
            return length
        missing = 0
        while links[i, missing] >= 0:
            missing += 1
        x, y = (missing + 1) % 3, (missing + 2) % 3
        u, v = directions[x, links[i, x]], directions[y, links[i, y]]
        start, size = gap(links, length, i, missing, counts[missing])
        for offset in range(size):
            e = (start + offset) % counts[missing]
            d = directions[missing, e]
            cost = _angle(u, v) + _angle(v, d) + _angle(d, u)
            if cost < best:
                best, chosen, entity = cost, i, e
    if chosen >= 0:
        for missing in range(3):
            if links[chosen, missing] < 0:
                links[chosen, missing] = entity
        return length
    for r in range(counts[0]):
        u = directions[0, r]
        g = _nearest(directions[1], counts[1], u)
        b = _nearest(directions[2], counts[2], u + directions[1, g])
        v, d = directions[1, g], directions[2, b]
        cost = _angle(u, v) + _angle(v, d) + _angle(d, u)
        if cost < best:
            best = cost
            links[0, 0], links[0, 1], links[0, 2] = r, g, b
    return 1


@compiled
def _nearest(directions, count, toward):
    best, entity = -np.inf, 0
    for e in range(count):
        u = directions[e]
        close = u[0] * toward[0] + u[1] * toward[1] + u[2] * toward[2]
        if close > best:
            best, entity = close, e
    return entity


@compiled
def _staircase(links, length, directions, counts, step, moves, out):
    """Writes the closed staircase through the links; returns its length."""
    cut = 0
    while links[cut].min() < 0:
        cut += 1
    # Positions along each sequence, counted on from the cut; the cut itself closes the turn.
    at = np.full((length + 1, 3), -1, np.int32)
    last = np.zeros(3, np.int32)
    for i in range(length):
        link = links[(cut + i) % length]
        for k in range(3):
            if link[k] >= 0:
                last[k] = last[k] + (link[k] - last[k]) % counts[k] if i else link[k]
                at[i, k] = last[k]
    at[length] = at[0] + counts
    size, start = np.int64(0), 0  # not a literal, which would be a type of its own
    for stop in range(1, length + 1):
        if at[stop].min() >= 0:
            anchors = at[start : stop + 1]
            size = _between_anchors(anchors, directions, counts, step, moves, out, size)
            start = stop
    return size


@compiled
def _between_anchors(at, directions, counts, step, moves, out, size):
    """Appends the cheapest path from the first of ``at`` until before the last."""
    run = at[-1] - at[0]
    low, partials = at[0], at[1:-1]
    # Literals would be types of their own, and functions compiled for each.
    each, every = np.int64(1), np.int64(COARSE)
    whole = _all_of(run)
    window = whole
    if (run + 1).prod() > LARGEST_WHOLE:
        # Of the type of run, for which the functions are compiled.
        coarse, none = (run // COARSE).astype(np.int32), partials[:0]
        _cheapest(low, coarse, every, _all_of(coarse), none, directions, counts, step, moves)
        window = _around(_walk(coarse, moves), run)
    found = _cheapest(low, run, each, window, partials, directions, counts, step, moves)
    if not found:
        found = _cheapest(low, run, each, whole, partials, directions, counts, step, moves)
    if not found:  # the partial triples contradict each other
        _cheapest(low, run, each, whole, partials[:0], directions, counts, step, moves)
    path = _walk(run, moves)
    for i in range(len(path) - 1):
        out[size + i] = low + path[i]
    return size + len(path) - 1


@compiled
def _all_of(run):
    """The window that leaves out nothing: first and last green, first and last blue entity."""
    window = np.zeros((run[0] + 1, 4), np.int32)
    window[:, 1], window[:, 3] = run[1], run[2]
    return window


@compiled
def _walk(run, moves):
    """The lattice points from zero to ``run`` by the moves that lead to each."""
    path = np.empty((run.sum() + 1, 3), np.int32)
    place, start = run.copy(), len(path) - 1
    path[start] = place
    while place[0] + place[1] + place[2] > 0:
        move = moves[(place[0] * (run[1] + 1) + place[1]) * (run[2] + 1) + place[2]]
        for k in range(3):
            place[k] -= _MOVES[move, k]
        start -= 1
        path[start] = place
    return path[start:]


@compiled
def _around(path, run):
    """For each red entity, the green and blue ones within a margin of a coarse path."""
    window = np.empty((run[0] + 1, 4), np.int32)
    window[:, 0], window[:, 1], window[:, 2], window[:, 3] = run[1], 0, run[2], 0
    for p in range(len(path)):
        first = max(path[p, 0] * COARSE - MARGIN, 0)
        last = min(path[p, 0] * COARSE + COARSE + MARGIN, run[0])
        for i in range(first, last + 1):
            for k in range(2):
                at = path[p, k + 1] * COARSE
                window[i, 2 * k] = max(min(window[i, 2 * k], at - MARGIN), 0)
                high = min(at + COARSE + MARGIN, run[k + 1])
                window[i, 2 * k + 1] = max(window[i, 2 * k + 1], high)
    return window


@compiled
def _table(x, y, low, run, stride, directions, counts):
    """Angles between every ``stride``-th entity of two colours along their runs."""
    table = np.empty((run[x] + 1, run[y] + 1), np.float32)
    for i in range(run[x] + 1):
        u = directions[x, (low[x] + i * stride) % counts[x]]
        for j in range(run[y] + 1):
            table[i, j] = _angle(u, directions[y, (low[y] + j * stride) % counts[y]])
    return table


@compiled
def _through(table, x, y, low, partials):
    """Leaves only paths through each partial pair (a, b) of two colours.

    What lies neither before nor behind it is forbidden, in ``table``; and so, in what is returned,
    are the diagonal steps that would pass beside it: into (a, b + 1) and (a + 1, b). Both by an
    infinite cost.
    """
    beside = np.zeros(table.shape, np.float32)
    rows, columns = table.shape
    for p in range(len(partials)):
        a, b = partials[p, x] - low[x], partials[p, y] - low[y]
        if partials[p, x] < 0 or partials[p, y] < 0:
            continue
        table[:a, b + 1 :] = np.inf
        table[a + 1 :, :b] = np.inf
        if b + 1 < columns:
            beside[a, b + 1] = np.inf
        if a + 1 < rows:
            beside[a + 1, b] = np.inf
    return beside


@compiled
def _cheapest(low, run, stride, window, partials, directions, counts, step, moves):
    """Moves of the path of least summed tripoint distance (eq. 22) and steps; False if none fits.

    Every move advances one, two or all three sequences by one entity, or by ``stride`` of them.
    ``window`` bounds green and blue for each red entity.
    """
    rg = _table(0, 1, low, run, stride, directions, counts)
    gb = _table(1, 2, low, run, stride, directions, counts)
    rb = _table(0, 2, low, run, stride, directions, counts)
    no_rg = _through(rg, 0, 1, low, partials)
    no_gb = _through(gb, 1, 2, low, partials)
    no_rb = _through(rb, 0, 2, low, partials)
    nj, nk = run[1] + 1, run[2] + 1
    # Row and column 0 stay infinite: there is nothing before the first entity.
    cost = np.full((2, nj + 1, nk + 1), np.float32(np.inf))
    for i in range(run[0] + 1):
        here, above = cost[i % 2], cost[(i + 1) % 2]
        here[:] = np.float32(np.inf)
        for j in range(window[i, 0], window[i, 1] + 1):
            for k in range(window[i, 2], window[i, 3] + 1):
                best = above[j, k] + (no_rg[i, j] + no_gb[j, k] + no_rb[i, k])
                move = 0
                other = above[j, k + 1] + no_rg[i, j]
                if other < best:
                    best, move = other, 1
                other = above[j + 1, k] + no_rb[i, k]
                if other < best:
                    best, move = other, 2
                other = here[j, k] + no_gb[j, k]
                if other < best:
                    best, move = other, 3
                if above[j + 1, k + 1] < best:
                    best, move = above[j + 1, k + 1], 4
                if here[j, k + 1] < best:
                    best, move = here[j, k + 1], 5
                if here[j + 1, k] < best:
                    best, move = here[j + 1, k], 6
                if i + j + k == 0:
                    best = np.float32(0.0)
                moves[(i * nj + j) * nk + k] = move
                here[j + 1, k + 1] = best + (rg[i, j] + gb[j, k] + rb[i, k] + step)
    return cost[run[0] % 2, nj, nk] < np.inf
