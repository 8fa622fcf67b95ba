"""Discrete visibility fields as a method, and the same estimator without a field (paper 001)."""

import math
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, get_args

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float
from tqdm.auto import tqdm

from jaxvis.cache import cached_arrays, content_hash
from jaxvis.lighting import Environment
from jaxvis.methods.base import Method, refuse_spheres, require_key
from jaxvis.methods.traced import RayVisibility, shading_points, to_image
from jaxvis.methods.visibility_field.build import (
    Masks,
    Sampling,
    Settings,
    trace_masks,
    traced_size,
    visibility_field,
)
from jaxvis.methods.visibility_field.cull import Labels, Table, rules
from jaxvis.methods.visibility_field.estimate import (
    Frame,
    all_frequency,
    diffuse,
    glossy,
)
from jaxvis.methods.visibility_field.field import FieldVisibility
from jaxvis.methods.visibility_field.grid import Grid
from jaxvis.methods.visibility_field.hemisphere import shifts
from jaxvis.methods.visibility_field.light import FieldLight
from jaxvis.methods.visibility_field.masks import Dilation
from jaxvis.methods.visibility_field.stages import RAYS_PER_CHUNK
from jaxvis.reflectance import Lambert
from jaxvis.sampling.random import key_words
from jaxvis.scene import RayTracer, Scene, Surface

Lighting = Literal["harmonics", "environment"]

CELLS_ALONG_DIAGONAL = 96
"""What the cell size is taken from if it is not given: about the paper's 50 cm in Sponza."""

LARGEST_MASKS = 127
"""Texels are counted in 16 bits, and traced at twice the size."""


@dataclass(frozen=True)
class Unculled(Method):
    """The estimator of :class:`VisibilityField` without a field: it traces every ray.

    ``lighting="harmonics"``: the environment's first nine spherical harmonics, as in the paper, by
    ``spp`` Hammersley rays a pixel, turned by blue noise; cosine-weighted where the reflectance is
    diffuse, else drawn by the BRDF. Rays are the midpoints of their strata: few of them have a bias
    of a per cent or two, which all pictures of the same ``spp`` share. ``lighting="environment"``:
    all of it, by multiple importance sampling, without bias.
    """

    spp: int = 64
    lighting: Lighting = "harmonics"
    rays_per_chunk: int = RAYS_PER_CHUNK

    stochastic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        _check(self)

    def precompute(self, scene: Scene, progress: bool = True) -> RayVisibility:
        """Nothing but the Embree tree."""
        return RayVisibility.of(scene)

    def light(self, environment: Environment) -> FieldLight:
        """Nine coefficients; the environment's sampling table if all of it lights the scene.

        Raises:
            ValueError: the environment has local lights.
        """
        return _light(self, environment)

    def shade(
        self,
        visibility: RayVisibility,
        light: FieldLight,
        surface: Surface,
        *,
        key: jax.Array | None = None,
        progress: bool = False,
    ) -> Float[Array, "height width 3"]:
        """An estimate of each pixel's radiance: with the same key, from the rays of the field."""
        key = require_key(key, self)
        return _shade(self, visibility.tracer, None, None, light, surface, key, progress)

    def evaluations(self, visibility: RayVisibility, light: FieldLight, surface: Surface) -> int:
        return self.spp * int(jnp.sum(surface.mask))


