"""Light that comes by one diffuse bounce: rays from each point, and rays to the light from what
they meet.

    L(x) = rho(x) / pi  integral over x's hemisphere of  rho(y) / pi  E(y)  cos dw,

where y is what the ray along w meets, rho the base colour and E the irradiance of the light itself,
with traced shadows. Light that a specular lobe reflects, at x or at y, does not count.
"""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float64
from scipy.stats import qmc
from tqdm.auto import tqdm

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
    Components,
    Proposal,
    ShadingPoints,
    block_points,
    pad_points,
    slice_points,
)
from jaxvis.reflectance import Lambert, MaterialValues
from jaxvis.sampling.sequences import BELOW_ONE
from jaxvis.scene import Hits, RayTracer
from jaxvis.scene.rays import BLOCK
from jaxvis.sphere.frames import dot

SCRAMBLINGS = 4
"""Independent estimates whose spread tells the error."""

RAYS_PER_STAGE = 64
"""Of a point: one shape for every stage, so that each is compiled once."""

HITS_PER_BLOCK = 1 << 14
"""Hits in one call of the jitted stages; the last block of a stage is padded."""

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

    A point sends ``rays`` cosine-distributed rays, and each place that one meets sends a ray
    through the environment's distribution and a cosine-distributed one, weighed by the balance
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
    engines = [
        qmc.Sobol(dimensions, rng=np.random.default_rng((seed, r))) for r in range(SCRAMBLINGS)
    ]
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
        padded = pad_points(self._points, -count % block)
        numbers = jnp.asarray(np.minimum(uniforms, BELOW_ONE), jnp.float32)
        lights = draw_lights(self._light, numbers[:, 2:4])

        def shade_block(start: int) -> None:
            inside = min(block, count - start)
            part = slice_points(padded, start, block)
            origins, directions, ray = _leave(part, numbers, inside)
            hits = _closest_hits(self._tracer, origins, directions)
            places = self._reflectors.at(hits, directions)
            ray = ray[places.ray]
            radiance = np.empty((len(ray), 3), np.float32)
            for first in range(0, len(ray), HITS_PER_BLOCK):
                rows = slice(first, min(first + HITS_PER_BLOCK, len(ray)))
                radiance[rows] = self._reflected(places, ray, rows, numbers, lights)
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
        places: Reflecting,
        ray: np.ndarray,
        rows: slice,
        numbers: Float[Array, "samples dimensions"],
        lights: Lights,
    ) -> Float[np.ndarray, "hits 3"]:
        """Radiance that places send back along their rays: rho / pi times the irradiance."""
        points = _padded_points(places, ray, rows)
        own = _of_ray(numbers, points)
        proposals = [
            balanced(_lights_of_ray(lights, points), points, reflectance=DIFFUSE),
            from_brdf(self._light, own[..., 4:7], points, reflectance=DIFFUSE),
        ]
        spheres = self._light.environment.spheres
        for i in range(self.spheres):
            assert spheres is not None
            proposals.append(
                towards_spheres(
                    spheres,
                    points,
                    jnp.full(1, i),
                    own[..., 6 + 2 * i : 8 + 2 * i],
                    1.0,
                    reflectance=DIFFUSE,
                )
            )
        inside = rows.stop - rows.start
        total = np.zeros((inside, 3), np.float32)
        origins = places.origin[rows]
        for proposal in proposals:
            total += _unblocked(self._tracer, origins, proposal, inside)
        return total
