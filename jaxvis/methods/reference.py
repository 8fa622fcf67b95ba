"""Ground truth by brute force: environment x ray-traced visibility x BRDF, without noise."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.stats import qmc
from tqdm.auto import tqdm

from jaxvis.cache import cached_arrays, content_hash
from jaxvis.errors import JaxvisWarning
from jaxvis.lighting import Environment
from jaxvis.methods.base import Method
from jaxvis.methods.sphere_rays import StratifiedSpheres
from jaxvis.methods.traced import (
    Components,
    Proposal,
    Propose,
    RayVisibility,
    ShadingPoints,
    components,
    propose,
    reflected,
    shading_points,
    to_image,
    trace_and_sum,
)
from jaxvis.reflectance import Reflectance
from jaxvis.sampling import LatLongDistribution
from jaxvis.scene import Scene, Surface
from jaxvis.sphere import latlong

DIRECTIONS_PER_STAGE = 64
"""One shape for every stage, so that each is compiled once; no more than the first level has."""
REPLICATES = 4
"""Independent scramblings whose spread tells the error."""
FIRST_LEVEL, LAST_LEVEL = 6, 14
"""Powers of two: directions of each kind in a scrambling, at first and at most."""
SPHERE_DIRECTIONS = 1024
"""In each scrambling, to each sphere light, where every texel of the environment is summed."""


class Solution(NamedTuple):
    """A reference image, with how well it is known.

    ``error`` is the image's standard error, root mean square over the covered pixels and relative
    to their mean radiance; 0 when every texel was integrated and there are no spheres.
    ``directions`` is how many directions each pixel integrated.
    """

    image: Float[Array, "height width 3"]
    error: float
    directions: int


@dataclass(frozen=True)
class Reference(Method):
    """Every texel of the environment, or as many directions as an error target needs.

    With ``error=None`` each pixel sums radiance x BRDF x cosine x visibility over ``subdivision``^2
    directions in every texel of the environment, with exact solid angles (``rows``, if given, first
    resamples the environment to that many rows, which makes another, blurrier light).

    With an ``error`` the directions are a stratified subset, the same for all pixels so that there
    is no noise between them: scrambled Sobol points (Owen 1995), half of them through the
    environment's cumulative distribution and half through the BRDF's, weighted by the balance
    heuristic. Four
    independent scramblings tell the error, and the subset doubles until the image's relative
    standard error (see :class:`Solution`) is at most ``error``.

    Sphere lights add as many directions each, from the cones that they subtend; with no ``error``,
    four times 1024.
    """

    error: float | None = None
    rows: int | None = None
    subdivision: int = 1

    def __post_init__(self) -> None:
        if self.error is not None and not self.error > 0.0:
            raise ValueError(f"error must be positive, got {self.error}")
        if self.rows is not None and self.rows < 1:
            raise ValueError(f"rows must be at least 1, got {self.rows}")
        if self.subdivision < 1:
            raise ValueError(f"subdivision must be at least 1, got {self.subdivision}")

    def precompute(self, scene: Scene, progress: bool = True) -> RayVisibility:
        """Nothing but the Embree tree."""
        return RayVisibility.of(scene)

    def light(self, environment: Environment) -> ReferenceLight:
        """The environment, resampled to ``rows`` if that is given."""
        if self.rows is not None:
            environment = environment.resize(self.rows)
        luminance = np.asarray(environment.radiance, np.float64) @ [0.2126, 0.7152, 0.0722]
        return ReferenceLight(environment, LatLongDistribution.build(luminance))

    def shade(
        self,
        visibility: RayVisibility,
        light: ReferenceLight,
        surface: Surface,
        *,
        key: jax.Array | None = None,
        progress: bool = False,
    ) -> Float[Array, "height width 3"]:
        """The image of :meth:`solve`."""
        return self.solve(visibility, light, surface, progress=progress).image

    def solve(
        self,
        visibility: RayVisibility,
        light: ReferenceLight,
        surface: Surface,
        *,
        progress: bool = False,
    ) -> Solution:
        """The image, its error and the number of directions."""
        points = shading_points(surface)
        trace = partial(_trace, visibility, points, progress)
        light = replace(light, environment=light.environment.seen_from(surface.origin))
        if self.error is None:
            radiance = _every_texel(light, surface.reflectance, self.subdivision, trace)
            error, directions = 0.0, light.environment.radiance[..., 0].size * self.subdivision**2
            if light.environment.spheres is not None:
                spheres = StratifiedSpheres(light.environment.spheres, REPLICATES)
                radiance, error = _mean(radiance + _of_spheres(spheres, surface.reflectance, trace))
                directions += REPLICATES * SPHERE_DIRECTIONS * spheres.count
        else:
            radiance, error, directions = _subset(light, surface.reflectance, self.error, trace)
        return Solution(to_image(surface, points, radiance), error, directions)

    def solve_cached(
        self,
        visibility: RayVisibility,
        light: ReferenceLight,
        surface: Surface,
        *,
        progress: bool = False,
    ) -> tuple[Solution, bool]:
        """:meth:`solve`, or what an earlier call with the same content stored on disk.

        Returns (solution, whether it came from the disk).
        """
        key = content_hash(
            jax.tree.leaves((visibility, light.environment, surface)),
            repr((surface.reflectance, surface.supersampling, self)),
        )

        def build() -> dict[str, Any]:
            return self.solve(visibility, light, surface, progress=progress)._asdict()

        arrays, cached = cached_arrays("reference", key, build)
        image = jnp.asarray(arrays["image"])
        return Solution(image, float(arrays["error"]), int(arrays["directions"])), cached

    def evaluations(
        self, visibility: RayVisibility, light: ReferenceLight, surface: Surface
    ) -> int:
        """Directions times points; a subset counts as 0: only :meth:`solve` knows what it takes."""
        if self.error is not None:
            return 0
        directions = light.environment.radiance[..., 0].size * self.subdivision**2
        if light.environment.spheres is not None:
            directions += REPLICATES * SPHERE_DIRECTIONS * light.environment.spheres.count
        return directions * int(jnp.sum(surface.mask))


Trace = Callable[[list[Propose], int, str], np.ndarray]
"""(proposals, samples of each, what to call it) -> sum of the unblocked weights [points, 3]."""


def _trace(
    visibility: RayVisibility,
    points: ShadingPoints,
    progress: bool,
    proposals: list[Propose],
    samples: int,
    what: str,
) -> np.ndarray:
    count, tracer = len(points.pixel), visibility.tracer
    with tqdm(total=count, desc=what, unit="px", leave=False, disable=not progress) as bar:
        return trace_and_sum(tracer, points, proposals, samples, advance=bar.update)


def _every_texel(
    light: ReferenceLight, reflectance: Reflectance, subdivision: int, trace: Trace
) -> np.ndarray:
    """Radiance of each point: the sum over all texels."""
    directions, radiance = texel_lights(light.environment, subdivision)
    step = min(DIRECTIONS_PER_STAGE, len(directions))
    lights = jnp.asarray(directions), jnp.asarray(radiance)
    proposals = [
        partial(_towards, *(part[i : i + step] for part in lights), reflectance=reflectance)
        for i in range(0, len(directions), step)
    ]
    return trace(proposals, step, "reference")


def texel_lights(
    environment: Environment, subdivision: int
) -> tuple[Float[np.ndarray, "lights 3"], Float[np.ndarray, "lights 3"]]:
    """The environment as directional lights: unit directions and radiance times solid angle.

    ``subdivision``^2 lights a texel, at the centres of equal steps of phi and theta, with exact
    solid angles. Black texels are left out; the list is padded with black lights to whole stages.
    """
    height, width = (n * subdivision for n in environment.radiance.shape[:2])
    radiance = np.asarray(environment.radiance, np.float64)
    radiance = radiance.repeat(subdivision, axis=0).repeat(subdivision, axis=1)
    flux = (radiance * latlong.row_solid_angles(height, width)[:, None, None]).reshape(-1, 3)
    directions = latlong.texel_directions(height, width).reshape(-1, 3)
    lit = np.flatnonzero(flux.max(axis=-1) > 0.0)
    missing = -len(lit) % DIRECTIONS_PER_STAGE if len(lit) > DIRECTIONS_PER_STAGE else 0
    missing += not len(lit)
    flux = np.concatenate([flux[lit], np.zeros((missing, 3))])
    directions = np.concatenate([directions[lit], np.tile([[0.0, 1.0, 0.0]], (missing, 1))])
    return directions.astype(np.float32), flux.astype(np.float32)


def _towards(
    directions: Float[Array, "lights 3"],
    flux: Float[Array, "lights 3"],
    points: ShadingPoints,
    *,
    reflectance: Reflectance,
) -> Proposal:
    """The same directional lights for every point."""
    everywhere = _everywhere(points, directions)
    value, _ = reflected(points, everywhere, reflectance=reflectance)
    return _scaled(points, everywhere, value, flux)


@jax.jit
def _everywhere(points: ShadingPoints, directions: Float[Array, "lights 3"]) -> Components:
    return components(jnp.broadcast_to(directions, (len(points.normal), *directions.shape)))


@jax.jit
def _scaled(
    points: ShadingPoints,
    directions: Components,
    value: Float[Array, "points lights 3"],
    flux: Float[Array, "lights 3"],
) -> Proposal:
    return propose(jnp.stack(directions, axis=-1), value * flux, points)


def _of_spheres(
    spheres: StratifiedSpheres, reflectance: Reflectance, trace: Trace
) -> Float[np.ndarray, "replicates points 3"]:
    """Radiance of each point by sphere lights, by each of the scramblings."""
    sums = []
    for r in range(REPLICATES):
        proposals = spheres.proposals(r, SPHERE_DIRECTIONS, DIRECTIONS_PER_STAGE, reflectance)
        sums.append(trace(proposals, DIRECTIONS_PER_STAGE, f"spheres ({r + 1}/{REPLICATES})"))
    return np.stack(sums) / SPHERE_DIRECTIONS


def _mean(
    estimates: Float[np.ndarray, "replicates points 3"],
) -> tuple[Float[np.ndarray, "points 3"], float]:
    """The mean of independent estimates, and its relative standard error."""
    radiance = estimates.mean(axis=0)
    if not radiance.size:
        return radiance, 0.0
    variance = estimates.var(axis=0, ddof=1).mean() / len(estimates)
    return radiance, float(np.sqrt(variance) / max(radiance.mean(), 1e-30))


def _subset(
    light: ReferenceLight, reflectance: Reflectance, target: float, trace: Trace
) -> tuple[np.ndarray, float, int]:
    """Radiance of each point, its relative standard error, and the directions per point."""
    engines = [(qmc.Sobol(2, rng=2 * r), qmc.Sobol(3, rng=2 * r + 1)) for r in range(REPLICATES)]
    local = light.environment.spheres
    spheres = None if local is None else StratifiedSpheres(local, REPLICATES)
    totals: list[np.ndarray] = []
    count = 0
    while True:
        fresh = max(count, 1 << FIRST_LEVEL)  # doubling keeps the Sobol points a net
        step = min(fresh, DIRECTIONS_PER_STAGE)
        sums = []
        for replicate, (of_light, of_brdf) in enumerate(engines):
            uniforms = of_light.random(fresh), of_brdf.random(fresh)
            proposals: list[Propose] = []
            for i in range(0, fresh, step):
                block = (jnp.asarray(u[i : i + step], jnp.float32) for u in uniforms)
                on_light, on_brdf = block
                proposals += [
                    partial(balanced, draw_lights(light, on_light), reflectance=reflectance),
                    partial(from_brdf, light, on_brdf, reflectance=reflectance),
                ]
            if spheres is not None:
                proposals += spheres.proposals(replicate, fresh, step, reflectance)
            sums.append(
                trace(proposals, step, f"reference {count + fresh} ({replicate + 1}/{REPLICATES})")
            )
        totals = [a + b for a, b in zip(totals, sums, strict=True)] if totals else sums
        count += fresh
        radiance, error = _mean(np.stack(totals) / count)
        if error <= target:
            break
        if count >= 1 << LAST_LEVEL:
            warnings.warn(
                f"reference: relative error {error:.2g} after {count} directions, not {target:.2g}",
                JaxvisWarning,
                stacklevel=2,
            )
            break
    kinds = 2 if spheres is None else 2 + spheres.count
    return radiance.astype(np.float32), error, kinds * REPLICATES * count