@dataclass(frozen=True)
class VisibilityField(Method):
    """A grid of octahedral masks that tells which rays are visible or blocked without tracing them
    (Xu et al., "Precomputed Discrete Visibility Fields for Real-Time Ray-Traced Environment
    Lighting").

    ``cell`` is the cells' edge in scene units (None: a 96th of the scene's diagonal), ``masks`` the
    texels along a mask. Masks are made from ``samples`` points of the surface with ``rays`` rays
    each; ``sampling`` spreads the points evenly over cells as well as area (``"stratified"``), or
    over area alone as the paper does (``"random"``). ``dilation`` is how far masks grow: by half a
    texel, by a whole one as in the paper (``"full"``), or not at all (``"none"``).

    ``labels`` choose what is traced (:func:`~jaxvis.methods.visibility_field.cull.rules`).
    ``conservative`` also traces what no sample has looked at and where the six neighbouring cells
    disagree, so that next to no ray is wrongly dropped. The paper's method is
    ``labels="paper", conservative=False, dilation="full", sampling="random"``.

    ``spp``, ``lighting``: as in :class:`Unculled`. ``control_variate``: cells of label 0 take their
    unshadowed irradiance from the harmonics (eq. 11) and not from the same rays.
    """

    cell: float | None = None
    masks: int = 18
    samples: int = 1_000_000
    rays: int = 128
    sampling: Sampling = "stratified"
    dilation: Dilation = "half"
    labels: Labels = "four-state"
    conservative: bool = True
    spp: int = 64
    lighting: Lighting = "harmonics"
    control_variate: bool = True
    seed: int = 0
    rays_per_chunk: int = RAYS_PER_CHUNK

    stochastic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        _check(self)
        _require_one_of(self.labels, Labels, "labels")
        _require_one_of(self.dilation, Dilation, "dilation")
        if self.cell is not None and not (math.isfinite(self.cell) and self.cell > 0.0):
            raise ValueError(f"cell must be a positive length, got {self.cell}")
        if not 1 <= self.masks <= LARGEST_MASKS:
            raise ValueError(f"masks must be from 1 to {LARGEST_MASKS}, got {self.masks}")
        self._settings(1.0 if self.cell is None else self.cell).check()

    def _settings(self, cell: float) -> Settings:
        size = traced_size(self.masks, self.dilation)
        return Settings(cell, size, self.samples, self.rays, sampling=self.sampling, seed=self.seed)

    def precompute(self, scene: Scene, progress: bool = True) -> FieldVisibility:
        """The field. The samples' masks are cached on disk, whatever is made of them."""
        cell = scene.diagonal / CELLS_ALONG_DIAGONAL if self.cell is None else self.cell
        settings = self._settings(cell)
        grid = Grid.covering(scene.positions, cell)
        both = [m.two_sided for m in scene.materials]
        key = content_hash(scene.geometry_hash, both, scene.material_ids, tuple(settings))

        def build() -> dict:
            return trace_masks(scene, settings, progress=progress)._asdict()

        arrays, _ = cached_arrays("visibility-masks", key, build)
        return visibility_field(
            scene,
            grid,
            Masks(**{**arrays, "size": settings.size}),
            size=self.masks,
            dilation=self.dilation,
            neighbours=self.conservative,
        )

    def light(self, environment: Environment) -> FieldLight:
        """Nine coefficients; the environment's sampling table if all of it lights the scene.

        Raises:
            ValueError: the environment has local lights.
        """
        return _light(self, environment)

    def shade(
        self,
        visibility: FieldVisibility,
        light: FieldLight,
        surface: Surface,
        *,
        key: jax.Array | None = None,
        progress: bool = False,
    ) -> Float[Array, "height width 3"]:
        """An estimate of each pixel's radiance from the rays that :class:`Unculled` would trace."""
        simple = self.lighting == "harmonics" and isinstance(surface.reflectance, Lambert)
        chosen, inverted = rules(
            visibility, self.labels, conservative=self.conservative, inverted=simple
        )
        table = Table.of(visibility, chosen)
        control = inverted if self.control_variate and bool(inverted.any()) else None
        key = require_key(key, self)
        return _shade(self, visibility.tracer, table, control, light, surface, key, progress)

    def evaluations(self, visibility: FieldVisibility, light: FieldLight, surface: Surface) -> int:
        return self.spp * int(jnp.sum(surface.mask))


def _check(method: Unculled | VisibilityField) -> None:
    if method.spp < 1:
        raise ValueError(f"spp must be at least 1, got {method.spp}")
    if method.rays_per_chunk < 1:
        raise ValueError(f"rays_per_chunk must be at least 1, got {method.rays_per_chunk}")
    _require_one_of(method.lighting, Lighting, "lighting")


def _require_one_of(value: str, options: Any, name: str) -> None:
    if value not in get_args(options):
        raise ValueError(f"{name} must be one of {', '.join(get_args(options))}, got {value!r}")


def _light(method: Unculled | VisibilityField, environment: Environment) -> FieldLight:
    refuse_spheres(environment, method)
    if method.lighting == "environment":
        return FieldLight.whole(environment)
    return FieldLight.low_frequency(environment)


def _shade(
    method: Unculled | VisibilityField,
    tracer: RayTracer,
    table: Table | None,
    inverted: Bool[Array, "rows"] | None,
    light: FieldLight,
    surface: Surface,
    key: jax.Array,
    progress: bool,
) -> Float[Array, "height width 3"]:
    points = shading_points(surface)
    columns = surface.mask.shape[1]
    with tqdm(total=len(points.pixel), desc="shading", unit="px", disable=not progress) as bar:
        frame = Frame(tracer, points, columns, table, inverted, method.rays_per_chunk, bar.update)
        if method.lighting == "environment":
            if light.all_frequency is None:
                raise ValueError("lighting='environment' needs the light of the same method")
            words = key_words(key)
            radiance = all_frequency(
                frame, light.all_frequency, words, method.spp, surface.reflectance
            )
        elif isinstance(surface.reflectance, Lambert):
            radiance = diffuse(frame, light.coefficients, shifts(key), method.spp)
        else:
            radiance = glossy(
                frame, light.coefficients, shifts(key), method.spp, surface.reflectance
            )
    return to_image(surface, points, radiance)
