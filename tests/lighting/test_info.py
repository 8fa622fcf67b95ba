"""What a light probe holds."""

import json

import numpy as np
import pytest

from jaxvis.lighting import environment_info
from tests.lighting.probe_files import gradient, write_pfm


def test_a_file_in_numbers(tmp_path):
    path = write_pfm(tmp_path / "sun.pfm", np.ones((8, 16, 3)))
    info = environment_info(path)
    assert json.loads(json.dumps(info)) == info
    assert info["name"] == "sun"
    assert info["layout"] == "latlong"
    assert info["size"] == [16, 8]
    assert info["map"] == [16, 8]
    assert info["usable"] is True
    assert info["minimum"] == info["maximum"] == 1.0
    assert info["mean"] == pytest.approx(1.0)
    assert info["dynamic_range"] == pytest.approx(1.0)
    assert info["brightest_share"] == pytest.approx(1e-3)


def test_a_sun_takes_the_share_of_the_brightest_thousandth():
    height = 64
    radiance = np.ones((height, 2 * height, 3))
    radiance[10, 20] = 1e5
    share = (np.cos(np.pi * 10 / height) - np.cos(np.pi * 11 / height)) / (4 * height)
    info = environment_info(radiance)
    sun = 1e5 * share
    assert share < 1e-3
    expected = (sun + 1e-3 - share) / (sun + 1.0 - share)
    assert info["brightest_share"] == pytest.approx(expected, rel=1e-5)
    assert info["dynamic_range"] == pytest.approx(1e5)
    assert info["mean"] == pytest.approx(sun + 1.0 - share)


def test_says_why_a_probe_is_not_usable(tmp_path):
    broken = gradient(4, 8)
    broken[0, 0] = np.nan
    info = environment_info(write_pfm(tmp_path / "broken.pfm", broken))
    assert info["usable"] is False
    assert "NaN" in info["problem"]
    assert info["layout"] == "latlong"
    assert "mean" not in info
    info = environment_info(write_pfm(tmp_path / "odd.pfm", np.ones((4, 7, 3))))
    assert info["usable"] is False
    assert "shape of no layout" in info["problem"]
    with pytest.raises(FileNotFoundError):
        environment_info(tmp_path / "absent.hdr")


def test_warnings_are_told_not_raised():
    radiance = gradient(4, 8)
    radiance[0, 0, 0] = -1e-5
    info = environment_info(radiance)
    assert info["usable"] is True
    assert len(info["warnings"]) == 1
    assert "negative" in info["warnings"][0]


def test_cubes_and_built_ins():
    info = environment_info([np.ones((4, 4, 3))] * 6)
    assert info["layout"] == "faces"
    assert info["pictures"] == 6
    assert info["map"] == [16, 8]
    info = environment_info("uniform:radiance=3")
    assert info["layout"] == "built-in"
    assert info["mean"] == pytest.approx(3.0)
    assert environment_info(np.zeros((2, 4, 3)))["dynamic_range"] is None
