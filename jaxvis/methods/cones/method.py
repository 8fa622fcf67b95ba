"""Hybrid cone tracing (paper 003), and the voxel cone tracing that it is compared with."""

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, TypeVar, get_args

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from jaxvis.chunks import block_of, chunked_map
from jaxvis.cores import core_count
from jaxvis.devices import dealer, device_count
from jaxvis.lighting import Environment
from jaxvis.methods.base import Method, refuse_spheres
from jaxvis.methods.cones.cells import Accumulation, Fit, Ranges, range_table
from jaxvis.methods.cones.cones import cone_set
from jaxvis.methods.cones.inject import (
    colours_of,
    constant,
    irradiance,
    irradiance_of_patches,
    irradiance_of_texels,
    lit,
    volume_of,
)
from jaxvis.methods.cones.light import ConeLight, cone_light
from jaxvis.methods.cones.march import (
    Lightmaps,
    March,
    Points,
    Search,
    Stepping,
    cone_radiosity,
)
from jaxvis.methods.cones.ranges import PowerSums
from jaxvis.methods.cones.visibility import ConeVisibility, build
from jaxvis.methods.traced import ShadingPoints, shading_points, to_image
from jaxvis.scene import RayTracer, Scene, Surface

T = TypeVar("T")

POINTS_AT_ONCE = 4096
"""Points whose cones are followed together: their state stays in the cache."""

FEW_POINTS = 1024
"""And in images that have no more, so that they are padded less."""

SKY_STRIDE = 4
"""Texels between those at which light from the sky is traced."""


