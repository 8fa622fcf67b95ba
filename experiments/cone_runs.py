"""What the tables of hybrid cone tracing share: ground truth, lit maps, their bytes and errors.

Used by :mod:`experiments.cone_table`.
"""

import contextlib
import threading
from collections.abc import Iterator
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float32

from experiments.measuring import resident_megabytes
from jaxvis.compare.measurement import finite_image
from jaxvis.compare.setting import Setting
from jaxvis.image import flip, psnr, relative_rmse
from jaxvis.methods import HybridCones, Reference, VoxelCones
from jaxvis.methods.cones.cells import range_table
from jaxvis.methods.cones.march import Lightmaps
from jaxvis.methods.cones.volume import FACES, level_offset
from jaxvis.methods.traced import shading_points, to_image

Pixels = Float32[np.ndarray, "height width 3"]

BRICK = 8
"""Voxels along a side of the blocks in which sparse volumes are counted."""

PAUSE = 0.005
"""Seconds between looks at the memory held."""


@dataclass(frozen=True, eq=False)
class Truth:
    """Ray-traced images of a setting with one bounce: all light, and that of the bounce."""

    setting: Setting
    image: Pixels
    indirect: Pixels
    error: float
    """Standard error of the image, relative to its mean."""

    @staticmethod
    def of(setting: Setting, error: float, rays: int) -> "Truth":
        """The images of ``reference``, from the disk if they were rendered before.

        Args:
            setting: what is seen.
            error: most that the whole image's standard error may be.
            rays: bounce rays of each pixel, at first.
        """
        method = Reference(error=error, bounces=1, bounce_rays=rays)
        visibility = method.precompute(setting.scene, progress=False)
        found, _ = method.solve_cached(
            visibility, method.light(setting.environment), setting.surface
        )
        return Truth(setting, np.asarray(found.image), np.asarray(found.indirect), found.error)

    @property
    def indirect_error(self) -> float:
        """At most, as if all noise were in the bounce: relative to its mean."""
        covered = self.setting.covered
        return self.error * float(self.image[covered].mean() / self.indirect[covered].mean())

    def errors(self, lit: "Lit") -> dict[str, Any]:
        """Of the whole image, and of its indirect part alone."""
        covered, whole = self.setting.covered, lit.whole(self.setting)
        return {
            "RMSE %": 100.0 * relative_rmse(whole, self.image, covered),
            "dB": psnr(whole, self.image, covered),
            "FLIP": flip(whole, self.image, covered),
            "indirect RMSE %": 100.0
            * relative_rmse(lit.indirect(self.setting), self.indirect, covered),
        }


@dataclass(frozen=True, eq=False)
class Lit:
    """A scene's lightmaps under a light, as a method made them."""

    method: HybridCones
    visibility: Any
    light: Any
    maps: Lightmaps

    @staticmethod
    def of(method: HybridCones, setting: Setting) -> "Lit":
        visibility = method.precompute(setting.scene, progress=False)
        light = method.light(setting.environment)
        maps = jax.block_until_ready(method.lightmaps(visibility, light))
        return Lit(method, visibility, light, maps)

    def by(self, method: HybridCones) -> "Lit":
        """The same maps for another march, with the table of heights that it searches in."""
        maps, ranges = self.maps, None
        if method.search == "cells" and maps.plan is not None and maps.heights is not None:
            ranges = range_table(maps.heights, maps.plan, method.ranges)
        return replace(self, method=method, maps=replace(maps, ranges=ranges))

    def gather(self, setting: Setting) -> jax.Array:
        """Irradiance by cones of what is shaded."""
        return self.method.gather(self.visibility, self.maps, self.light, setting.surface)

    def whole(self, setting: Setting) -> Pixels:
        """What ``shade`` gives, without lighting the maps again."""
        return finite_image(
            self.method.shade_lit(self.visibility, self.maps, self.light, setting.surface)
        )

    def indirect(self, setting: Setting) -> Pixels:
        """The light of the maps alone, before a black sky."""
        black = replace(self.light, sky=jax.tree.map(jnp.zeros_like, self.light.sky))
        fallen = self.method.gather(self.visibility, self.maps, black, setting.surface)
        points = shading_points(setting.surface)
        radiance = np.asarray(points.material.base_colour * fallen / np.pi)
        return finite_image(to_image(setting.surface, points, radiance))


