"""Monte Carlo integration of direct light, one estimator per sampling strategy."""

from dataclasses import dataclass
from typing import Literal, get_args

import jax
import numpy as np
from jaxtyping import Array, Float

from jaxvis.lighting import Environment
from jaxvis.methods.base import require_key
from jaxvis.methods.estimators import Counts, MonteCarloLight, proposals
from jaxvis.methods.monte_carlo.estimate import (
    Estimator,
    balanced_proposals,
    estimate,
    halves,
)
from jaxvis.methods.traced import RAYS_PER_CHUNK, RayVisibility, shading_points
from jaxvis.sampling.random import key_words
from jaxvis.scene import Surface
from jaxvis.sphere.latlong import row_solid_angles

Strategy = Literal["uniform", "environment", "brdf", "mis"]


@dataclass(frozen=True)
class MonteCarlo(Estimator):
    """Unbiased Monte Carlo with ``spp`` rays a pixel (a camera ray, with supersampling).

    Strategies: ``uniform`` over the hemisphere; ``environment`` in proportion to luminance times
    solid angle, by an alias table over the texels; ``brdf`` in proportion to the reflectance
    model's sampling density; ``mis``, half of the rays from each of the last two, weighted by the
    balance heuristic (Veach and Guibas 1995). ``compensation`` sharpens the environment's density
    for ``mis`` (Karlik et al. 2019, "MIS Compensation").

    Sphere lights, where the environment has any, get ``spp`` rays more, shared among them and
    uniform over the cones that they subtend, whatever the strategy.
    """

    strategy: Strategy = "mis"
    spp: int = 64
    compensation: bool = False
    rays_per_chunk: int = RAYS_PER_CHUNK

    def __post_init__(self) -> None:
        strategies = get_args(Strategy)
        if self.strategy not in strategies:
            raise ValueError(
                f"strategy must be one of {', '.join(strategies)}, got {self.strategy!r}"
            )
        super().__post_init__()
        if self.compensation and self.strategy != "mis":
            raise ValueError(f"compensation needs strategy 'mis', got {self.strategy!r}")

    def light(self, environment: Environment) -> MonteCarloLight:
        """The environment with its sampling table."""
        if self.compensation:
            return MonteCarloLight.of(environment, sharpen=compensated)
        return MonteCarloLight.of(environment)

    def shade(
        self,
        visibility: RayVisibility,
        light: MonteCarloLight,
        surface: Surface,
        *,
        key: jax.Array | None = None,
        progress: bool = False,
    ) -> Float[Array, "height width 3"]:
        """One estimate of each pixel's radiance; independent between pixels and between keys."""
        points = shading_points(surface)
        words, reflectance = key_words(require_key(key, self)), surface.reflectance
        if self.strategy == "mis":
            proposed = balanced_proposals(self.counts, light, words, reflectance)
        else:
            proposed = proposals(self.counts, light, words, reflectance)
        return estimate(
            *(visibility, light, surface, points, proposed, words, self),
            most=int(max(self.counts)),
            progress=progress,
        )

    @property
    def counts(self) -> Counts:
        """Rays a pixel from each technique."""
        if self.strategy == "mis":
            return halves(self.spp)
        return Counts(**{self.strategy: self.spp})


def compensated(luminance: Float[np.ndarray, "height width"]) -> Float[np.ndarray, "height width"]:
    """What exceeds the sphere's mean: the sharpened density of Karlik et al. 2019, eq. 14 ff.

    BRDF sampling covers the dim rest. A map without contrast keeps its own density.
    """
    mean = np.average(luminance.mean(axis=1), weights=row_solid_angles(*luminance.shape))
    excess = np.maximum(luminance - mean, 0.0)
    return excess if excess.sum() > 1e-3 * luminance.sum() else luminance
