"""From visibility polygons to their correspondence: all stages (host)."""

import os
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Int, Int16, Int32
from tqdm.auto import tqdm

from jaxvis.cluster import map_jobs
from jaxvis.methods.vectorized.correspondence.candidates import (
    Candidates,
    Layout,
    layout,
    rgb_tripoints,
)
from jaxvis.methods.vectorized.correspondence.fill import fill_faces
from jaxvis.methods.vectorized.correspondence.guard import excess_error
from jaxvis.methods.vectorized.correspondence.interpolated import Interpolation
from jaxvis.methods.vectorized.correspondence.invariants import check_lists, check_shared
from jaxvis.methods.vectorized.correspondence.selection import Guides, neighbours, select
from jaxvis.methods.vectorized.correspondence.thinning import thin_faces
from jaxvis.methods.vectorized.correspondence.triples import CorrespondingPolygons
from jaxvis.methods.vectorized.mesh import Mesh
from jaxvis.methods.vectorized.polygons import VisibilityPolygons
from jaxvis.scene import RayTracer

Construction = Literal["relaxed", "paper"]

BATCH = 128
"""Faces of one job."""

THREADS = min(2, os.cpu_count() or 1)


class Settings(NamedTuple):
    """How vectors come to correspond.

    ``construction="paper"`` selects among all tripoints by the paper's two rules alone.
    ``"relaxed"`` first finds each face's cheapest staircase by itself, its guide, and selects among
    tripoints whose tangents agree (products of ``tangent`` or more) and that lie, with what the
    neighbours get of them, within ``slack`` entities of the guides. ``step`` is the cost of a
    triple beside its distance, in radians: it makes lists shorter. Of each list at most ``most``
    triples are evaluated. Faces in which a polygon interpolated by ``interpolation`` gives an
    irradiance that is further from the truth than the mean of three, by more than ``guard`` of pi,
    keep three evaluations. The paper's lists are evaluated wholly, and in all faces.
    """

    construction: Construction = "relaxed"
    seed: int = 0
    tangent: float = 0.3
    slack: int = 1
    step: float = 1.0
    most: int = 112
    interpolation: Interpolation = "position"
    guard: float = 0.028


def build_correspondence(
    polygons: VisibilityPolygons,
    tracer: RayTracer | None,
    settings: Settings = Settings(),  # noqa: B008 (frozen)
    *,
    progress: bool = False,
) -> CorrespondingPolygons:
    """The triples of every face (paper 000, III-B to D).

    Args:
        polygons: at the corners.
        tracer: of the scene, to find the faces that keep three evaluations; None: none do.
        settings: how.
        progress: shows a bar.

    Raises:
        AssertionError: a list misses a vector or is out of order.
    """
    relaxed = settings.construction == "relaxed"
    mesh = Mesh.of(polygons)
    stored = mesh.faces if len(polygons.backs) else mesh.faces[: len(mesh.planes)]
    faces = np.flatnonzero((stored >= 0).all(axis=1))
    corners = stored[faces]
    centres = np.asarray(polygons.positions, np.float64)[corners].mean(axis=1)
    with tqdm(
        total=4 * len(faces), desc="correspondence", unit="face", disable=not progress
    ) as bar:
        seen, candidates = _candidates(polygons, corners, centres, settings, bar)
        guides = _guides(seen, candidates, settings, bar) if relaxed else _no_guides(seen)
        around = neighbours(corners, mesh.edges[: len(stored)][faces])
        lists = select(seen, candidates, around, guides, seed=settings.seed)
        bar.update(len(faces))
        triples, sizes = _filled(seen, lists.links, lists.lengths, settings.step, bar)
    entities = seen.counts.astype(np.int16)[:, None]
    triples %= entities
    check_lists(triples, sizes, seen.counts)
    check_shared(lists.links, lists.lengths, triples, sizes)
    pack = partial(_packed, polygons, len(stored), faces, seen)
    if not relaxed:
        return pack(triples, sizes, most=triples.shape[1])
    found = pack(triples, sizes, most=settings.most)
    if tracer is None:
        return found
    # A face may be better off without what its neighbours wish.
    wrong = excess_error(found, tracer, settings.interpolation, faces)[faces] > settings.guard
    triples[wrong] = (guides.triples % entities)[wrong]
    sizes[wrong] = guides.sizes[wrong]
    check_lists(triples, sizes, seen.counts)
    found = pack(triples, sizes, most=settings.most)
    excess = excess_error(found, tracer, settings.interpolation, faces[wrong])
    return _without(found, excess > settings.guard)


def _in_batches(
    function: Callable[..., Any],
    shared: Sequence[Any],
    fields: Sequence[Any],
    bar: tqdm | None = None,
) -> list[Any]:
    """``function(*shared, part)`` of batches of faces: ``fields`` are arrays with a row for each
    face, or tuples of such; a part has the same, of the batch's faces."""
    count = len(jax.tree.leaves(fields)[0])
    parts = (
        jax.tree.map(lambda leaf, start=start: leaf[start : start + BATCH], fields)
        for start in range(0, count, BATCH)
    )
    found = []
    for result in map_jobs(function, shared, parts, threads=THREADS):
        found.append(result)
        if bar is not None:
            bar.update(min(BATCH, count - BATCH * (len(found) - 1)))
    return found


def _joined(parts: Sequence[Sequence[np.ndarray]]) -> Iterator[np.ndarray]:
    """Each field of the parts, of all faces."""
    return map(np.concatenate, zip(*parts, strict=True))


