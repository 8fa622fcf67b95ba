"""Outlines between corners: corresponding position vectors, interpolated (paper 000, eq. 21).

A list of triples makes one outline for each place in a face. On an edge, where one corner does not
count, triples that differ in that corner alone make the same vector: edges have shorter lists.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32, Int, Int32

from jaxvis.methods.vectorized.correspondence.triples import CorrespondingPolygons
from jaxvis.methods.vectorized.evaluation import (
    Integral,
    References,
    Sites,
    integrals,
    sum_over_polygons,
)
from jaxvis.methods.vectorized.mesh import Mesh
from jaxvis.methods.vectorized.polygons import VisibilityPolygons
from jaxvis.sphere.polygons import Directions, normalized

Interpolation = Literal["position", "direction"]

SIZES = 8
"""How many lengths lists of triples are taken to have."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class TripleLists:
    """Lists of triples, of faces and of edges, as shading reads them."""

    vectors: Float[Array, "rows 4"]
    """Of one polygon after the other."""
    triples: Int[Array, "3 entries"]
    """Of one list after the other, and as many entries more as the longest list has."""
    starts: Int[Array, "lists"]
    counts: Int[Array, "lists"]
    rows: Int[Array, "lists 3"]
    """First row of each corner's polygon."""
    distances: Float[Array, "lists"]


class Outlines(NamedTuple):
    """Which list belongs to which face and edge. Host, but for ``lists``."""

    lists: TripleLists
    counts: Int32[np.ndarray, "lists"]
    sizes: Int[np.ndarray, "sizes"]
    """As how long lists count, ascending."""
    corners: Int32[np.ndarray, "lists 3"]
    """Polygons."""
    of_face: Int32[np.ndarray, "faces"]
    """-1 where there is none."""
    of_edge: Int32[np.ndarray, "edges"]
    """From the first face beside each edge that has triples; -1 where none has."""

    @staticmethod
    def of(corresponding: CorrespondingPolygons) -> "Outlines":
        """The lists of a visibility, which are kept with it."""
        known = vars(corresponding)
        if "_outlines" not in known:
            known["_outlines"] = _build(corresponding)
        return known["_outlines"]


def polygons_of(visibility: VisibilityPolygons | CorrespondingPolygons) -> VisibilityPolygons:
    """The polygons, whether or not they correspond."""
    return visibility.polygons if isinstance(visibility, CorrespondingPolygons) else visibility


def interpolated(
    lists: TripleLists, references: References, size: int, interpolation: Interpolation
) -> Directions:
    """Outlines as seen from their sites, not normalised; after their end the first vector repeats.

    ``"position"`` weights position vectors (eq. 21), those at infinity as if they were as far as
    the face's others; ``"direction"`` weights unit directions.

    Args:
        lists: of triples.
        references: which lists, from where, and with which weights.
        size: at least as long as the lists.
        interpolation: of what.
    """
    number = jnp.asarray(references.polygon)
    start, count, rows = (
        leaf.take(number, axis=0) for leaf in (lists.starts, lists.counts, lists.rows)
    )
    entries = jax.vmap(lambda first: jax.lax.dynamic_slice(lists.triples, (0, first), (3, size)))(
        start
    )
    entries = jnp.where(jnp.arange(size) < count[:, None, None], entries, entries[..., :1])
    index = entries.astype(jnp.int32) + rows[..., None]
    found = jnp.take(lists.vectors, index.reshape(-1), axis=0, mode="clip")
    found = found.reshape(*index.shape, 4)
    position, weight = jnp.asarray(references.position), jnp.asarray(references.weight)
    x, y, z = (position[:, i, None] for i in range(3))
    total = [jnp.float32(0.0)] * 3
    for k in range(3):
        share, w = weight[:, k, None], found[:, k, :, 3]
        if interpolation == "direction":
            seen = (found[:, k, :, 0] - w * x, found[:, k, :, 1] - w * y, found[:, k, :, 2] - w * z)
            unit = normalized(Directions(*seen))
            total = [total[i] + share * unit[i] for i in range(3)]
        else:
            distance = lists.distances.take(number)[:, None]
            share = jnp.where(w > 0.0, share, share * distance)
            total = [
                total[i] + share * (found[:, k, :, i] - w * position[:, i, None]) for i in range(3)
            ]
    return Directions(*total)


