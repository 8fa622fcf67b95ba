"""What every reflectance model can do."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxvis.reflectance.values import MaterialValues
from jaxvis.sampling import hemisphere
from jaxvis.sphere.frames import dot, to_local, to_world


class Cosines(NamedTuple):
    """Where light and viewer stand, as far as isotropic models feel it; arrays that broadcast."""

    view: Float[Array, "*#points"]
    """n.v."""
    light: Float[Array, "*#points"]
    """n.l."""
    facet: Float[Array, "*#points"]
    """n.h, in [0, 1]: h mirrors the view to the light."""
    facing: Float[Array, "*#points"]
    """v.h, in (0, 1]."""
    mirror: Float[Array, "*#points"]
    """r.l: r is the view mirrored by the normal."""

    @staticmethod
    def of(
        view: Float[Array, "*#points"],
        light: Float[Array, "*#points"],
        between: Float[Array, "*#points"],
    ) -> "Cosines":
        """From n.v, n.l and ``between`` = v.l. In float32 good for exponents up to some 1000."""
        square = jnp.maximum(2.0 + 2.0 * between, 1e-8)
        inverse = 1.0 / jnp.sqrt(square)
        facet = jnp.clip(jnp.abs(view + light) * inverse, 0.0, 1.0)
        facing = jnp.minimum(0.5 * square * inverse, 1.0)
        return Cosines(view, light, facet, facing, 2.0 * view * light - between)


class Terms(NamedTuple):
    """BRDF x cosine = base_colour x base + specular_colour x specular + grazing_colour x grazing.

    One of :meth:`Reflectance.terms`, which are numbers, the other of :meth:`Reflectance.colours`,
    which do not depend on the light: it can be added up first and coloured last.
    """

    base: Float[Array, "..."]
    specular: Float[Array, "..."]
    grazing: Float[Array, "..."]


@dataclass(frozen=True)
class Reflectance(ABC):
    """A reflectance model. Frozen and hashable, so that it can be a static argument of jit.

    Directions are unit and point away from the surface; normals are on the viewer's side. All
    arguments broadcast over the points, and results are finite with finite gradients, also where
    the view or the light is at or below the horizon.
    """

    @abstractmethod
    def evaluate_and_pdf(
        self,
        material: MaterialValues,
        normal: Float[Array, "*#points 3"],
        view: Float[Array, "*#points 3"],
        light: Float[Array, "*#points 3"],
    ) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        """:meth:`evaluate` ``[*points, 3]`` and :meth:`pdf` ``[*points]``, sharing their work."""

    @abstractmethod
    def terms(self, material: MaterialValues, cosines: Cosines) -> Terms:
        """BRDF x max(n.l, 0) per steradian without its colours, [*points] each."""

    @abstractmethod
    def colours(self, material: MaterialValues) -> Terms:
        """What the :meth:`terms` are multiplied with, [*points, 3] each."""

    @abstractmethod
    def sample(
        self,
        material: MaterialValues,
        normal: Float[Array, "*#points 3"],
        view: Float[Array, "*#points 3"],
        uniforms: Float[Array, "*#points 3"],
    ) -> Float[Array, "..."]:
        """Unit light directions ``[*points, 3]`` for numbers uniform in [0, 1)^3.

        Some may lie below the horizon, where :meth:`evaluate` is 0.
        """

    def evaluate(
        self,
        material: MaterialValues,
        normal: Float[Array, "*#points 3"],
        view: Float[Array, "*#points 3"],
        light: Float[Array, "*#points 3"],
    ) -> Float[Array, "..."]:
        """BRDF x max(n.l, 0) per steradian, ``[*points, 3]``; 0 unless n.l > 0 and n.v > 0."""
        return self.evaluate_and_pdf(material, normal, view, light)[0]

    def pdf(
        self,
        material: MaterialValues,
        normal: Float[Array, "*#points 3"],
        view: Float[Array, "*#points 3"],
        light: Float[Array, "*#points 3"],
    ) -> Float[Array, "..."]:
        """Density per steradian with which :meth:`sample` returns ``light``, ``[*points]``.

        It is exact over the whole sphere, where it integrates to 1.
        """
        return self.evaluate_and_pdf(material, normal, view, light)[1]


@dataclass(frozen=True)
class GlossyReflectance(Reflectance):
    """A diffuse and a specular lobe. A sample comes from one of them, its density is the mixture's.

    The third uniform number chooses: below :meth:`specular_share` it is the specular lobe.
    """

    @abstractmethod
    def specular_share(
        self, material: MaterialValues, cos_view: Float[Array, "..."]
    ) -> Float[Array, "..."]:
        """Probability, in [0, 1], that a sample is the specular lobe's; 0 if specular is black."""

    @abstractmethod
    def sample_specular(
        self,
        material: MaterialValues,
        view: Float[Array, "*points 3"],
        uniforms: Float[Array, "*points 2"],
    ) -> Float[Array, "*points 3"]:
        """Light directions of the specular lobe; view and light are local (normal = +z)."""

    def sample(
        self,
        material: MaterialValues,
        normal: Float[Array, "*#points 3"],
        view: Float[Array, "*#points 3"],
        uniforms: Float[Array, "*#points 3"],
    ) -> Float[Array, "..."]:
        normal, view, uniforms = over_points(material, normal, view, uniforms)
        local = to_local(view, normal)
        diffuse = hemisphere.sample_cosine(uniforms[..., :2])
        specular = self.sample_specular(material, local, uniforms[..., :2])
        chosen = uniforms[..., 2] < self.specular_share(material, local[..., 2])
        # By component: XLA then computes each lobe once, not once per component of the result.
        light = [jnp.where(chosen, specular[..., k], diffuse[..., k]) for k in range(3)]
        return to_world(jnp.stack(light, axis=-1), normal)


