"""Candidates for corresponding entities: the tripoints of spherical Voronoi diagrams (host).

The polygons of a triangle's three corners, coloured red, green and blue, are seen from the
triangle's centre. A Voronoi vertex of all their vectors whose three cells have three colours is an
RGB tripoint, and names one entity of each polygon (paper 000, section III-B). Voronoi vertices of
points on the sphere are the facets of their convex hull.
"""

from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Float, Float32, Float64, Int, Int16, Int32

JITTER = 1e-7
"""Radians by which sites are moved: those that coincide must remain different sites."""

FAR = np.cos(np.radians(25.0))
"""Cosine to the nearest site above which an axis needs no auxiliary site."""


class Layout(NamedTuple):
    """What the corners of faces see from the faces' centres."""

    directions: Float32[np.ndarray, "faces 3 capacity 3"]
    """Unit, for each corner's entities; after their count the last one repeats."""
    tangents: Float32[np.ndarray, "faces 3 capacity 3"]
    """Unit, along the polygon at each entity; zero at the tip of a bridge."""
    counts: Int32[np.ndarray, "faces 3"]
    distances: Float32[np.ndarray, "faces"]
    """Harmonic mean distance of the finite vectors; 1 where there is none."""


class Candidates(NamedTuple):
    """RGB tripoints of faces, one face's after another's, by ascending distance."""

    triples: Int16[np.ndarray, "candidates 3"]
    """Entities of the three corners."""
    starts: Int32[np.ndarray, "faces+1"]


def layout(
    vectors: Float[np.ndarray, "polygons 4 capacity"],
    counts: Int[np.ndarray, "polygons"],
    polygons: Int[np.ndarray, "faces 3"],
    centres: Float[np.ndarray, "faces 3"],
) -> Layout:
    """The polygons of each face's corners as seen from its centre."""
    q = vectors[polygons].astype(np.float64)
    relative = q[:, :, :3] - q[:, :, 3:] * centres[:, None, :, None]
    length = np.linalg.norm(relative, axis=2)
    n = counts[polygons]
    place = np.arange(q.shape[-1])
    finite = (q[:, :, 3] > 0.0) & (place < n[..., None])
    inverse = np.where(finite, 1.0 / np.maximum(length, 1e-12), 0.0).sum(axis=(1, 2))
    some = inverse > 0.0
    distances = np.where(some, finite.sum(axis=(1, 2)) / np.where(some, inverse, 1.0), 1.0)
    directions = np.moveaxis(relative / np.maximum(length, 1e-12)[:, :, None], 2, 3)
    following = np.where(place + 1 < n[..., None], place + 1, 0)[..., None]
    previous = np.where(place > 0, place - 1, n[..., None] - 1)[..., None]
    along = np.take_along_axis(directions, following, 2) - np.take_along_axis(
        directions, previous, 2
    )
    step = np.linalg.norm(along, axis=-1, keepdims=True)
    tangents = np.where(step > 1e-9, along / np.maximum(step, 1e-9), 0.0)
    return Layout(
        directions.astype(np.float32),
        tangents.astype(np.float32),
        n.astype(np.int32),
        distances.astype(np.float32),
    )


def rgb_tripoints(layout: Layout, *, tangent: float | None, seed: int) -> Candidates:
    """The candidates of each face, best first.

    Args:
        layout: of the faces.
        tangent: least product of any two of a tripoint's tangents: entities on strands that run in
            other directions do not correspond, however close they are. None takes all tripoints, as
            the paper does.
        seed: of the jitter, which is the same for every face.
    """
    capacity = layout.directions.shape[2]
    jitter = JITTER * np.random.default_rng(seed).standard_normal((3 * capacity + 6, 3))
    found = [
        _of_face(layout.directions[f], layout.tangents[f], layout.counts[f], jitter, tangent)
        for f in range(len(layout.counts))
    ]
    lengths = np.array([len(triples) for triples in found], np.int32)
    starts = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
    triples = np.concatenate([np.zeros((0, 3), np.int16), *found])
    return Candidates(triples.astype(np.int16), starts)


def tripoint_distance(
    red: Float[np.ndarray, "*any 3"],
    green: Float[np.ndarray, "*any 3"],
    blue: Float[np.ndarray, "*any 3"],
) -> Float64[np.ndarray, "*any"]:
    """The three angles between unit vectors, summed (paper 000, eq. 22), in radians."""
    pairs = (red, green), (green, blue), (blue, red)
    cosines = np.stack([np.einsum("...c,...c->...", a, b, dtype=np.float64) for a, b in pairs])
    return np.asarray(np.arccos(np.clip(cosines, -1.0, 1.0)).sum(axis=0))


def hull_facets(
    sites: Float[np.ndarray, "sites 3"], jitter: Float[np.ndarray, "jitters 3"]
) -> tuple[Float64[np.ndarray, "points 3"], Int32[np.ndarray, "facets 3"]]:
    """The Delaunay triangles of unit vectors on the sphere.

    Axes far from all sites become auxiliary sites after them, so that no facet spans more than a
    hemisphere.

    Returns:
        (sites, jittered, and auxiliary ones; indices into them)
    """
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    free = (axes @ sites.T).max(axis=1) < FAR
    points = np.concatenate([sites, axes[free]]).astype(np.float64)
    points += jitter[: len(points)]
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return points, scipy.spatial.ConvexHull(points, qhull_options="Qt").simplices


def _of_face(
    directions: Float32[np.ndarray, "3 capacity 3"],
    tangents: Float32[np.ndarray, "3 capacity 3"],
    counts: Int32[np.ndarray, "3"],
    jitter: Float64[np.ndarray, "jitters 3"],
    tangent: float | None,
) -> Int16[np.ndarray, "candidates 3"]:
    sites = np.concatenate([directions[k, : counts[k]] for k in range(3)])
    starts = np.cumsum([0, *counts])
    _, facets = hull_facets(sites, jitter)
    facets = np.sort(facets, axis=1)
    own = facets[:, 2] < starts[3]
    rgb = own & (np.searchsorted(starts, facets, side="right") == [1, 2, 3]).all(axis=1)
    triples = facets[rgb] - starts[:3]
    r, g, b = (directions[k, triples[:, k]] for k in range(3))
    distance = tripoint_distance(r, g, b)
    order = np.lexsort((*triples.T, distance))
    if tangent is not None:
        t = [tangents[k, triples[:, k]] for k in range(3)]
        products = [np.einsum("ac,ac->a", t[k - 1], t[k]) for k in range(3)]
        order = order[np.min(products, axis=0)[order] > tangent]
    return triples[order].astype(np.int16)
