"""Ground truth by brute force: environment x ray-traced visibility x BRDF, without noise."""

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from tqdm.auto import tqdm

from jaxvis.cache import cached_arrays, content_hash
from jaxvis.errors import JaxvisWarning
from jaxvis.lighting import Environment
from jaxvis.methods.balanced import ReferenceLight, balanced, draw_lights, from_brdf, towards
from jaxvis.methods.base import Method
from jaxvis.methods.bounce import LIGHTS_PER_HIT, SCRAMBLINGS, bounced
from jaxvis.methods.reflectors import ReflectorVisibility
from jaxvis.methods.sphere_rays import StratifiedSpheres
from jaxvis.methods.traced import (
    Propose,
    RayVisibility,
    ShadingPoints,
    shading_points,
    to_image,
    trace_and_sum,
)
from jaxvis.reflectance import Reflectance
from jaxvis.sampling import LatLongDistribution
from jaxvis.sampling.sequences import sobol
from jaxvis.scene import Scene, Surface
from jaxvis.sphere import latlong

DIRECTIONS_PER_STAGE = 64
"""One shape for every stage, so that each is compiled once; no more than the first level has."""
REPLICATES = 4
"""Independent scramblings whose spread tells the error."""
MOST_BOUNCE_RAYS = 1 << 14
"""Of each pixel, when an error target asks for more and more."""
FIRST_LEVEL, LAST_LEVEL = 6, 14
"""Powers of two: directions of each kind in a scrambling, at first and at most."""
SPHERE_DIRECTIONS = 1024
"""In each scrambling, to each sphere light, where every texel of the environment is summed."""


