"""Several reflectance models in one scene: each material names its own."""

from dataclasses import dataclass

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxvis.reflectance.cook_torrance import CookTorrance
from jaxvis.reflectance.model import Cosines, Reflectance, Terms
from jaxvis.reflectance.phong import BlinnPhong
from jaxvis.reflectance.values import MaterialValues


@dataclass(frozen=True)
class Mixed(Reflectance):
    """At each point the model that its material names: ``models[material.model]``.

    Materials without a model have the first, and numbers beyond the last mean the last. All models
    are evaluated at all points, so that a mixture costs what its models cost together.
    """

    models: tuple[Reflectance, ...] = (BlinnPhong(), CookTorrance("beckmann"))

    def __post_init__(self) -> None:
        models = tuple(self.models) if isinstance(self.models, list | tuple) else ()
        if not models or not all(isinstance(m, Reflectance) for m in models):
            raise ValueError(
                f"Mixed needs a tuple of models, as in (Phong(), Lambert()), got {self.models!r}"
            )
        object.__setattr__(self, "models", models)

    def evaluate_and_pdf(
        self,
        material: MaterialValues,
        normal: Float[Array, "*#points 3"],
        view: Float[Array, "*#points 3"],
        light: Float[Array, "*#points 3"],
    ) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        value, pdf = self.models[0].evaluate_and_pdf(material, normal, view, light)
        for later, here in self.later_models(material):
            other, density = later.evaluate_and_pdf(material, normal, view, light)
            value = jnp.where(here[..., None], other, value)
            pdf = jnp.where(here, density, pdf)
        return value, pdf

    def terms(self, material: MaterialValues, cosines: Cosines) -> Terms:
        terms = self.models[0].terms(material, cosines)
        for later, here in self.later_models(material):
            terms = _chosen(here, later.terms(material, cosines), terms)
        return terms

    def colours(self, material: MaterialValues) -> Terms:
        colours = self.models[0].colours(material)
        for later, here in self.later_models(material):
            colours = _chosen(here[..., None], later.colours(material), colours)
        return colours

    def sample(
        self,
        material: MaterialValues,
        normal: Float[Array, "*#points 3"],
        view: Float[Array, "*#points 3"],
        uniforms: Float[Array, "*#points 3"],
    ) -> Float[Array, "..."]:
        light = self.models[0].sample(material, normal, view, uniforms)
        for later, here in self.later_models(material):
            other = later.sample(material, normal, view, uniforms)
            light = jnp.where(here[..., None], other, light)
        return light

    def later_models(
        self, material: MaterialValues
    ) -> list[tuple[Reflectance, Bool[Array, "*points"]]]:
        """The models after the first, and where each is meant."""
        if material.model is None:
            return []
        number = jnp.minimum(material.model, len(self.models) - 1)
        return [(model, number == k) for k, model in enumerate(self.models) if k > 0]


def _chosen(here: Bool[Array, "..."], one: Terms, other: Terms) -> Terms:
    return Terms(*(jnp.where(here, a, b) for a, b in zip(one, other, strict=True)))
