"""Environments as spherical Gaussians: a few fitted ones, or one for each cell of a partition."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float

from jaxvis.cache import cached_arrays, content_hash
from jaxvis.lighting.environment import Environment
from jaxvis.lighting.partition import partition
from jaxvis.sphere import latlong
from jaxvis.sphere.gaussians import SphericalGaussians, total

LADDER = (2.0, 8.0, 32.0, 128.0, 512.0, 4096.0)
"""Sharpnesses that a fit may begin with."""

ENERGY = 3.0
"""Weight of the squared relative error of the whole energy, in units of the energy."""

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def cell_gaussians(
    environment: Environment, count: int = 512, sharpest: float = 1e4
) -> SphericalGaussians:
    """One lobe for each of ``count`` cells of an adaptive partition of the sphere (host).

    Each lobe has exactly its cell's radiant energy in each channel. Its axis is the cell's
    luminance-weighted mean direction. Its sharpness is that of a lobe of the same spread: 4 pi /
    solid angle for a round cell of one radiance, or 1 / (1 - R) for a mean direction of length R if
    that is more. Cut by half-spaces such lobes come nearest to the cells' light; the sum of all is
    no picture of it, with peaks of twice the radiance. A map with fewer texels than ``count`` gets
    black lobes for the rest.

    Raises:
        ValueError: ``count`` below :data:`~jaxvis.lighting.partition.COARSEST`.
    """
    radiance = np.asarray(environment.radiance, np.float64)
    height, width = radiance.shape[:2]
    solid_angles = np.repeat(latlong.row_solid_angles(height, width)[:, None], width, axis=1)
    flux = radiance * solid_angles[..., None]
    brightness = flux @ LUMINANCE
    labels = np.empty((height, width), np.int64)
    for number, (top, bottom, left, right) in enumerate(partition(brightness, count)):
        labels[top:bottom, left:right] = number

    def sums(values: np.ndarray) -> np.ndarray:
        columns = values.reshape(height * width, -1).T
        added = [np.bincount(labels.ravel(), column, count) for column in columns]
        return np.stack(added, axis=-1)

    # A trace of the mean light: the axis of a black cell is its middle.
    weight = brightness + 1e-9 * np.maximum(brightness.mean(), 1e-30)
    towards = sums(latlong.texel_directions(height, width) * weight[..., None])
    weights = np.maximum(sums(weight), 1e-300)
    within = sums(weight * solid_angles) / weights / (4.0 * np.pi)  # spread inside of the texels
    length = np.linalg.norm(towards, axis=-1, keepdims=True)
    axis = np.where(length > 0.0, towards / np.maximum(length, 1e-300), [0.0, 1.0, 0.0])
    spread = np.minimum(1.0 - length / weights + within, sums(solid_angles) / (4.0 * np.pi))[:, 0]
    sharpness = jnp.asarray(np.minimum(1.0 / np.maximum(spread, 1e-9), sharpest), jnp.float32)
    each = np.asarray(total(sharpness), np.float64)
    amplitude = jnp.asarray(sums(flux) / each[:, None], jnp.float32)
    return SphericalGaussians(jnp.asarray(axis, jnp.float32), sharpness, amplitude)


class GaussianFit(NamedTuple):
    """Fitted lobes and how well they fit."""

    lobes: SphericalGaussians
    residual: float
    """Root mean square error over the root mean square of the map that was fitted."""
    weighted_residual: float
    """The same with weights 1 / (L + a tenth of the mean), those of the fit: counts dim areas."""
    energy: tuple[float, float, float]
    """Energy of the fit over that of the map, each channel, before the amplitudes were scaled."""


def fit_gaussians(
    environment: Environment,
    count: int = 32,
    steps: int = 2000,
    *,
    height: int = 64,
    sharpest: float = 1e4,
    step_size: float = 0.03,
    cached: bool = True,
) -> GaussianFit:
    """``count`` lobes whose sum is close to the environment; same input, same lobes.

    Matching pursuit on a coarse map places lobes one by one, each at the direction and the
    sharpness of :data:`LADDER` that explain most of what is left; Adam then moves all axes,
    sharpnesses (1 to ``sharpest``) and amplitudes for ``steps`` steps. The loss is the integral of
    \\|error\\|^2 / (L + mean / 10) on a map of ``height`` rows. Lastly each channel is scaled to
    the environment's total energy. Results are kept in the cache, by content.

    Raises:
        ValueError: ``count``, ``steps`` or ``height`` out of range.
    """
    if count < 1 or steps < 0:
        raise ValueError(f"count must be at least 1 and steps 0, got {count} and {steps}")
    if height < 4 or not sharpest > 1.0:
        raise ValueError(
            f"height must be at least 4 and sharpest above 1, got {height} and {sharpest}"
        )
    settings = (count, steps, height, sharpest, step_size, LADDER)

    def build() -> dict[str, np.ndarray]:
        return _fit(environment, count, steps, height, sharpest, step_size)

    if cached:
        key = content_hash("1", np.asarray(environment.radiance), settings)
        arrays, _ = cached_arrays("gaussian-fit", key, build)
    else:
        arrays = build()
    lobes = SphericalGaussians(
        *(jnp.asarray(arrays[name]) for name in ("axis", "sharpness", "amplitude"))
    )
    red, green, blue = (float(ratio) for ratio in arrays["energy"])
    residual, weighted = (float(value) for value in arrays["residuals"])
    return GaussianFit(lobes, residual, weighted, (red, green, blue))


def _fit(
    environment: Environment,
    count: int,
    steps: int,
    height: int,
    sharpest: float,
    step_size: float,
) -> dict[str, np.ndarray]:
    target = _map_of(environment, height)
    mean = max(float((target.weight @ target.radiance).sum()) / (12.0 * np.pi), 1e-30)
    target = _scaled(target, mean)
    coarse = _scaled(_map_of(environment, min(32, height)), mean)
    start = _pursue(coarse, jnp.asarray(LADDER, jnp.float32), count=count)
    lobes = _descend(start, target, jnp.float32(sharpest), jnp.float32(step_size), steps=steps)
    energy = np.asarray(environment.radiance, np.float64).sum(axis=1)
    energy = latlong.row_solid_angles(environment.height, environment.width) @ energy
    found = mean * np.asarray(lobes.integral(), np.float64).sum(axis=0)
    scale = np.where(found > 0.0, energy / np.maximum(found, 1e-30), 0.0)
    lobes = SphericalGaussians(
        lobes.axis, lobes.sharpness, lobes.amplitude * jnp.asarray(scale, jnp.float32)
    )
    residuals = _residuals(lobes, target)
    return {
        "axis": np.asarray(lobes.axis),
        "sharpness": np.asarray(lobes.sharpness),
        "amplitude": np.asarray(lobes.amplitude) * np.float32(mean),
        "energy": np.where(energy > 0.0, found / np.maximum(energy, 1e-30), 1.0),
        "residuals": np.asarray(residuals),
    }


class _Map(NamedTuple):
    """A map's texels as a list."""

    directions: Float[np.ndarray, "texels 3"]
    radiance: Float[np.ndarray, "texels 3"]
    level: Float[np.ndarray, "texels 3"]
    """Mean radiance of 3 x 3 texels: what is next to the sun is not held to its own darkness."""
    weight: Float[np.ndarray, "texels"]
    """Solid angles."""
    spread: Float[np.ndarray, "texels"]
    """Variance (square radians, along one axis) of the Gaussian that stands for its footprint."""


