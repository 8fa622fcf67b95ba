"""Which triples may be left out of an evaluation, as they hardly change the polygon (host, Numba).

A list visits every entity, so it has more triples than any of its three polygons has vectors; most
of the surplus lies nearly on the great circles between its neighbours.
"""

import numpy as np

from jaxvis.compiled import compiled


@compiled
def thin_faces(faces, layout, triples, sizes, most, kept):
    """Marks the triples that are evaluated.

    As in the simplification of polygons, the triple that changes least goes first.

    Args:
        faces: which.
        layout: of all faces.
        triples: int16 [faces, room, 3].
        sizes: of the lists.
        most: triples that are left.
        kept: bool [faces, room], where the marks go.
    """
    room = triples.shape[1]
    before, after = np.zeros(room, np.int32), np.zeros(room, np.int32)
    cost = np.zeros(room)
    outline = np.zeros((room, 4, 3))
    for f in faces:
        size = sizes[f]
        _outlines(layout.directions[f], triples[f], size, outline)
        kept[f, :size] = True
        for i in range(size):
            before[i], after[i] = (i - 1) % size, (i + 1) % size
        for i in range(size):
            cost[i] = _change(outline, before[i], i, after[i])
        for _ in range(size - most):
            i = np.argmin(cost[:size])
            kept[f, i] = False
            cost[i] = np.inf
            a, c = before[i], after[i]
            after[a], before[c] = c, a
            cost[a] = _change(outline, before[a], a, c)
            cost[c] = _change(outline, a, c, after[c])


@compiled
def _outlines(directions, triples, size, outline):
    """The list's polygon at each corner and at the centre of the face, seen from the centre."""
    for i in range(size):
        for k in range(3):
            outline[i, k] = directions[k, triples[i, k]]
        outline[i, 3] = (outline[i, 0] + outline[i, 1] + outline[i, 2]) / 3.0


@compiled
def _change(outline, a, b, c):
    """Area of the triangles between a vector and its neighbours, the largest of four outlines."""
    largest = 0.0
    for k in range(4):
        u, v = outline[b, k] - outline[a, k], outline[c, k] - outline[b, k]
        x = u[1] * v[2] - u[2] * v[1]
        y = u[2] * v[0] - u[0] * v[2]
        z = u[0] * v[1] - u[1] * v[0]
        largest = max(largest, 0.5 * np.sqrt(x * x + y * y + z * z))
    return largest
