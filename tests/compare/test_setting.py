"""What is lit and seen."""

import dataclasses
import json

import numpy as np
import pytest

from jaxvis.compare import prepare, read_camera
from jaxvis.reflectance import reflectance_by_name
from jaxvis.scene import Camera

SIZE = (20, 14)


def test_camera_files(tmp_path):
    path = tmp_path / "camera.json"
    camera = Camera((1.0, 2.0, 3.0), (0.0, 0.5, 0.0), field_of_view=0.5)
    path.write_text(json.dumps({"camera": dataclasses.asdict(camera), "schema": 1}))
    assert read_camera(path) == camera
    path.write_text('{"eye": [1, 2, 3], "target": [0, 0.5, 0]}')
    assert read_camera(path) == dataclasses.replace(camera, field_of_view=0.6)
    for text in ("{", "[]", '{"eye": [1, 2, 3]}', '{"eye": [1, 2], "target": [0, 0, 0]}'):
        path.write_text(text)
        with pytest.raises(ValueError, match=r"camera\.json: not a camera"):
            read_camera(path)
    with pytest.raises(FileNotFoundError, match=r"gone\.json: no such"):
        read_camera(tmp_path / "gone.json")


def test_rotation_turns_light_and_background(scene, sky):
    plain, turned = prepare(scene, sky, SIZE), prepare(scene, sky, SIZE, rotate=np.pi)
    assert not np.array_equal(plain.background, turned.background)
    flipped = turned.environment.rotate(np.pi)
    assert np.allclose(flipped.radiance, sky.radiance, atol=1e-5)


def test_the_model_replaces_that_of_the_grey(scene, sky):
    grey = prepare(scene, sky, SIZE, albedo=0.5)
    np.testing.assert_allclose(grey.surface.material.base_colour[grey.surface.mask], 0.5)
    assert grey.surface.reflectance == reflectance_by_name("lambert")
    shiny = prepare(scene, sky, SIZE, albedo=0.5, reflectance="phong")
    assert shiny.surface.reflectance == reflectance_by_name("phong")


def test_backs_of_one_sided_faces_are_counted(scene, sky):
    below = Camera((0.0, -1.0, 4.0), (0.0, -0.9, 0.0), field_of_view=0.7)
    one_sided = prepare(scene, sky, SIZE, camera=below)
    assert one_sided.back_pixels == one_sided.covered.sum() > 0
    assert prepare(scene, sky, SIZE, camera=below, two_sided=True).back_pixels == 0
