"""Default views: whole objects, land, rooms, and the views that files come with."""

import os
from pathlib import Path

import numpy as np
import pytest
import trimesh

from jaxvis.reflectance import Material
from jaxvis.scene import Camera, build_scene, default_camera, load_scene, trace_surface
from jaxvis.scene.framing import MARGIN, close_up


def projected(scene, camera, aspect):
    """Vertices in the picture: [-1, 1] is its width and height. NaN behind the camera."""
    right, up, forward = camera.axes()
    offsets = scene.positions + scene.origin - camera.eye
    depth = offsets @ forward
    scale = np.where(depth > 0, depth, np.nan) * np.tan(0.5 * camera.field_of_view)
    return np.stack([offsets @ right / (scale * aspect), offsets @ up / scale], axis=-1)


def egg(shape, shift=(0.0, 0.0, 0.0)):
    ball = trimesh.creation.icosphere(2)
    return build_scene(ball.vertices * shape + shift, ball.faces)


@pytest.mark.parametrize("shape", [(1, 1, 1), (5, 1, 1), (1, 6, 1), (1, 1, 5), (1e-3, 2e-3, 1e-3)])
@pytest.mark.parametrize("aspect", [0.5, 1.0, 16 / 9])
def test_a_whole_object_is_seen_as_large_as_can_be(shape, aspect):
    scene = egg(shape, (1e5, 0.0, -1e5))
    camera = default_camera(scene, aspect=aspect)
    places = projected(scene, camera, aspect)
    assert np.abs(places).max() <= 1.0 - MARGIN + 1e-3
    assert np.abs(places).max(axis=0).max() > 1.0 - MARGIN - 0.02
    # From above, from the front and from the right.
    assert np.all(np.subtract(camera.eye, camera.target) > 0.0)


def test_the_rays_see_it_too():
    scene = egg((2, 1, 1))
    mask = np.asarray(trace_surface(scene, default_camera(scene), (32, 32)).mask)
    assert mask.any(axis=0).sum() >= 28
    assert not np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]]).any()


def test_two_sided_objects_are_seen_from_outside():
    ball = trimesh.creation.icosphere(2)
    scene = build_scene(ball.vertices, ball.faces, materials=(Material(two_sided=True),))
    assert np.linalg.norm(default_camera(scene).eye) > 1.5


def hills(size):
    row, column = np.mgrid[0:size, 0:size].astype(float)
    heights = 0.5 * np.sin(row / 3.0) * np.cos(column / 4.0)
    points = np.stack([column, heights, row], axis=-1).reshape(-1, 3)
    first = (np.arange(size * size).reshape(size, size)[:-1, :-1]).reshape(-1)
    triangles = [[first, first + size, first + size + 1], [first, first + size + 1, first + 1]]
    return build_scene(points, np.concatenate([np.stack(t, axis=-1) for t in triangles]))


def test_land_fills_the_picture():
    scene = hills(30)
    camera = default_camera(scene)
    surface = trace_surface(scene, camera, (24, 24))
    assert surface.mask.mean() > 0.6
    assert not surface.backs.any()
    assert camera.eye[1] > scene.bounds[1, 1]


def test_land_without_a_vertex_in_its_middle_is_seen_whole():
    corners = [[-1.0, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]]
    scene = build_scene(corners, [[0, 2, 1], [0, 3, 2]])
    camera = default_camera(scene)
    assert camera.eye[1] > 0.0
    assert np.abs(projected(scene, camera, 1.0)).max() < 1.0


def test_a_closed_plate_is_not_land():
    plate = trimesh.creation.box((4.0, 0.2, 4.0))
    scene = build_scene(plate.vertices, plate.faces)
    assert np.abs(projected(scene, default_camera(scene), 1.0)).max() < 1.0


def corridor(length=12.0, shift=0.0):
    """A closed hall along x, seen from within."""
    hall = trimesh.creation.box((length, 3.0, 3.0))
    for _ in range(3):
        hall = hall.subdivide()
    return build_scene(hall.vertices + shift, hall.faces[:, ::-1])


def test_a_hall_is_seen_along_its_length():
    scene = corridor(shift=100.0)
    camera = default_camera(scene)
    eye = np.subtract(camera.eye, 100.0)
    assert np.all(np.abs(eye) < [6.0, 1.5, 1.5])
    assert abs(eye[0]) > 3.0  # from near one end
    assert abs(eye[2]) < 0.4  # in the middle
    forward = camera.axes()[2]
    assert abs(forward[0]) > 0.99
    assert forward[0] * eye[0] < 0.0  # to the other end
    assert trace_surface(scene, camera, (16, 16)).mask.all()


def test_the_view_is_the_same_each_time():
    assert default_camera(corridor()) == default_camera(corridor())


def test_the_scenes_own_camera_comes_first():
    own = Camera((9, 9, 9), (0, 0, 0))
    assert default_camera(egg((1, 1, 1)).with_camera(own)) is own


def test_distant_file_cameras_move_closer():
    scene = egg((1, 1, 1), (3.0, 0.0, 0.0))
    far = Camera((3, 20, 40), (3.5, 0, 0), field_of_view=0.8)
    near = close_up(scene, far)
    np.testing.assert_allclose(near.axes(), far.axes(), atol=1e-9)
    assert near.field_of_view == 0.8
    places = np.abs(projected(scene, near, 1.0))
    assert 0.9 < places.max() < 1.0


@pytest.mark.parametrize("eye", [(0.0, 0.0, 3.0), (0.1, 0.0, 0.0)])
def test_near_and_inner_file_cameras_stay(eye):
    camera = Camera(eye, (0, 0, -5))
    assert close_up(egg((1, 1, 1)), camera) is camera


@pytest.mark.parametrize("aspect", [0.0, -1.0, np.nan])
def test_bad_aspects(aspect):
    with pytest.raises(ValueError, match="aspect must be positive"):
        default_camera(egg((1, 1, 1)), aspect=aspect)


@pytest.mark.filterwarnings("ignore::jaxvis.errors.JaxvisWarning")
def test_sibenik_is_seen_along_its_nave():
    folder = os.environ.get("JAXVIS_DATA")
    if not folder:
        pytest.skip("JAXVIS_DATA is not set: the cathedral's view is not checked")
    scene = load_scene(Path(folder) / "scenes/sibenik.ply")
    camera = default_camera(scene)
    assert abs(camera.axes()[2][0]) > 0.98
    assert abs(camera.eye[2]) < 1.0
    assert trace_surface(scene, camera, (24, 16)).backs.mean() < 0.02
