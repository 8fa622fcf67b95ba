"""The estimators: rays whose weights add up to an unbiased estimate of (20), paper 000.

All are one multi-sample estimator (Veach and Guibas 1995): n_t directions from each technique t,
each weighted by f / sum_t n_t p_t, which is the balance heuristic. Drawing and weighing are jitted
apart, in a few large kernels, so that what several outputs share is computed once. A point's rays
depend on its pixel, its sample numbers and the key alone.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt32

from jaxvis.lighting import Environment, SphereLights
from jaxvis.methods.sphere_rays import towards_spheres
from jaxvis.methods.traced import (
    Components,
    Proposal,
    Propose,
    ShadingPoints,
    components,
    propose,
    reflected,
)
from jaxvis.reflectance import Reflectance
from jaxvis.sampling import EnvironmentSampler
from jaxvis.sampling.hemisphere import pdf_uniform, sample_uniform
from jaxvis.sampling.random import counter_bits, uniform
from jaxvis.sphere import latlong
from jaxvis.sphere.frames import dot, to_world


class Drawn(NamedTuple):
    """Directions with the environment texels (row * width + column) that they point to."""

    directions: Components
    texel: Int[Array, "points samples"]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class MonteCarloLight:
    """An environment and the table by which its directions are drawn."""

    environment: Environment
    sampler: EnvironmentSampler

    @classmethod
    def of(
        cls,
        environment: Environment,
        sharpen: Callable[[np.ndarray], np.ndarray] = lambda luminance: luminance,
    ) -> "MonteCarloLight":
        """Directions are drawn in proportion to luminance, or to what ``sharpen`` makes of it."""
        luminance = np.asarray(environment.radiance, np.float64) @ [0.2126, 0.7152, 0.0722]
        return cls(environment, EnvironmentSampler.build(sharpen(luminance)))

    def draw(self, words: UInt32[Array, "2"], points: ShadingPoints, samples: int) -> Drawn:
        """``samples`` directions for each point, in proportion to the environment's luminance."""
        return draw_environment(self, random_numbers(words, points, first=0, samples=samples))

    def density(self, points: ShadingPoints, drawn: Drawn) -> Float[Array, "points samples"]:
        """Density per steradian with which :meth:`draw` gives these directions to these points."""
        return self.sampler.texel_pdf(drawn.texel)


class Counts(NamedTuple):
    """How many directions a point draws from each technique."""

    uniform: float = 0
    environment: float = 0
    brdf: float = 0


Draw = Callable[[ShadingPoints], Drawn]


@runtime_checkable
class DrawnLight(Protocol):
    """A pytree from which the directions of the technique "environment" are drawn.

    They may be drawn from the environment's luminance (:class:`MonteCarloLight`) or from something
    closer to what a point receives, if it is positive wherever light may come from.
    """

    @property
    def environment(self) -> Environment: ...

    def draw(self, words: UInt32[Array, "2"], points: ShadingPoints, samples: int) -> Drawn: ...

    def density(self, points: ShadingPoints, drawn: Drawn) -> Float[Array, "points samples"]: ...


def draws(
    counts: Counts, light: DrawnLight, words: UInt32[Array, "2"], reflectance: Reflectance
) -> list[Draw]:
    """One way to draw directions for each technique that is drawn from."""

    def from_uniform(points: ShadingPoints) -> Drawn:
        numbers = random_numbers(words, points, first=0, samples=int(counts.uniform))
        return located(draw_uniform(points, numbers), light)

    def from_environment(points: ShadingPoints) -> Drawn:
        return light.draw(words, points, int(counts.environment))

    def from_brdf(points: ShadingPoints) -> Drawn:
        first = int(counts.environment)  # numbers that the environment's directions leave
        numbers = random_numbers(words, points, first=first, samples=int(counts.brdf))
        return located(draw_brdf(points, numbers, reflectance=reflectance), light)

    techniques = (from_uniform, from_environment, from_brdf)
    return [draw for count, draw in zip(counts, techniques, strict=True) if count]


def proposals(
    counts: Counts, light: DrawnLight, words: UInt32[Array, "2"], reflectance: Reflectance
) -> list[Propose]:
    """One proposal for each technique that is drawn from."""

    def proposal(draw: Draw) -> Propose:
        def propose_rays(points: ShadingPoints) -> Proposal:
            drawn = draw(points)
            return weighed(light, points, drawn, counts=counts, reflectance=reflectance)

        return propose_rays

    return [proposal(draw) for draw in draws(counts, light, words, reflectance)]


def tossed_proposal(
    light: DrawnLight, words: UInt32[Array, "2"], reflectance: Reflectance
) -> Propose:
    """A single direction, from the environment or the BRDF by the toss of a coin.

    The density of what results is the mean of the two.
    """

    def toss(points: ShadingPoints) -> Proposal:
        numbers = random_numbers(words, points, first=0, samples=1)
        coin = random_numbers(words, points, first=1, samples=1)[0]
        lit = light.draw(words, points, 1)
        reflected = located(draw_brdf(points, numbers, reflectance=reflectance), light)
        drawn = jax.tree.map(lambda a, b: jnp.where(coin < 0.5, a, b), lit, reflected)
        half = Counts(environment=0.5, brdf=0.5)
        return weighed(light, points, drawn, counts=half, reflectance=reflectance)

    return toss


