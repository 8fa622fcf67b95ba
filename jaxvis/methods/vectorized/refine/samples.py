"""Places where a mesh has samples or may get some, and the samples (host)."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int, Int32

from jaxvis.methods.vectorized.polygons import VisibilityPolygons
from jaxvis.methods.vectorized.precompute import Settings, trace_samples
from jaxvis.methods.vertices import Around, placed_samples
from jaxvis.scene import Scene


class Traced(NamedTuple):
    """Samples and their polygons: fields of :class:`VisibilityPolygons`."""

    vectors: Float32[np.ndarray, "samples 4 capacity"]
    counts: Int32[np.ndarray, "samples"]
    positions: Float32[np.ndarray, "samples 3"]
    normals: Float32[np.ndarray, "samples 3"]
    buried: Bool[np.ndarray, "samples"]

    def take(self, chosen: Int[np.ndarray, "chosen"]) -> "Traced":
        """Some of them."""
        return Traced(*(field.take(chosen, axis=0) for field in self))

    def joined(self, *others: "Traced") -> "Traced":
        """These, then the others."""
        return Traced(*(np.concatenate(fields) for fields in zip(self, *others, strict=True)))


class Vertices(NamedTuple):
    """Places where a mesh has corners, or may get some."""

    positions: Float64[np.ndarray, "vertices 3"]
    normals: Float64[np.ndarray, "vertices 3"]
    """Interpolated from those of the first vertices as shading does; not unit."""
    front: Int32[np.ndarray, "vertices"]
    """Samples."""
    back: Int32[np.ndarray, "vertices"]
    """The same on the backs of two-sided triangles, -1 where there are none."""

    def joined(self, other: "Vertices") -> "Vertices":
        """These, then the others."""
        return Vertices(*(np.concatenate(fields) for fields in zip(self, other, strict=True)))


class Ground(NamedTuple):
    """The scene on which samples are placed."""

    scene: Scene
    two_sided: Bool[np.ndarray, "triangles"]

    @staticmethod
    def of(scene: Scene) -> "Ground":
        """With the triangles' sides."""
        both = np.array([m.two_sided for m in scene.materials])[scene.material_ids]
        return Ground(scene, both)

    def trace(
        self,
        positions: Float64[np.ndarray, "samples 3"],
        normals: Float64[np.ndarray, "samples 3"],
        around: Around,
        settings: Settings,
    ) -> Traced:
        """New samples.

        Args:
            positions: where.
            normals: on the samples' side, not unit.
            around: the triangles at the samples.
            settings: how finely.
        """
        placed = placed_samples(positions, normals, around, diagonal=self.scene.diagonal)
        single = positions.astype(np.float32)
        vectors, counts, hidden = trace_samples(
            self.scene, single, *placed, settings, progress=False
        )
        return Traced(vectors, counts, single, placed.normals, hidden)


def first_vertices(polygons: VisibilityPolygons) -> tuple[Vertices, Traced]:
    """The vertices and samples of triangles that are not refined. Vertices are front samples."""
    traced = Traced(*(np.asarray(getattr(polygons, name)) for name in Traced._fields))
    triangles, backs = np.asarray(polygons.triangles), np.asarray(polygons.backs)
    back = np.full(len(traced.counts), -1, np.int32)
    if len(backs):
        both = backs[:, 0] >= 0
        back[triangles[both]] = backs[both]
    vertices = Vertices(
        traced.positions.astype(np.float64),
        traced.normals.astype(np.float64),
        np.arange(len(back), dtype=np.int32),
        back,
    )
    return vertices, traced
