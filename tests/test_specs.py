"""Names with parameters, and hints at names that may be meant."""

from pathlib import Path

import pytest

from jaxvis import specs

KNOWN = ("teapot", "courtyard", "plane")


@pytest.mark.parametrize(
    ("spec", "name", "parameters"),
    [
        ("plane", "plane", {}),
        ("plane:", "plane", {}),
        ("plane:size=2", "plane", {"size": "2"}),
        ("plane: size = 2 , cells=3,", "plane", {"size": "2", "cells": "3"}),
        ("plane:label=a=b:c", "plane", {"label": "a=b:c"}),
        ("plane:label=", "plane", {"label": ""}),
        ("", "", {}),
    ],
)
def test_a_spec_is_a_name_and_parameters(spec, name, parameters):
    assert specs.name_of(spec) == name
    assert specs.parameters_of(spec, "scene") == parameters


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("plane:size", "scene 'plane:size': 'size' is not parameter=value"),
        ("plane:=5", "'=5' is not parameter=value"),
        ("plane:size=1,cells=2,size=3", "size is set twice; set it once"),
    ],
)
def test_what_is_no_assignment_is_refused(spec, message):
    with pytest.raises(ValueError, match=message):
        specs.parameters_of(spec, "scene")


def test_parameters_that_there_are_not():
    specs.check_parameters({"size": "2"}, ["size", "cells"], "scene 'plane'")
    with pytest.raises(ValueError, match="scene 'plane' has no parameter 'sice'; it has size, c"):
        specs.check_parameters({"size": "2", "sice": "3"}, ["size", "cells"], "scene 'plane'")
    with pytest.raises(ValueError, match="it has none"):
        specs.check_parameters(["size"], [], "scene 'plane'")


def test_unknown_names():
    assert specs.unknown("teapto:size=3", KNOWN, "scene") == (
        "unknown scene 'teapto:size=3': did you mean teapot? known are teapot, courtyard, plane"
    )
    assert specs.unknown("xyz", KNOWN, "scene") == (
        "unknown scene 'xyz': known are teapot, courtyard, plane"
    )
    assert "did you mean plane or planet?" in specs.unknown("plan", ("planet", "plane"), "scene")


@pytest.mark.parametrize(
    ("source", "expected"),
    [("teapto", False), ("a.obj", True), ("folder/a", True), (Path("teapto"), True)],
)
def test_what_can_only_be_a_file(source, expected):
    assert specs.is_file_name(source) == expected


def test_missing_files(tmp_path):
    (tmp_path / "house.obj").touch()
    (tmp_path / "other.ply").touch()
    path = tmp_path / "hose.obj"
    assert str(specs.no_such_file(path)) == f"{path}: no such file; did you mean house.obj?"
    path = tmp_path / "xyz"
    assert str(specs.no_such_file(path)) == f"{path}: no such file"
    path = tmp_path / "nowhere" / "house.obj"
    assert str(specs.no_such_file(path)) == f"{path}: no such file, and no folder {path.parent}"