def sphere_proposal(
    spheres: SphereLights,
    words: UInt32[Array, "2"],
    samples: int,
    reflectance: Reflectance,
) -> Propose:
    """``samples`` rays a point to sphere lights (in the points' coordinates), shared fairly.

    Each light gets ``samples`` / lights of them, rounded up or down by chance: rays take the lights
    in order, from a random place of the first one's share on, so that no ray is lost or given
    twice, and each light's expectation is its share.
    """
    share = spheres.count / samples

    def propose_rays(points: ShadingPoints) -> Proposal:
        # After the numbers of the environment's rays, be they as many or a coin more.
        numbers = random_numbers(words, points, first=samples + 1, samples=samples)
        lights, uniforms = _assigned(numbers, count=spheres.count)
        return towards_spheres(spheres, points, lights, uniforms, share, reflectance=reflectance)

    return propose_rays


@partial(jax.jit, static_argnames="count")
def _assigned(
    numbers: tuple[Float[Array, "points samples"], ...], *, count: int
) -> tuple[Int[Array, "points samples"], Float[Array, "points samples 2"]]:
    """The light of each ray, and its numbers within the cone."""
    samples = numbers[0].shape[1]
    place = (jnp.arange(samples) + numbers[2][:, :1]) * (count / samples)
    return jnp.minimum(place.astype(jnp.int32), count - 1), jnp.stack(numbers[:2], axis=-1)


@partial(jax.jit, static_argnames=("first", "samples"))
def random_numbers(
    words: UInt32[Array, "2"], points: ShadingPoints, *, first: int, samples: int
) -> tuple[Float[Array, "points samples"], ...]:
    """Four numbers in [0, 1) for each of a point's samples ``first``, ``first`` + 1, ..."""
    sample = jnp.arange(first, first + samples)
    return tuple(uniform(b) for b in counter_bits(words, points.pixel[:, None], sample[None, :]))


@jax.jit
def draw_uniform(
    points: ShadingPoints, numbers: tuple[Float[Array, "points samples"], ...]
) -> Components:
    """Directions uniform over the hemisphere of the shading normal."""
    local = sample_uniform(jnp.stack(numbers[:2], axis=-1))
    return components(to_world(local, points.normal[:, None, :]))


def draw_environment(
    light: MonteCarloLight, numbers: tuple[Float[Array, "points samples"], ...]
) -> Drawn:
    """Directions in proportion to the environment's luminance."""
    texel = draw_texel(light, numbers[0], numbers[1])
    return Drawn(place_in_texel(light, texel, numbers[2], numbers[3]), texel)


@jax.jit
def draw_texel(
    light: MonteCarloLight, u: Float[Array, "points samples"], v: Float[Array, "points samples"]
) -> Int[Array, "points samples"]:
    """Texels in proportion to luminance x solid angle."""
    return light.sampler.table.sample(u, v)


@jax.jit
def place_in_texel(
    light: MonteCarloLight,
    texel: Int[Array, "points samples"],
    u: Float[Array, "points samples"],
    v: Float[Array, "points samples"],
) -> Components:
    """Directions uniform within texels."""
    return components(light.sampler.inside(texel, u, v))


@partial(jax.jit, static_argnames="reflectance")
def draw_brdf(
    points: ShadingPoints,
    numbers: tuple[Float[Array, "points samples"], ...],
    *,
    reflectance: Reflectance,
) -> Components:
    """Directions in proportion to the reflectance model's sampling density."""
    uniforms = jnp.stack(numbers[:3], axis=-1)
    return components(reflectance.sample(*points.per_sample(), uniforms))


@jax.jit
def located(directions: Components, light: DrawnLight) -> Drawn:
    """Directions with their texels."""
    height, width = light.environment.radiance.shape[:2]
    row, column = latlong.texel(jnp.stack(directions, axis=-1), height, width)
    return Drawn(directions, row * width + column)


def weighed(
    light: DrawnLight,
    points: ShadingPoints,
    drawn: Drawn,
    *,
    counts: Counts,
    reflectance: Reflectance,
) -> Proposal:
    """BRDF x cosine x radiance / sum over the techniques of count x density."""
    value, density = reflected(points, drawn.directions, reflectance=reflectance)
    return divided(light, points, drawn, value, density, counts=counts)


@partial(jax.jit, static_argnames="counts")
def divided(
    light: DrawnLight,
    points: ShadingPoints,
    drawn: Drawn,
    value: Float[Array, "points samples 3"],
    density: Float[Array, "points samples"],
    *,
    counts: Counts,
) -> Proposal:
    """``value`` x radiance over the expected number of directions per steradian."""
    directions = jnp.stack(drawn.directions, axis=-1)
    total = counts.brdf * density
    if counts.environment:
        total = total + counts.environment * light.density(points, drawn)
    if counts.uniform:
        cosine = dot(points.normal[:, None, :], directions)
        total = total + counts.uniform * pdf_uniform(cosine)
    over = jnp.where(total > 0.0, 1.0 / jnp.where(total > 0.0, total, 1.0), 0.0)
    radiance = light.environment.radiance.reshape(-1)
    texel = 3 * drawn.texel
    weights = [value[..., c] * jnp.take(radiance, texel + c, mode="clip") * over for c in range(3)]
    return propose(directions, jnp.stack(weights, axis=-1), points)
