"""Local lights: spheres that shine evenly, somewhere in the scene."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxvis.sphere.gaussians import SphericalGaussians, total

Numbers = Sequence[Any] | np.ndarray | jax.Array | float | int

_NARROWEST = 1e-14
"""Least 1 - cos of a cone's half angle: a lamp 10,000 km away that is 2 m wide."""

_LARGEST, _BRIGHTEST = 1e15, 1e30  # whose squares, and sums, float32 holds


class Cones(NamedTuple):
    """What spheres subtend where they are seen from: circular cones, of at most a hemisphere.

    From inside of a sphere it is the hemisphere towards its centre.
    """

    x: Float[Array, "*cones"]
    """Components of the unit axis, which points to the centre."""
    y: Float[Array, "*cones"]
    z: Float[Array, "*cones"]
    distance: Float[Array, "*cones"]
    """To the centre."""
    radius: Float[Array, "*#cones"]
    """Of the sphere."""
    versine: Float[Array, "*cones"]
    """1 - cos of the half angle, in (0, 1]."""

    @staticmethod
    def of(
        centre: Float[Array, "*#cones 3"],
        radius: Float[Array, "*#cones"],
        points: Float[Array, "*#cones 3"],
    ) -> "Cones":
        """The cones of spheres seen from points; all arguments broadcast."""
        x, y, z = (centre[..., axis] - points[..., axis] for axis in range(3))
        square = x * x + y * y + z * z
        apart = square > 1e-30
        distance = jnp.sqrt(jnp.where(apart, square, 1e-30))
        # At the centre itself, +Y.
        x, y, z = (jnp.where(apart, d, u) for d, u in ((x, 0.0), (y, distance), (z, 0.0)))
        within = jnp.square(radius)
        sine_square = within / jnp.maximum(square, within)
        # The bound keeps gradients finite at the sphere's surface.
        cosine = jnp.sqrt(jnp.maximum(1.0 - sine_square, 1e-12))
        versine = jnp.clip(sine_square / (1.0 + cosine), _NARROWEST, 1.0)
        inverse = 1.0 / distance
        return Cones(x * inverse, y * inverse, z * inverse, distance, radius, versine)

    @property
    def axis(self) -> Float[Array, "*cones 3"]:
        """Unit directions to the centres."""
        return jnp.stack([self.x, self.y, self.z], axis=-1)

    @property
    def solid_angle(self) -> Float[Array, "*cones"]:
        """In steradians: 2 pi versine."""
        return 2.0 * jnp.pi * self.versine

    @property
    def sharpness(self) -> Float[Array, "*cones"]:
        """Of the spherical Gaussian whose mean direction is as long as the cone's: 2 / versine."""
        return 2.0 / self.versine

    def entry(self, apart: Float[Array, "*#cones"]) -> Float[Array, "*cones"]:
        """How far away the sphere begins in directions whose 1 - cos to the axis is ``apart``.

        0 from inside; outside of the cone, the distance at which the sphere is nearest.
        """
        along = self.distance * (1.0 - apart)
        beside = jnp.square(self.distance) * apart * (2.0 - apart)
        half = jnp.sqrt(jnp.maximum(jnp.square(self.radius) - beside, 0.0))
        # along - half, without its cancellation before a small sphere.
        square = (self.distance - self.radius) * (self.distance + self.radius)
        return jnp.maximum(square, 0.0) / jnp.maximum(along + half, 1e-30)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SphereLights:
    """Spheres of even radiance (linear Rec. 709), at world coordinates: those of the mesh file.

    They light, and do nothing else: the camera does not see them, and they block no light. What
    stands between a sphere and a point shadows it; what stands behind it does not, unless a method
    says otherwise. Positions are float32: give scenes that lie far from their origin a nearer one.

    Lights are made and checked by :meth:`of`; all three arrays may be traced by JAX.
    """

    position: Float[Array, "*lights 3"]
    radius: Float[Array, "*lights"]
    radiance: Float[Array, "*lights 3"]

    @classmethod
    def of(cls, position: Numbers, radius: Numbers, radiance: Numbers) -> "SphereLights":
        """Lights from lists of numbers: for each, three coordinates, a radius, and red, green and
        blue.

        Raises:
            ValueError: other shapes, values that are not finite, a radius that is not positive, or
                negative radiance.
        """
        radii = _numbers("radius", radius)
        if radii.ndim != 1 or not len(radii):
            raise ValueError(
                f"sphere lights: radius must be a list, a number for each light, got {radius!r}"
            )
        places, colours = _numbers("position", position), _numbers("radiance", radiance)
        for name, array in (("position", places), ("radiance", colours)):
            if array.shape != (len(radii), 3):
                raise ValueError(
                    f"sphere lights: {name} must have the shape {[len(radii), 3]}, three numbers "
                    f"for each radius, got {list(array.shape)}"
                )
        for name, array, good, rule in (
            ("position", places, np.abs(places) < _LARGEST, "finite"),
            ("radius", radii, (radii > 1.0 / _LARGEST) & (radii < _LARGEST), "positive and finite"),
            ("radiance", colours, (colours >= 0.0) & (colours < _BRIGHTEST), "finite and >= 0"),
        ):
            if not good.all():
                light = int(np.argwhere(~good)[0, 0])
                raise ValueError(
                    f"sphere lights: {name} must be {rule}, got {array[light]} for light {light}"
                )
        return cls(*(jnp.asarray(array, jnp.float32) for array in (places, radii, colours)))

    @property
    def count(self) -> int:
        """How many there are."""
        return self.radius.shape[-1]

    def scale(self, factor: float | Float[Array, "..."]) -> "SphereLights":
        """The same lights, ``factor`` times as bright (a number, or one per channel)."""
        return replace(self, radiance=self.radiance * jnp.asarray(factor, self.radiance.dtype))

    def seen_from(self, origin: Float[Array, "3"]) -> "SphereLights":
        """The same lights in coordinates that have their origin here, such as a scene's centred
        ones (``Surface.origin``)."""
        return replace(self, position=self.position - origin)

    def take(self, lights: Int[Array, "*points"]) -> "SphereLights":
        """Some of them, in any shape: one for each ray, say."""
        return jax.tree.map(lambda leaf: jnp.take(leaf, lights, axis=0, mode="clip"), self)

    def cones(self, points: Float[Array, "*points 3"]) -> Cones:
        """What each light subtends at each point, in the lights' coordinates."""
        return Cones.of(self.position, self.radius, points[..., None, :])

    def gaussians(self, points: Float[Array, "*points 3"]) -> SphericalGaussians:
        """Each light as each point sees it, as a lobe with the same energy (spec 3.9).

        Its axis points to the centre. Its sharpness, 2 / (1 - cos of the half angle), makes it as
        wide: with the same mean direction the unshadowed irradiance is exact, too.
        """
        cones = self.cones(points)
        scale = cones.solid_angle / total(cones.sharpness)
        return SphericalGaussians(cones.axis, cones.sharpness, scale[..., None] * self.radiance)


def _numbers(name: str, values: Numbers) -> np.ndarray:
    try:
        return np.asarray(values, np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"sphere lights: {name} must be numbers, got {values!r}") from None
