"""3D lightmaps: voxels that look different from six sides, and their mip chain (paper 003, V-B)."""

from dataclasses import dataclass, field
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float16, Int

FACES = 6
"""Ways in which a ray may go through a voxel: towards +x, -x, +y, -y, +z, -z."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Grid:
    """A cube of n x n x n voxels."""

    low: Float[Array | np.ndarray, "3"]
    """The lowest corner, in the scene's centred coordinates."""
    voxel: Float[Array | np.ndarray, ""]
    """Side of a voxel."""
    resolution: int = field(metadata={"static": True})
    """n, a power of two."""

    @staticmethod
    def around(
        low: Float[np.ndarray, "3"], high: Float[np.ndarray, "3"], resolution: int
    ) -> "Grid":
        """The cube about a box's centre that holds it with a voxel to spare on each side."""
        extent = max(float(np.max(high - low)), 1e-12)
        voxel = extent / max(resolution - 2, 1)
        corner = 0.5 * (low + high) - 0.5 * resolution * voxel
        return Grid(corner.astype(np.float32), np.asarray(voxel, np.float32), resolution)

    @property
    def levels(self) -> int:
        """Of the mip chain, from n to 1 voxels a side."""
        return self.resolution.bit_length()

    @property
    def cells(self) -> int:
        """Voxels of all levels."""
        return level_offset(self.resolution, self.levels)


def level_offset(resolution: int, level: int) -> int:
    """Voxels in all levels before one."""
    return sum((resolution >> finer) ** 3 for finer in range(level))


Channels = tuple[Float[Array, "entries"], ...]
"""One flat array a channel, all levels of one face after those of another. Opacity is the last; the
colours before it are premultiplied. Separate arrays because XLA fuses their loads on a CPU."""


@partial(jax.jit, static_argnames="resolution")
def mip_chain(base: tuple[Float16[Array, "6 voxels"], ...], resolution: int) -> Channels:
    """All levels of a volume from its finest one.

    Along the way that a ray goes, the nearer voxel covers the farther one; across it the four pairs
    are averaged. A wall stays opaque from the front, and thin from the side, at every level
    (Crassin et al. 2011, "Interactive Indirect Illumination Using Voxel Cone Tracing", section 6).

    Args:
        base: x-major voxels for each face: premultiplied channels, then opacity.
        resolution: voxels a side.
    """
    # All channels in one array: a quarter of the operations to compile.
    levels = [jnp.stack(base).reshape(len(base), FACES, *[resolution] * 3)]
    while levels[-1].shape[2] > 1:
        # Without a barrier XLA computes a level anew in the next, which takes long to compile.
        levels.append(jax.lax.optimization_barrier(_coarser(levels[-1])))
    return tuple(
        jnp.concatenate([level[c].reshape(FACES, -1) for level in levels], axis=1).reshape(-1)
        for c in range(len(base))
    )


def _coarser(level: Float[Array, "channels 6 n n n"]) -> Float[Array, "channels 6 m m m"]:
    pairs = []
    for axis in range(3):
        faces = level[:, 2 * axis : 2 * axis + 2].astype(jnp.float32)
        even, odd = _halves(faces, 2 + axis)
        # The second face of an axis meets the odd slices first.
        near = jnp.stack([even[:, 0], odd[:, 1]], axis=1)
        far = jnp.stack([odd[:, 0], even[:, 1]], axis=1)
        together = near + (1.0 - near[-1]) * far
        for other in range(3):
            if other != axis:
                even, odd = _halves(together, 2 + other)
                together = 0.5 * (even + odd)
        pairs.append(together.astype(jnp.float16))
    return jnp.concatenate(pairs, axis=1)


def _halves(values: Array, axis: int) -> tuple[Array, Array]:
    """Every second slice, and those between."""
    even = jax.lax.slice_in_dim(values, 0, None, 2, axis)
    odd = jax.lax.slice_in_dim(values, 1, None, 2, axis)
    return even, odd


def sample_volume(
    grid: Grid,
    channels: Channels,
    at: tuple[Float[Array, "*lanes"], ...],
    toward: tuple[Float[Array, "*lanes"], ...],
    level: Float[Array, "*#lanes"],
) -> tuple[Float[Array, "*lanes"], ...]:
    """Quadrilinear: eight voxels at each of two levels, from the three faces that a ray meets.

    Args:
        grid: where the voxels are.
        channels: their mip chain.
        at: x, y, z of the places, centred coordinates.
        toward: the rays' unit directions.
        level: 0 for the finest voxels; clipped to those that there are.
    """
    last = grid.levels - 1
    level = jnp.clip(level, 0.0, float(last))
    below = jnp.minimum(jnp.floor(level), float(max(last - 1, 0)))
    along = level - below
    place = [(a - grid.low[axis]) / grid.voxel for axis, a in enumerate(at)]
    whole = below.astype(jnp.int32)
    finer = _trilinear(grid, channels, place, toward, whole)
    if last == 0:
        return finer
    coarser = _trilinear(grid, channels, place, toward, whole + 1)
    return tuple(f + along * (c - f) for f, c in zip(finer, coarser, strict=True))


def _trilinear(
    grid: Grid,
    channels: Channels,
    place: list[Float[Array, "*lanes"]],
    toward: tuple[Float[Array, "*lanes"], ...],
    level: Int[Array, "*#lanes"],
) -> tuple[Float[Array, "*lanes"], ...]:
    offsets = [level_offset(grid.resolution, k) for k in range(grid.levels)]
    start = jnp.asarray(offsets, jnp.int32)[level]
    side = jnp.right_shift(jnp.int32(grid.resolution), level)
    scale = jnp.exp2(-level.astype(jnp.float32))
    last = (side - 1).astype(jnp.float32)
    low, high, share = [], [], []
    for p in place:
        q = jnp.clip(p * scale - 0.5, 0.0, last)
        i = jnp.minimum(jnp.floor(q), jnp.maximum(last - 1.0, 0.0))
        low.append(i.astype(jnp.int32))
        high.append(jnp.minimum(low[-1] + 1, side - 1))
        share.append(q - i)
    faces = [
        (jnp.where(d > 0.0, 2 * axis, 2 * axis + 1) * grid.cells, d * d)
        for axis, d in enumerate(toward)
    ]
    found = [jnp.float32(0.0)] * len(channels)
    for x, u in ((low[0], 1.0 - share[0]), (high[0], share[0])):
        for y, v in ((low[1], 1.0 - share[1]), (high[1], share[1])):
            for z, w in ((low[2], 1.0 - share[2]), (high[2], share[2])):
                cell = start + (x * side + y) * side + z
                corner = u * v * w
                for face, facing in faces:
                    weight = corner * facing
                    for c, channel in enumerate(channels):
                        value = jnp.take(channel, cell + face, mode="clip").astype(jnp.float32)
                        found[c] = found[c] + weight * value
    return tuple(found)