def sum_over_outlines(
    integral: Callable[[Any], Integral],
    visibility: VisibilityPolygons | CorrespondingPolygons,
    sites: Sites,
    *,
    extra: Any = (),
    **options: Any,
) -> Float[Array | np.ndarray, "sites channels"]:
    """:func:`sum_over_polygons`; but one integral a site where its face's polygons correspond.

    Sites with one polygon use that; so do sites of faces whose polygons are kept separate, and add
    up what they have.

    Args:
        integral: for a source of outlines, the polygons' vectors or :class:`TripleLists`, the
            integral of each reference.
        visibility: the polygons, and perhaps their correspondence.
        sites: where.
        extra, options: as for :func:`sum_over_polygons`.
    """
    polygons = polygons_of(visibility)
    separately = integral(polygons.vectors)
    if not isinstance(visibility, CorrespondingPolygons):
        return sum_over_polygons(separately, visibility, sites, extra=extra, **options)
    outlines = Outlines.of(visibility)
    one, several = np.flatnonzero(sites.outline >= 0), np.flatnonzero(sites.outline < 0)

    def gather(rows: Int[np.ndarray, "rows"]) -> References:
        at = one.take(rows)
        number, position, normal, plane = (
            field.take(at, axis=0) for field in (sites.outline, *sites[:3])
        )
        others = jax.tree.map(lambda leaf: leaf.take(at, axis=0), extra)
        weight = sites.weight.take(at, axis=0)
        return References(number, position, normal, plane, others, weight)

    waiting = integrals(
        integral(outlines.lists),
        gather,
        sites.outline.take(one),
        outlines.counts,
        outlines.sizes,
        **options,
    )
    others = jax.tree.map(lambda leaf: leaf.take(several, axis=0), extra)
    rest = sum_over_polygons(separately, polygons, sites.take(several), extra=others, **options)
    joint = waiting()
    place = np.empty(len(sites.outline), np.intp)
    place[one], place[several] = np.arange(len(one)), len(one) + np.arange(len(several))
    xp = np if isinstance(joint, np.ndarray) and isinstance(rest, np.ndarray) else jnp
    return xp.concatenate([joint, rest]).take(place, axis=0)


def joined_outlines(
    visibility: VisibilityPolygons | CorrespondingPolygons,
    mesh: Mesh,
    face: Int32[np.ndarray, "sites"],
    polygon: Int32[np.ndarray, "sites 3"],
    weight: Float32[np.ndarray, "sites 3"],
) -> tuple[
    Int32[np.ndarray, "sites 3"], Float32[np.ndarray, "sites 3"], Int32[np.ndarray, "sites"]
]:
    """Polygons and weights of sites in faces, and the list of triples that joins them, or -1.

    Sites on an edge have the list of the edge, whichever face they were found in, and its order
    of corners: triangles that share the edge have the same outline there.
    """
    if not isinstance(visibility, CorrespondingPolygons):
        return polygon, weight, np.full(len(face), -1, np.int32)
    outlines = Outlines.of(visibility)
    counting = polygon >= 0
    corners = np.count_nonzero(counting, axis=1)
    outline = np.where(corners == 3, outlines.of_face.take(face), np.int32(-1))
    between = np.flatnonzero(corners == 2)
    missing = np.argmin(counting.take(between, axis=0), axis=1)
    of_edge = outlines.of_edge.take(mesh.edges.reshape(-1).take(3 * face.take(between) + missing))
    joined = np.flatnonzero(of_edge >= 0)
    between, of_edge = between.take(joined), of_edge.take(joined)
    outline[between] = of_edge
    polygon, weight, own = polygon.copy(), weight.copy(), polygon.take(between, axis=0)
    known = outlines.corners.take(of_edge, axis=0)
    same = known[:, :, None] == own[:, None, :]
    weight[between] = np.einsum("sck,sk->sc", same, weight.take(between, axis=0))
    polygon[between] = np.where(same.any(axis=2), known, np.int32(-1))
    return polygon, weight, outline


