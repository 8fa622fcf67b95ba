"""Lambert's model: the same radiance in every direction."""

from dataclasses import dataclass

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxvis.reflectance.model import Cosines, Reflectance, Terms, over_points
from jaxvis.reflectance.values import MaterialValues
from jaxvis.sampling import hemisphere
from jaxvis.sphere.frames import dot, to_world


@dataclass(frozen=True)
class Lambert(Reflectance):
    """Diffuse: base_colour / pi. The specular colour is ignored."""

    def evaluate_and_pdf(
        self,
        material: MaterialValues,
        normal: Float[Array, "*#points 3"],
        view: Float[Array, "*#points 3"],
        light: Float[Array, "*#points 3"],
    ) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        normal, view, light = over_points(material, normal, view, light)
        density = hemisphere.pdf_cosine(dot(normal, light))
        lit = jnp.where(dot(normal, view) > 0.0, density, 0.0)
        return material.base_colour * lit[..., None], density

    def terms(self, material: MaterialValues, cosines: Cosines) -> Terms:
        lit = jnp.where(cosines.view > 0.0, hemisphere.pdf_cosine(cosines.light), 0.0)
        return Terms(lit, jnp.zeros_like(lit), jnp.zeros_like(lit))

    def colours(self, material: MaterialValues) -> Terms:
        black = jnp.zeros_like(material.base_colour)
        return Terms(material.base_colour, black, black)

    def sample(
        self,
        material: MaterialValues,
        normal: Float[Array, "*#points 3"],
        view: Float[Array, "*#points 3"],
        uniforms: Float[Array, "*#points 3"],
    ) -> Float[Array, "..."]:
        normal, _, uniforms = over_points(material, normal, view, uniforms)
        return to_world(hemisphere.sample_cosine(uniforms[..., :2]), normal)
