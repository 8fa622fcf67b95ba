"""2D lightmaps: heights over the ground plan, and horizons along them (paper 003, V-B and VI-B)."""

from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float32, Int

from jaxvis.reflectance import evaluate_materials
from jaxvis.scene import RayTracer, Scene

LARGEST = 65535
"""Of a height as it is stored: heights are whole numbers from 0, the lowest, to this."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Plan:
    """A square of n x n texels of the ground plan, seen from above."""

    low: Float[Array | np.ndarray, "3"]
    """The lowest corner and, as y, the lowest height (centred coordinates)."""
    texel: Float[Array | np.ndarray, ""]
    """Side of a texel."""
    rise: Float[Array | np.ndarray, ""]
    """Highest minus lowest height."""
    resolution: int = field(metadata={"static": True})
    """n, a power of two."""

    @staticmethod
    def around(
        low: Float[np.ndarray, "3"], high: Float[np.ndarray, "3"], resolution: int
    ) -> "Plan":
        """The square about a box's plan."""
        extent = max(float(high[0] - low[0]), float(high[2] - low[2]), 1e-12)
        corner = 0.5 * (low + high) - 0.5 * extent
        corner[1] = low[1]
        rise = max(float(high[1] - low[1]), 1e-6 * extent)
        texel, height = (np.asarray(size, np.float32) for size in (extent / resolution, rise))
        return Plan(corner.astype(np.float32), texel, height, resolution)

    @property
    def levels(self) -> int:
        """Of the mip chain, from n to 1 texels a side."""
        return self.resolution.bit_length()


class Seen(NamedTuple):
    """What is seen of a height field straight from above, at the texels' centres, x-major."""

    height: Float32[np.ndarray, "texels"]
    """0 to 1 over the plan's rise; 0 where there is nothing."""
    there: Bool[np.ndarray, "texels"]
    position: Float32[np.ndarray, "texels 3"]
    normal: Float32[np.ndarray, "texels 3"]
    """Geometric, upwards."""
    albedo: Float32[np.ndarray, "texels 3"]


def look_down(scene: Scene, chosen: Bool[np.ndarray, "triangles"], plan: Plan) -> Seen:
    """Rays straight down to some of the scene's triangles (host)."""
    ids = np.flatnonzero(chosen)
    n = plan.resolution
    centres = (np.arange(n) + 0.5) * float(plan.texel)
    origins = np.empty((n, n, 3), np.float32)
    origins[..., 0] = plan.low[0] + centres[:, None]
    origins[..., 1] = float(plan.low[1]) + 1.5 * float(plan.rise) + float(plan.texel)
    origins[..., 2] = plan.low[2] + centres
    origins = origins.reshape(-1, 3)
    down = np.broadcast_to(np.array([0.0, -1.0, 0.0], np.float32), origins.shape)
    hits = RayTracer(scene.positions, scene.triangles[ids]).closest_hit(origins, down)
    there = hits.triangle >= 0
    which = ids[hits.triangle[there]]
    weights = hits.barycentrics[there]
    height = np.where(there, origins[:, 1] - hits.distance, plan.low[1]).astype(np.float32)
    position = origins.copy()
    position[:, 1] = height
    normal = np.zeros((n * n, 3), np.float32)
    upward = scene.geometric_normals[which]
    normal[there] = upward * np.where(upward[:, 1:2] < 0.0, -1.0, 1.0)
    uv = None if scene.uvs is None else np.einsum("sk,skc->sc", weights, scene.uvs[which])
    paint = scene.colours
    colour = None if paint is None else np.einsum("sk,skc->sc", weights, paint[which])
    albedo = np.zeros((n * n, 3), np.float32)
    values = evaluate_materials(scene.materials, scene.material_ids[which], uv, colour)
    albedo[there] = values.base_colour
    return Seen((height - plan.low[1]) / plan.rise, there, position, normal, albedo)


@partial(jax.jit, static_argnames="resolution")
def mip_chain(base: Float[Array, "texels"], resolution: int) -> Float[Array, "cells"]:
    """All levels of a map, each the mean of the four texels below it; one flat array."""
    level = base.reshape(resolution, resolution)
    levels = [level.reshape(-1)]
    while level.shape[0] > 1:
        half = level.shape[0] // 2
        level = level.reshape(half, 2, half, 2).mean(axis=(1, 3))
        levels.append(level.reshape(-1))
    return jnp.concatenate(levels)


@jax.jit
def stored_heights(heights: Float[Array, "cells"]) -> Array:
    """Heights as 16-bit whole numbers: those of a 100 m rise are exact to a millimetre."""
    return jnp.round(jnp.clip(heights, 0.0, 1.0) * LARGEST).astype(jnp.uint16)


def level_offset(resolution: int, level: int) -> int:
    """Texels in all levels before one."""
    return sum((resolution >> finer) ** 2 for finer in range(level))


class Corners(NamedTuple):
    """The four texels about a place, and how much each counts."""

    cells: tuple[Int[Array, "*lanes"], ...]
    weights: tuple[Float[Array, "*lanes"], ...]

    def read(self, channel: Array, scale: float = 1.0) -> Float[Array, "*lanes"]:
        """Bilinear."""
        return sum(
            weight * scale * jnp.take(channel, cell, mode="clip").astype(jnp.float32)
            for cell, weight in zip(self.cells, self.weights, strict=True)
        )  # pyright: ignore


def corners(
    plan: Plan, x: Float[Array, "*lanes"], z: Float[Array, "*lanes"], level: Int[Array, "*#lanes"]
) -> Corners:
    """Where to read a level of the map at places (centred coordinates); the border goes on."""
    offsets = [level_offset(plan.resolution, k) for k in range(plan.levels)]
    start = jnp.asarray(offsets, jnp.int32)[level]
    side = jnp.right_shift(jnp.int32(plan.resolution), level)
    scale = jnp.exp2(-level.astype(jnp.float32)) / plan.texel
    last = (side - 1).astype(jnp.float32)
    lows, highs, shares = [], [], []
    for place, corner in ((x, plan.low[0]), (z, plan.low[2])):
        q = jnp.clip((place - corner) * scale - 0.5, 0.0, last)
        i = jnp.minimum(jnp.floor(q), jnp.maximum(last - 1.0, 0.0))
        lows.append(i.astype(jnp.int32))
        highs.append(jnp.minimum(lows[-1] + 1, side - 1))
        shares.append(q - i)
    u, v = shares
    return Corners(
        (
            start + lows[0] * side + lows[1],
            start + lows[0] * side + highs[1],
            start + highs[0] * side + lows[1],
            start + highs[0] * side + highs[1],
        ),
        ((1.0 - u) * (1.0 - v), (1.0 - u) * v, u * (1.0 - v), u * v),
    )
