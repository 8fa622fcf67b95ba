"""Conversion of metallic-roughness and MTL materials, and what it cannot keep."""

import numpy as np
import pytest
from PIL import Image
from trimesh.visual.material import PBRMaterial, SimpleMaterial

from jaxvis.reflectance import BlinnPhong, CookTorrance, Lambert, Material
from jaxvis.scene.file_materials import Losses, convert_material, file_reflectance


def convert(material, *, gltf=None, has_uv=True):
    losses = Losses()
    return convert_material(material, gltf, has_uv, losses), losses


def noise(height, width, seed):
    texels = np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)
    return Image.fromarray(texels)


def test_the_defaults_of_gltf_are_a_rough_white_metal():
    material, losses = convert(PBRMaterial())
    assert material.base_colour == (0.0, 0.0, 0.0)
    assert material.specular == (1.0, 1.0, 1.0)
    assert material.roughness == 1.0
    assert losses == Losses()


@pytest.mark.parametrize("metallic", [0.0, 0.3, 1.0])
def test_constants_split_between_diffuse_and_specular(metallic):
    pbr = PBRMaterial(baseColorFactor=[204, 102, 51, 255], metallicFactor=metallic)
    material, _ = convert(pbr)
    base = np.array([0.8, 0.4, 0.2])
    np.testing.assert_allclose(material.base_colour, base * (1 - metallic), atol=1e-9)
    np.testing.assert_allclose(material.specular, 0.04 * (1 - metallic) + base * metallic)


def test_a_constant_metal_tints_with_the_texture():
    pbr = PBRMaterial(baseColorTexture=noise(4, 4, 0), metallicFactor=0.5)
    material, _ = convert(pbr)
    assert material.base_colour_texture is not None
    assert material.specular_texture is not None
    texels = material.base_colour_texture.texels
    np.testing.assert_allclose(material.base_colour, 0.5)
    np.testing.assert_allclose(material.specular_texture.texels, 0.02 + 0.5 * texels, atol=1e-6)
    assert material.specular == (1.0, 1.0, 1.0)


def test_textures_of_different_sizes_meet_at_the_larger():
    pbr = PBRMaterial(
        baseColorTexture=noise(4, 8, 1),
        metallicRoughnessTexture=Image.fromarray(np.full((2, 2, 3), [0, 255, 255], np.uint8)),
        metallicFactor=1.0,
    )
    material, _ = convert(pbr)  # constant metal: the texture goes
    assert material.base_colour == (0.0, 0.0, 0.0)
    pbr.metallicRoughnessTexture = noise(2, 2, 2)
    material, _ = convert(pbr)
    assert material.specular_texture is not None
    assert material.base_colour_texture is not None
    assert material.roughness_texture is not None
    assert material.specular_texture.texels.shape == (4, 8, 3)
    assert material.roughness_texture.texels.shape == (2, 2, 1)
    # Nothing is lost or gained: base + specular = colour + 0.04 (1 - metal) >= colour.
    total = material.base_colour_texture.texels + material.specular_texture.texels
    colour, _ = convert(PBRMaterial(baseColorTexture=noise(4, 8, 1), metallicFactor=0.0))
    assert colour.base_colour_texture is not None
    excess = total - colour.base_colour_texture.texels
    assert excess.min() >= -1e-6
    assert excess.max() <= 0.04 + 1e-6


def test_textures_without_coordinates_are_left_out():
    pbr = PBRMaterial(baseColorTexture=noise(2, 2, 0), metallicFactor=0.0)
    material, losses = convert(pbr, has_uv=False)
    assert not material.textured
    assert losses.missing_textures == []


def test_grey_and_palette_images():
    grey = Image.fromarray(np.array([[0, 255]], np.uint8))
    for image in (grey, grey.convert("P"), grey.convert("LA"), grey.convert("1")):
        material, _ = convert(PBRMaterial(baseColorTexture=image, metallicFactor=0.0))
        assert material.base_colour_texture is not None
        texels = material.base_colour_texture.texels
        np.testing.assert_allclose(texels, [[[0, 0, 0], [1, 1, 1]]], atol=1e-6)


def test_expected_textures_that_are_not_there_are_counted():
    gltf = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    _, losses = convert(PBRMaterial(name="wall"), gltf=gltf)
    assert losses.missing_textures == ["wall"]


def test_exact_factors_win_unless_an_extension_replaced_them():
    pbr = PBRMaterial(baseColorFactor=[0.2, 0.2, 0.2, 1.0], metallicFactor=0.0)
    exact = {"pbrMetallicRoughness": {"baseColorFactor": [0.123, 0.2, 0.2, 1.0]}}
    assert convert(pbr, gltf=exact)[0].base_colour[0] == 0.123
    exact["extensions"] = {"KHR_materials_pbrSpecularGlossiness": {}}
    assert convert(pbr, gltf=exact)[0].base_colour[0] == pytest.approx(0.2)


def test_normal_maps_and_light_are_counted():
    pbr = PBRMaterial(normalTexture=noise(2, 2, 0), emissiveFactor=[1.0, 0, 0])
    _, losses = convert(pbr)
    assert (losses.normal_maps, losses.emitters) == (1, 1)
    _, losses = convert(PBRMaterial(emissiveFactor=[0.0, 0, 0]))
    assert (losses.normal_maps, losses.emitters) == (0, 0)


def test_alpha_counts_only_where_it_is_used():
    pbr = PBRMaterial(baseColorFactor=[255, 255, 255, 10], name="glass")
    assert convert(pbr)[1].transparent == []
    pbr.alphaMode = "BLEND"
    assert convert(pbr)[1].transparent == ["glass"]


def test_mtl_numbers():
    simple = SimpleMaterial(name="m", kd=[0.1, 0.2, 0.3], ks=0.5, ns=8.0)
    material, _ = convert(simple)
    assert material.base_colour == pytest.approx((0.1, 0.2, 0.3))
    assert material.specular == (0.5, 0.5, 0.5)
    assert material.roughness == pytest.approx((2 / 10) ** 0.25)


def test_no_material_is_diffuse_grey():
    assert convert(None)[0] == Material()
    assert convert(SimpleMaterial())[0].base_colour == (0.8, 0.8, 0.8)


def test_the_files_reflectance():
    matt, glossy = Material(), Material(specular=(0.5, 0.5, 0.5))
    assert file_reflectance([None], [matt]) == Lambert()
    assert file_reflectance([SimpleMaterial()], [glossy]) == BlinnPhong()
    assert file_reflectance([None, PBRMaterial()], [matt, glossy]) == CookTorrance("ggx")
