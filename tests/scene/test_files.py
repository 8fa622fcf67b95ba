"""Mesh files: geometry and transforms of every format, colours, materials, and damage."""

import json
import os
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual.material import PBRMaterial

from jaxvis.errors import InvalidScene, JaxvisWarning
from jaxvis.reflectance import BlinnPhong, CookTorrance, Lambert
from jaxvis.scene import Camera, load_scene, trace_surface

AHEAD = Camera((0, 0, 4), (0, 0, 0), field_of_view=2.0 * np.arctan(0.25))
"""Sees [-1, 1] x [-1, 1] of the plane z = 0."""

SQUARE = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])
UV = (SQUARE[:, :2] + 1.0) / 2.0


def linear(encoded):
    """sRGB decoding, written out."""
    return encoded / 12.92 if encoded <= 0.04045 else ((encoded + 0.055) / 1.055) ** 2.4


def four_colours() -> Image.Image:
    """Red top left, green top right, blue bottom left, grey 128 bottom right; 16 x 16."""
    texels = np.zeros((16, 16, 3), np.uint8)
    texels[:8, :8, 0] = texels[:8, 8:, 1] = texels[8:, :8, 2] = 255
    texels[8:, 8:] = 128
    return Image.fromarray(texels)


def check_four_colours(scene):
    image = np.asarray(trace_surface(scene, AHEAD, (4, 4)).material.base_colour)
    np.testing.assert_allclose(image[0, 0], [1, 0, 0], atol=1e-6)
    np.testing.assert_allclose(image[0, 3], [0, 1, 0], atol=1e-6)
    np.testing.assert_allclose(image[3, 0], [0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(image[3, 3], linear(128 / 255), atol=1e-6)


def textured_square(**options) -> trimesh.Trimesh:
    material = PBRMaterial(**{"metallicFactor": 0.0, **options})
    visual = trimesh.visual.TextureVisuals(uv=UV, material=material)
    return trimesh.Trimesh(SQUARE, FACES, visual=visual, process=False)


@pytest.mark.parametrize("suffix", [".glb", ".obj", ".ply", ".stl", ".off"])
def test_every_format_gives_the_same_sphere(tmp_path, suffix):
    sphere = trimesh.creation.icosphere(2)
    path = tmp_path / f"ball{suffix}"
    sphere.export(path, **({"include_normals": False} if suffix == ".glb" else {}))
    scene = load_scene(path)
    assert len(scene.positions) == 162
    assert len(scene.triangles) == 320
    np.testing.assert_allclose(scene.bounds, sphere.bounds, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(scene.positions, axis=-1), 1.0, atol=1e-6)
    assert (
        np.einsum("tx,tx->t", scene.geometric_normals, scene.positions[scene.triangles[:, 0]]).min()
        > 0.9
    )
    assert scene.name == "ball"
    assert scene.reflectance == Lambert()
    assert scene.materials[0].base_colour == (0.8, 0.8, 0.8)
    assert scene.camera is None


def test_gltf_folder_with_buffers_and_images(tmp_path):
    exported = trimesh.Scene(textured_square(baseColorTexture=four_colours())).export(
        file_type="gltf"
    )
    for name, data in exported.items():
        (tmp_path / name).write_bytes(data)
    check_four_colours(load_scene(tmp_path / "model.gltf"))


def test_glb_texture_is_srgb_and_stands_upright(tmp_path):
    textured_square(baseColorTexture=four_colours()).export(tmp_path / "square.glb")
    scene = load_scene(tmp_path / "square.glb")
    check_four_colours(scene)
    assert scene.reflectance == CookTorrance("ggx")
    assert not scene.materials[0].two_sided


def test_glb_factors_are_linear_and_exact(tmp_path):
    material = PBRMaterial(
        baseColorFactor=[0.5, 0.25, 0.125, 1.0], metallicFactor=0.25, roughnessFactor=0.3,
        doubleSided=True, name="paint",
    )  # fmt: skip
    mesh = textured_square()
    mesh.visual.material = material
    mesh.export(tmp_path / "paint.glb")
    factor = [0.123, 0.456, 0.789, 1.0]
    _edit_json(tmp_path / "paint.glb", "baseColorFactor", factor)
    (paint,) = load_scene(tmp_path / "paint.glb").materials
    base = np.array(factor[:3])
    np.testing.assert_allclose(paint.base_colour, 0.75 * base, atol=1e-9)
    np.testing.assert_allclose(paint.specular, 0.75 * 0.04 + 0.25 * base, atol=1e-9)
    assert paint.roughness == pytest.approx(0.3)
    assert paint.two_sided
    assert paint.name == "paint"


def _edit_json(path: Path, key: str, value) -> None:
    """Replaces a material factor in a GLB's JSON, beyond the 8 bits that trimesh writes."""
    data = path.read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    header = json.loads(data[20 : 20 + length])
    header["materials"][0]["pbrMetallicRoughness"][key] = value
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text + data[20 + length :]
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)


def test_metallic_roughness_texture(tmp_path):
    texels = np.zeros((16, 16, 3), np.uint8)
    texels[..., 1] = 51  # roughness 0.2
    texels[:, 8:, 2] = 255  # the right half is metal
    textured_square(
        baseColorTexture=four_colours(),
        metallicRoughnessTexture=Image.fromarray(texels),
        metallicFactor=1.0,
        roughnessFactor=0.5,
    ).export(tmp_path / "half.glb")
    scene = load_scene(tmp_path / "half.glb")
    values = trace_surface(scene, AHEAD, (4, 4)).material
    base, specular = np.asarray(values.base_colour), np.asarray(values.specular)
    np.testing.assert_allclose(base[0, 0], [1, 0, 0], atol=1e-6)
    np.testing.assert_allclose(specular[0, 0], 0.04, atol=1e-6)
    np.testing.assert_allclose(base[0, 3], 0.0, atol=1e-6)
    np.testing.assert_allclose(specular[0, 3], [0, 1, 0], atol=1e-6)
    np.testing.assert_allclose(values.roughness, 0.1, atol=1e-6)
    assert scene.materials[0].roughness_texture is None  # constant: no texture is kept


def test_gltf_vertex_colours_are_linear(tmp_path):
    mesh = trimesh.Trimesh(SQUARE, FACES, process=False, vertex_colors=[[128, 64, 0, 255]] * 4)
    mesh.export(tmp_path / "colours.glb")
    surface = trace_surface(load_scene(tmp_path / "colours.glb"), AHEAD, (2, 2))
    expected = np.array([128, 64, 0]) / 255
    np.testing.assert_allclose(surface.material.base_colour[0, 0], expected, atol=1e-3)


@pytest.mark.parametrize("suffix", [".ply", ".obj"])
def test_other_vertex_colours_are_srgb(tmp_path, suffix):
    mesh = trimesh.Trimesh(SQUARE, FACES, process=False, vertex_colors=[[128, 64, 0, 255]] * 4)
    mesh.export(tmp_path / f"colours{suffix}")
    surface = trace_surface(load_scene(tmp_path / f"colours{suffix}"), AHEAD, (2, 2))
    expected = [linear(128 / 255), linear(64 / 255), 0.0]
    np.testing.assert_allclose(surface.material.base_colour[0, 0], expected, atol=1e-5)


def test_face_colours(tmp_path):
    mesh = trimesh.Trimesh(SQUARE, FACES, process=False, face_colors=[[255, 0, 0], [0, 255, 0]])
    mesh.export(tmp_path / "faces.ply")
    surface = trace_surface(load_scene(tmp_path / "faces.ply"), AHEAD, (8, 8))
    seen = np.asarray(surface.material.base_colour)
    np.testing.assert_array_equal(seen[7, 5], [1, 0, 0])
    np.testing.assert_array_equal(seen[0, 2], [0, 1, 0])


OBJ = """mtllib square.mtl
v -1 -1 0
v 1 -1 0
v 1 1 0
v -1 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl paint
f 1/1 2/2 3/3 4/4
"""


def write_obj(folder: Path, mtl: str | None) -> Path:
    (folder / "square.obj").write_text(OBJ)
    if mtl is not None:
        (folder / "square.mtl").write_text(mtl)
    return folder / "square.obj"


def test_obj_with_mtl(tmp_path):
    four_colours().save(tmp_path / "four.png")
    path = write_obj(
        tmp_path, "newmtl paint\nKd 1 1 1\nKs 0.5 0.25 0.125\nNs 30\nmap_Kd four.png\n"
    )
    scene = load_scene(path)
    check_four_colours(scene)
    (paint,) = scene.materials
    assert paint.specular == (0.5, 0.25, 0.125)
    # The exponent 2 / a^2 - 2 with a = r^2 is Ns again.
    assert 2.0 / paint.roughness**4 - 2.0 == pytest.approx(30.0)
    assert scene.reflectance == BlinnPhong()


@pytest.mark.parametrize(
    "mtl",
    [
        "newmtl paint\nKd 0.3 0.2 0.1\n",
        "newmtl paint\nKd 0.3 0.2 0.1\nKs 0 0 0\nNs 30\n",
        "newmtl paint\nKd 0.3 0.2 0.1\nKs 1 1 1\nNs 30\nillum 1\n",
    ],
)
def test_mtl_without_highlights_is_lambert(tmp_path, mtl):
    scene = load_scene(write_obj(tmp_path, mtl))
    assert scene.reflectance == Lambert()
    assert scene.materials[0].base_colour == pytest.approx((0.3, 0.2, 0.1))
    assert scene.materials[0].specular == (0.0, 0.0, 0.0)


def test_transparent_mtl_is_opaque_with_a_warning(tmp_path):
    path = write_obj(tmp_path, "newmtl paint\nKd 0.3 0.2 0.1\nd 0.5\n")
    with pytest.warns(JaxvisWarning, match=r"1 materials with transparency \(paint\)"):
        load_scene(path)


def test_black_kd_beside_a_texture_is_white(tmp_path):
    four_colours().save(tmp_path / "four.png")
    path = write_obj(tmp_path, "newmtl paint\nKd 0 0 0\nmap_Kd four.png\n")
    check_four_colours(load_scene(path))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        ("missing", r"1 textures are missing \(four\.png\); restore them in "),
        ("not an image", r"1 textures are not readable images \(four\.png\)"),
        ("truncated", r"textures of 1 materials \(paint\) are missing, damaged or"),
    ],
)
def test_unusable_texture_is_refused(tmp_path, damage, message):
    if damage == "not an image":
        (tmp_path / "four.png").write_bytes(b"hello")
    if damage == "truncated":
        noise = np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8)
        Image.fromarray(noise).save(tmp_path / "four.png")
        data = (tmp_path / "four.png").read_bytes()
        (tmp_path / "four.png").write_bytes(data[: len(data) // 2])
    path = write_obj(tmp_path, "newmtl paint\nKd 0.5 0.5 0.5\nmap_Kd four.png\n")
    with pytest.raises(InvalidScene, match=message) as caught:
        load_scene(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("written", ["../my maps/four.png", "..\\my maps\\four.png"])
def test_mtl_textures_outside_the_folder_and_with_backslashes(tmp_path, written):
    (tmp_path / "my maps").mkdir()
    (tmp_path / "mesh").mkdir()
    four_colours().save(tmp_path / "my maps" / "four.png")
    check_four_colours(
        load_scene(write_obj(tmp_path / "mesh", f"newmtl paint\nKd 1 1 1\nmap_Kd {written}\n"))
    )


def test_missing_mtl_warns(tmp_path):
    with pytest.warns(JaxvisWarning, match=r"materials are missing \(square\.mtl\)"):
        scene = load_scene(write_obj(tmp_path, None))
    assert scene.materials[0].base_colour == (0.8, 0.8, 0.8)
    assert any("square.mtl" in note for note in scene.notes)


def gltf_with_image(folder: Path, uri: str) -> Path:
    """A square whose only image is at ``uri``; writes no image."""
    exported = trimesh.Scene(textured_square(baseColorTexture=four_colours())).export(
        file_type="gltf"
    )
    for name, data in exported.items():
        if not name.endswith(".png"):
            (folder / name).write_bytes(data)
    header = json.loads((folder / "model.gltf").read_text())
    header["images"] = [{"uri": uri}]
    (folder / "model.gltf").write_text(json.dumps(header))
    return folder / "model.gltf"


def test_missing_gltf_texture_is_refused(tmp_path):
    path = gltf_with_image(tmp_path, "gone.png")
    with pytest.raises(InvalidScene, match=r"model\.gltf: 1 textures are missing \(gone\.png\)"):
        load_scene(path)


def test_gltf_names_are_uris(tmp_path):
    path = gltf_with_image(tmp_path, "four%20colours.png")
    four_colours().save(tmp_path / "four colours.png")
    check_four_colours(load_scene(path))


def test_damaged_embedded_texture_is_refused(tmp_path):
    path = gltf_with_image(tmp_path, "data:image/png;base64,aGVsbG8=")
    with pytest.raises(InvalidScene, match=r"textures of 1 materials \(.+\) are missing, damaged"):
        load_scene(path)


@pytest.mark.parametrize(("mode", "count"), [("MASK", 96), ("BLEND", 128)])
def test_transparent_texels_count_as_opaque_with_a_warning(tmp_path, mode, count):
    texels = np.full((16, 16, 4), 255, np.uint8)
    texels[:6, :, 3], texels[6:8, :, 3] = 0, 200
    textured_square(baseColorTexture=Image.fromarray(texels), alphaMode=mode, name="leaf").export(
        tmp_path / "leaf.glb"
    )
    with pytest.warns(JaxvisWarning, match=rf"\(leaf\) count as opaque: {count} texels"):
        scene = load_scene(tmp_path / "leaf.glb")
    assert trace_surface(scene, AHEAD, (4, 4)).mask.all()


def test_opaque_texels_do_not_warn(tmp_path):
    textured_square(baseColorTexture=four_colours(), alphaMode="MASK").export(tmp_path / "leaf.glb")
    assert load_scene(tmp_path / "leaf.glb").notes == ()


def scene_of_nodes(tmp_path, *matrices) -> Path:
    graph = trimesh.Scene()
    egg = trimesh.creation.icosphere(2, 0.5)
    egg.vertices = egg.vertices * [1.0, 1.4, 1.0] + [0.2, 0.1, 0.0]  # not symmetric
    for number, matrix in enumerate(matrices):
        graph.add_geometry(egg, geom_name="egg", node_name=f"n{number}", transform=matrix)
    graph.export(tmp_path / "nodes.glb", include_normals=True)
    return tmp_path / "nodes.glb"


def test_instances_and_node_transforms(tmp_path):
    left = trimesh.transformations.translation_matrix([-5.0, 0, 0])
    turned = trimesh.transformations.rotation_matrix(0.7, [0, 1, 0], [1, 0, 0])
    turned[:3, :3] *= [1.0, 3.0, 0.5]  # uneven scale: normals need the inverse transpose
    one = load_scene(scene_of_nodes(tmp_path, np.eye(4)))
    two = load_scene(scene_of_nodes(tmp_path, left, turned))
    assert len(two.triangles) == 2 * len(one.triangles)
    points = one.positions[one.triangles].astype(np.float64) + one.origin
    shifted, moved = points - [5.0, 0, 0], points @ turned[:3, :3].T + turned[:3, 3]
    found = two.positions[two.triangles] + two.origin
    # The order of nodes is trimesh's affair.
    swapped = found[0, 0, 0] > -3.0
    expected = np.concatenate([moved, shifted] if swapped else [shifted, moved])
    np.testing.assert_allclose(found, expected, atol=1e-5)
    normals = one.normals[one.triangles] @ np.linalg.inv(turned[:3, :3])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    count = len(one.triangles)
    half = slice(count) if swapped else slice(count, None)
    np.testing.assert_allclose(two.normals[two.triangles[half]], normals, atol=1e-3)


def test_mirrored_nodes_keep_their_front_outside(tmp_path):
    mirrored = load_scene(scene_of_nodes(tmp_path, np.diag([-1.0, 1.0, 1.0, 1.0])))
    assert mirrored.notes == ()
    surface = trace_surface(mirrored, Camera((3, 2, 4), (-0.2, 0.1, 0.3)), (32, 32))
    assert surface.mask.sum() > 50
    assert not surface.backs.any()
    outward = mirrored.positions[mirrored.triangles].mean(axis=1)
    assert np.einsum("tx,tx->t", mirrored.geometric_normals, outward).min() > 0.0


def test_far_node_gives_the_surface_of_the_near_one(tmp_path):
    shift = np.array([1e6, -1e6, 2e6])
    eye, target = np.array([1.5, 1.0, 2.0]), np.array([0.0, 0, 0.5])
    near = load_scene(scene_of_nodes(tmp_path, np.eye(4)))
    far = load_scene(scene_of_nodes(tmp_path, trimesh.transformations.translation_matrix(shift)))
    a = trace_surface(near, Camera(eye, target), (24, 24))
    b = trace_surface(far, Camera(eye + shift, target + shift), (24, 24))
    assert a.mask.sum() > 50
    np.testing.assert_array_equal(a.mask, b.mask)
    np.testing.assert_allclose(b.position, a.position, atol=1e-6)
    np.testing.assert_allclose(b.normal, a.normal, atol=1e-6)


def test_far_obj_keeps_its_files_precision(tmp_path):
    lines = [f"v {1e6 + x:.9f} {2e6 + y:.9f} {z:.9f}" for x, y, z in SQUARE * 1e-3]
    (tmp_path / "far.obj").write_text("\n".join([*lines, "f 1 2 3", "f 1 3 4"]))
    scene = load_scene(tmp_path / "far.obj")
    np.testing.assert_allclose(scene.positions[scene.triangles], (SQUARE * 1e-3)[FACES], atol=1e-9)


def test_materials_of_two_meshes_stay_with_their_triangles(tmp_path):
    red, green = (
        textured_square(baseColorFactor=[1.0, 0, 0, 1]),
        textured_square(baseColorFactor=[0, 1.0, 0, 1]),
    )
    green.apply_translation([2.5, 0, 0])
    trimesh.Scene([red, green]).export(tmp_path / "two.glb")
    scene = load_scene(tmp_path / "two.glb")
    centres = scene.positions[scene.triangles].mean(axis=1)[:, 0]
    colours = np.array([m.base_colour for m in scene.materials])[scene.material_ids]
    np.testing.assert_allclose(colours, np.where(centres[:, None] < 0, [1, 0, 0], [0, 1, 0]))


def bad_file(tmp_path, kind) -> Path:
    sphere = trimesh.creation.icosphere(1)
    if kind.startswith("truncated"):
        path = tmp_path / f"ball{kind.split()[1]}"
        sphere.export(path)
        data = path.read_bytes()
        path.write_bytes(data[: int(0.6 * len(data))])
        return path
    if kind.startswith(("garbage", "empty")):
        path = tmp_path / f"ball{kind.split()[1]}"
        path.write_bytes(b"" if kind.startswith("empty") else bytes(range(256)) * 8)
        return path
    if kind == "points":
        trimesh.PointCloud(sphere.vertices).export(tmp_path / "ball.ply")
        return tmp_path / "ball.ply"
    if kind == "lines":
        path = trimesh.load_path(np.array([[[0.0, 0, 0], [1, 1, 1]]]))
        trimesh.Scene(path).export(tmp_path / "ball.glb")
        return tmp_path / "ball.glb"
    if kind == "unknown":
        (tmp_path / "ball.blend").write_bytes(b"BLENDER")
        return tmp_path / "ball.blend"
    texts = {
        "index": "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n",
        "nan": "v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n",
        "flat": "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n",
    }
    (tmp_path / "ball.obj").write_text(texts[kind])
    return tmp_path / "ball.obj"


@pytest.mark.parametrize(
    "kind",
    [
        *(f"truncated {suffix}" for suffix in (".glb", ".ply", ".stl")),
        *(f"garbage {suffix}" for suffix in (".glb", ".gltf", ".obj", ".ply", ".stl", ".off")),
        *(f"empty {suffix}" for suffix in (".glb", ".obj", ".ply", ".stl")),
        "points", "lines", "unknown", "index", "nan", "flat",
    ],
)  # fmt: skip
def test_unusable_files_are_refused_in_one_line(tmp_path, kind):
    path = bad_file(tmp_path, kind)
    with pytest.raises(InvalidScene) as caught:
        load_scene(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def data_file(name: str) -> Path:
    folder = os.environ.get("JAXVIS_DATA")
    if not folder:
        pytest.skip(f"JAXVIS_DATA is not set: {name} is not checked")
    return Path(folder) / name


def test_duck():
    scene = load_scene(data_file("models/duck.glb"))
    assert len(scene.triangles) == 4212
    assert scene.reflectance == CookTorrance("ggx")
    assert scene.camera is not None
    surface = trace_surface(scene, scene.camera, (40, 40))
    mask = np.asarray(surface.mask)
    assert 0.25 < mask.mean() < 0.8
    assert not surface.backs.any()
    red, green, blue = np.asarray(surface.material.base_colour)[mask].mean(axis=0)
    assert red > green > 3.0 * blue  # a yellow duck
    # Not cut off at any border.
    assert not np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]]).any()


def test_sponza():
    path = data_file("scenes/sponza.glb")
    with pytest.warns(JaxvisWarning) as caught:
        scene = load_scene(path)
    assert any("3 materials with transparency" in str(w.message) for w in caught)
    assert any("dropped 1 of 262267 triangles" in str(w.message) for w in caught)
    assert len(scene.triangles) == 262266
    assert len(scene.materials) == 25
    assert {m.name for m in scene.materials if m.two_sided} == {"leaf", "Material__57", "chain"}
    inside = Camera((600, 300, -40), (-500, 300, -40), field_of_view=1.0)
    surface = trace_surface(scene, inside, (48, 32))
    assert surface.coverage.mean() > 0.95
    assert surface.backs.mean() < 0.01
    roughness = np.asarray(surface.material.roughness)[np.asarray(surface.mask)]
    assert roughness.std() > 0.02  # it varies over the surfaces


@pytest.mark.parametrize("coordinate", ["nan", "inf", "-11e999", "1e200"])
@pytest.mark.parametrize("normal", ["0 1 0", "0 0 0", "nan 0 inf"])
def test_stl_out_of_range_is_one_line(normal, coordinate, tmp_path, recwarn):
    """trimesh compares an STL's normals with its vertices' as it reads, with NumPy's warnings."""
    path = tmp_path / "mesh.stl"
    path.write_text(
        f"solid s\nfacet normal {normal}\nouter loop\nvertex 0 0 0\nvertex 0 0 1\n"
        f"vertex {coordinate} 0 0\nendloop\nendfacet\nendsolid s\n"
    )
    with pytest.raises(InvalidScene, match=r"mesh\.stl: .*(NaN or infinite|larger than float32)"):
        load_scene(path)
    assert not [str(warning.message) for warning in recwarn]