def _build(corresponding: CorrespondingPolygons) -> Outlines:
    polygons, mesh = corresponding.polygons, Mesh.of(corresponding.polygons)
    evaluated = np.asarray(corresponding.evaluated)
    triples = np.asarray(corresponding.triples)[evaluated]
    starts = np.concatenate([[0], np.cumsum(evaluated)])[np.asarray(corresponding.starts)]
    counts = np.diff(starts)
    faces = np.flatnonzero(counts).astype(np.int32)
    of_face = np.full(len(mesh.faces), -1, np.int32)
    of_face[faces] = np.arange(len(faces))
    edge, first = np.unique(mesh.edges[faces], return_index=True)
    of_edge = np.full(mesh.edge_count, -1, np.int32)
    of_edge[edge] = len(faces) + np.arange(len(edge))
    beside, corner = faces.take(first // 3), first % 3
    shorter, edge_counts = _without_corner(triples, starts, beside, corner)
    face = np.concatenate([faces, beside])
    all_counts = np.concatenate([counts.take(faces), edge_counts]).astype(np.int32)
    corners = mesh.faces.take(face, axis=0)
    sizes = _sizes(all_counts)
    margin = np.zeros((sizes[-1], 3), triples.dtype)
    entries = np.concatenate([triples, shorter, margin])
    lists = TripleLists(
        vectors=jnp.moveaxis(polygons.vectors, 1, 2).reshape(-1, 4),
        triples=jnp.asarray(entries.T),
        starts=jnp.asarray(np.cumsum(all_counts) - all_counts, jnp.int32),
        counts=jnp.asarray(all_counts),
        rows=jnp.asarray(corners * polygons.capacity),
        distances=jnp.asarray(corresponding.distances).take(face),
    )
    return Outlines(lists, all_counts, sizes, corners, of_face, of_edge)


def _without_corner(
    triples: Int[np.ndarray, "triples 3"],
    starts: Int[np.ndarray, "faces_and_end"],
    faces: Int[np.ndarray, "chosen"],
    corner: Int[np.ndarray, "chosen"],
) -> tuple[Int[np.ndarray, "kept 3"], Int[np.ndarray, "chosen"]]:
    """The triples of faces that differ from the ones before them in the other two corners.

    Returns:
        (those of one face after the other, how many of each); at least one of each
    """
    counts = np.diff(starts).take(faces)
    row = np.repeat(np.arange(len(faces)), counts)
    place = np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)
    start = starts.take(faces).take(row)
    before = start + (place - 1) % counts.take(row)
    found = triples.take(start + place, axis=0)
    differs = found != triples.take(before, axis=0)
    differs[np.arange(len(row)), corner.take(row)] = False
    kept = differs.any(axis=1)
    kept |= (place == 0) & ~np.bincount(row[kept], minlength=len(faces)).astype(bool).take(row)
    return found[kept], np.bincount(row[kept], minlength=len(faces))


def _sizes(counts: Int[np.ndarray, "lists"]) -> Int[np.ndarray, "sizes"]:
    """Quantiles of lists' lengths, rounded up to multiples of eight."""
    if not len(counts):
        return np.array([8])
    quantiles = np.quantile(counts, np.arange(1, SIZES + 1) / SIZES)
    return np.unique(8 * np.ceil(quantiles / 8).astype(np.int64))
