"""Cook and Torrance's microfacet model over a diffuse base."""

from dataclasses import dataclass

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxvis.reflectance.model import (
    Cosines,
    GlossyReflectance,
    Terms,
    coloured,
    facet_cosines,
    luminance,
    mix,
    over_points,
)
from jaxvis.reflectance.values import MaterialValues
from jaxvis.sampling import hemisphere, microfacet
from jaxvis.sphere.frames import dot, reflect

FAINTEST_SPECULAR = 0.02
"""Specular colours below this have no full reflection at grazing angles: none if black."""


@dataclass(frozen=True)
class CookTorrance(GlossyReflectance):
    """F D G / (4 n.l n.v) of facets of width a = roughness^2, over a diffuse base.

    D is GGX or Beckmann, G Smith's height-correlated masking and shadowing (Heitz 2014), F
    Schlick's: F(c) = F0 + g (1 - F0) (1 - c)^5 at c = v.h with F0 = specular. Its grazing
    reflectance g is 1, but falls to 0 for specular colours whose mean is below
    :data:`FAINTEST_SPECULAR` (Lagarde and de Rousiers 2014, "Moving Frostbite to PBR"), so that
    black specular means Lambert.

    What the facets leave to the base enters and leaves through the mean surface:
    base / pi (1 - F0) (1 - k S(n.l)) (1 - k S(n.v)) / (1 - k / 21), S(c) = (1 - c)^5, reciprocal.
    For k = g, base colour 1 and a smooth surface exactly all light is reflected (Shirley et al.
    1997, "A Practitioners' Assessment of Light Reflection Models"). Rough facets reflect far less
    at grazing angles, and there k = g (0.08 + 0.92 (1 - a^2)^2), as low as the energy allows: with
    k = g rough objects would have dark outlines. The base of glTF 2.0's appendix B, (1 - F(v.h))
    base / pi, would reflect up to 1.7 times the light that comes in at grazing angles.
    """

    distribution: microfacet.Model = "ggx"

    def evaluate_and_pdf(
        self,
        material: MaterialValues,
        normal: Float[Array, "*#points 3"],
        view: Float[Array, "*#points 3"],
        light: Float[Array, "*#points 3"],
    ) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        normal, view, light = over_points(material, normal, view, light)
        cos_view, cos_light = dot(normal, view), dot(normal, light)
        cos_facet, facing = facet_cosines(normal, view, light)
        width = material.microfacet_width
        mirror = 2.0 * cos_view * cos_light  # of no concern to microfacets
        cosines = Cosines(cos_view, cos_light, cos_facet, facing, mirror)
        value = coloured(self.colours(material), self.terms(material, cosines))

        facets = 0.25 * microfacet.distribution(cos_facet, width, self.distribution)
        cosine = hemisphere.pdf_cosine(cos_light)
        towards_view = jnp.clip(cos_view, LOWEST_COSINE, 1.0)
        if self.distribution == "ggx":  # visible facets, which all face up
            visible = facets * microfacet.masking(towards_view, width) / towards_view
            lobe = jnp.where(cos_view + cos_light > 0.0, visible, 0.0)
        else:
            lobe = facets * cos_facet / facing
        return value, mix(self.specular_share(material, cos_view), lobe, cosine)

    def terms(self, material: MaterialValues, cosines: Cosines) -> Terms:
        width, grazing = material.microfacet_width, grazing_reflectance(material)
        up = (cosines.view > 0.0) & (cosines.light > 0.0)
        towards_view = jnp.clip(cosines.view, LOWEST_COSINE, 1.0)
        towards_light = jnp.clip(cosines.light, LOWEST_COSINE, 1.0)
        facets = 0.25 * microfacet.distribution(cosines.facet, width, self.distribution)
        passing = microfacet.masking_shadowing(
            towards_light, towards_view, width, self.distribution
        )
        specular = jnp.where(up, facets * passing / towards_view, 0.0)

        coat = grazing * smoothness(width)
        entering = (1.0 - coat * schlick_weight(towards_light)) / (1.0 - coat * (1.0 / 21.0))
        leaving = 1.0 - coat * schlick_weight(towards_view)
        cosine = hemisphere.pdf_cosine(cosines.light)
        diffuse = jnp.where(up, cosine * entering * leaving, 0.0)
        return Terms(diffuse, specular, specular * (grazing * schlick_weight(cosines.facing)))

    def colours(self, material: MaterialValues) -> Terms:
        f0 = material.specular
        return Terms(material.base_colour * (1.0 - f0), f0, 1.0 - f0)

    def specular_share(
        self, material: MaterialValues, cos_view: Float[Array, "..."]
    ) -> Float[Array, "..."]:
        """The Fresnel reflectance's part of the luminance, at n.v; 0 below the horizon."""
        coat = grazing_reflectance(material) * smoothness(material.microfacet_width)
        rise = coat * schlick_weight(jnp.clip(cos_view, 0.0, 1.0))
        f0 = luminance(material.specular)
        specular = f0 + (1.0 - f0) * rise
        diffuse = luminance(material.base_colour * (1.0 - material.specular)) * (1.0 - rise)
        share = specular / jnp.maximum(specular + diffuse, 1e-6)
        return jnp.where(cos_view > 0.0, share, 0.0)

    def sample_specular(
        self,
        material: MaterialValues,
        view: Float[Array, "*points 3"],
        uniforms: Float[Array, "*points 2"],
    ) -> Float[Array, "*points 3"]:
        width = material.microfacet_width
        if self.distribution == "ggx":
            facet = microfacet.sample_visible_normal(uniforms, view, width)
        else:
            facet = microfacet.sample_normal(uniforms, width, self.distribution)
        return reflect(view, facet)


LOWEST_COSINE = 1e-5
"""Masking is evaluated at cosines no lower than this, which keeps its gradients finite."""


def grazing_reflectance(material: MaterialValues) -> Float[Array, "..."]:
    """Reflectance at grazing angles: 1 but for specular colours that are (nearly) black."""
    f0 = material.specular
    mean = (f0[..., 0] + f0[..., 1] + f0[..., 2]) * (1.0 / 3.0)
    return jnp.minimum(mean * (1.0 / FAINTEST_SPECULAR), 1.0)


def smoothness(width: Float[Array, "..."]) -> Float[Array, "..."]:
    """How much of a smooth surface's grazing reflection facets of this width have, from above.

    A fit to the directional albedo of GGX by quadrature, so that no more light leaves than came.
    """
    return 0.08 + 0.92 * jnp.square(1.0 - width * width)


def schlick_weight(cosine: Float[Array, "..."]) -> Float[Array, "..."]:
    """(1 - c)^5."""
    rest = 1.0 - cosine
    square = rest * rest
    return square * square * rest
