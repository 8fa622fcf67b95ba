"""Rooms and objects told apart by rays."""

import numpy as np
import pytest
import trimesh

from jaxvis.reflectance import Material
from jaxvis.scene import build_scene
from jaxvis.scene.rooms import is_architecture, is_open_below, room_camera


def box(extents, inward, two_sided=False):
    mesh = trimesh.creation.box(extents)
    faces = mesh.faces[:, ::-1] if inward else mesh.faces
    return build_scene(mesh.vertices, faces, materials=(Material(two_sided=two_sided),))


def test_inward_walls_are_a_room_outward_ones_an_object():
    assert is_architecture(box((4, 3, 5), True))
    assert not is_architecture(box((4, 3, 5), False))


def test_two_sided_objects_are_no_rooms():
    assert not is_architecture(box((4, 3, 5), False, two_sided=True))


def test_a_street_is_architecture():
    """Two long rows of houses and one across the end, on a ground, open above."""
    parts = [trimesh.creation.box((40, 12, 8)) for _ in range(3)]
    parts[0].apply_translation([0, 6, -8])
    parts[1].apply_translation([0, 6, 8])
    parts[2].apply_translation([40, 6, 0])
    ground = trimesh.creation.box((40, 0.1, 24))
    mesh = trimesh.util.concatenate([*parts, ground])
    scene = build_scene(mesh.vertices, mesh.faces)
    assert is_architecture(scene)
    camera = room_camera(scene)
    assert abs(camera.eye[2]) < 4.0
    assert abs(camera.axes()[2][0]) > 0.9
    assert 0.0 < camera.eye[1] < 6.0


def test_open_below():
    ground = build_scene([[0, 0, 0], [1, 0, 0], [1, 0, -1], [0, 0, -1]], [[0, 1, 2], [0, 2, 3]])
    assert is_open_below(ground)
    assert not is_open_below(box((1, 1, 1), False))


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_the_view_does_not_depend_on_the_unit(scale):
    small, large = box((7, 3, 4), True), box((7 * scale, 3 * scale, 4 * scale), True)
    np.testing.assert_allclose(
        np.multiply(room_camera(small).eye, scale), room_camera(large).eye, rtol=1e-4,
        atol=1e-4 * scale,
    )  # fmt: skip


def test_a_room_with_a_wall_the_wrong_way_is_not_entered():
    room = trimesh.creation.box((4, 4, 4))
    faces = room.faces[:, ::-1].copy()
    outward = room.face_normals[:, 0] > 0.9
    faces[outward] = faces[outward, ::-1]
    assert outward.sum() == 2
    assert not is_architecture(build_scene(room.vertices, faces))