def _map_of(environment: Environment, height: int) -> _Map:
    """The environment at ``height`` rows, at most its own."""
    height = min(height, environment.height)
    radiance = np.asarray(environment.resize(height).radiance)
    down = np.pad(radiance, ((1, 1), (0, 0), (0, 0)), mode="edge")
    across = down[:-2] + down[1:-1] + down[2:]
    level = (np.roll(across, 1, axis=1) + across + np.roll(across, -1, axis=1)) / 9.0
    directions = latlong.texel_directions(height, 2 * height).reshape(-1, 3).astype(np.float32)
    weight = np.repeat(latlong.row_solid_angles(height, 2 * height), 2 * height)
    # Density 1 / solid angle at the middle, as the texel's own; 0.46 of it at the edge, for 1/2.
    spread = weight / (2.0 * np.pi)
    light = radiance.reshape(-1, 3), level.reshape(-1, 3)
    return _Map(directions, *light, weight.astype(np.float32), spread.astype(np.float32))


def _scaled(target: _Map, mean: float) -> _Map:
    scale = np.float32(1.0 / mean)
    return target._replace(radiance=target.radiance * scale, level=target.level * scale)


def _importance(target: _Map) -> Float[Array, "texels 3"]:
    """Solid angle over (L + 0.1 mean); the map's mean is 1."""
    return jnp.asarray(target.weight)[:, None] / (target.level + 0.1)


