"""An environment map, radiance from infinity as a function of direction, and lights before it."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxvis.lighting import resampling
from jaxvis.lighting.blur import phong_blur
from jaxvis.lighting.spheres import SphereLights
from jaxvis.sphere import latlong


@dataclass(frozen=True)
class Environment:
    """Lat-long radiance map, linear Rec. 709, finite, non-negative, width = 2 height.

    It is piecewise constant: each texel holds the average radiance over its solid angle, and every
    method integrates that same function. Several may be stacked along a leading axis, for
    ``jax.vmap``; the methods are those of one.

    ``spheres`` are local lights besides, at places in the world. A light that comes out of a
    compiled function may have the ``name`` of another that went in: programs are not compiled for
    names.
    """

    radiance: Float[Array, "*lights height width 3"]
    name: str = "environment"
    spheres: SphereLights | None = None

    @property
    def height(self) -> int:
        return self.radiance.shape[-3]

    @property
    def width(self) -> int:
        return self.radiance.shape[-2]

    def towards(
        self, directions: Float[Array | np.ndarray, "*points 3"]
    ) -> Float[Array, "*points 3"]:
        """The map's radiance in each direction (any length but zero), without the spheres."""
        return latlong.nearest(self.radiance, jnp.asarray(directions))

    def scale(self, factor: float | Float[Array, "..."]) -> "Environment":
        """The same light, ``factor`` times as bright (a number, or one per channel)."""
        radiance = self.radiance * jnp.asarray(factor, self.radiance.dtype)
        spheres = None if self.spheres is None else self.spheres.scale(factor)
        return replace(self, radiance=radiance, spheres=spheres)

    def with_spheres(self, spheres: SphereLights | None) -> "Environment":
        """The same map with these local lights instead of any that it had."""
        return replace(self, spheres=spheres)

    def seen_from(self, origin: Float[Array, "3"]) -> "Environment":
        """The same light with its spheres in coordinates that have their zero at this place, such
        as a scene's centred ones (``Surface.origin``)."""
        return self if self.spheres is None else self.with_spheres(self.spheres.seen_from(origin))

    def rotate(self, yaw: float | Float[Array, ""]) -> "Environment":
        """The same light turned by ``yaw`` radians about +Y, counter-clockwise seen from above.

        A quarter turn moves what was at +Z to +X, and what was at +X to -Z: with R the right-handed
        rotation about +Y, ``rotated.towards(R d) == environment.towards(d)``. Whole texels are
        exact; in between, a texel becomes the average of what came to lie over it, which keeps all
        energy. Differentiable in ``yaw``. The spheres stay where they are in the scene.
        """
        return replace(self, radiance=resampling.rotate(self.radiance, yaw))

    def resize(self, height: int) -> "Environment":
        """The same light at ``height`` x 2 ``height`` texels: averages, so that energy is kept."""
        if height < 1:
            raise ValueError(f"height must be at least 1, got {height}")
        return replace(self, radiance=resampling.resize(self.radiance, height, 2 * height))

    def blur(self, exponent: float, height: int | None = None) -> "Environment":
        """The map convolved with the normalised Phong lobe of this exponent, the spheres as before.

        See :func:`jaxvis.lighting.blur.phong_blur`. ``height`` is that of the result, by default
        as here.
        """
        blurred = phong_blur(self.radiance, exponent, self.height if height is None else height)
        return replace(self, radiance=blurred)

    def irradiance_map(self, height: int = 64) -> Float[Array, "height width 3"]:
        """Irradiance (pi for radiance 1) of a free surface as a lat-long map over its normal.

        Without the spheres. It is smooth: look it up with :func:`jaxvis.sphere.latlong.bilinear`.
        """
        return math.pi * phong_blur(self.radiance, 1.0, height)


class _Name:
    """A name that equals every other: what is compiled for one light serves the next."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Name)

    def __hash__(self) -> int:
        return hash(_Name)


def _flatten(light: Environment) -> tuple[tuple[tuple[Any, Any], ...], _Name]:
    keys = map(jax.tree_util.GetAttrKey, ("radiance", "spheres"))
    return tuple(zip(keys, (light.radiance, light.spheres), strict=True)), _Name(light.name)


def _unflatten(name: _Name, leaves: Iterable[Any]) -> Environment:
    # Not by its initialiser: in place of arrays, JAX has objects of its own.
    light = object.__new__(Environment)
    for key, value in zip(("radiance", "spheres"), leaves, strict=True):
        object.__setattr__(light, key, value)
    object.__setattr__(light, "name", name.text)
    return light


jax.tree_util.register_pytree_with_keys(Environment, _flatten, _unflatten)
