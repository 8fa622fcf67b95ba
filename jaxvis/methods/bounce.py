"""Light that comes by one diffuse bounce: rays from each point, and rays to the light from what
they meet.

    L(x) = rho(x) / pi  integral over x's hemisphere of  rho(y) / pi  E(y)  cos dw,

where y is what the ray along w meets, rho the base colour and E the irradiance of the light itself,
with traced shadows. Light that a specular lobe reflects, at x or at y, does not count.
"""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32, Float64, Int
from tqdm.auto import tqdm

from jaxvis.chunks import block_of
from jaxvis.methods.balanced import (
    Lights,
    ReferenceLight,
    balanced,
    draw_lights,
    from_brdf,
    reflect,
)
from jaxvis.methods.reflectors import Reflecting, Reflectors, ReflectorVisibility
from jaxvis.methods.sphere_rays import towards_spheres
from jaxvis.methods.traced import (
    Proposal,
    ShadingPoints,
    block_points,
)
from jaxvis.reflectance import Lambert, MaterialValues
from jaxvis.sampling.sequences import BELOW_ONE, sobol
from jaxvis.scene import Hits, RayTracer
from jaxvis.scene.rays import BLOCK

SCRAMBLINGS = 4
"""Independent estimates whose spread tells the error."""

RAYS_PER_STAGE = 64
"""Of a point: one shape for every stage, so that each is compiled once."""

HITS_PER_BLOCK = 1 << 14
"""Hits in one call of the jitted stages, or as many as there are rays; the last is padded."""

LIGHTS_PER_HIT = 2
"""Rays through the environment's distribution from each hit, spread evenly over it: of a sun that
sends half of the light, they always try one. With one, half of the variance is theirs; four cost
more than they save."""

GOLDEN = 0.618034

DIFFUSE = Lambert()


