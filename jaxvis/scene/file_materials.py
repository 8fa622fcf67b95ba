"""From the materials that mesh files hold to base colour, specular colour and roughness (host)."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float, Float32
from trimesh.visual.color import DEFAULT_COLOR
from trimesh.visual.material import PBRMaterial, SimpleMaterial, color_image

from jaxvis.reflectance import BlinnPhong, CookTorrance, Lambert, Material, Reflectance, Texture

DIELECTRIC = 0.04
"""Normal-incidence reflectance of a non-metal in glTF's metallic-roughness model."""

PLACEHOLDER = np.asarray(color_image())
"""What trimesh paints on meshes that have texture coordinates but no material."""

SPECULAR_GLOSSINESS = "KHR_materials_pbrSpecularGlossiness"


@dataclass
class Losses:
    """What the conversion could not keep, counted over the materials of one file."""

    missing_textures: list[str] = field(default_factory=list)
    """Names of materials with a texture that cannot be had."""
    transparent: list[str] = field(default_factory=list)
    transparent_texels: int = 0
    normal_maps: int = 0
    emitters: int = 0


def convert_material(
    material: Any, gltf: dict[str, Any] | None, has_uv: bool, losses: Losses
) -> Material:
    """A trimesh material as a jaxvis one.

    Args:
        material: what ``visual.material`` held, or None.
        gltf: the same material in the file's JSON, whose factors trimesh rounds to 8 bits.
        has_uv: whether the mesh has texture coordinates; without them textures are left out.
        losses: is added to.
    """
    if isinstance(material, PBRMaterial):
        return _from_metallic_roughness(material, gltf or {}, has_uv, losses)
    if isinstance(material, SimpleMaterial):
        return _from_mtl(material, has_uv, losses)
    return Material()


def file_reflectance(sources: list[Any], materials: list[Material]) -> Reflectance:
    """The model that the file's materials are meant for: GGX for metallic-roughness, Blinn-Phong
    for MTL with highlights (its illumination model 2), Lambert for the rest.
    """
    if any(isinstance(source, PBRMaterial) for source in sources):
        return CookTorrance("ggx")
    if any(max(material.specular) > 0.0 for material in materials):
        return BlinnPhong()
    return Lambert()


def _from_metallic_roughness(
    pbr: PBRMaterial, gltf: dict[str, Any], has_uv: bool, losses: Losses
) -> Material:
    """glTF 2.0, appendix B: a metal reflects its base colour, anything else 4 % and diffusely."""
    name = str(pbr.name or "")
    factor, alpha = _base_colour_factor(pbr, gltf)
    images = gltf.get("pbrMetallicRoughness", {})
    base_image = _pixels(pbr.baseColorTexture, "baseColorTexture" in images, name, has_uv, losses)
    surface_image = _pixels(
        pbr.metallicRoughnessTexture, "metallicRoughnessTexture" in images, name, has_uv, losses
    )
    metallic: float | Texture = _factor(pbr.metallicFactor)
    roughness, roughness_texture = _factor(pbr.roughnessFactor), None
    if surface_image is not None:
        surface = Texture.from_image(surface_image[..., :3], srgb=False).texels
        metallic = _constant_or_texture(np.float32(metallic) * surface[..., 2:3])
        rough = _constant_or_texture(surface[..., 1:2])
        if isinstance(rough, Texture):
            roughness_texture = rough
        else:
            roughness *= rough
    base = None if base_image is None else Texture.from_image(base_image[..., :3], srgb=True)
    _count_losses(pbr, alpha, base_image, name, losses)
    shared: dict[str, Any] = {
        "roughness": roughness,
        "roughness_texture": roughness_texture,
        "two_sided": bool(pbr.doubleSided),
        "name": name,
    }
    return _split_metal(factor, base, metallic, shared)


def _split_metal(
    factor: Float[np.ndarray, "3"],
    base: Texture | None,
    metallic: float | Texture,
    shared: dict[str, Any],
) -> Material:
    """Diffuse base (1 - metallic), specular 0.04 (1 - metallic) + base metallic."""
    if not isinstance(metallic, Texture):
        diffuse = _colour(factor * (1.0 - metallic))
        if base is None or metallic == 0.0:
            specular = _colour(DIELECTRIC * (1.0 - metallic) + factor * metallic)
            return Material(diffuse, specular, base_colour_texture=base, **shared)
        tinted = DIELECTRIC * (1.0 - metallic) + metallic * factor * base.texels
        white = (1.0, 1.0, 1.0)
        return Material(
            diffuse, white, base_colour_texture=base, specular_texture=_texture(tinted), **shared
        )
    shape = metallic.texels.shape[:2]
    if base is not None:
        shape = max(shape, base.texels.shape[:2], key=lambda size: size[0] * size[1])
    metal = _resampled(metallic, shape)
    colour = factor if base is None else factor * _resampled(base, shape)
    return Material(
        (1.0, 1.0, 1.0),
        (1.0, 1.0, 1.0),
        base_colour_texture=_texture(colour * (1.0 - metal)),
        specular_texture=_texture(DIELECTRIC * (1.0 - metal) + colour * metal),
        **shared,
    )


