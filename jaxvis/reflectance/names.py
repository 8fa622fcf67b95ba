"""Reflectance models by name."""

from jaxvis.reflectance.cook_torrance import CookTorrance
from jaxvis.reflectance.lambert import Lambert
from jaxvis.reflectance.mixed import Mixed
from jaxvis.reflectance.model import Reflectance
from jaxvis.reflectance.phong import BlinnPhong, Phong

MODELS: dict[str, Reflectance] = {
    "lambert": Lambert(),
    "phong": Phong(),
    "blinn-phong": BlinnPhong(),
    "ggx": CookTorrance("ggx"),
    "beckmann": CookTorrance("beckmann"),
    "mixed": Mixed(),
}


def reflectance_by_name(name: str) -> Reflectance:
    """The model called ``name``; ValueError lists the names if there is none."""
    if name not in MODELS:
        raise ValueError(f"no reflectance {name!r}: use one of {', '.join(MODELS)}")
    return MODELS[name]
