"""What the Monte Carlo methods share: how many rays, of what, traced and added up."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float, UInt32
from tqdm.auto import tqdm

from jaxvis.methods.base import Method
from jaxvis.methods.estimators import (
    Counts,
    DrawnLight,
    proposals,
    sphere_proposal,
    tossed_proposal,
)
from jaxvis.methods.traced import (
    Propose,
    RayVisibility,
    ShadingPoints,
    to_image,
    trace_and_sum,
)
from jaxvis.reflectance import Reflectance
from jaxvis.scene import Scene, Surface


class Estimator(Method):
    """A method that traces ``spp`` rays a shaded pixel, in chunks of ``rays_per_chunk``, and as
    many more to sphere lights where the environment has any.

    Subclasses are dataclasses whose ``__post_init__`` calls this one's.
    """

    spp: int
    rays_per_chunk: int

    stochastic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Refuses numbers of rays below 1.

        Raises:
            ValueError: naming the parameter.
        """
        if self.spp < 1:
            raise ValueError(f"spp must be at least 1, got {self.spp}")
        if self.rays_per_chunk < 1:
            raise ValueError(f"rays_per_chunk must be at least 1, got {self.rays_per_chunk}")

    def precompute(self, scene: Scene, progress: bool = True) -> RayVisibility:
        """Nothing but the Embree tree."""
        return RayVisibility.of(scene)

    def evaluations(self, visibility: RayVisibility, light: DrawnLight, surface: Surface) -> int:
        """``spp`` a shaded pixel, and as many to sphere lights where there are any."""
        lit_by = 1 if light.environment.spheres is None else 2
        return lit_by * self.spp * int(jnp.sum(surface.mask))


def halves(spp: int) -> Counts:
    """Half of the rays from the light, half from the BRDF; the odd one from the light."""
    return Counts(environment=(spp + 1) // 2, brdf=spp // 2)


def balanced_proposals(
    counts: Counts, light: DrawnLight, words: UInt32[Array, "2"], reflectance: Reflectance
) -> list[Propose]:
    """Rays from the light and the BRDF under the balance heuristic.

    The single one of ``halves(1)`` comes from either technique, by the toss of a coin.
    """
    if counts == halves(1):
        return [tossed_proposal(light, words, reflectance)]
    return proposals(counts, light, words, reflectance)


def estimate(
    visibility: RayVisibility,
    light: DrawnLight,
    surface: Surface,
    points: ShadingPoints,
    proposed: list[Propose],
    words: UInt32[Array, "2"],
    method: Estimator,
    *,
    most: int,
    progress: bool = False,
) -> Float[Array, "height width 3"]:
    """The image of what the proposed rays, and ``spp`` to sphere lights, bring from the light.

    No proposal gives more than ``most`` rays a point.
    """
    spheres = light.environment.seen_from(surface.origin).spheres
    if spheres is not None:
        proposed = [*proposed, sphere_proposal(spheres, words, method.spp, surface.reflectance)]
        most = method.spp
    with tqdm(total=len(points.pixel), desc="shading", unit="px", disable=not progress) as bar:
        radiance = trace_and_sum(
            visibility.tracer,
            points,
            proposed,
            most,
            rays_per_chunk=method.rays_per_chunk,
            advance=bar.update,
        )
    return to_image(surface, points, radiance)
