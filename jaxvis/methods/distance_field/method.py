"""Distance fields as methods: at every vertex, adaptively sampled, or filled by shadow maps."""

from dataclasses import dataclass
from typing import Any, Literal, get_args

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxvis.cache import content_hash
from jaxvis.lighting import Environment
from jaxvis.lighting.gaussians import cell_gaussians, fit_gaussians
from jaxvis.methods.base import Method
from jaxvis.methods.distance_field.build import (
    Angular,
    Fill,
    Spatial,
    cached_fields,
    place_samples,
    sample_every_vertex,
)
from jaxvis.methods.distance_field.carry import carry_over
from jaxvis.methods.distance_field.field import DistanceFields
from jaxvis.methods.distance_field.foretold import Measure, check_measure
from jaxvis.methods.distance_field.light import LobesAndSpheres
from jaxvis.methods.distance_field.maps import check_resolution
from jaxvis.methods.distance_field.neighbours import Interpolation, check_interpolation
from jaxvis.methods.distance_field.shade import shade_view, view_of
from jaxvis.scene import Scene, Surface
from jaxvis.sphere.gaussians import SphericalGaussians

Lobes = Literal["cells", "fitted"]
Rays = Literal["adaptive", "dense"]

LARGEST_RESOLUTION = 1024
"""Of a map, whose distances then take 2 MB; more is a slip."""


@dataclass(frozen=True)
class DistanceField(Method):
    """Spherical signed distance functions at every vertex: the SSDF baseline of papers 000 and 002.

    Each vertex has a hemispherical map of ``resolution`` x ``resolution`` texels. Light is a list
    of ``lights`` spherical Gaussians, as in Wang et al. 2009, and what is seen of each follows from
    the signed distance along its axis, interpolated over the triangle. ``lobes="fitted"`` fits them
    to the environment; ``"cells"`` takes one for each cell of an adaptive partition of it, which
    with a few hundred comes close to the exact integral. Reflectance is evaluated towards each
    lobe, with facets spread by the lobe's width.

    ``fill`` says which texels are traced: all (``"dense"``), or those at boundaries
    (``"adaptive"``, from ``coarsest`` texels a side on).
    """

    resolution: int = 128
    lights: int = 512
    lobes: Lobes = "cells"
    fill: Fill = "dense"
    coarsest: int = 16

    def __post_init__(self) -> None:
        _require("lobes", self.lobes, get_args(Lobes))
        _require("fill", self.fill, self._fills())
        if self.lights < 8:
            raise ValueError(f"lights must be at least 8, got {self.lights}")
        if not 4 <= self.resolution <= LARGEST_RESOLUTION:
            raise ValueError(
                f"resolution must be from 4 to {LARGEST_RESOLUTION}, got {self.resolution}"
            )
        if self.fill == "adaptive":
            check_resolution(self.resolution, self.coarsest)

    def _fills(self) -> tuple[str, ...]:
        return get_args(Rays)

    def precompute(self, scene: Scene, progress: bool = True) -> DistanceFields:
        """Maps and distances at all vertices; cached on disk."""
        key = content_hash("every vertex", scene.geometry_hash, _sides(scene), self._angular)
        return cached_fields(
            key, lambda: sample_every_vertex(scene, self._angular, progress=progress)
        )

    def light(self, environment: Environment) -> LobesAndSpheres:
        """The environment as ``lights`` lobes, and its spheres as they are."""
        if self.lobes == "fitted":
            lobes = fit_gaussians(environment, self.lights).lobes
        else:
            lobes = cell_gaussians(environment, self.lights)
        return LobesAndSpheres(lobes.axis, lobes.sharpness, lobes.amplitude, environment.spheres)

    def shade(
        self,
        visibility: DistanceFields,
        light: SphericalGaussians,
        surface: Surface,
        *,
        key: jax.Array | None = None,
        progress: bool = False,
    ) -> Float[Array, "height width 3"]:
        """Differentiable in the light, the materials and the distances.

        Sphere lights are lobes that differ from place to place. Visibility maps have no depth: what
        lies behind a sphere shadows it as if it lay before it.

        Raises:
            ValueError: the surface shows what was not sampled; says what to do.
        """
        return shade_view(visibility, light, view_of(visibility, surface), surface)

    def evaluations(
        self, visibility: DistanceFields, light: LobesAndSpheres, surface: Surface
    ) -> int:
        return int(jnp.sum(surface.mask)) * light.count

    @property
    def _angular(self) -> Angular:
        return Angular(self.resolution, self.fill, self.coarsest)