def bounced(
    visibility: ReflectorVisibility,
    light: ReferenceLight,
    points: ShadingPoints,
    rays: int,
    *,
    seed: int = 0,
    progress: bool = False,
) -> Iterator[tuple[Float64[np.ndarray, "scramblings points 3"], int]]:
    """Radiance of each point by one diffuse bounce: independent estimates, ever better ones.

    A point sends ``rays`` cosine-distributed rays, and each place that one meets sends two rays
    through the environment's distribution and a cosine-distributed one, weighted by the balance
    heuristic, and one to each sphere light. All their directions come from scrambled Sobol points
    (Owen 1995), the same for all points so that there is no noise between them. The estimates are
    unbiased; they depend on ``seed``, and on nothing else of how the work is shared.

    Args:
        light: with its spheres in the points' coordinates.
        rays: of each point, in all scramblings together; a power of two of at least 4.
        seed: of the scramblings.

    Yields:
        (estimates, rays that each point sent for them): with ``rays`` first, then with twice as
        many and so on.
    """
    integral = _Integral(visibility, light, points)
    dimensions = 6 + 2 * integral.spheres
    engines = [sobol(dimensions, (seed, r)) for r in range(SCRAMBLINGS)]
    totals = np.zeros((SCRAMBLINGS, len(points.pixel), 3))
    count, fresh = 0, rays // SCRAMBLINGS
    while True:
        step = min(fresh, RAYS_PER_STAGE)
        stages = [(r, e.random(step)) for _ in range(fresh // step) for r, e in enumerate(engines)]
        what = f"bounce, {SCRAMBLINGS * (count + fresh)} rays"
        for r, uniforms in tqdm(stages, desc=what, leave=False, disable=not progress):
            totals[r] += integral.sums(uniforms)
        count += fresh
        albedo = np.asarray(points.material.base_colour, np.float64)
        yield albedo * totals / count, SCRAMBLINGS * count
        fresh = count


class _Numbers(NamedTuple):
    """Of each ray, in [0, 1): where it goes, and those from what it meets. Reflectance models draw
    with three; a diffuse one ignores the third."""

    leave: Float[Array, "*rays 3"]
    light: Float[Array, "*rays 2"]
    reflect: Float[Array, "*rays 3"]
    spheres: tuple[Float[Array, "*rays 2"], ...]

    @staticmethod
    def of(uniforms: Float64[np.ndarray, "samples dimensions"]) -> "_Numbers":
        parts = np.minimum(uniforms, BELOW_ONE).astype(np.float32)
        ignored = np.zeros((len(parts), 1), np.float32)
        leave, light, reflected = (parts[:, i : i + 2] for i in (0, 2, 4))
        return _Numbers(
            jnp.asarray(np.concatenate([leave, ignored], axis=1)),
            jnp.asarray(light),
            jnp.asarray(np.concatenate([reflected, ignored], axis=1)),
            tuple(jnp.asarray(parts[:, i : i + 2]) for i in range(6, parts.shape[1], 2)),
        )


class _Integral:
    """The integral's sums over rays, for all points."""

    def __init__(
        self, visibility: ReflectorVisibility, light: ReferenceLight, points: ShadingPoints
    ) -> None:
        self._tracer: RayTracer = visibility.tracer
        self._reflectors = Reflectors(visibility)
        self._light, self._points = light, points
        spheres = light.environment.spheres
        self.spheres = 0 if spheres is None else spheres.count

    def sums(
        self, uniforms: Float64[np.ndarray, "samples dimensions"]
    ) -> Float64[np.ndarray, "points 3"]:
        """Sum over a stage's rays of the radiance that they bring, without the points' albedo.

        Each thread takes a block of points through all stages: leave, meet, light, add.
        """
        count, samples = len(self._points.pixel), len(uniforms)
        result = np.zeros((count, 3))
        if not count:
            return result
        block = block_points(count, samples)
        size = min(HITS_PER_BLOCK, block * samples)
        numbers = _Numbers.of(uniforms)
        lights = _draw(self._light, numbers.light)

        def shade_block(start: int) -> None:
            inside = min(block, count - start)
            ray, origins, directions = _leave(block_of(self._points, start, block), numbers, inside)
            places = self._reflectors.at(
                _closest_hits(self._tracer, origins, directions), directions
            )
            ray = ray[places.ray]
            radiance = np.empty((len(ray), 3), np.float32)
            for first in range(0, len(ray), size):
                rows = slice(first, min(first + size, len(ray)))
                points = _shading_points(places, ray % samples, rows, size)
                radiance[rows] = self._reflected(points, places.origin[rows], numbers, lights)
            for c in range(3):
                result[start : start + inside, c] = np.bincount(
                    ray // samples, weights=radiance[:, c], minlength=inside
                )

        starts = iter(range(0, count, block))
        shade_block(next(starts))  # alone: it compiles
        with ThreadPoolExecutor(self._tracer.threads, thread_name_prefix="jaxvis-bounce") as pool:
            list(pool.map(shade_block, starts))
        return result

    def _reflected(
        self,
        points: ShadingPoints,
        origins: Float32[np.ndarray, "hits 3"],
        numbers: _Numbers,
        lights: Lights,
    ) -> Float32[np.ndarray, "hits 3"]:
        """Radiance that places send back along their rays: rho / pi times the irradiance.

        The places are ``points``, after those of ``origins`` padding.
        """
        numbers, lights = _of_each(points, numbers, lights)
        proposals = [
            balanced(lights, points, reflectance=DIFFUSE),
            from_brdf(self._light, numbers.reflect, points, reflectance=DIFFUSE),
        ]
        spheres = self._light.environment.spheres
        if spheres is not None:
            proposals += [
                towards_spheres(
                    spheres,
                    points,
                    jnp.asarray(np.full(1, light)),
                    uniforms,
                    1.0,
                    reflectance=DIFFUSE,
                )
                for light, uniforms in enumerate(numbers.spheres)
            ]
        total = np.zeros_like(origins)
        for proposal in proposals:
            total += _unblocked(self._tracer, origins, proposal)
        return total


def _leave(
    points: ShadingPoints, numbers: _Numbers, inside: int
) -> tuple[Int[np.ndarray, "rays"], Float32[np.ndarray, "rays 3"], Float32[np.ndarray, "rays 3"]]:
    """Rays from the first ``inside`` points that do not go below their triangle's plane.

    Returns (point x samples + sample, origin, direction) of each.
    """
    x, y, z = (
        np.asarray(axis)[:inside] for axis in reflect(points, numbers.leave, reflectance=DIFFUSE)
    )
    plane = np.asarray(points.geometric_normal)[:inside, :, None]
    above = x * plane[:, 0] + y * plane[:, 1] + z * plane[:, 2] > 0.0
    ray = np.flatnonzero(above)
    directions = np.empty((len(ray), 3), np.float32)
    for axis, values in enumerate((x, y, z)):
        directions[:, axis] = values.reshape(-1).take(ray)
    return ray, np.asarray(points.origin).take(ray // x.shape[1], axis=0), directions


def _closest_hits(
    tracer: RayTracer,
    origins: Float32[np.ndarray, "rays 3"],
    directions: Float32[np.ndarray, "rays 3"],
) -> Hits:
    """The closest hits, traced in this thread: a tracer shares out only what is over a block."""
    parts = [
        tracer.closest_hit(origins[first : first + BLOCK], directions[first : first + BLOCK])
        for first in range(0, max(len(origins), 1), BLOCK)
    ]
    return Hits(*(np.concatenate(leaves) for leaves in zip(*parts, strict=True)))


def _shading_points(
    places: Reflecting, sample: Int[np.ndarray, "hits"], rows: slice, size: int
) -> ShadingPoints:
    """Some of the places, padded to ``size``; ``pixel`` is the sample of their ray.

    The padding's normals are zero, and so no ray leaves it.
    """

    def pad(values: np.ndarray) -> Array:
        block = np.zeros((size, *values.shape[1:]), values.dtype)
        block[: rows.stop - rows.start] = values[rows]
        return jnp.asarray(block)

    return ShadingPoints(
        pad(places.origin),
        pad(places.normal),
        pad(places.geometric_normal),
        pad(places.view),
        _diffuse(pad(places.albedo)),
        pad(sample.astype(np.int32)),
    )


@jax.jit
def _diffuse(albedo: Float[Array, "hits 3"]) -> MaterialValues:
    return MaterialValues(albedo, jnp.zeros_like(albedo), jnp.ones_like(albedo[:, 0]))


@jax.jit
def _draw(light: ReferenceLight, uniforms: Float[Array, "samples 2"]) -> Lights:
    """Directions [samples, lights] for each sample, with an equal part of the radiance each.

    They are steps of a lattice from the place that the numbers say, so that each is distributed as
    a single one would be, and all together are spread over the distribution.
    """
    steps = jnp.arange(LIGHTS_PER_HIT) * jnp.array([[GOLDEN], [1.0 / LIGHTS_PER_HIT]])
    places = jnp.mod(uniforms[:, None, :] + steps.T, 1.0)
    lights = draw_lights(light, jnp.minimum(places, BELOW_ONE))
    red, green, blue = (channel * (1.0 / LIGHTS_PER_HIT) for channel in lights.radiance)
    return lights._replace(radiance=(red, green, blue))


@jax.jit
def _of_each(points: ShadingPoints, numbers: _Numbers, lights: Lights) -> tuple[_Numbers, Lights]:
    """Each point's own numbers [points, 1, ...] and lights [points, lights], by its sample."""

    def own(leaf: Array) -> Array:
        return jnp.take(leaf, points.pixel, axis=0, mode="clip")

    return jax.tree.map(lambda leaf: own(leaf)[:, None], numbers), jax.tree.map(own, lights)


def _unblocked(
    tracer: RayTracer, origins: Float32[np.ndarray, "hits 3"], rays: Proposal
) -> Float32[np.ndarray, "hits 3"]:
    """What each hit's ray brings if nothing blocks it, else 0."""
    inside = len(origins)
    directions = [np.asarray(axis)[:inside] for axis in rays.directions]
    limits = None if rays.limits is None else np.asarray(rays.limits)[:inside]
    visible = tracer.visible(origins, directions, np.asarray(rays.active)[:inside], limits)
    # Added up one after another: NumPy's sum over a short last axis is slow.
    total = np.zeros_like(origins)
    for channel, weights in enumerate(np.asarray(w)[:inside] for w in rays.weights):
        for sample in range(visible.shape[1]):
            total[:, channel] += np.where(visible[:, sample], weights[:, sample], np.float32(0.0))
    return total
