"""Vectorized visibility as a method: precompute, light, shade (paper 000)."""

from contextlib import nullcontext
from dataclasses import dataclass
from typing import Literal, get_args

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32

from jaxvis.cache import cached_arrays, content_hash
from jaxvis.lighting import Environment
from jaxvis.methods.base import Method
from jaxvis.methods.vectorized.contrast import contrast
from jaxvis.methods.vectorized.evaluation import Sites
from jaxvis.methods.vectorized.glossy import lobe_visibility
from jaxvis.methods.vectorized.irradiance import Quadrature, irradiance, is_traced
from jaxvis.methods.vectorized.light import PolygonLight, polygon_light
from jaxvis.methods.vectorized.mesh import Mesh, faces_in_view, polygons_in_view, shaded_pixels
from jaxvis.methods.vectorized.plan import (
    Plan,
    corner_sites,
    padded,
    plan_fragments,
)
from jaxvis.methods.vectorized.polygons import FIELDS, KIND, VisibilityPolygons
from jaxvis.methods.vectorized.precompute import Settings, precompute_polygons
from jaxvis.methods.vectorized.resolve import diffuse_image, glossy_image
from jaxvis.methods.vectorized.tessellation import edge_levels, plan_tessellation
from jaxvis.reflectance import Lambert
from jaxvis.scene import Scene, Surface
from jaxvis.sphere.contours import Lookup

Shading = Literal["tessellated", "fragment", "vertex"]
Integration = Literal["split", "vsat"]

LARGEST_ZETA = 8.0
"""Triangles in 65536 parts: more is a slip."""


