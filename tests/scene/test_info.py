"""What `jaxvis info` says of scenes."""

import numpy as np
import pytest
import trimesh

from jaxvis.errors import InvalidScene
from jaxvis.reflectance import Material, Texture
from jaxvis.scene import build_scene, scene_info

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def test_a_closed_mesh():
    box = trimesh.creation.box((1.0, 2.0, 3.0))
    info = scene_info(build_scene(box.vertices, box.faces, name="box"))
    assert info.watertight
    assert (info.vertices, info.triangles, info.materials, info.textures) == (24, 12, 1, 0)
    assert info.bounds == ((-0.5, -1.0, -1.5), (0.5, 1.0, 1.5))
    text = str(info)
    assert "box: usable as a scene" in text
    assert "watertight" in text
    assert "size 1 x 2 x 3" in text


def test_open_and_textured_and_two_sided():
    texture = Texture(np.ones((1, 1, 3), np.float32))
    materials = (
        Material(base_colour_texture=texture, specular_texture=texture, two_sided=True),
        Material(),
    )
    info = scene_info(
        build_scene(SQUARE, FACES, uvs=np.zeros((2, 3, 2)), materials=materials,
                    material_ids=[0, 1], notes=("left out a cloud",))
    )  # fmt: skip
    assert not info.watertight
    assert (info.border_edges, info.non_manifold_edges) == (4, 0)
    assert (info.textures, info.two_sided_triangles) == (1, 1)
    assert "open (4 border edges, 0 non-manifold edges)" in str(info)
    assert "note: left out a cloud" in str(info)
    assert "texture coordinates" in str(info)


def test_non_manifold_edges():
    third = [[0.0, 0, 0], [1, 1, 0], [0, 0, 1]]
    points = np.concatenate([SQUARE, third])
    assert scene_info(build_scene(points, [*FACES.tolist(), [4, 5, 6]])).non_manifold_edges == 1
    against = [[0, 1, 2], [0, 3, 2]]  # both sides wind against each other along the diagonal
    assert scene_info(build_scene(SQUARE, against)).non_manifold_edges == 1


def test_of_a_file_mends_without_warning(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\nf 1 2 3\nf 1 2 4\n")
    info = scene_info(tmp_path / "a.obj")
    assert info.triangles == 1
    assert info.notes == ("dropped 1 of 2 triangles without area",)
    (tmp_path / "b.obj").write_text("v 0 0 0\n")
    with pytest.raises(InvalidScene, match="no triangles"):
        scene_info(tmp_path / "b.obj")
