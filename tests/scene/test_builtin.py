"""All built-in scenes: found by name, sound, the same every time."""

import inspect
from functools import cache

import numpy as np
import pytest

from jaxvis.scene.builtin import MAKERS, builtin_scene, builtin_scenes
from jaxvis.scene.builtin.parameters import length, whole
from tests.scene.builtin_checks import camera_rays, least_alignment, sees_backs

SMALL = {"courtyard": {"triangles": 20_000}}


def make(name, **parameters):
    return builtin_scene(name, **(SMALL.get(name, {}) | parameters))


kept = cache(make)


def test_names():
    assert builtin_scenes()[:2] == ("teapot", "courtyard")
    assert set(builtin_scenes()) == set(MAKERS)


@pytest.mark.parametrize("name", builtin_scenes())
def test_scenes_need_no_mending_and_do_not_change(name):
    scene = kept(name)
    assert scene.name == name
    assert scene.notes == ()
    assert least_alignment(scene) > 0.0
    again = make(name)
    assert scene.geometry_hash == again.geometry_hash
    assert np.array_equal(scene.material_ids, again.material_ids)


@pytest.mark.parametrize("name", builtin_scenes())
def test_cameras_see_fronts(name):
    scene = kept(name)
    origins, directions = camera_rays(scene, 96, 64)
    assert sees_backs(scene, origins, directions) == 0
    hit = scene.tracer.occluded(origins, directions)
    assert hit.mean() > 0.05


def test_a_flipped_scene_shows_its_backs():
    scene = make("teapot")
    origins, directions = camera_rays(scene, 96, 64)
    # From below the plane the same rays look at its back.
    assert sees_backs(scene, origins * [1, -1, 1], directions * [1, -1, 1]) > 1000


@pytest.mark.parametrize("name", builtin_scenes())
def test_every_parameter_is_documented_and_checked(name):
    maker = MAKERS[name]
    text = (inspect.getdoc(maker) or "").split("Args:")[1]
    for parameter in inspect.signature(maker).parameters:
        assert parameter in text
        for wrong in (-1, float("nan"), float("inf"), 10**9):
            with pytest.raises(ValueError, match=rf"^scene '{name}': {parameter} must be [^\n]*$"):
                make(name, **{parameter: wrong})


def test_unknown_names():
    with pytest.raises(
        ValueError, match=r"unknown built-in scene 'teacup'.* known are teapot, court"
    ):
        builtin_scene("teacup")
    with pytest.raises(ValueError, match="'plane' has no parameter 'height'; it has size, cells"):
        builtin_scene("plane", height=2.0)
    with pytest.raises(ValueError, match="'plane' has no parameter 'name'"):
        builtin_scene("plane", name="other")


def test_numbers_in_other_guises():
    assert len(make("plane", cells=3.0, size=2).triangles) == 18
    with pytest.raises(ValueError, match=r"cells must be a whole number from 1 to 512, got 3\.5"):
        make("plane", cells=3.5)
    assert whole("rows", np.int64(7), 1, 9) == 7
    assert length("size", np.float32(0.5)) == 0.5
    assert length("size", 0, zero=True) == 0.0
    for wrong in ("many", None, True, [3], 0):
        with pytest.raises(ValueError, match="must be a whole number from 1 to 9"):
            whole("rows", wrong, 1, 9)
        with pytest.raises(ValueError, match="must be a number above 0 and at most 9"):
            length("size", wrong, high=9.0)