@dataclass(frozen=True)
class VectorizedVisibility(Method):
    """Visibility polygons at the vertices, integrated against summed-area tables of the light.

    Light at a place in a triangle is the barycentric sum of the integrals over the polygons of its
    three corners, seen from that place (eq. 19). It is evaluated at every pixel
    (``shading="fragment"``), at the mesh's vertices (``"vertex"``), or at the vertices of triangles
    that are divided where the light changes fast (``"tessellated"``, eqs. 17 and 18), ``zeta``
    being how often edges are halved where blurring the environment makes a visible difference.
    Sites that triangles share are not clipped by the triangles' planes; pixels lose on average as
    much as these would hide.

    ``integration`` is ``"split"``, the trapezoidal rule on edges cut in ``pieces`` (2 by default),
    or ``"vsat"`` on whole edges (eqs. 9 to 12) with ``sharpness``: alpha' in 1 / radians,
    ``"paper"`` (5.8) or ``"scaled"`` by the edges' lengths. ``lookup`` reads the tables at the
    nearest texel corner or between corners.

    ``vectors`` is the most that a polygon has, ``resolution`` the cells along the hemisphere map
    from which it is traced.
    """

    vectors: int = 128
    shading: Shading = "tessellated"
    zeta: float = 2.0
    integration: Integration = "split"
    pieces: int | None = None
    lookup: Lookup = "nearest"
    sharpness: float | Literal["paper", "scaled"] = "scaled"
    resolution: int = Settings().resolution

    def __post_init__(self) -> None:
        for name, options in (
            ("shading", Shading),
            ("integration", Integration),
            ("lookup", Lookup),
        ):
            if getattr(self, name) not in get_args(options):
                allowed = ", ".join(get_args(options))
                raise ValueError(f"{name} must be one of {allowed}, got {getattr(self, name)!r}")
        if not 0.0 <= self.zeta <= LARGEST_ZETA:
            raise ValueError(f"zeta must be from 0 to {LARGEST_ZETA:g}, got {self.zeta}")
        if self.pieces is not None and self.pieces < 1:
            raise ValueError(f"pieces must be at least 1, got {self.pieces}")
        if self.integration == "vsat" and self.quadrature.pieces != 1:
            raise ValueError(
                f"integration 'vsat' leaves edges whole: pieces must be 1, got {self.pieces}"
            )
        self._settings.check()

    @property
    def quadrature(self) -> Quadrature:
        """How contours are integrated."""
        pieces = self.pieces or (2 if self.integration == "split" else 1)
        return Quadrature(self.integration, pieces, self.lookup)

    @property
    def _settings(self) -> Settings:
        return Settings(
            vectors=self.vectors, resolution=self.resolution, coarsest=self.resolution // 2
        )

    def precompute(self, scene: Scene, progress: bool = True) -> VisibilityPolygons:
        """Polygons at the vertices, or those that an earlier call stored on disk."""
        both = np.array([m.two_sided for m in scene.materials])[scene.material_ids]
        key = content_hash(scene.geometry_hash, both, tuple(self._settings), FIELDS)

        def build() -> dict[str, Array]:
            found = precompute_polygons(scene, self._settings, progress=progress)
            return {name: getattr(found, name) for name in FIELDS}

        arrays, _ = cached_arrays(KIND, key, build)
        return VisibilityPolygons(**{name: jnp.asarray(arrays[name]) for name in FIELDS})

    def light(self, environment: Environment) -> PolygonLight:
        """Summed-area tables of the environment, and its Phong lobes."""
        return polygon_light(environment, lookup=self.lookup, sharpness=self.sharpness)

    def shade(
        self,
        visibility: VisibilityPolygons,
        light: PolygonLight,
        surface: Surface,
        *,
        key: jax.Array | None = None,
        progress: bool = False,
    ) -> Float[Array, "height width 3"]:
        """The image. Differentiable with respect to light and material.

        Only they may be traced; where vmap or jit follow the light, ``shading="tessellated"`` needs
        a plan of its own: see :meth:`plan`.
        """
        plan, corners = self._plan(visibility, light, surface)
        return self._shade(visibility, light, surface, plan, corners)

    def plan(self, visibility: VisibilityPolygons, light: PolygonLight, surface: Surface) -> Plan:
        """Where :meth:`shade` evaluates the light, and how pixels interpolate it.

        A tessellation depends on the light, as a constant: gradients do not see it.

        Raises:
            ValueError: geometry is traced, or the light of a tessellation is, by vmap or jit.
        """
        return self._plan(visibility, light, surface)[0]

    def shade_planned(
        self,
        visibility: VisibilityPolygons,
        light: PolygonLight,
        surface: Surface,
        plan: Plan,
    ) -> Float[Array, "height width 3"]:
        """:meth:`shade` with a plan that was made before, perhaps for another light."""
        return self._shade(visibility, light, surface, plan, None)

    def evaluations(
        self, visibility: VisibilityPolygons, light: PolygonLight, surface: Surface
    ) -> int:
        """Polygons that are integrated; under the blurred environment, too."""
        return self.plan(visibility, light, surface).evaluations

    def _plan(
        self, visibility: VisibilityPolygons, light: PolygonLight, surface: Surface
    ) -> tuple[Plan, Float32[np.ndarray, "corners 3"] | None]:
        """The plan, and the irradiance at its first sites if it is known already."""
        _require_known(visibility, surface)
        mesh = Mesh.of(visibility)
        pixels = shaded_pixels(mesh, surface)
        if self.shading == "fragment":
            return plan_fragments(visibility, mesh, pixels, surface), None
        faces = faces_in_view(mesh, pixels)
        polygons = polygons_in_view(mesh, faces, len(visibility.counts))
        difference = np.zeros(len(visibility.counts), np.float32)
        found = None
        if self.shading == "tessellated":
            sites = corner_sites(visibility, polygons)
            found, difference[polygons] = self._differences(visibility, light, sites)
        zeta = self.zeta if self.shading == "tessellated" else 0.0
        levels = edge_levels(mesh, faces, difference, zeta)
        plan = plan_tessellation(visibility, mesh, pixels, polygons, levels, surface.mask.size)
        if self.shading == "tessellated":
            plan = plan._replace(evaluations=plan.evaluations + len(polygons))
        return plan, None if is_traced(light) else found

    def _differences(
        self, visibility: VisibilityPolygons, light: PolygonLight, sites: Sites
    ) -> tuple[Float32[np.ndarray, "sites 3"], Float32[np.ndarray, "sites"]]:
        """Irradiance, and how much blurring the light changes it (eq. 17)."""
        light = jax.tree.map(jax.lax.stop_gradient, light) if is_traced(light) else light
        if is_traced(light):
            raise ValueError(
                "shading='tessellated' divides triangles by the light, which vmap or jit hide: "
                "make the plan outside, as in method.shade_planned(..., method.plan(...)), or use "
                "shading='fragment'"
            )
        tables = light.vector, light.blurred
        both = np.asarray(irradiance(visibility, light, sites, self.quadrature, *tables))
        return both[:, :3], contrast(both[:, :3], both[:, 3:])

    def _shade(
        self,
        visibility: VisibilityPolygons,
        light: PolygonLight,
        surface: Surface,
        plan: Plan,
        corners: Float32[np.ndarray, "corners 3"] | None,
    ) -> Float[Array, "height width 3"]:
        done = 0 if corners is None else len(corners)
        rest = plan.sites.take(np.arange(done, len(plan.sites.normal)))
        found = irradiance(visibility, light, rest, self.quadrature, light.vector)
        found = found if corners is None else np.concatenate([corners, found])
        values = padded(found, plan.capacity)
        if isinstance(surface.reflectance, Lambert):
            return diffuse_image(values, plan.stencil, surface, clipped=plan.clipped)
        known = not is_traced(light, visibility, surface)
        with jax.ensure_compile_time_eval() if known else nullcontext():
            seen = lobe_visibility(
                visibility,
                light,
                plan,
                surface.material.roughness.reshape(-1),
                surface.eye,
                surface.reflectance,
                self.quadrature,
            )
        return glossy_image(values, seen, plan.stencil, surface, light, clipped=plan.clipped)


def _require_known(visibility: VisibilityPolygons, surface: Surface) -> None:
    geometry = (surface.mask, surface.triangle, surface.barycentrics, surface.position)
    geometry += (surface.normal, surface.geometric_normal, surface.eye)
    if is_traced(geometry, visibility.counts, visibility.triangles, visibility.backs):
        raise ValueError(
            "geometry is planned on the host: jit and vmap over lights and materials only, with "
            "the surface and the visibility taken from outside"
        )
