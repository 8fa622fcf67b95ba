"""Samples on the edges and in the triangles of a mesh, to see how well its corners interpolate."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Int, Int32, Int64

from jaxvis.methods.vectorized.precompute import Settings
from jaxvis.methods.vectorized.refine.bisection import Edges, Leaves, edge_keys
from jaxvis.methods.vectorized.refine.indicator import interpolation_errors
from jaxvis.methods.vectorized.refine.samples import Ground, Traced, Vertices
from jaxvis.methods.vertices import Around


class Probes(NamedTuple):
    """The edges whose midpoints were traced."""

    keys: Int64[np.ndarray, "probes"]
    """Ascending: see :func:`edge_keys`."""
    midpoint: Int32[np.ndarray, "probes"]
    """Vertices."""
    error: Float32[np.ndarray, "probes"]

    @staticmethod
    def none() -> "Probes":
        """Of a mesh that was not looked at yet."""
        return Probes(np.zeros(0, np.int64), np.zeros(0, np.int32), np.zeros(0, np.float32))

    def of(self, edges: Edges) -> "Probes":
        """Those of edges that all have one, in their order."""
        at = np.searchsorted(self.keys, edge_keys(edges.ends))
        return Probes(*(field[at] for field in self))

    def missing(self, edges: Edges) -> Int[np.ndarray, "missing"]:
        """Edges that have none."""
        return np.flatnonzero(~np.isin(edge_keys(edges.ends), self.keys))

    def joined(self, other: "Probes") -> "Probes":
        """Both."""
        fields = [np.concatenate(pair) for pair in zip(self, other, strict=True)]
        order = np.argsort(fields[0])
        return Probes(*(field[order] for field in fields))


def probe_edges(
    ground: Ground,
    settings: Settings,
    vertices: Vertices,
    traced: Traced,
    probes: Probes,
    leaves: Leaves,
    edges: Edges,
) -> tuple[Vertices, Traced, Probes]:
    """With vertices and samples at the midpoints of all edges that had none."""
    new = probes.missing(edges)
    ends = edges.ends[new]
    positions, normals = vertices.positions[ends].mean(axis=1), vertices.normals[ends].mean(axis=1)
    number = np.full(len(edges.ends), -1)
    number[new] = np.arange(len(new))
    leaf, corner = np.nonzero(number[edges.of] >= 0)
    root = leaves.root[leaf]
    around = Around(
        number[edges.of[leaf, corner]],
        ground.scene.geometric_normals[root],
        vertices.positions[leaves.corners].mean(axis=1)[leaf],
    )
    error = np.zeros(len(new), np.float32)
    own, added, count = [], [], len(traced.counts)
    for sign, samples, rows in (
        (1.0, vertices.front, np.ones(len(root), bool)),
        (-1.0, vertices.back, ground.two_sided[root]),
    ):
        chosen, rows = _on_side(around, sign, rows)
        found = ground.trace(positions[chosen], sign * normals[chosen], rows, settings)
        place = np.full(len(new), -1, np.int32)
        place[chosen] = count + np.arange(len(chosen))
        count += len(chosen)
        own.append(place)
        added.append(found)
        probe = chosen[rows.sample]
        errors = interpolation_errors(
            traced, samples[ends[probe]], found.take(rows.sample), rows.plane
        )
        np.maximum.at(error, probe, errors)
    midpoint = len(vertices.front) + np.arange(len(new), dtype=np.int32)
    return (
        vertices.joined(Vertices(positions, normals, *own)),
        traced.joined(*added),
        probes.joined(Probes(edge_keys(ends), midpoint, error)),
    )


def _on_side(
    around: Around, sign: float, rows: Bool[np.ndarray, "rows"]
) -> tuple[Int[np.ndarray, "chosen"], Around]:
    """(the samples that some rows have, these rows for them, turned to their side)."""
    chosen, sample = np.unique(around.sample[rows], return_inverse=True)
    return chosen, Around(sample, sign * around.plane[rows], around.centre[rows])


def probe_centres(
    ground: Ground, settings: Settings, vertices: Vertices, traced: Traced, leaves: Leaves
) -> Float32[np.ndarray, "leaves"]:
    """The errors at the centroids of triangles."""
    positions = vertices.positions[leaves.corners].mean(axis=1)
    normals = vertices.normals[leaves.corners].mean(axis=1)
    around = Around(
        np.arange(len(positions)), ground.scene.geometric_normals[leaves.root], positions
    )
    error = np.zeros(len(positions), np.float32)
    for sign, samples, rows in (
        (1.0, vertices.front, np.ones(len(positions), bool)),
        (-1.0, vertices.back, ground.two_sided[leaves.root]),
    ):
        chosen, rows = _on_side(around, sign, rows)
        found = ground.trace(positions[chosen], sign * normals[chosen], rows, settings)
        corners = samples[leaves.corners[chosen]]
        errors = interpolation_errors(traced, corners, found, rows.plane)
        error[chosen] = np.maximum(error[chosen], errors)
    return error
