"""What vectorized visibility stores: a polygon of position vectors at every vertex."""

from dataclasses import dataclass, field
from os import PathLike

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxvis.cache import load_arrays, save_arrays


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class VisibilityPolygons:
    """The boundary of the sky that each sample sees, as homogeneous position vectors (x, y, z, w).

    Finite points (w = 1) lie on occluders, in centred scene coordinates; points at infinity (w = 0)
    are unit directions at the rim of the sample's domain. From a place s near the sample a vector
    lies in the direction of (x, y, z) - w s (paper 000, equation 3).

    Each polygon is one cyclic sequence with the visible region on its left, seen from outside the
    sphere. Its loops are joined by double bridges, which cancel. After ``counts`` entries the last
    one repeats. A sample that sees nothing has one repeated point. A polygon may reach below its
    sample's tangent plane, for shading points with other normals: it must be clamped to theirs.

    ``triangles`` are the polygons of each mesh triangle's corners on its front, ``backs`` those on
    its back: -1 where the material has only one side, and none at all where that holds for the
    whole mesh. ``buried`` samples lie behind a surface that passes through their triangles: where a
    triangle has other corners they should not count.

    Where the scene's triangles are refined, ``triangles`` and ``backs`` are their parts, and
    ``splits`` and ``children`` lead from the scene's triangles to them
    (:class:`~jaxvis.methods.vectorized.refine.locate.Forest`). Otherwise both are empty.
    """

    vectors: Float[Array, "polygons 4 capacity"]
    counts: Int[Array, "polygons"]
    positions: Float[Array, "polygons 3"]
    normals: Float[Array, "polygons 3"]
    triangles: Int[Array, "triangles 3"]
    backs: Int[Array, "backs 3"]
    buried: Bool[Array, "polygons"]
    splits: Int[Array, "nodes"] = field(default_factory=lambda: jnp.zeros(0, jnp.int8))
    children: Int[Array, "nodes"] = field(default_factory=lambda: jnp.zeros(0, jnp.int32))

    @property
    def capacity(self) -> int:
        """Most vectors of a polygon."""
        return self.vectors.shape[-1]

    @property
    def nbytes(self) -> int:
        """Of all arrays."""
        return sum(leaf.nbytes for leaf in jax.tree.leaves(self))

    def save(self, path: str | PathLike) -> None:
        """Writes an .npz file."""
        save_arrays(path, KIND, {name: getattr(self, name) for name in FIELDS})

    @classmethod
    def load(cls, path: str | PathLike) -> "VisibilityPolygons":
        """Reads what :meth:`save` wrote.

        Raises:
            FileNotFoundError, ValueError: as :func:`jaxvis.cache.load_arrays`.
        """
        arrays, _ = load_arrays(path, KIND)
        return cls(**{name: jnp.asarray(arrays[name]) for name in FIELDS})


KIND = "visibility-polygons"
FIELDS = tuple(VisibilityPolygons.__dataclass_fields__)