@partial(jax.jit, static_argnames="count")
def _pursue(target: _Map, ladder: Float[Array, "levels"], *, count: int) -> SphericalGaussians:
    """Lobes at texels' centres, each the one that lowers the loss most."""
    kernels = jax.vmap(lambda sharpness: _averages(target.directions, sharpness, target))(ladder)
    kernels = jnp.swapaxes(kernels, 1, 2)
    weight = _importance(target)
    squares = jnp.einsum("ltu,uc->ltc", jnp.square(kernels), weight)

    def add(left, _):
        overlap = jnp.einsum("ltu,uc->ltc", kernels, weight * left)
        amplitude = jnp.maximum(overlap, 0.0) / squares
        gain = jnp.sum(amplitude * (2.0 * overlap - amplitude * squares), axis=-1)
        best = jnp.argmax(gain)
        level, place = best // gain.shape[1], best % gain.shape[1]
        chosen = amplitude[level, place]
        left = left - kernels[level, place][:, None] * chosen
        return left, (jnp.asarray(target.directions)[place], ladder[level], chosen)

    _, (axis, sharpness, amplitude) = jax.lax.scan(add, target.radiance, length=count)
    return SphericalGaussians(axis, sharpness, amplitude)


class _Free(NamedTuple):
    """Unbounded parameters of lobes."""

    vector: Float[Array, "lobes 3"]
    logit: Float[Array, "lobes"]
    """Of log sharpness between 0 and that of the sharpest."""
    logarithm: Float[Array, "lobes 3"]
    """Of the amplitude: from walls to the sun, one step size fits all."""

    def lobes(self, sharpest: Float[Array, ""]) -> SphericalGaussians:
        length = jnp.sqrt(jnp.sum(jnp.square(self.vector), axis=-1, keepdims=True))
        sharpness = jnp.exp(jax.nn.sigmoid(self.logit) * jnp.log(sharpest))
        return SphericalGaussians(self.vector / length, sharpness, jnp.exp(self.logarithm))


def _residuals(
    lobes: SphericalGaussians, target: _Map
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    error, light = jnp.square(_sum(lobes, target) - target.radiance), jnp.square(target.radiance)
    weights = jnp.asarray(target.weight)[:, None] * jnp.ones(3), _importance(target)
    plain, weighted = (
        jnp.sqrt(jnp.sum(w * error) / jnp.maximum(jnp.sum(w * light), 1e-30)) for w in weights
    )
    return plain, weighted


def _sum(lobes: SphericalGaussians, target: _Map) -> Float[Array, "texels 3"]:
    return _averages(lobes.axis, lobes.sharpness, target) @ lobes.amplitude


def _averages(
    axis: Float[Array | np.ndarray, "lobes 3"],
    sharpness: Float[Array, "*#lobes"],
    target: _Map,
) -> Float[Array, "texels lobes"]:
    """Lobes of amplitude 1 averaged over the texels, which counts for those narrower than a texel.

    A texel's footprint is taken for a Gaussian: variances, inverses of sharpness, add up.
    """
    share = 1.0 / (1.0 + sharpness * jnp.asarray(target.spread)[:, None])
    cosine = jnp.asarray(target.directions) @ jnp.asarray(axis).T  # precise enough to sharpness 1e4
    return share * jnp.exp(sharpness * share * (cosine - 1.0))


@partial(jax.jit, static_argnames="steps")
def _descend(
    start: SphericalGaussians,
    target: _Map,
    sharpest: Float[Array, ""],
    step_size: Float[Array, ""],
    *,
    steps: int,
) -> SphericalGaussians:
    share = jnp.clip(jnp.log(start.sharpness) / jnp.log(sharpest), 0.02, 0.98)
    faint = 1e-4 * jnp.max(start.amplitude, axis=-1, keepdims=True) + 1e-6
    free = _Free(
        start.axis,
        jnp.log(share / (1.0 - share)),
        jnp.log(jnp.maximum(start.amplitude, faint)),
    )
    weight = _importance(target)

    energy = jnp.asarray(target.weight) @ target.radiance

    def loss(free: _Free) -> Float[Array, ""]:
        lobes = free.lobes(sharpest)
        shape = jnp.sum(weight * jnp.square(_sum(lobes, target) - target.radiance))
        missing = jnp.sum(lobes.integral(), axis=0) - energy
        return shape + ENERGY * jnp.sum(jnp.square(missing) / jnp.maximum(energy, 1e-3))

    rate = optax.cosine_decay_schedule(1.0, max(steps, 1))
    optimizer = optax.chain(optax.scale_by_adam(), optax.scale_by_schedule(rate))

    def step(carry, _):
        free, state = carry
        value, gradient = jax.value_and_grad(loss)(free)
        update, state = optimizer.update(gradient, state)
        free = jax.tree.map(lambda parameter, by: parameter - step_size * by, free, update)
        return (free, state), value

    (free, _), _ = jax.lax.scan(step, (free, optimizer.init(free)), length=steps)
    return free.lobes(sharpest)