@dataclass(frozen=True)
class Solution:
    """A reference image, with how well it is known.

    ``error`` is the image's standard error, root mean square over the covered pixels and relative
    to their mean radiance; 0 when every texel was integrated and there are neither spheres nor
    bounces. ``directions`` is how many directions each pixel integrated, those at the other end of
    its bounce rays included. ``indirect`` is that part of the image that came by a bounce.

    Unpacks as (image, error, directions).
    """

    image: Float[Array, "height width 3"]
    error: float
    directions: int
    indirect: Float[Array, "height width 3"]

    def __iter__(self) -> Iterator[Any]:
        return iter((self.image, self.error, self.directions))


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

    With ``bounces=1`` light also comes by one diffuse bounce (:mod:`jaxvis.methods.bounce`):
    ``bounce_rays`` rays from each pixel, in four scramblings whose spread tells the error, and from
    what they meet, rays to the light. An ``error`` doubles them until the whole image is as good.
    The diffuse albedo reflects at both ends; specular lobes reflect no bounced light and send none.
    """

    error: float | None = None
    rows: int | None = None
    subdivision: int = 1
    bounces: int = 0
    bounce_rays: int = 256

    def __post_init__(self) -> None:
        if self.error is not None and not self.error > 0.0:
            raise ValueError(f"error must be positive, got {self.error}")
        if self.rows is not None and self.rows < 1:
            raise ValueError(f"rows must be at least 1, got {self.rows}")
        if self.subdivision < 1:
            raise ValueError(f"subdivision must be at least 1, got {self.subdivision}")
        if self.bounces not in (0, 1):
            raise ValueError(f"bounces must be 0 or 1, got {self.bounces}")
        rays = self.bounce_rays
        if not SCRAMBLINGS <= rays <= MOST_BOUNCE_RAYS or rays & (rays - 1):
            raise ValueError(
                f"bounce_rays must be a power of two from {SCRAMBLINGS} to {MOST_BOUNCE_RAYS}, "
                f"got {rays}"
            )

    def __repr__(self) -> str:
        """Names bounces only where they are set, so that older cached results keep their keys."""
        values = ((f.name, getattr(self, f.name), f.default) for f in fields(self))
        always = ("error", "rows", "subdivision")
        shown = [f"{name}={v!r}" for name, v, default in values if name in always or v != default]
        return f"{type(self).__name__}({', '.join(shown)})"

    def precompute(self, scene: Scene, progress: bool = True) -> RayVisibility:
        """Nothing but the Embree tree; with bounces, also what the triangles reflect."""
        return ReflectorVisibility.of(scene) if self.bounces else RayVisibility.of(scene)

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
        """The image, its error and the number of directions.

        Raises:
            ValueError: there are bounces, and ``visibility`` does not know the materials.
        """
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
        indirect = np.zeros_like(radiance)
        if self.bounces:
            indirect, error, more = self._bounced(
                visibility, light, points, radiance, error, progress
            )
            directions += more
        return Solution(
            to_image(surface, points, radiance + indirect),
            error,
            directions,
            to_image(surface, points, indirect),
        )

    def _bounced(
        self,
        visibility: RayVisibility,
        light: ReferenceLight,
        points: ShadingPoints,
        direct: Float[np.ndarray, "points 3"],
        error: float,
        progress: bool,
    ) -> tuple[Float[np.ndarray, "points 3"], float, int]:
        """What a bounce adds to each point, the error of the whole, and the directions for it.

        ``error`` is that of ``direct``.
        """
        if not isinstance(visibility, ReflectorVisibility):
            raise ValueError(
                f"bounces={self.bounces} needs visibility that knows the materials: "
                "precompute it with the same bounces"
            )
        estimates = bounced(visibility, light, points, self.bounce_rays, progress=progress)
        while True:
            estimate, rays = next(estimates)
            indirect, of_bounce = _mean(estimate)
            mean = float(direct.mean()) if direct.size else 0.0
            added = float(indirect.mean()) if indirect.size else 0.0
            whole = float(np.hypot(error * mean, of_bounce * added)) / max(mean + added, 1e-30)
            if self.error is None or whole <= self.error or rays >= MOST_BOUNCE_RAYS:
                break
        if self.error is not None and whole > self.error:
            _warn_of_error(whole, f"{rays} bounce rays", self.error)
        return indirect.astype(np.float32), whole, _directions_of_bounce(light, rays)

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
            solution = self.solve(visibility, light, surface, progress=progress)
            arrays = {f.name: getattr(solution, f.name) for f in fields(solution)}
            return arrays if self.bounces else {k: v for k, v in arrays.items() if k != "indirect"}

        arrays, cached = cached_arrays("reference", key, build)
        image = jnp.asarray(arrays["image"])
        # Entries without bounces hold no zeros.
        indirect = jnp.asarray(arrays.get("indirect", np.zeros_like(arrays["image"])))
        found = Solution(image, float(arrays["error"]), int(arrays["directions"]), indirect)
        return found, cached

    def evaluations(
        self, visibility: RayVisibility, light: ReferenceLight, surface: Surface
    ) -> int:
        """Directions times points; a subset counts as 0: only :meth:`solve` knows what it takes."""
        if self.error is not None:
            return 0
        directions = light.environment.radiance[..., 0].size * self.subdivision**2
        if light.environment.spheres is not None:
            directions += REPLICATES * SPHERE_DIRECTIONS * light.environment.spheres.count
        if self.bounces:
            directions += _directions_of_bounce(light, self.bounce_rays)
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
        partial(towards, *(part[i : i + step] for part in lights), reflectance=reflectance)
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
    engines = [(sobol(2, 2 * r), sobol(3, 2 * r + 1)) for r in range(REPLICATES)]
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
            _warn_of_error(error, f"{count} directions", target)
            break
    kinds = 2 if spheres is None else 2 + spheres.count
    return radiance.astype(np.float32), error, kinds * REPLICATES * count


def _warn_of_error(error: float, effort: str, target: float) -> None:
    warnings.warn(
        f"reference: relative error {error:.2g} after {effort}, not {target:.2g}",
        JaxvisWarning,
        stacklevel=3,
    )


def _directions_of_bounce(light: ReferenceLight, rays: int) -> int:
    """Bounce rays of a pixel, and those from their ends to the light."""
    spheres = light.environment.spheres
    return rays * (2 + LIGHTS_PER_HIT + (0 if spheres is None else spheres.count))