@dataclass(frozen=True)
class AdaptiveVisibility(DistanceField):
    """Distance functions at adaptively placed vertices (paper 002), carried from frame to frame.

    Samples start as the vertices nearest k-means centres under e_g = ``alpha`` x distance / the
    scene's diagonal + normal difference (eq. 6), ``initial`` of the budget of them. In each of
    ``rounds`` rounds a sample whose neighbours foretell its visibility (eq. 8) with a relative
    error above ``largest`` gets new ones between it and them, and one that they foretell to
    ``least`` is dropped if that is true of none of its neighbours. The error is that of signed
    distances, which are what is interpolated (``measure="distances"``), or the paper's eq. 7
    (``"coefficients"``). ``budget`` is the most samples, as a share of the vertices. Vertices take
    distances from the ``near`` nearest samples, with weights that are exact for linear functions
    (``interpolation="linear"``) or the paper's (``"inverse"``).

    The paper's alpha is 0.1 to 0.5 in a scene "normalised" to a size that it does not tell; in
    scenes scaled to a diagonal of 1, several times that measured better.
    """

    fill: Fill = "adaptive"
    largest: float = 0.10
    least: float = 0.05
    alpha: float = 5.0
    initial: float = 0.4
    rounds: int = 4
    budget: float = 0.12
    near: int = 8
    interpolation: Interpolation = "linear"
    measure: Measure = "distances"

    def __post_init__(self) -> None:
        super().__post_init__()
        check_interpolation(self.interpolation)
        check_measure(self.measure)
        for name in ("alpha", "budget"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        if not 0.0 <= self.least <= self.largest:
            raise ValueError(
                f"least must be from 0 to largest, got {self.least} and {self.largest}"
            )
        if not 0.0 < self.initial <= 1.0:
            raise ValueError(f"initial must be above 0 and at most 1, got {self.initial}")
        if self.rounds < 0:
            raise ValueError(f"rounds must be at least 0, got {self.rounds}")
        if self.near < 1:
            raise ValueError(f"near must be at least 1, got {self.near}")

    def _fills(self) -> tuple[str, ...]:
        return get_args(Fill)

    def precompute(self, scene: Scene, progress: bool = True) -> DistanceFields:
        """Samples for all views of the scene; cached on disk."""
        key = content_hash(
            "placed", scene.geometry_hash, _sides(scene), self._angular, self._spatial
        )
        return cached_fields(
            key, lambda: place_samples(scene, self._angular, self._spatial, progress=progress)
        )

    def precompute_for(
        self, scene: Scene, surface: Surface, previous: Any = None, progress: bool = True
    ) -> DistanceFields:
        """Samples at what the surface shows, carried over from the previous frame if there is one:
        directions in which nothing moved are not traced again.
        """
        if previous is not None:
            return carry_over(previous, scene, self._angular, self._spatial, surface)
        return place_samples(scene, self._angular, self._spatial, surface, progress=progress)

    @property
    def _spatial(self) -> Spatial:
        return Spatial(
            self.alpha,
            self.initial,
            self.largest,
            self.least,
            self.rounds,
            self.budget,
            self.near,
            self.interpolation,
            self.measure,
        )


@dataclass(frozen=True)
class ShadowMaps(AdaptiveVisibility):
    """Paper 002's baseline: as :class:`AdaptiveVisibility`, but each map is filled by drawing all
    triangles into a hemicube at its sample, without rays.
    """

    fill: Fill = "rasterized"

    def _fills(self) -> tuple[str, ...]:
        return ("rasterized",)


def _sides(scene: Scene) -> tuple[bool, ...]:
    """Which materials are two-sided: their triangles have samples on both sides."""
    return tuple(bool(material.two_sided) for material in scene.materials)


def _require(name: str, value: str, options: tuple[str, ...]) -> None:
    if value not in options:
        raise ValueError(f"{name} must be one of {', '.join(options)}, got {value!r}")