def _candidates(
    polygons: VisibilityPolygons,
    corners: Int32[np.ndarray, "faces 3"],
    centres: np.ndarray,
    settings: Settings,
    bar: tqdm,
) -> tuple[Layout, Candidates]:
    vectors, counts = np.asarray(polygons.vectors), np.asarray(polygons.counts)
    if not len(corners):
        seen = layout(vectors, counts, corners, centres)
        return seen, Candidates(np.zeros((0, 3), np.int16), np.zeros(1, np.int32))
    shared = vectors, counts, settings
    found = _in_batches(_candidates_of, shared, (corners, centres), bar)
    seen = Layout(*_joined([part for part, _ in found]))
    lengths = np.concatenate([np.diff(part.starts) for _, part in found])
    starts = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
    return seen, Candidates(np.concatenate([part.triples for _, part in found]), starts)


def _candidates_of(
    vectors: np.ndarray,
    counts: np.ndarray,
    settings: Settings,
    part: tuple[Int32[np.ndarray, "faces 3"], np.ndarray],
) -> tuple[Layout, Candidates]:
    seen = layout(vectors, counts, *part)
    tangent = settings.tangent if settings.construction == "relaxed" else None
    return seen, rgb_tripoints(seen, tangent=tangent, seed=settings.seed)


def _guides(seen: Layout, candidates: Candidates, settings: Settings, bar: tqdm) -> Guides:
    """Each face's cheapest staircase through its best candidate."""
    some = np.diff(candidates.starts) > 0
    best = np.full((len(some), 1, 3), -1, np.int16)
    best[some, 0] = candidates.triples[candidates.starts[:-1][some]]
    return Guides(*_filled(seen, best, some.astype(np.int32), settings.step, bar), settings.slack)


def _no_guides(seen: Layout) -> Guides:
    faces = len(seen.counts)
    return Guides(np.zeros((faces, 1, 3), np.int16), np.zeros(faces, np.int32), 0)


def _filled(
    seen: Layout,
    links: Int16[np.ndarray, "faces links 3"],
    lengths: Int32[np.ndarray, "faces"],
    step: float,
    bar: tqdm,
) -> tuple[Int16[np.ndarray, "faces room 3"], Int32[np.ndarray, "faces"]]:
    if not len(lengths):
        capacity = seen.directions.shape[2]
        return np.zeros((0, 3 * capacity, 3), np.int16), np.zeros(0, np.int32)
    triples, sizes = _joined(_in_batches(_fill, (np.float32(step),), (seen, links, lengths), bar))
    return triples, sizes


def _fill(
    step: np.float32,
    part: tuple[Layout, Int16[np.ndarray, "faces links 3"], Int32[np.ndarray, "faces"]],
) -> tuple[Int16[np.ndarray, "faces room 3"], Int32[np.ndarray, "faces"]]:
    seen, links, lengths = part
    faces, _, capacity, _ = seen.directions.shape
    triples = np.zeros((faces, 3 * capacity, 3), np.int16)
    sizes = np.zeros(faces, np.int32)
    fill_faces(np.arange(faces), seen, links, lengths, step, triples, sizes)
    return triples, sizes


def _thin(
    most: int,
    part: tuple[Layout, Int16[np.ndarray, "faces room 3"], Int32[np.ndarray, "faces"]],
) -> Bool[np.ndarray, "faces room"]:
    seen, triples, sizes = part
    kept = np.zeros(triples.shape[:2], bool)
    thin_faces(np.arange(len(sizes)), seen, triples, sizes, most, kept)
    return kept


def _packed(
    polygons: VisibilityPolygons,
    stored: int,
    faces: Int[np.ndarray, "faces"],
    seen: Layout,
    triples: Int16[np.ndarray, "faces room 3"],
    sizes: Int32[np.ndarray, "faces"],
    *,
    most: int,
) -> CorrespondingPolygons:
    """Lists without their padding, of all faces, with at most so many triples evaluated."""
    thinned = _in_batches(_thin, (most,), (seen, triples, sizes))
    kept = np.concatenate([np.zeros((0, triples.shape[1]), bool), *thinned])
    some = np.arange(triples.shape[1]) < sizes[:, None]
    lengths, far = np.zeros(stored, np.int32), np.ones(stored, np.float32)
    lengths[faces], far[faces] = sizes, seen.distances
    return CorrespondingPolygons(
        polygons,
        triples=jnp.asarray(triples[some]),
        evaluated=jnp.asarray(kept[some]),
        starts=jnp.asarray(np.concatenate([[0], np.cumsum(lengths)]), jnp.int32),
        distances=jnp.asarray(far),
        separate=jnp.zeros(stored, bool),
    )


def _without(
    corresponding: CorrespondingPolygons, separate: Bool[np.ndarray, "faces"]
) -> CorrespondingPolygons:
    """The same with no triples in some faces."""
    lengths = np.diff(np.asarray(corresponding.starts))
    some = ~np.repeat(separate, lengths)
    starts = np.concatenate([[0], np.cumsum(np.where(separate, 0, lengths))])
    return CorrespondingPolygons(
        corresponding.polygons,
        triples=corresponding.triples[some],
        evaluated=corresponding.evaluated[some],
        starts=jnp.asarray(starts, jnp.int32),
        distances=corresponding.distances,
        separate=jnp.asarray(separate),
    )
