"""The three verbs that every method has (DESIGN §1)."""

import dataclasses
from abc import ABC, abstractmethod
from typing import Any, ClassVar

import jax
from jaxtyping import Array, Float

from jaxvis.lighting import Environment
from jaxvis.scene import Scene, Surface


@dataclasses.dataclass(frozen=True)
class Method(ABC):
    """A way to light a scene: a frozen dataclass of hyperparameters with three verbs.

    ``precompute`` returns a Visibility, a pytree with ``nbytes``, ``save(path)`` and
    ``load(path)``; ``light`` returns a pytree. ``shade`` is deterministic unless
    :attr:`stochastic`; then it needs an explicit ``key``, and the same key gives the same bits.
    """

    stochastic: ClassVar[bool] = False

    @abstractmethod
    def precompute(self, scene: Scene, progress: bool = True) -> Any:
        """What the method stores of the scene's visibility. Host; may trace rays."""

    def precompute_for(
        self, scene: Scene, surface: Surface, previous: Any = None, progress: bool = True
    ) -> Any:
        """:meth:`precompute` for one view: methods that sample visibility anew for every frame
        store no more than the surface shows.

        ``previous`` is what this gave for the frame before of an animation (the same triangles
        with other vertex positions), from which such methods carry over what still holds.
        """
        return self.precompute(scene, progress)

    @abstractmethod
    def light(self, environment: Environment) -> Any:
        """What the method stores of the light. Jitted."""

    @abstractmethod
    def shade(
        self,
        visibility: Any,
        light: Any,
        surface: Surface,
        *,
        key: jax.Array | None = None,
        progress: bool = False,
    ) -> Float[Array, "height width 3"]:
        """Linear radiance that each pixel sends to the camera; 0 where it sees no scene.

        ``progress`` allows a bar to methods that take their time.
        """

    @abstractmethod
    def evaluations(self, visibility: Any, light: Any, surface: Surface) -> int:
        """How many directions or polygons ``shade`` integrates for this surface."""

    def parameters(self) -> dict[str, Any]:
        """The hyperparameters, for tables."""
        return dataclasses.asdict(self)


LIGHT_LOCALLY = ("reference", "mc-*", "distance-field", "adaptive", "shadow-map")
"""Registered names of the methods that know of local lights."""


def refuse_spheres(environment: Environment, method: Method) -> None:
    """For ``light`` of a method that knows light from infinity alone.

    Raises:
        ValueError: the environment has sphere lights.
    """
    if environment.spheres is not None:
        *others, last = LIGHT_LOCALLY
        raise ValueError(
            f"{type(method).__name__} has no local lights (lamps, spheres): take them away, or use "
            f"{', '.join(others)} or {last}"
        )


def require_key(key: jax.Array | None, method: Method) -> jax.Array:
    """The key that a stochastic method was given.

    Raises:
        ValueError: none was given.
    """
    if key is None:
        raise ValueError(f"{type(method).__name__}.shade needs key=, as in jax.random.key(0)")
    return key
