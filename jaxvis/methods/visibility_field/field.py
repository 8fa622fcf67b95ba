"""What a discrete visibility field stores: two masks in every cell that holds surface."""

from dataclasses import dataclass, field
from os import PathLike

import jax
import numpy as np
from jaxtyping import Array, Int, Integer, UInt8, UInt32

from jaxvis.cache import load_arrays, save_arrays
from jaxvis.methods.traced import RayVisibility
from jaxvis.methods.visibility_field.grid import Grid
from jaxvis.scene import RayTracer

KIND = "visibility-field"
TEXELS_PER_WORD = 16
"""Two bits a texel, in words of 32."""

VISIBLE, OCCLUDED = 1, 2
"""Bits of a texel: some point of the cell sees the sky there; some point is blocked there (paper
001, eqs. 5 and 6). A texel with neither was never looked at."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class FieldVisibility:
    """Octahedral visibility and occlusion masks of the occupied cells of a grid.

    ``keys`` are the numbers of the occupied cells, ascending. ``words`` hold their masks: texel
    t = i * size + j of the octahedral map has its two bits (:data:`VISIBLE`, :data:`OCCLUDED`)
    at 2 (t mod 16) of word t div 16. ``visible`` and ``occluded`` count the bits of each cell, for
    labels. ``rays`` traces what the masks leave open.
    """

    grid: Grid
    keys: Int[Array | np.ndarray, "cells"]
    words: UInt32[Array | np.ndarray, "cells words"]
    visible: Integer[Array | np.ndarray, "cells"]
    occluded: Integer[Array | np.ndarray, "cells"]
    rays: RayVisibility
    size: int = field(metadata={"static": True})

    @property
    def nbytes(self) -> int:
        """Of the field alone; the triangles, which every traced method needs, come on top."""
        arrays = (self.grid.origin, self.grid.edge, self.keys, self.words)
        return sum(int(array.nbytes) for array in (*arrays, self.visible, self.occluded))

    @property
    def dense_bytes(self) -> int:
        """What the paper's layout takes: a byte a texel, with a border, for every cell."""
        return self.grid.cells * (self.size + 2) ** 2

    @property
    def rays_traced(self) -> int:
        """Rays traced through it so far."""
        return self.rays.rays_traced

    @property
    def tracer(self) -> RayTracer:
        """What traces the rays that are left."""
        return self.rays.tracer

    def texels(self) -> UInt8[np.ndarray, "cells size size"]:
        """The two bits of every texel, unpacked (host)."""
        return unpacked(np.asarray(self.words), self.size)

    def save(self, path: str | PathLike) -> None:
        """Writes an .npz file."""
        arrays = {name: getattr(self, name) for name in ("keys", "words", "visible", "occluded")}
        arrays |= {"origin": self.grid.origin, "edge": self.grid.edge}
        arrays |= {"positions": self.rays.positions, "triangles": self.rays.triangles}
        save_arrays(path, KIND, arrays, size=self.size, shape=list(self.grid.shape))

    @classmethod
    def load(cls, path: str | PathLike) -> "FieldVisibility":
        """Reads what :meth:`save` wrote and rebuilds the Embree tree.

        Raises:
            FileNotFoundError, ValueError: as :func:`jaxvis.cache.load_arrays`.
        """
        arrays, header = load_arrays(path, KIND)
        positions, triangles = arrays["positions"], arrays["triangles"]
        rays = RayVisibility(positions, triangles, RayTracer(positions, triangles))
        x, y, z = header["shape"]
        grid = Grid(arrays["origin"], arrays["edge"], (x, y, z))
        columns = {name: arrays[name] for name in ("keys", "words", "visible", "occluded")}
        return cls(grid, **columns, rays=rays, size=header["size"])


def packed(texels: UInt8[np.ndarray, "cells size size"]) -> UInt32[np.ndarray, "cells words"]:
    """Two bits a texel in words of 32 (host)."""
    flat = texels.reshape(len(texels), texels.shape[1] * texels.shape[2])
    missing = -flat.shape[1] % TEXELS_PER_WORD
    flat = np.pad(flat, ((0, 0), (0, missing)))
    flat = flat.reshape(len(texels), flat.shape[1] // TEXELS_PER_WORD, TEXELS_PER_WORD)
    words = np.zeros(flat.shape[:2], np.uint32)
    for place in range(TEXELS_PER_WORD):
        words |= (flat[..., place].astype(np.uint32) & 3) << np.uint32(2 * place)
    return words


def unpacked(
    words: UInt32[np.ndarray, "cells words"], size: int
) -> UInt8[np.ndarray, "cells size size"]:
    """What :func:`packed` packed."""
    places = 2 * np.arange(TEXELS_PER_WORD, dtype=np.uint32)
    texels = ((words[..., None] >> places) & 3).astype(np.uint8)
    return texels.reshape(len(words), -1)[:, : size * size].reshape(-1, size, size)