def coloured(colours: Terms, terms: Terms) -> Float[Array, "*points 3"]:
    """The sum of the terms with their colours."""
    return (
        colours.base * terms.base[..., None]
        + colours.specular * terms.specular[..., None]
        + colours.grazing * terms.grazing[..., None]
    )


def over_points(
    material: MaterialValues, *vectors: Float[Array, "..."]
) -> tuple[Float[Array, "*points 3"], ...]:
    """``vectors`` [*points, 3], each with all the points of the material and of the others."""
    shapes = [vector.shape[:-1] for vector in vectors]
    points = jnp.broadcast_shapes(material.roughness.shape, *shapes)
    return tuple(jnp.broadcast_to(vector, (*points, 3)) for vector in vectors)


def mix(
    share: Float[Array, "..."], specular: Float[Array, "..."], diffuse: Float[Array, "..."]
) -> Float[Array, "..."]:
    """``share`` of ``specular`` and the rest of ``diffuse``; exact where share is 0 or 1."""
    return share * specular + (1.0 - share) * diffuse


def luminance(colour: Float[Array, "*points 3"]) -> Float[Array, "*points"]:
    """Rec. 709 luminance."""
    return 0.2126 * colour[..., 0] + 0.7152 * colour[..., 1] + 0.0722 * colour[..., 2]


def cosine_between(
    a: Float[Array, "*points 3"], b: Float[Array, "*points 3"]
) -> Float[Array, "*points"]:
    """Cosine of the angle between unit vectors: 1 - |a - b|^2 / 2.

    Unlike a . b it does not feel, near 1, that float32 vectors are a little longer or shorter than
    1. Narrow lobes do: 2e-7 in the cosine makes 0.5 % at the exponent 20000.
    """
    apart = a - b
    return 1.0 - 0.5 * dot(apart, apart)


def facet_cosines(
    normal: Float[Array, "*points 3"],
    view: Float[Array, "*points 3"],
    light: Float[Array, "*points 3"],
) -> tuple[Float[Array, "*points"], Float[Array, "*points"]]:
    """Cosines (n.h, v.h) for the facet h that mirrors ``view`` to ``light``, v.h above 0.

    Where the facet faces down (the light is then below the horizon) n.h is that of -h, the upward
    facet that mirrors the view there. A light opposite the view has v.h = 5e-5.
    """
    double = view + light  # 2 (v.h) h
    square = jnp.maximum(dot(double, double), 1e-8)
    inverse = 1.0 / jnp.sqrt(square)
    signed = jnp.where(dot(normal, double) < 0.0, -inverse, inverse)
    cosine = cosine_between(normal, double * signed[..., None])
    return jnp.clip(cosine, 0.0, 1.0), jnp.minimum(0.5 * square * inverse, 1.0)
