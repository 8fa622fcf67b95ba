"""Rays to sphere lights, each from the cone that a light subtends, that end where it begins."""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxvis.lighting.spheres import Cones, SphereLights
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
from jaxvis.sampling.cone import sample_cone
from jaxvis.sampling.sequences import sobol
from jaxvis.sphere.frames import to_world


def towards_spheres(
    spheres: SphereLights,
    points: ShadingPoints,
    lights: Int[Array, "*#points samples"],
    uniforms: Float[Array, "*#points samples 2"],
    share: Float[Array, ""] | float,
    *,
    reflectance: Reflectance,
) -> Proposal:
    """A ray to one light each, uniform over its cone.

    Weights are ``share`` x BRDF x cosine x radiance x solid angle: what the light sends on average,
    if a ``share`` of 1 / n goes with n rays.

    Args:
        spheres: in the points' coordinates.
        lights: which of them a ray goes to.
        uniforms: where in the cone.
        share: of the light's energy that a ray carries.
    """
    directions, limits, energy = _drawn(spheres, points, lights, uniforms, share)
    value, _ = reflected(points, directions, reflectance=reflectance)
    return _weighed(points, directions, value, energy, limits)


@jax.jit
def _drawn(
    spheres: SphereLights,
    points: ShadingPoints,
    lights: Int[Array, "*#points samples"],
    uniforms: Float[Array, "*#points samples 2"],
    share: Float[Array, ""] | float,
) -> tuple[Components, Float[Array, "points samples"], Float[Array, "points samples 3"]]:
    """Directions, the lengths of their rays, and their ``share`` of radiance x solid angle."""
    chosen = spheres.take(lights)
    cones = Cones.of(chosen.position, chosen.radius, points.origin[:, None])
    directions = to_world(sample_cone(uniforms, cones.versine), cones.axis)
    energy = chosen.radiance * (share * cones.solid_angle)[..., None]
    return components(directions), cones.entry(uniforms[..., 0] * cones.versine), energy


@jax.jit
def _weighed(
    points: ShadingPoints,
    directions: Components,
    value: Float[Array, "points samples 3"],
    energy: Float[Array, "points samples 3"],
    limits: Float[Array, "points samples"],
) -> Proposal:
    return propose(jnp.stack(directions, axis=-1), value * energy, points, limits)


class StratifiedSpheres:
    """Rays to each sphere light through scrambled Sobol points. These are the same for all points
    of a surface, so that there is no noise between them.

    Args:
        spheres: in the points' coordinates.
        replicates: independent scramblings.
    """

    def __init__(self, spheres: SphereLights, replicates: int) -> None:
        self.spheres = spheres
        self._engines = [
            [sobol(2, (r, light)) for light in range(spheres.count)] for r in range(replicates)
        ]

    @property
    def count(self) -> int:
        """Of the lights."""
        return self.spheres.count

    def proposals(
        self, replicate: int, count: int, step: int, reflectance: Reflectance
    ) -> list[Propose]:
        """The next ``count`` rays to each light, ``step`` of them at once; each carries all of the
        light's energy."""
        proposals: list[Propose] = []
        for light, engine in enumerate(self._engines[replicate]):
            uniforms = jnp.asarray(engine.random(count), jnp.float32)
            lights = jnp.full(step, light)
            for i in range(0, count, step):
                proposals.append(
                    partial(
                        towards_spheres,
                        self.spheres,
                        lights=lights,
                        uniforms=uniforms[i : i + step],
                        share=1.0,
                        reflectance=reflectance,
                    )
                )
        return proposals
