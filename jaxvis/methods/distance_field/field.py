"""Signed distances at samples, and how vertices interpolate between them."""

from dataclasses import dataclass, field
from os import PathLike

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float16, Float32, Int, Int32, UInt8

from jaxvis.cache import load_arrays, save_arrays

KIND = "distance-fields"

ARRAYS = (
    "signed_distance",
    "frames",
    "bits",
    "samples",
    "near",
    "weights",
    "positions",
    "normals",
    "triangles",
    "backs",
)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class DistanceFields:
    """Spherical signed distance functions at samples, interpolated at a mesh's vertices.

    Vertices are those of all triangles' fronts and then, turned over, those of two-sided triangles'
    backs. A sample is one of them. Maps are on the grid of :mod:`jaxvis.sphere.hemisphere_grid`, in
    the frames' local coordinates. A vertex sees the sum of ``weights`` x the distances of the
    samples ``near`` it; all weights of a vertex that was not asked for are 0.
    """

    signed_distance: Float16[Array | np.ndarray, "samples n n"]
    """Radians to the nearest texel of the other class, negative where occluded (eq. 4)."""
    frames: Float[Array | np.ndarray, "samples 3 3"]
    """Rows: tangent, bitangent, normal."""
    bits: UInt8[Array | np.ndarray, "samples bytes"]
    """The visibility maps, eight texels a byte."""
    samples: Int[Array | np.ndarray, "samples"]
    """The vertex of each."""
    near: Int[Array | np.ndarray, "vertices near"]
    weights: Float[Array | np.ndarray, "vertices near"]
    positions: Float[Array | np.ndarray, "vertices 3"]
    normals: Float[Array | np.ndarray, "vertices 3"]
    triangles: Int[Array | np.ndarray, "triangles 3"]
    """Vertices at the corners of the fronts."""
    backs: Int[Array | np.ndarray, "backs 3"]
    """The same of the backs, -1 where there is none; empty if no triangle has one."""
    rays_traced: int = field(default=0, metadata={"static": True})
    """By what filled the maps."""
    density: float = field(default=0.0, metadata={"static": True})
    """Samples over vertices asked for when they were placed; where they are carried over from frame
    to frame there are no more, so that frames after many cost what the first did."""

    @property
    def resolution(self) -> int:
        """Texels along each side of a map."""
        return self.signed_distance.shape[-1]

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        return sum(int(getattr(self, name).nbytes) for name in ARRAYS)

    def maps(self) -> Bool[np.ndarray, "samples n n"]:
        """The visibility maps, true where the sky is seen."""
        return unpacked(np.asarray(self.bits), self.resolution)

    def save(self, path: str | PathLike) -> None:
        """Writes an .npz file."""
        arrays = {name: getattr(self, name) for name in ARRAYS}
        header = {"rays_traced": self.rays_traced, "density": self.density}
        save_arrays(path, KIND, arrays, **header)

    @classmethod
    def load(cls, path: str | PathLike) -> "DistanceFields":
        """Reads what :meth:`save` wrote.

        Raises:
            FileNotFoundError, ValueError: see :func:`jaxvis.cache.load_arrays`.
        """
        arrays, header = load_arrays(path, KIND)
        loaded = {name: jnp.asarray(arrays[name]) for name in ARRAYS}
        rays, density = int(header["rays_traced"]), float(header["density"])
        return cls(**loaded, rays_traced=rays, density=density)


def packed(maps: Bool[np.ndarray, "samples n n"]) -> UInt8[np.ndarray, "samples bytes"]:
    """Eight texels a byte."""
    return np.packbits(maps.reshape(len(maps), maps.shape[1] * maps.shape[2]), axis=-1)


def unpacked(
    bits: UInt8[np.ndarray, "samples bytes"], resolution: int
) -> Bool[np.ndarray, "samples n n"]:
    """What :func:`packed` took."""
    flat = np.unpackbits(bits, axis=-1, count=resolution**2)
    return flat.reshape(-1, resolution, resolution).view(np.bool_)


def corners_seen(
    fields: DistanceFields,
    triangle: Int[np.ndarray, "pixels"],
    geometric_normal: Float32[np.ndarray, "pixels 3"],
) -> Int32[np.ndarray, "pixels 3"]:
    """The vertices at the corners of the sides that pixels see.

    Raises:
        ValueError: pixels see triangles, or backs of triangles, that have no samples.
    """
    triangles, backs = np.asarray(fields.triangles), np.asarray(fields.backs)
    if len(triangle) and triangle.max() >= len(triangles):
        raise ValueError("the surface was traced in another scene than the visibility's")
    corners = triangles.take(triangle, axis=0)
    a, b, c = (np.asarray(fields.positions).take(corners[:, k], axis=0) for k in range(3))
    behind = np.einsum("pc,pc->p", np.cross(b - a, c - a), geometric_normal) < 0.0
    if behind.any():
        turned = backs.take(triangle[behind], axis=0) if len(backs) else np.full((1, 3), -1)
        if turned.min() < 0:
            raise ValueError(
                "the surface shows backs of triangles without samples: make their materials "
                "two-sided before precomputing"
            )
        corners = corners.copy()
        corners[behind] = turned
    return corners