@dataclass(frozen=True)
class HybridCones(Method):
    """Diffuse light by cones through voxels and a height field (paper 003).

    Connected meshes whose surface is a height field, to ``threshold`` of their diagonal (eq. 5),
    are stored in a 2D lightmap of ``texels``^2 (0: none are); all others in a 3D lightmap of
    ``voxels``^3, whose voxels look different from six sides. Each pixel sends ``cones`` cones of an
    ``aperture`` in radians: they meet the lightmaps at levels of their own width, and what is left
    of them the sky, averaged over a cone. With ``bounces=1`` the lightmaps send on, diffusely, the
    light of the environment that falls on them, by ``directions`` shadow rays each.

    Up to ``suns`` small bright sources are taken out of the environment and shine with traced
    shadows, from every pixel. Only the base colour reflects: specular light is left out, as in the
    paper.

    Cones of surfaces in voxels start ``offset`` voxels off them, along the normal and along their
    axes: less darkens curved surfaces by themselves, more leaves out what touches them. By default
    it is 1/4 with cubes and 1 with half steps, which look farther back.

    ``stepping="cubes"`` marches by cubes that touch one another (eq. 10), ``"half"`` by half of the
    cone's width.

    ``search="horizon"`` follows the height field's horizon along three azimuths of a cone.
    ``"cells"`` is the paper's search, of 3 x 3 cells in each cube that the heights may reach, as
    ``ranges`` tell: ``"pyramid"`` for exact bounds, ``"hsat"`` for the paper's. It accumulates the
    share of cells that are met, by ``accumulation="paper"`` less at the beginning of a cone (eq.
    17). ``fit="paper"`` fits cubes to cones that are not parallel to an axis by eq. 11.
    """

    voxels: int = 128
    texels: int = 2048
    cones: int = 6
    aperture: float = math.pi / 3.0
    stepping: Stepping = "cubes"
    bounces: int = 0
    suns: int = 2
    directions: int = 64
    threshold: float = 1e-3
    offset: float | None = None
    search: Search = "horizon"
    fit: Fit = "clean"
    accumulation: Accumulation = "clean"
    ranges: Ranges = "pyramid"

    def __post_init__(self) -> None:
        for name, none in (("voxels", False), ("texels", True)):
            value = getattr(self, name)
            if (value < 4 or value & (value - 1)) and not (none and value == 0):
                also = ", or 0 for voxels alone" if none else ""
                raise ValueError(f"{name} must be a power of two of at least 4{also}, got {value}")
        if self.voxels > 512 or self.texels > 8192:
            raise ValueError(
                f"voxels may be 512 and texels 8192 at most, got {self.voxels} and {self.texels}"
            )
        cone_set(self.cones)
        if isinstance(self.aperture, float | int) and not 0.05 <= self.aperture <= 2.0:
            raise ValueError(f"aperture must be from 0.05 to 2 radians, got {self.aperture}")
        if self.stepping not in get_args(Stepping):
            raise ValueError(f"stepping must be cubes or half, got {self.stepping!r}")
        for name, kind in (
            ("search", Search),
            ("fit", Fit),
            ("accumulation", Accumulation),
            ("ranges", Ranges),
        ):
            if getattr(self, name) not in get_args(kind):
                choice = " or ".join(get_args(kind))
                raise ValueError(f"{name} must be {choice}, got {getattr(self, name)!r}")
        if self.stepping != "cubes" and (self.search != "horizon" or self.fit != "clean"):
            raise ValueError(f"search=cells and fit=paper need stepping=cubes, got {self.stepping}")
        if self.fit == "paper" and isinstance(self.aperture, float | int) and self.aperture > 1.5:
            raise ValueError(
                f"aperture may be 1.5 radians at most with fit=paper, got {self.aperture}"
            )
        if self.bounces not in (0, 1):
            raise ValueError(f"bounces must be 0 or 1, got {self.bounces}")
        if self.suns < 0:
            raise ValueError(f"suns must be at least 0, got {self.suns}")
        if self.directions < 8:
            raise ValueError(f"directions must be at least 8, got {self.directions}")
        if self.offset is not None and not 0.0 < self.offset <= 4.0:
            raise ValueError(f"offset must be above 0 and at most 4 voxels, got {self.offset}")
        if not self.threshold > 0.0:
            raise ValueError(f"threshold must be positive, got {self.threshold}")

    def precompute(self, scene: Scene, progress: bool = True) -> ConeVisibility:
        """Voxels and heights, with what light falls on if it bounces."""
        found = build(scene, self.voxels, self.texels, self.threshold, self.bounces > 0)
        return replace(found, maps=self._with_ranges(found.maps))

    def light(self, environment: Environment) -> ConeLight:
        """The suns, the sky averaged over cones, and lights that stand for it in shadow rays."""
        refuse_spheres(environment, self)
        return cone_light(environment, self.suns, self.directions)

    def lightmaps(self, visibility: ConeVisibility, light: ConeLight) -> Lightmaps:
        """The maps lit: black without bounces.

        Raises:
            ValueError: the visibility was made without bounces.
        """
        maps = self._with_ranges(visibility.maps)
        if not self.bounces:
            return maps
        solid, level = visibility.volume, visibility.plan
        if (maps.grid is not None and solid is None) or (maps.plan is not None and level is None):
            raise ValueError("the visibility was precomputed with bounces=0: precompute it again")
        if maps.grid is not None and solid is not None:
            seen = np.asarray(solid.origin), np.asarray(solid.normal)
            fallen = irradiance_of_patches(visibility.tracer, *seen, light)
            channels = volume_of(
                jnp.asarray(solid.albedo) / math.pi * fallen,
                *(solid.fronts, solid.backs, solid.two_sided, solid.slot, solid.voxels),
                resolution=maps.grid.resolution,
                count=len(solid.voxels),
            )
            maps = replace(maps, volume=channels)
        if maps.plan is not None and level is not None:
            seen = np.asarray(level.origin), np.asarray(level.normal)
            size = maps.plan.resolution
            fallen = irradiance_of_texels(visibility.tracer, *seen, light, size, SKY_STRIDE)
            colours = colours_of(jnp.asarray(level.albedo) / math.pi * fallen, size)
            maps = replace(maps, colours=colours)
        return maps

    def shade(
        self,
        visibility: ConeVisibility,
        light: ConeLight,
        surface: Surface,
        *,
        key: jax.Array | None = None,
        progress: bool = False,
    ) -> Float[Array, "height width 3"]:
        """Light from the sky and, with bounces, from surfaces through cones; from suns by rays."""
        return self.shade_lit(visibility, self.lightmaps(visibility, light), light, surface)

    def shade_lit(
        self, visibility: ConeVisibility, maps: Lightmaps, light: ConeLight, surface: Surface
    ) -> Float[Array, "height width 3"]:
        """:meth:`shade` with maps that :meth:`lightmaps` lit: for many views of a light."""
        points = shading_points(surface)
        fallen = self.gather(visibility, maps, light, surface)
        if len(light.sun_flux):
            fallen = fallen + _from_suns(visibility.tracer, points, light)
        # On the host, as the number of points is another in every view.
        on_host = not any(isinstance(x, Tracer) for x in (fallen, points.material.base_colour))
        albedo = points.material.base_colour
        reflected = np.asarray(albedo) * fallen if on_host else albedo * fallen
        return to_image(surface, points, reflected * np.float32(1.0 / math.pi))

    def gather(
        self, visibility: ConeVisibility, maps: Lightmaps, light: ConeLight, surface: Surface
    ) -> Float[Array | np.ndarray, "points 3"]:
        """Irradiance of each shaded point of the surface by cones alone."""
        points = shading_points(surface)
        position = np.asarray(surface.position).reshape(-1, 3)[np.asarray(points.pixel)]
        triangle = np.asarray(surface.triangle).reshape(-1)[np.asarray(points.pixel)]
        voxel = 0.0 if maps.grid is None else float(maps.grid.voxel)
        texel = 0.0 if maps.plan is None else float(maps.plan.texel)
        flat = np.asarray(visibility.flat)[triangle]
        # A cone begins off its own surface: in voxels by ``offset``, in the height field, beside
        # which all voxels are of others, by a texel.
        off = self._offset * voxel
        away, first = np.where(flat, 0.25 * texel, off), np.where(flat, texel, off)
        apart = np.where(flat, 0.0, off)
        lengths = (length.astype(np.float32) for length in (away, first, apart))
        starts = Points(*map(jax.device_put, (position, points.normal, *lengths)))
        march = self._march(maps)

        def trace(some: Points) -> Array:
            return cone_radiosity(maps, light.sky, some, self.aperture, march)

        return _in_threads(trace, starts, (maps, light, self.aperture))

    @property
    def _offset(self) -> float:
        if self.offset is not None:
            return self.offset
        return 0.25 if self.stepping == "cubes" else 1.0

    def _with_ranges(self, maps: Lightmaps) -> Lightmaps:
        """With the table that the search asks; without one from a file, or for the other search."""
        if self.search != "cells" or maps.plan is None or maps.heights is None:
            return maps
        if maps.ranges is not None and isinstance(maps.ranges, PowerSums) == (
            self.ranges == "hsat"
        ):
            return maps
        return replace(maps, ranges=range_table(maps.heights, maps.plan, self.ranges))

    def _march(self, maps: Lightmaps) -> March:
        """Steps from the first voxel or texel on until cones have crossed the scene."""
        nominal = self.aperture if isinstance(self.aperture, float | int) else math.pi / 3.0
        wide = 2.0 * math.tan(0.5 * nominal)
        # The smallest cubes of eq. 11 are those with a diagonal across the cone.
        step = 0.5 if self.stepping == "half" else math.sqrt(0.5 if self.fit == "clean" else 1 / 3)
        growth = 1.0 + wide * step
        starts, sizes, extents = [], [], []
        if maps.grid is not None:
            starts.append(self._offset * float(maps.grid.voxel))
            sizes.append(float(maps.grid.voxel))
            extents.append(sizes[-1] * maps.grid.resolution)
        if maps.plan is not None:
            starts.append(float(maps.plan.texel))
            sizes.append(starts[-1])
            extents.append(sizes[-1] * maps.plan.resolution)
        first, largest = sizes[0], math.sqrt(3.0) * max(extents)
        near = math.log(first / min(starts)) / math.log(growth)
        steps = math.log(largest / first) / math.log(growth)
        return March(
            self.stepping,
            self.cones,
            math.ceil(steps) + 1,
            max(math.ceil(near), 0),
            self.search,
            self.fit,
            self.accumulation,
        )

    def evaluations(self, visibility: Any, light: ConeLight, surface: Surface) -> int:
        """Cones."""
        return int(jnp.sum(surface.mask)) * self.cones


