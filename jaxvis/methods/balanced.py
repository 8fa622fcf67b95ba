"""The reference's rays: to directional lights, or through the environment's distribution and the
BRDF's, weighted by the balance heuristic.
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxvis.lighting import Environment
from jaxvis.methods.traced import (
    Components,
    Proposal,
    ShadingPoints,
    components,
    propose,
    reflected,
)
from jaxvis.reflectance import Reflectance
from jaxvis.sampling import LatLongDistribution
from jaxvis.sphere import latlong


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ReferenceLight:
    """The environment that is integrated, and the table from which subsets are drawn.

    Its spheres are in world coordinates.
    """

    environment: Environment
    distribution: LatLongDistribution


def towards(
    directions: Float[Array, "lights 3"],
    flux: Float[Array, "lights 3"],
    points: ShadingPoints,
    *,
    reflectance: Reflectance,
) -> Proposal:
    """Rays to the same directional lights for every point; ``flux`` is radiance x solid angle."""
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


class Lights(NamedTuple):
    """Directional lights: radiance and the environment's sampling density along each."""

    directions: Components
    radiance: Components
    density: Float[Array, "*#points lights"]


@jax.jit
def draw_lights(light: ReferenceLight, uniforms: Float[Array, "*points lights 2"]) -> Lights:
    """Unit directions through the environment's distribution."""
    return looked_up(light, components(light.distribution.sample(uniforms)))


def from_brdf(
    light: ReferenceLight,
    uniforms: Float[Array, "*#points lights 3"],
    points: ShadingPoints,
    *,
    reflectance: Reflectance,
) -> Proposal:
    """Directions through the BRDF's distribution, balanced against the environment's."""
    directions = reflect(points, uniforms, reflectance=reflectance)
    return balanced(looked_up(light, directions), points, reflectance=reflectance)


@partial(jax.jit, static_argnames="reflectance")
def reflect(
    points: ShadingPoints, uniforms: Float[Array, "*#points lights 3"], *, reflectance: Reflectance
) -> Components:
    """Directions through the BRDF's distribution: the same numbers for every point, or its own."""
    everywhere = jnp.broadcast_to(uniforms, (len(points.normal), *uniforms.shape[-2:]))
    return components(reflectance.sample(*points.per_sample(), everywhere))


@jax.jit
def looked_up(light: ReferenceLight, directions: Components) -> Lights:
    """What the environment sends along unit directions, and how densely it is drawn there."""
    height, width = light.distribution.density.shape
    row, column = latlong.texel(jnp.stack(directions, axis=-1), height, width)
    texel = row * width + column
    radiance = light.environment.radiance.reshape(-1)
    red, green, blue = (jnp.take(radiance, 3 * texel + c, mode="clip") for c in range(3))
    density = jnp.take(light.distribution.density.reshape(-1), texel, mode="clip")
    return Lights(directions, (red, green, blue), density)


def balanced(lights: Lights, points: ShadingPoints, *, reflectance: Reflectance) -> Proposal:
    """Rays to the lights, weighted by the balance heuristic between environment and BRDF."""
    shape = (len(points.normal), lights.density.shape[-1])
    x, y, z = (jnp.broadcast_to(axis, shape) for axis in lights.directions)
    value, density = reflected(points, (x, y, z), reflectance=reflectance)
    return _divided(points, (x, y, z), lights, value, density)


@jax.jit
def _divided(
    points: ShadingPoints,
    directions: Components,
    lights: Lights,
    value: Float[Array, "points lights 3"],
    density: Float[Array, "points lights"],
) -> Proposal:
    """``value`` x radiance over the sum of both densities: the balance heuristic, 1 : 1."""
    over = 1.0 / jnp.maximum(density + lights.density, 1e-30)
    weights = [value[..., c] * lights.radiance[c] * over for c in range(3)]
    return propose(jnp.stack(directions, axis=-1), jnp.stack(weights, axis=-1), points)
