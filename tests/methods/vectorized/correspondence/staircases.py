"""Correspondences that need no construction: entities in proportion to their numbers."""

import jax.numpy as jnp
import numpy as np

from jaxvis.methods.vectorized.correspondence import CorrespondingPolygons


def staircase(counts, seed=0):
    """A cyclic list that visits all of ``counts`` entities in order, from random first ones."""
    rng = np.random.default_rng(seed)
    length = max(counts) + int(rng.integers(0, 6))
    steps = np.arange(length)[:, None] * np.asarray(counts) // length
    return ((steps + rng.integers(0, counts)) % counts).astype(np.int16)


def corresponding(polygons, separate=None, distances=None, seed=0):
    """Polygons with a staircase for each face that is not ``separate``."""
    faces = np.concatenate([polygons.triangles, polygons.backs])
    separate = np.resize([False] if separate is None else separate, len(faces))
    counts = np.asarray(polygons.counts)
    lists = [
        np.zeros((0, 3), np.int16) if apart or face[0] < 0 else staircase(counts[face], seed + f)
        for f, (face, apart) in enumerate(zip(faces, separate, strict=True))
    ]
    return joined(polygons, lists, separate, distances)


def joined(polygons, lists, separate=None, distances=None):
    """Polygons with given lists of triples."""
    triples = np.concatenate([np.zeros((0, 3), np.int16), *lists]).astype(np.int16)
    starts = np.cumsum([0, *(len(triples) for triples in lists)])
    distances = np.resize([1.0] if distances is None else distances, len(lists))
    separate = np.zeros(len(lists), bool) if separate is None else separate
    return CorrespondingPolygons(
        polygons=polygons,
        triples=jnp.asarray(triples),
        evaluated=jnp.ones(len(triples), bool),
        starts=jnp.asarray(starts, jnp.int32),
        distances=jnp.asarray(distances, jnp.float32),
        separate=jnp.asarray(separate),
    )
