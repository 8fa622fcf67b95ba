"""Reflectance models and the materials that feed them."""

from jaxvis.reflectance.cook_torrance import CookTorrance
from jaxvis.reflectance.gaussians import cosine_lobe, specular_lobe
from jaxvis.reflectance.lambert import Lambert
from jaxvis.reflectance.material import Material, checked_albedo, evaluate_materials
from jaxvis.reflectance.mixed import Mixed
from jaxvis.reflectance.model import Reflectance
from jaxvis.reflectance.names import reflectance_by_name
from jaxvis.reflectance.phong import BlinnPhong, Phong
from jaxvis.reflectance.texture import Texture
from jaxvis.reflectance.values import MaterialValues

__all__ = [
    "BlinnPhong",
    "CookTorrance",
    "Lambert",
    "Material",
    "MaterialValues",
    "Mixed",
    "Phong",
    "Reflectance",
    "Texture",
    "checked_albedo",
    "cosine_lobe",
    "evaluate_materials",
    "reflectance_by_name",
    "specular_lobe",
]
