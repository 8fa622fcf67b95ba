"""Phong's and Blinn's models, normalised."""

from abc import abstractmethod
from dataclasses import dataclass

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxvis.reflectance.model import (
    Cosines,
    GlossyReflectance,
    Terms,
    coloured,
    cosine_between,
    facet_cosines,
    luminance,
    mix,
    over_points,
)
from jaxvis.reflectance.values import MaterialValues
from jaxvis.sampling import hemisphere, phong
from jaxvis.sphere.components import join
from jaxvis.sphere.frames import dot, reflect, to_world


class _CosinePower(GlossyReflectance):
    """base / pi, and a power of some cosine times a specular colour."""

    @abstractmethod
    def _cosine(self, cosines: Cosines) -> Float[Array, "..."]:
        """The cosine whose power the specular lobe is."""

    @abstractmethod
    def _specular(
        self,
        lobe: Float[Array, "..."],
        cos_light: Float[Array, "..."],
        exponent: Float[Array, "..."],
    ) -> Float[Array, "..."]:
        """The specular term of a lobe that is normalised about its own axis."""

    def terms(self, material: MaterialValues, cosines: Cosines) -> Terms:
        lobe = phong.pdf_lobe(self._cosine(cosines), material.exponent)
        specular = self._specular(lobe, cosines.light, material.exponent)
        return _above(cosines.view, cosines.light, hemisphere.pdf_cosine(cosines.light), specular)

    def colours(self, material: MaterialValues) -> Terms:
        base, specular = material.base_colour, material.specular
        return Terms(base, specular, jnp.zeros_like(specular))

    def specular_share(
        self, material: MaterialValues, cos_view: Float[Array, "..."]
    ) -> Float[Array, "..."]:
        specular, base = luminance(material.specular), luminance(material.base_colour)
        return specular / jnp.maximum(specular + base, 1e-6)


@dataclass(frozen=True)
class Phong(_CosinePower):
    """base / pi + specular (a + 2) / 2 pi max(r.l, 0)^a, a = exponent, r the view's mirror image.

    Reciprocal, and reflects at most base + specular of the light (Lafortune and Willems 1994,
    "Using the Modified Phong Reflectance Model for Physically Based Rendering").

    With ``foreshortened=False`` the specular lobe, (a + 1) / 2 pi max(r.l, 0)^a, does not carry the
    factor n.l: paper 000, eq. 13 (its G = 1), normalised. That form is not reciprocal.
    """

    foreshortened: bool = True

    def evaluate_and_pdf(
        self,
        material: MaterialValues,
        normal: Float[Array, "*#points 3"],
        view: Float[Array, "*#points 3"],
        light: Float[Array, "*#points 3"],
    ) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        normal, view, light = over_points(material, normal, view, light)
        cos_view, cos_light = dot(normal, view), dot(normal, light)
        exponent = material.exponent
        diffuse = hemisphere.pdf_cosine(cos_light)
        lobe = phong.pdf_lobe(cosine_between(reflect(view, normal), light), exponent)
        terms = _above(cos_view, cos_light, diffuse, self._specular(lobe, cos_light, exponent))
        value = coloured(self.colours(material), terms)
        return value, mix(self.specular_share(material, cos_view), lobe, diffuse)

    def _cosine(self, cosines: Cosines) -> Float[Array, "..."]:
        return cosines.mirror

    def _specular(
        self,
        lobe: Float[Array, "..."],
        cos_light: Float[Array, "..."],
        exponent: Float[Array, "..."],
    ) -> Float[Array, "..."]:
        if not self.foreshortened:
            return lobe
        return lobe * cos_light * ((exponent + 2.0) / (exponent + 1.0))

    def sample_specular(
        self,
        material: MaterialValues,
        view: Float[Array, "*points 3"],
        uniforms: Float[Array, "*points 2"],
    ) -> Float[Array, "*points 3"]:
        mirror = join(-view[..., 0], -view[..., 1], view[..., 2])
        return to_world(phong.sample_lobe(uniforms, material.exponent), mirror)


@dataclass(frozen=True)
class BlinnPhong(_CosinePower):
    """base / pi + specular (a + 2) (a + 4) / (8 pi (2^(-a/2) + a)) max(n.h, 0)^a, a = exponent.

    The factor makes a lobe of specular colour 1 reflect all of the light that comes along the
    normal: it is 1 over the hemisphere's integral of (n.h)^a n.l at v = n. Light from other
    directions is reflected less, so that energy is at most base + specular. Reciprocal.
    """

    def evaluate_and_pdf(
        self,
        material: MaterialValues,
        normal: Float[Array, "*#points 3"],
        view: Float[Array, "*#points 3"],
        light: Float[Array, "*#points 3"],
    ) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        normal, view, light = over_points(material, normal, view, light)
        cos_view, cos_light = dot(normal, view), dot(normal, light)
        exponent = material.exponent
        diffuse = hemisphere.pdf_cosine(cos_light)
        cos_facet, facing = facet_cosines(normal, view, light)
        facet = phong.pdf_lobe(cos_facet, exponent)
        terms = _above(cos_view, cos_light, diffuse, self._specular(facet, cos_light, exponent))
        value = coloured(self.colours(material), terms)
        lobe = facet / (4.0 * facing)
        return value, mix(self.specular_share(material, cos_view), lobe, diffuse)

    def _cosine(self, cosines: Cosines) -> Float[Array, "..."]:
        return cosines.facet

    def _specular(
        self,
        lobe: Float[Array, "..."],
        cos_light: Float[Array, "..."],
        exponent: Float[Array, "..."],
    ) -> Float[Array, "..."]:
        factor = (exponent + 2.0) * (exponent + 4.0) / (4.0 * (exponent + 1.0))
        return lobe * cos_light * (factor / (jnp.exp2(-0.5 * exponent) + exponent))

    def sample_specular(
        self,
        material: MaterialValues,
        view: Float[Array, "*points 3"],
        uniforms: Float[Array, "*points 2"],
    ) -> Float[Array, "*points 3"]:
        return reflect(view, phong.sample_lobe(uniforms, material.exponent))


def _above(
    cos_view: Float[Array, "..."],
    cos_light: Float[Array, "..."],
    diffuse: Float[Array, "..."],
    specular: Float[Array, "..."],
) -> Terms:
    """The two terms where view and light are above the horizon."""
    up = (cos_view > 0.0) & (cos_light > 0.0)
    diffuse, specular = jnp.where(up, diffuse, 0.0), jnp.where(up, specular, 0.0)
    return Terms(diffuse, specular, jnp.zeros_like(specular))
