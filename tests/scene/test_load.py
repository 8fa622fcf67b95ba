"""Scenes by name: built-in, data set or file, and what is said when there is none."""

import numpy as np
import pytest
import trimesh

from jaxvis import datasets
from jaxvis.scene import build_scene, builtin_scenes, load_scene
from jaxvis.scene import load as load_module


@pytest.fixture
def made(monkeypatch):
    """Stands in for the built-in scenes: returns the calls that are made of them."""
    calls = []

    def make(name, **parameters):
        calls.append((name, parameters))
        return build_scene(np.eye(3), [[0, 1, 2]], name=name)

    monkeypatch.setattr(load_module, "builtin_scenes", lambda: ("teapot", "courtyard"))
    monkeypatch.setattr(load_module, "builtin_scene", make)
    return calls


def test_builtin_scene_with_parameters(made):
    load_scene("teapot")
    load_scene("courtyard:triangles=100000, closed=true,height=2.5,style=gothic")
    assert made == [
        ("teapot", {}),
        ("courtyard", {"triangles": 100000, "closed": True, "height": 2.5, "style": "gothic"}),
    ]


def test_a_real_builtin_scene_loads():
    assert "plane" in builtin_scenes()
    assert load_scene("plane").name.startswith("plane")


def test_data_set_by_name(monkeypatch, tmp_path):
    (tmp_path / "models").mkdir()
    trimesh.creation.box().export(tmp_path / "models" / "bunny.obj")
    monkeypatch.setenv("JAXVIS_DATA", str(tmp_path))
    scene = load_scene("bunny")
    assert scene.name == "bunny"
    assert len(scene.triangles) == 12


def test_data_set_that_is_not_there(monkeypatch):
    monkeypatch.delenv("JAXVIS_DATA", raising=False)
    monkeypatch.setattr(datasets.pooch, "retrieve", None)
    with pytest.raises(FileNotFoundError, match="set JAXVIS_DATA"):
        load_scene("sponza")


def test_file_as_text_and_as_path(tmp_path):
    trimesh.creation.box().export(tmp_path / "box.stl")
    for source in (tmp_path / "box.stl", str(tmp_path / "box.stl")):
        assert load_scene(source).name == "box"


def test_two_sided_is_the_files_unless_told(tmp_path):
    trimesh.creation.box().export(tmp_path / "box.stl")
    path = tmp_path / "box.stl"
    assert not load_scene(path).materials[0].two_sided
    assert load_scene(path, two_sided=True).materials[0].two_sided
    assert not load_scene(path, two_sided=False).materials[0].two_sided


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("teapo", "unknown scene 'teapo': did you mean teapot.* known are .*courtyard.*duck"),
        ("dukc", "did you mean duck"),
        ("courtyrd:triangles=5", "did you mean courtyard"),
        ("courtyard:triangles", "'triangles' is not parameter=value"),
        ("courtyard:=5", "'=5' is not parameter=value"),
        ("duck:size=3", "data set 'duck' has no parameters"),
    ],
)
def test_unknown_names(made, source, message):
    with pytest.raises(ValueError, match=message) as caught:
        load_scene(source)
    assert "\n" not in str(caught.value)


def test_missing_file_suggests_its_neighbours(tmp_path):
    trimesh.creation.box().export(tmp_path / "house.obj")
    with pytest.raises(
        FileNotFoundError, match=r"hose\.obj: no such file; did you mean house\.obj"
    ):
        load_scene(tmp_path / "hose.obj")
    with pytest.raises(FileNotFoundError, match="no such file, and no folder"):
        load_scene(str(tmp_path / "nowhere" / "house.obj"))
    with pytest.raises(FileNotFoundError, match="is a folder"):
        load_scene(tmp_path)