def name_of(method: HybridCones) -> str:
    """For tables: the method and the sizes of its maps."""
    if isinstance(method, VoxelCones):
        return f"voxel {method.voxels}³"
    return f"hybrid {method.voxels}³ + {method.texels}²"


def hybrid_of(text: str) -> HybridCones:
    """``128x2048`` as a method: voxels, then texels along a side.

    Raises:
        ValueError: not two whole numbers.
    """
    try:
        voxels, texels = map(int, text.split("x"))
    except ValueError:
        raise ValueError(f"a hybrid is VOXELSxTEXELS, as 128x2048; got {text!r}") from None
    return HybridCones(voxels=voxels, texels=texels, bounces=1)


def voxel_of(voxels: int) -> VoxelCones:
    return VoxelCones(voxels=voxels, bounces=1)


def table_bytes(maps: Lightmaps) -> dict[str, int]:
    """Bytes of the arrays that lightmaps hold: ``3D``, ``2D`` and the ``rest``."""
    volume = sum(int(channel.nbytes) for channel in maps.volume)
    level = sum(int(table.nbytes) for table in (*maps.colours, maps.heights) if table is not None)
    return {"3D": volume, "2D": level, "rest": maps.nbytes - volume - level}


def isotropic_bytes(maps: Lightmaps) -> int:
    """As :attr:`Lightmaps.nbytes` would be with voxels that look the same from all sides.

    Computed, not allocated: a sixth of the volume.
    """
    return maps.nbytes - table_bytes(maps)["3D"] * (FACES - 1) // FACES


def sparse_bytes(maps: Lightmaps) -> int:
    """As :attr:`Lightmaps.nbytes` would be if only bricks of 8^3 voxels in which any face of any
    voxel is opaque at all were kept, with a pointer of four bytes for each brick there might be.

    Levels of fewer than 8 voxels a side stay whole, as do the height field's maps. Computed from
    the opacity that is allocated.
    """
    if maps.grid is None:
        return maps.nbytes
    opacity = np.asarray(maps.volume[-1]).reshape(FACES, -1)
    voxel = FACES * sum(channel.dtype.itemsize for channel in maps.volume)
    total = 0
    for level in range(maps.grid.levels):
        n = maps.grid.resolution >> level
        start = level_offset(maps.grid.resolution, level)
        if n < BRICK:
            total += n**3 * voxel
            continue
        m = n // BRICK
        filled = (opacity[:, start : start + n**3] > 0.0).any(axis=0)
        bricks = filled.reshape(m, BRICK, m, BRICK, m, BRICK).any(axis=(1, 3, 5))
        total += int(bricks.sum()) * BRICK**3 * voxel + 4 * bricks.size
    return maps.nbytes - table_bytes(maps)["3D"] + total


@contextlib.contextmanager
def peak_memory() -> Iterator[SimpleNamespace]:
    """Most memory that the process held while this is entered, and what it held at first, in MB.

    Yields an object whose ``before`` is known at once and ``most`` afterwards.
    """
    before = resident_megabytes()
    found, done = SimpleNamespace(before=before, most=before), threading.Event()

    def look() -> None:
        while not done.wait(PAUSE):
            found.most = max(found.most, resident_megabytes())

    watcher = threading.Thread(target=look, daemon=True)
    watcher.start()
    try:
        yield found
    finally:
        done.set()
        watcher.join()
        found.most = max(found.most, resident_megabytes())
