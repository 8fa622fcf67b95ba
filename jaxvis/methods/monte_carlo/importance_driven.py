"""Importance driven environment map sampling (paper 000, section IV-D; Bashford-Rogers,
Debattista and Chalmers 2014), alone and with adaptive cumulative distributions on top.
"""

from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Array, Float

from jaxvis.lighting import Environment
from jaxvis.methods.base import require_key
from jaxvis.methods.estimators import Counts, DrawnLight
from jaxvis.methods.monte_carlo.cell_light import CellLight
from jaxvis.methods.monte_carlo.estimate import (
    Estimator,
    balanced_proposals,
    estimate,
    halves,
)
from jaxvis.methods.monte_carlo.local_light import TABLE, LocalLight
from jaxvis.methods.monte_carlo.path_map import directional_distribution, path_map
from jaxvis.methods.traced import RAYS_PER_CHUNK, RayVisibility, ShadingPoints, shading_points
from jaxvis.sampling.random import key_words
from jaxvis.scene import Surface

PATH_MAP = (64, 128)
"""Rows and columns of a path map; those of the environment where it has fewer."""


@dataclass(frozen=True)
class ImportanceDriven(Estimator):
    """MIS IDES: rays from the approximated directional distribution and, a share of ``brdf`` of
    them, from the BRDF, weighted by the balance heuristic.

    A pre-pass in every ``shade`` traces ``paths`` rays from what the camera sees, drawn by
    the BRDF with random numbers of their own, and bins those that leave the scene. This path map,
    blurred and with a ``floor`` in [0, 1] (the share that is the same in every direction), times
    the luminance is what directions are drawn from: light that the surface does not see is drawn
    less often. Given the pre-pass the estimate is unbiased, whatever the map.

    The pre-pass counts in ``rays_traced`` and in the time of a frame, not in ``evaluations``: its
    rays choose directions and are not integrated.
    """

    spp: int = 64
    brdf: float = 0.125
    paths: int = 65536
    floor: float = 0.08
    rays_per_chunk: int = RAYS_PER_CHUNK

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 <= self.brdf <= 1.0:
            raise ValueError(f"brdf must be a share from 0 to 1, got {self.brdf}")
        if self.paths < 1:
            raise ValueError(f"paths must be at least 1, got {self.paths}")
        if not 0.0 < self.floor <= 1.0:
            raise ValueError(
                f"floor must be above 0 (or light may be missed) and at most 1, got {self.floor}"
            )

    def light(self, environment: Environment) -> CellLight:
        """The environment's texels by cells of the path map, each with a sampling table."""
        return CellLight.of(environment, *PATH_MAP)

    def shade(
        self,
        visibility: RayVisibility,
        light: CellLight,
        surface: Surface,
        *,
        key: jax.Array | None = None,
        progress: bool = False,
    ) -> Float[Array, "height width 3"]:
        """One estimate of each pixel's radiance.

        Pixels share the pre-pass: it makes their noise alike in strength, not their errors.
        """
        key = require_key(key, self)
        points = shading_points(surface)
        words = key_words(key)
        guided = self.distribution(visibility, light, points, surface, jax.random.fold_in(key, 1))
        return estimate(
            *(visibility, guided, surface, points),
            balanced_proposals(self.counts, guided, words, surface.reflectance),
            *(words, self),
            most=int(max(self.counts)),
            progress=progress,
        )

    @property
    def counts(self) -> Counts:
        """Rays a pixel from the distribution and from the BRDF: at least one of each, from two
        samples on, if ``brdf`` is neither 0 nor 1."""
        if self.spp == 1:
            return halves(1)
        reflected = round(self.spp * self.brdf)
        if 0.0 < self.brdf < 1.0:
            reflected = min(max(1, reflected), self.spp - 1)
        return Counts(environment=self.spp - reflected, brdf=reflected)

    def distribution(
        self,
        visibility: RayVisibility,
        light: CellLight,
        points: ShadingPoints,
        surface: Surface,
        key: jax.Array,
    ) -> DrawnLight:
        """What directions are drawn from for these points, by a pre-pass with this key."""
        return light.in_proportion(self.directions(visibility, light, points, surface, key))

    def directions(
        self,
        visibility: RayVisibility,
        light: CellLight,
        points: ShadingPoints,
        surface: Surface,
        key: jax.Array,
    ) -> Float[np.ndarray, "rows columns"]:
        """The path map: how much of the light from each cell's direction is of use."""
        carried = path_map(
            *(visibility.tracer, points, key_words(key), self.paths, light.cells.shape),
            reflectance=surface.reflectance,
        )
        return directional_distribution(carried, self.floor)


@dataclass(frozen=True)
class LocalImportanceDriven(ImportanceDriven):
    """:class:`ImportanceDriven` by normal: Lawrence, Rusinkiewicz and Ramamoorthi 2005 on top.

    For each of 20 x 10 normals the distribution is multiplied by the clamped cosine and tabulated,
    64 x 32; its cumulative distributions are compressed to an error of ``tolerance``. A pixel draws
    from the four normals around its own, chosen in proportion to bilinear weights; the density is
    that of the mixture. Within a cell of the table texels are drawn by luminance.
    """

    tolerance: float = 0.002

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 <= self.tolerance < 0.5:
            raise ValueError(f"tolerance must be at least 0 and below 0.5, got {self.tolerance}")

    def light(self, environment: Environment) -> CellLight:
        """The environment's texels by cells of the tables, each with a sampling table."""
        return CellLight.of(environment, *TABLE)

    def distribution(
        self,
        visibility: RayVisibility,
        light: CellLight,
        points: ShadingPoints,
        surface: Surface,
        key: jax.Array,
    ) -> DrawnLight:
        useful = self.directions(visibility, light, points, surface, key)
        return LocalLight.of(light, useful, self.tolerance)
