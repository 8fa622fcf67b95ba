"""Vectorized visibility as a method: precompute, light, shade (paper 000)."""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Literal, get_args

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32

from jaxvis.cache import cached_arrays, content_hash
from jaxvis.lighting import Environment
from jaxvis.methods.base import Method, refuse_spheres
from jaxvis.methods.vectorized.contrast import contrast
from jaxvis.methods.vectorized.correspondence.interpolated import polygons_of
from jaxvis.methods.vectorized.correspondence.triples import CorrespondingPolygons
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
from jaxvis.methods.vectorized.refine.refine import Goal, refine_polygons
from jaxvis.methods.vectorized.resolve import diffuse_image, glossy_image
from jaxvis.methods.vectorized.tessellation import edge_levels, plan_tessellation
from jaxvis.reflectance import Lambert
from jaxvis.scene import Scene, Surface
from jaxvis.sphere.contours import Lookup

Shading = Literal["tessellated", "fragment", "vertex"]
Integration = Literal["split", "vsat"]

Visibility = VisibilityPolygons | CorrespondingPolygons

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

    ``refine`` adds polygons between the vertices, first where interpolation errs most for its
    length, until no edge or triangle errs by more than this part of a uniform sky's irradiance, or
    the polygons take ``growth`` times the bytes of those at the vertices; None adds none.
    """

    vectors: int = 128
    shading: Shading = "tessellated"
    zeta: float = 2.0
    integration: Integration = "split"
    pieces: int | None = None
    lookup: Lookup = "nearest"
    sharpness: float | Literal["paper", "scaled"] = "scaled"
    resolution: int = Settings().resolution
    refine: float | None = None
    growth: float = Goal().growth

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
        self._goal.check()

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

    @property
    def _goal(self) -> Goal:
        goal = Goal(growth=self.growth)
        return goal if self.refine is None else goal._replace(target=self.refine)

    def precompute(self, scene: Scene, progress: bool = True) -> VisibilityPolygons:
        """Polygons at the vertices, and between them where ``refine`` asks for it.

        What an earlier call stored on disk is taken from there.
        """
        both = np.array([m.two_sided for m in scene.materials])[scene.material_ids]
        key = content_hash(scene.geometry_hash, both, tuple(self._settings), FIELDS)

        def trace() -> VisibilityPolygons:
            return precompute_polygons(scene, self._settings, progress=progress)

        polygons = _cached(key, trace)
        if self.refine is None:
            return polygons

        def refine() -> VisibilityPolygons:
            options = {"settings": self._settings, "progress": progress}
            return refine_polygons(scene, polygons, self._goal, **options)[0]

        return _cached(content_hash(key, tuple(self._goal)), refine)

    def light(self, environment: Environment) -> PolygonLight:
        """Summed-area tables of the environment, and its Phong lobes.

        Raises:
            ValueError: it has local lights.
        """
        refuse_spheres(environment, self)
        return polygon_light(environment, lookup=self.lookup, sharpness=self.sharpness)

    def shade(
        self,
        visibility: Visibility,
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

    def plan(self, visibility: Visibility, light: PolygonLight, surface: Surface) -> Plan:
        """Where :meth:`shade` evaluates the light, and how pixels interpolate it.

        A tessellation depends on the light, as a constant: gradients do not see it.

        Raises:
            ValueError: geometry is traced, or the light of a tessellation is, by vmap or jit.
        """
        return self._plan(visibility, light, surface)[0]

    def shade_planned(
        self,
        visibility: Visibility,
        light: PolygonLight,
        surface: Surface,
        plan: Plan,
    ) -> Float[Array, "height width 3"]:
        """:meth:`shade` with a plan that was made before, perhaps for another light."""
        return self._shade(visibility, light, surface, plan, None)

    def evaluations(self, visibility: Visibility, light: PolygonLight, surface: Surface) -> int:
        """Polygons that are integrated; under the blurred environment, too."""
        return self.plan(visibility, light, surface).evaluations

    def _plan(
        self, visibility: Visibility, light: PolygonLight, surface: Surface
    ) -> tuple[Plan, Float32[np.ndarray, "corners 3"] | None]:
        """The plan, and the irradiance at its first sites if it is known already."""
        self._require(visibility)
        polygons = polygons_of(visibility)
        _require_known(polygons, surface)
        mesh = Mesh.of(polygons)
        pixels = shaded_pixels(mesh, surface)
        if self.shading == "fragment":
            return plan_fragments(visibility, mesh, pixels, surface), None
        faces = faces_in_view(mesh, pixels)
        corners = polygons_in_view(mesh, faces, len(polygons.counts))
        difference = np.zeros(len(polygons.counts), np.float32)
        found = None
        if self.shading == "tessellated":
            sites = corner_sites(polygons, corners)
            found, difference[corners] = self._differences(polygons, light, sites)
        zeta = self.zeta if self.shading == "tessellated" else 0.0
        levels = edge_levels(mesh, faces, difference, zeta)
        plan = plan_tessellation(visibility, mesh, pixels, corners, levels, surface.mask.size)
        if self.shading == "tessellated":
            plan = plan._replace(evaluations=plan.evaluations + len(corners))
        return plan, None if is_traced(light) else found

    def _require(self, visibility: Visibility) -> None:
        if not isinstance(visibility, VisibilityPolygons):
            raise ValueError("vectorized shades VisibilityPolygons: give it visibility.polygons")

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
        visibility: Visibility,
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
        known = not is_traced(light, polygons_of(visibility), surface)
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


def _cached(key: str, build: Callable[[], VisibilityPolygons]) -> VisibilityPolygons:
    """Polygons from the disk, or else those of ``build``."""

    def fields() -> dict[str, Array]:
        found = build()
        return {name: getattr(found, name) for name in FIELDS}

    arrays, _ = cached_arrays(KIND, key, fields)
    return VisibilityPolygons(**{name: jnp.asarray(arrays[name]) for name in FIELDS})


def _require_known(visibility: VisibilityPolygons, surface: Surface) -> None:
    geometry = (surface.mask, surface.triangle, surface.barycentrics, surface.position)
    geometry += (surface.normal, surface.geometric_normal, surface.eye)
    if is_traced(geometry, visibility.counts, visibility.triangles, visibility.backs):
        raise ValueError(
            "geometry is planned on the host: jit and vmap over lights and materials only, with "
            "the surface and the visibility taken from outside"
        )