def _from_mtl(simple: SimpleMaterial, has_uv: bool, losses: Losses) -> Material:
    """Wavefront MTL: Kd, Ks and Ns as linear numbers, map_Kd as sRGB; Ns = 2 / a^2 - 2."""
    stated = simple.kwargs
    name = str(simple.name or "")
    image = _pixels(simple.image, False, name, has_uv, losses)
    if not stated and image is not None and np.array_equal(image, PLACEHOLDER):
        image = None
    plain = "kd" not in stated and np.array_equal(simple.diffuse, DEFAULT_COLOR)
    if plain and image is None:
        return Material(name=name)
    diffuse = np.ones(3) if plain else _numbers(stated.get("kd"), simple.diffuse[:3] / 255.0)
    if image is not None and not diffuse.any():
        # Some exporters write a black Kd beside a texture that they mean to be seen.
        diffuse = np.ones(3)
    specular, roughness = np.zeros(3), 1.0
    matt = stated.get("illum", ["2"])[0] in ("0", "1")
    exponent = float(np.ravel(stated.get("ns", 0.0))[0])
    if "ks" in stated and exponent > 0.0 and not matt:
        specular = _numbers(stated["ks"], np.zeros(3))
        # a = roughness^2 is the width whose Phong exponent this is (MaterialValues.exponent).
        roughness = (2.0 / (exponent + 2.0)) ** 0.25
    texture = None if image is None else Texture.from_image(image[..., :3], srgb=True)
    opacity = float(stated["d"][-1]) if "d" in stated else 1.0
    if opacity < 1.0:
        losses.transparent.append(name)
    return Material(
        _colour(diffuse), _colour(specular), roughness, base_colour_texture=texture, name=name
    )


def _base_colour_factor(
    pbr: PBRMaterial, gltf: dict[str, Any]
) -> tuple[Float[np.ndarray, "3"], float]:
    exact = gltf.get("pbrMetallicRoughness", {}).get("baseColorFactor")
    if exact is not None and SPECULAR_GLOSSINESS not in gltf.get("extensions", {}):
        values = np.asarray(exact, np.float64)
    elif pbr.baseColorFactor is not None:
        values = np.asarray(pbr.baseColorFactor, np.float64) / 255.0
    else:
        values = np.ones(4)
    return values[:3], float(values[3])


def _pixels(
    image: Any, expected: bool, name: str, has_uv: bool, losses: Losses
) -> np.ndarray | None:
    """8-bit RGBA of a PIL image; None, and counted as missing, where it cannot be had."""
    if image is None:
        if expected:
            losses.missing_textures.append(name)
        return None
    if not has_uv:
        return None
    try:
        return np.asarray(image.convert("RGBA"))
    except (OSError, ValueError, SyntaxError):
        # Pillow decodes late: this is where a truncated image shows.
        losses.missing_textures.append(name)
        return None


def _count_losses(
    pbr: PBRMaterial, alpha: float, image: np.ndarray | None, name: str, losses: Losses
) -> None:
    losses.normal_maps += pbr.normalTexture is not None
    losses.emitters += pbr.emissiveFactor is not None and bool(np.any(pbr.emissiveFactor))
    if pbr.alphaMode not in ("MASK", "BLEND"):
        return
    cutoff = 1.0
    if pbr.alphaMode == "MASK":
        cutoff = 0.5 if pbr.alphaCutoff is None else pbr.alphaCutoff
    texels = np.array([alpha]) if image is None else alpha * image[..., 3] / 255.0
    if clear := int(np.sum(texels < cutoff)):
        losses.transparent.append(name)
        losses.transparent_texels += 0 if image is None else clear


def _constant_or_texture(values: Float32[np.ndarray, "h w 1"]) -> float | Texture:
    low, high = float(values.min()), float(values.max())
    return low if low == high else Texture(np.clip(values, 0.0, 1.0))


def _resampled(texture: Texture, shape: tuple[int, int]) -> Float[np.ndarray, "h w c"]:
    """The texture at the texel centres of another size."""
    if texture.texels.shape[:2] == shape:
        return texture.texels
    height, width = shape
    u, v = np.meshgrid((np.arange(width) + 0.5) / width, 1 - (np.arange(height) + 0.5) / height)
    values = texture.sample(np.stack([u.ravel(), v.ravel()], axis=-1))
    return values.reshape(height, width, texture.channels)


def _texture(values: Float[np.ndarray, "h w c"]) -> Texture:
    return Texture(np.clip(values, 0.0, 1.0).astype(np.float32))


def _factor(value: float | None) -> float:
    return 1.0 if value is None else float(np.clip(value, 0.0, 1.0))


def _numbers(value: Any, default: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """Three numbers of an MTL line, which may give one for all."""
    if value is None:
        return default
    return (
        np.broadcast_to(np.asarray(value, np.float64), (3,))
        if np.size(value) in (1, 3)
        else (default)
    )


def _colour(values: Float[np.ndarray, "3"]) -> tuple[float, float, float]:
    red, green, blue = np.clip(values, 0.0, 1.0).tolist()
    return red, green, blue
