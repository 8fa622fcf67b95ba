"""What cone tracing stores of a scene: lightmaps without light, and where light falls on them."""

from dataclasses import dataclass, field
from os import PathLike
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxvis.cache import load_arrays, save_arrays
from jaxvis.methods.cones.classify import height_field_meshes
from jaxvis.methods.cones.cones import own_azimuth
from jaxvis.methods.cones.heights import Plan, look_down, stored_heights
from jaxvis.methods.cones.heights import mip_chain as plan_chain
from jaxvis.methods.cones.inject import volume_of
from jaxvis.methods.cones.march import Lightmaps
from jaxvis.methods.cones.volume import Grid
from jaxvis.methods.cones.voxelize import projected_areas, voxelize
from jaxvis.scene import RayTracer, Scene

KIND = "cone-lightmaps"


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Receivers3D:
    """Patches of the surface in voxels, which receive direct light."""

    origin: Float[Array | np.ndarray, "patches 3"]
    normal: Float[Array | np.ndarray, "patches 3"]
    albedo: Float[Array | np.ndarray, "patches 3"]
    two_sided: Bool[Array | np.ndarray, "patches"]
    fronts: Float[Array | np.ndarray, "patches 6"]
    backs: Float[Array | np.ndarray, "patches 6"]
    slot: Int[Array | np.ndarray, "patches"]
    """Which of the occupied voxels a patch lies in."""
    voxels: Int[Array | np.ndarray, "occupied"]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Receivers2D:
    """Texels of the height field, which receive direct light."""

    origin: Float[Array | np.ndarray, "texels 3"]
    normal: Float[Array | np.ndarray, "texels 3"]
    albedo: Float[Array | np.ndarray, "texels 3"]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ConeVisibility:
    """Black lightmaps, and what is needed to light them."""

    maps: Lightmaps
    volume: Receivers3D | None
    plan: Receivers2D | None
    flat: Bool[np.ndarray, "triangles"]
    """Triangles that are in the height field."""
    positions: Float[np.ndarray, "vertices 3"]
    triangles: Int[np.ndarray, "triangles 3"]
    tracer: RayTracer = field(metadata={"static": True})

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays but the triangles'."""
        arrays = jax.tree.leaves((self.maps, self.volume, self.plan, self.flat))
        return sum(int(array.nbytes) for array in arrays)

    @property
    def rays_traced(self) -> int:
        """Rays traced through it so far."""
        return self.tracer.rays_traced

    def save(self, path: str | PathLike) -> None:
        """Writes an .npz file."""
        arrays: dict[str, Any] = {
            "flat": self.flat,
            "positions": self.positions,
            "triangles": self.triangles,
            "azimuth": self.maps.azimuth,
        }
        maps = self.maps
        header: dict[str, Any] = {"resolutions": [0, 0]}
        if maps.grid is not None:
            header["resolutions"][0] = maps.grid.resolution
            arrays |= {"grid_low": maps.grid.low, "voxel": maps.grid.voxel}
            arrays["opacity"] = maps.volume[0]
        if maps.plan is not None:
            header["resolutions"][1] = maps.plan.resolution
            arrays |= {"plan_low": maps.plan.low, "texel": maps.plan.texel, "rise": maps.plan.rise}
            arrays["heights"] = maps.heights
        for name, part in (("volume", self.volume), ("plan", self.plan)):
            if part is not None:
                arrays |= {f"{name}_{key}": value for key, value in vars(part).items()}
        save_arrays(path, KIND, arrays, **header)

    @classmethod
    def load(cls, path: str | PathLike) -> "ConeVisibility":
        """Reads what :meth:`save` wrote and rebuilds the Embree tree.

        Raises:
            FileNotFoundError, ValueError: see :func:`jaxvis.cache.load_arrays`.
        """
        arrays, header = load_arrays(path, KIND)
        voxels, texels = header["resolutions"]
        grid = plan = heights = None
        volume: tuple[Array, ...] = ()
        if voxels:
            grid = Grid(arrays["grid_low"], arrays["voxel"], voxels)
            volume = (jnp.asarray(arrays["opacity"]),)
        if texels:
            plan = Plan(arrays["plan_low"], arrays["texel"], arrays["rise"], texels)
            heights = jnp.asarray(arrays["heights"])

        def part(kind: type, name: str) -> Any:
            found = {f: arrays.get(f"{name}_{f}") for f in kind.__dataclass_fields__}
            return None if found["origin"] is None else kind(**found)

        positions, triangles = arrays["positions"], arrays["triangles"]
        return cls(
            Lightmaps(grid, volume, plan, heights, (), azimuth=np.float32(arrays["azimuth"])),
            part(Receivers3D, "volume"),
            part(Receivers2D, "plan"),
            arrays["flat"],
            positions,
            triangles,
            RayTracer(positions, triangles),
        )


def build(
    scene: Scene, voxels: int, texels: int, threshold: float, receivers: bool
) -> ConeVisibility:
    """Voxels and heights of a scene (host).

    Args:
        scene: any triangles.
        voxels: a side of the 3D lightmap.
        texels: a side of the 2D lightmap; 0 puts all triangles into voxels.
        threshold: below which a mesh counts as a height field (eq. 5).
        receivers: whether light is to fall on the maps.
    """
    flat = height_field_meshes(scene, threshold) if texels else np.zeros(len(scene.triangles), bool)
    grid = plan = heights = solid = level = None
    volume: tuple[Array, ...] = ()
    if not flat.all():
        solid_grid = Grid.around(*_box(scene, ~flat), voxels)
        solid, volume = _voxels(scene, ~flat, solid_grid)
        grid = solid_grid
    if flat.any():
        plan = Plan.around(*_box(scene, flat), texels)
        seen = look_down(scene, flat, plan)
        heights = stored_heights(plan_chain(jnp.asarray(seen.height), texels))
        if receivers:
            lift = 0.05 * float(plan.texel) * seen.normal
            level = Receivers2D(seen.position + lift, seen.normal, seen.albedo)
    return ConeVisibility(
        Lightmaps(grid, volume, plan, heights, (), azimuth=own_azimuth(scene.positions)),
        solid if receivers else None,
        level,
        flat,
        scene.positions,
        scene.triangles,
        scene.tracer,
    )


def _box(
    scene: Scene, chosen: Bool[np.ndarray, "triangles"]
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    corners = scene.positions[np.unique(scene.triangles[chosen])].astype(np.float64)
    return corners.min(axis=0), corners.max(axis=0)


def _voxels(
    scene: Scene, chosen: Bool[np.ndarray, "triangles"], grid: Grid
) -> tuple[Receivers3D, tuple[Array, ...]]:
    patches = voxelize(scene, chosen, grid)
    fronts, backs = projected_areas(patches)
    voxels, slot = np.unique(patches.voxel, return_inverse=True)
    # Off the surface, which bends within a voxel.
    origin = patches.position + 0.1 * float(grid.voxel) * patches.normal
    receivers = Receivers3D(
        origin,
        patches.normal,
        patches.albedo,
        patches.two_sided,
        fronts,
        backs,
        slot.astype(np.int32),
        voxels.astype(np.int32),
    )
    black = np.zeros((len(slot), 0), np.float32)
    volume = volume_of(
        *(black, fronts, backs, patches.two_sided, receivers.slot, receivers.voxels),
        resolution=grid.resolution,
        count=len(voxels),
    )
    return receivers, volume