@dataclass(frozen=True)
class VoxelCones(HybridCones):
    """Voxel cone tracing (Crassin et al. 2011), paper 003's baseline: all in one 3D lightmap.

    The same voxels, cones, sky and light as :class:`HybridCones`, by steps of half a cone's width.
    """

    voxels: int = 256
    texels: int = 0
    stepping: Stepping = "half"


def _from_suns(
    tracer: RayTracer, points: ShadingPoints, light: ConeLight
) -> Float[Array | np.ndarray, "points 3"]:
    """Irradiance of each point by the suns that it sees."""
    along = constant(light.sun_directions)
    seen = lit(tracer, np.asarray(points.origin), np.asarray(points.normal), along)
    # A shading normal may face a sun that its triangle does not.
    seen &= np.asarray(points.geometric_normal) @ along.T > 0.0

    def fallen(some: Any) -> Array:
        return irradiance(*some, light.sun_directions, light.sun_flux)

    return _in_threads(fallen, (points.normal, seen), light)


def _in_threads(
    function: Callable[[T], Float[Array, "few 3"]], points: T, others: Any
) -> Float[Array | np.ndarray, "points 3"]:
    """A function of points in blocks of one size, several at once: XLA runs the loops inside each
    on one core.

    In one compiled loop where JAX transforms the function, whose traces belong to a thread.

    Args:
        others: what else the function depends on.
    """
    count = len(jax.tree.leaves(points)[0])
    if not count:
        return np.zeros((0, 3), np.float32)
    size = POINTS_AT_ONCE if count > FEW_POINTS else FEW_POINTS
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(others)):
        return chunked_map(function, jax.tree.map(jnp.asarray, points), size)
    deal = dealer()

    def of_block(start: int) -> np.ndarray:
        with deal(start // size):
            return np.asarray(function(block_of(points, start, size)))

    threads = max(core_count(), device_count())
    with ThreadPoolExecutor(threads, thread_name_prefix="jaxvis-cones") as pool:
        return np.concatenate(list(pool.map(of_block, range(0, count, size))))[:count]
