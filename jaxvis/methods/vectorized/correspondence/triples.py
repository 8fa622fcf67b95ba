"""Which position vectors of a triangle's three polygons correspond: triples (paper 000, III-B)."""

from dataclasses import dataclass
from os import PathLike

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxvis.cache import load_arrays, save_arrays
from jaxvis.methods.vectorized.polygons import FIELDS as POLYGON_FIELDS
from jaxvis.methods.vectorized.polygons import VisibilityPolygons

PAPER_BYTES_PER_TRIPLE = 24
"""Three indices of eight bytes (paper 000, table I)."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class CorrespondingPolygons:
    """Visibility polygons, and how those at each face's corners correspond.

    Faces are the triangles' fronts and then, if ``polygons.backs`` holds any, their backs: the rows
    of :class:`jaxvis.methods.vectorized.mesh.Mesh`. A triple names one position vector of each of a
    face's three polygons. Face f has ``triples[starts[f] : starts[f + 1]]``: one cyclic sequence
    that visits every vector of every corner in the polygons' order and goes round once. Vectors of
    a triple, weighted by a place's barycentric coordinates, make one of the place's polygon (eq.
    21), so that at a corner it is the corner's.

    Those not ``evaluated`` hardly change that polygon, and are left out of it: a list that visits
    every vector is longer than a polygon needs to be.

    ``distances`` puts points at infinity among finite ones: D metres away, if the scene is in
    metres. ``separate`` faces have no triples; their polygons are integrated one by one (eq. 19).
    Nor have the backs of triangles with one side.
    """

    polygons: VisibilityPolygons
    triples: Int[Array, "triples 3"]
    evaluated: Bool[Array, "triples"]
    starts: Int[Array, "faces_and_end"]
    distances: Float[Array, "faces"]
    separate: Bool[Array, "faces"]

    @property
    def nbytes(self) -> int:
        """Of all arrays, the polygons' included."""
        return sum(leaf.nbytes for leaf in jax.tree.leaves(self))

    @property
    def triple_bytes(self) -> int:
        """Of the triples as they are stored here."""
        return self.triples.nbytes

    @property
    def paper_triple_bytes(self) -> int:
        """Of the triples as paper 000 stores them."""
        return PAPER_BYTES_PER_TRIPLE * len(self.triples)

    def save(self, path: str | PathLike) -> None:
        """Writes an .npz file."""
        save_arrays(path, KIND, {**polygon_arrays(self.polygons), **own_arrays(self)})

    @classmethod
    def load(cls, path: str | PathLike) -> "CorrespondingPolygons":
        """Reads what :meth:`save` wrote.

        Raises:
            FileNotFoundError, ValueError: as :func:`jaxvis.cache.load_arrays`.
        """
        arrays, _ = load_arrays(path, KIND)
        arrays = {name: jnp.asarray(values) for name, values in arrays.items()}
        polygons = VisibilityPolygons(**{name: arrays[_PREFIX + name] for name in POLYGON_FIELDS})
        return cls(polygons, **{name: arrays[name] for name in FIELDS})


def own_arrays(corresponding: CorrespondingPolygons) -> dict[str, Array]:
    """What there is besides the polygons, by name."""
    return {name: getattr(corresponding, name) for name in FIELDS}


def polygon_arrays(polygons: VisibilityPolygons) -> dict[str, Array]:
    """The polygons' arrays, by names that differ from those of :func:`own_arrays`."""
    return {_PREFIX + name: getattr(polygons, name) for name in POLYGON_FIELDS}


KIND = "corresponding-polygons"
FIELDS = tuple(name for name in CorrespondingPolygons.__dataclass_fields__ if name != "polygons")
_PREFIX = "polygons_"
