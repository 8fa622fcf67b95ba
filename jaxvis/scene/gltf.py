"""What trimesh does not hand over of a glTF file: cameras under their parents, exact factors."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from trimesh.transformations import quaternion_matrix

from jaxvis.scene.camera import Camera

READ_MODES = (0, 1, 4, 5)
"""Primitives that trimesh turns into geometry: points, lines, triangles, triangle strips."""


def read_header(path: Path) -> dict[str, Any]:
    """The JSON of a .gltf or .glb file. Raises ValueError or OSError for other files."""
    data = path.read_bytes()
    if data[:4] == b"glTF":
        (length,) = struct.unpack_from("<I", data, 12)
        data = data[20 : 20 + length]
    return json.loads(data)


def primitive_materials(header: dict[str, Any]) -> list[dict[str, Any] | None]:
    """The material of each primitive that trimesh reads, in its order; None where there is none."""
    materials = header.get("materials", [])
    return [
        materials[primitive["material"]] if "material" in primitive else None
        for mesh in header.get("meshes", [])
        for primitive in mesh["primitives"]
        if primitive.get("mode", 4) in READ_MODES
    ]


def find_camera(header: dict[str, Any], centre: Float64[np.ndarray, "3"]) -> Camera | None:
    """The file's first perspective camera, in world coordinates; None if it has none.

    Args:
        header: the file's JSON.
        centre: the scene's centre; the camera's target is the point on its axis abreast of it.
    """
    nodes = header.get("nodes", [])
    scenes = header.get("scenes", [])
    roots = scenes[header.get("scene", 0)].get("nodes", []) if scenes else range(len(nodes))
    stack = [(index, np.eye(4)) for index in reversed(list(roots))]
    visited = set()
    while stack:
        index, parent = stack.pop()
        if index in visited:
            continue
        visited.add(index)
        node = nodes[index]
        world = parent @ _local_matrix(node)
        if "camera" in node:
            lens = header["cameras"][node["camera"]].get("perspective")
            if lens is not None:
                return _camera(world, lens["yfov"], centre)
        stack += [(child, world) for child in reversed(node.get("children", []))]
    return None


def _local_matrix(node: dict[str, Any]) -> Float64[np.ndarray, "4 4"]:
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    if "rotation" in node:
        x, y, z, w = node["rotation"]
        matrix = quaternion_matrix([w, x, y, z])
    matrix[:3, :3] *= np.asarray(node.get("scale", (1.0, 1.0, 1.0)))
    matrix[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return matrix


def _camera(
    world: Float64[np.ndarray, "4 4"], field_of_view: float, centre: Float64[np.ndarray, "3"]
) -> Camera:
    """A glTF camera looks along its local -z, with y upwards."""
    eye, up = world[:3, 3], world[:3, 1]
    forward = -world[:3, 2] / np.linalg.norm(world[:3, 2])
    abreast = float(np.dot(centre - eye, forward))
    distance = abreast if abreast > 0.0 else 1.0
    return Camera(eye, eye + distance * forward, up / np.linalg.norm(up), field_of_view)
