"""What the rays of a visibility field carry: nine harmonics, or the environment itself."""

from dataclasses import dataclass

import jax
from jaxtyping import Array, Float

from jaxvis.lighting import Environment
from jaxvis.methods.estimators import MonteCarloLight
from jaxvis.sphere import harmonics


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class FieldLight:
    """Low-frequency light as its first nine coefficients, and all of it with its sampling table.

    Rays and unshadowed irradiance both come from the same coefficients, unclamped, so that cells
    of different labels meet without a seam (spec 2.2); the radiance can be slightly negative where
    a bright light rings.
    """

    coefficients: Float[Array, "9 3"]
    all_frequency: MonteCarloLight | None

    @classmethod
    def low_frequency(cls, environment: Environment) -> "FieldLight":
        """The nine coefficients alone."""
        return cls(harmonics.project(environment.radiance, 3), None)

    @classmethod
    def whole(cls, environment: Environment) -> "FieldLight":
        """The environment with its table too."""
        coefficients = harmonics.project(environment.radiance, 3)
        return cls(coefficients, MonteCarloLight.of(environment))
