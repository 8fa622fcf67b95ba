"""The glTF header: cameras under their parents, and materials by primitive."""

import json
import struct

import numpy as np
import pytest

from jaxvis.scene.gltf import find_camera, primitive_materials, read_header

LENS = {"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}


def test_header_of_both_containers(tmp_path):
    header = {"asset": {"version": "2.0"}, "meshes": []}
    text = json.dumps(header).encode()
    (tmp_path / "a.gltf").write_bytes(text)
    chunk = struct.pack("<I4s", len(text), b"JSON") + text
    (tmp_path / "a.glb").write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunk)) + chunk)
    assert read_header(tmp_path / "a.gltf") == header
    assert read_header(tmp_path / "a.glb") == header


def test_primitives_in_order():
    header = {
        "materials": [{"name": "a"}, {"name": "b"}],
        "meshes": [
            {"primitives": [{"material": 1}, {}, {"material": 0, "mode": 1}]},
            {"primitives": [{"material": 0, "mode": 2}, {"material": 0, "mode": 5}]},
        ],
    }
    assert primitive_materials(header) == [{"name": "b"}, None, {"name": "a"}, {"name": "a"}]


def test_camera_stands_where_its_parents_put_it():
    quarter = [0.0, float(np.sqrt(0.5)), 0.0, float(np.sqrt(0.5))]  # about y: -z turns to -x
    header = {
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [
            {"children": [1, 2], "scale": [0.5, 0.5, 0.5], "translation": [1, 0, 0]},
            {"mesh": 0},
            {"children": [3], "rotation": quarter},
            {"camera": 0, "translation": [0, 2, 6]},
        ],
        "cameras": [LENS],
    }
    camera = find_camera(header, np.array([1.0, 1.0, 0.0]))
    assert camera is not None
    np.testing.assert_allclose(camera.eye, [4.0, 1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(camera.axes()[2], [-1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(camera.target, [1.0, 1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(camera.up, [0, 1, 0], atol=1e-12)
    assert camera.field_of_view == 0.7


def test_matrices_are_stored_by_column():
    matrix = np.eye(4)
    matrix[:3, 3] = [1, 2, 3]
    header = {"nodes": [{"camera": 0, "matrix": matrix.T.ravel().tolist()}], "cameras": [LENS]}
    camera = find_camera(header, np.zeros(3))
    assert camera is not None
    assert camera.eye == (1.0, 2.0, 3.0)
    # The centre lies ahead by 3: the target is abreast of it.
    np.testing.assert_allclose(camera.target, [1, 2, 0])


@pytest.mark.parametrize(
    "header",
    [
        {},
        {"nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}]},
        {"nodes": [{"camera": 0}], "cameras": [{"type": "orthographic", "orthographic": {}}]},
        {"nodes": [{"children": [1]}, {"children": [0]}]},  # a loop
    ],
)
def test_no_camera(header):
    assert find_camera(header, np.zeros(3)) is None
