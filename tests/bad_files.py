"""Files that a user should not have, by kind: functions that write one into a folder."""

import json
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

from jaxvis.image import write_image

CORNERS = "v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv 0 1 0\n"
GOOD = f"{CORNERS}f 1 2 3\nf 1 4 2\nf 2 4 3\nf 3 4 1\n"  # a tetrahedron


def good_mesh(folder: Path) -> Path:
    path = folder / "good.obj"
    path.write_text(GOOD)
    return path


def good_light(folder: Path) -> Path:
    path = folder / "good.exr"
    write_image(path, np.ones((8, 16, 3), np.float32))
    return path


def text_file(name: str, content: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        (folder / name).write_text(content)
        return folder / name

    return write


def cut(name: str, content: Callable[[], bytes], share: float) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        data = content()
        (folder / name).write_bytes(data[: int(share * len(data))])
        return folder / name

    return write


def radiance(name: str, change: Callable[[np.ndarray], None]) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        pixels = np.ones((16, 32, 3), np.float32)
        change(pixels)
        write_image(folder / name, pixels)
        return folder / name

    return write


def cut_image(name: str, share: float) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        pixels = np.random.default_rng(0).uniform(0.1, 9.0, (32, 64, 3)).astype(np.float32)
        write_image(folder / name, pixels)
        data = (folder / name).read_bytes()
        (folder / name).write_bytes(data[: int(share * len(data))])
        return folder / name

    return write


def ply() -> bytes:
    """A square as a binary .ply."""
    header = (
        b"ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\n"
        b"property float y\nproperty float z\nelement face 2\n"
        b"property list uchar int vertex_indices\nend_header\n"
    )
    corners = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]], "<f4").tobytes()
    faces = b"".join(struct.pack("<Biii", 3, *face) for face in ((0, 2, 1), (0, 3, 2)))
    return header + corners + faces


def glb(image: str | None = None) -> bytes:
    """A tetrahedron as a .glb, with a base-colour texture if ``image`` says where that is."""
    corners = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [0, 1, 0]], "<f4")
    uvs = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], "<f4").tobytes()
    faces = np.array([0, 1, 2, 0, 3, 1, 1, 3, 2, 2, 3, 0], "<u2").tobytes()
    binary = corners.tobytes() + uvs + faces
    views = [(0, 48), (48, 32), (80, 24)]
    primitive = {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2}
    content = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "buffers": [{"byteLength": len(binary)}],
        "bufferViews": [{"buffer": 0, "byteOffset": o, "byteLength": n} for o, n in views],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": 5126,
                "count": 4,
                "type": "VEC3",
                "min": corners.min(axis=0).tolist(),
                "max": corners.max(axis=0).tolist(),
            },
            {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5123, "count": 12, "type": "SCALAR"},
        ],
    }
    if image is not None:
        primitive["material"] = 0
        content["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
        content["textures"] = [{"source": 0}]
        content["images"] = [{"uri": image}]
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    total = 12 + 8 + len(text) + 8 + len(binary)
    return (
        struct.pack("<III", 0x46546C67, 2, total)
        + struct.pack("<II", len(text), 0x4E4F534A)
        + text
        + struct.pack("<II", len(binary), 0x004E4942)
        + binary
    )


def textured(folder: Path, image: str) -> Path:
    (folder / "textured.glb").write_bytes(glb(image))
    return folder / "textured.glb"


def value_at(index: tuple, value: float) -> Callable[[np.ndarray], None]:
    def change(pixels: np.ndarray) -> None:
        pixels[index] = value

    return change


def half_negative(pixels: np.ndarray) -> None:
    pixels[::2] = -1.0


def shape(folder: Path, shape: tuple[int, int]) -> Path:
    write_image(folder / "aspect.exr", np.ones((*shape, 3), np.float32))
    return folder / "aspect.exr"


BAD_MESHES = {
    "missing": lambda folder: folder / "gone.obj",
    "missing folder": lambda folder: folder / "nowhere" / "gone.obj",
    "a folder": lambda folder: folder,
    "unknown format": text_file("mesh.xyzw", "what is this"),
    "not what it says": text_file("mesh.glb", GOOD),
    "truncated ply": cut("cut.ply", ply, 0.8),
    "truncated ply header": cut("cut.ply", ply, 0.2),
    "truncated glb": cut("cut.glb", glb, 0.9),
    "truncated glb header": cut("cut.glb", glb, 0.01),
    "empty file": text_file("empty.obj", ""),
    "no faces": text_file("points.obj", CORNERS),
    "only zero-area faces": text_file("flat.obj", f"{CORNERS}f 1 1 2\n"),
    "face index out of range": text_file("index.obj", f"{CORNERS}f 1 2 9\n"),
    "NaN vertex": text_file("nan.obj", GOOD.replace("v 1 0 1", "v nan 0 1")),
    "infinite vertex": text_file("inf.obj", GOOD.replace("v 1 0 1", "v inf 0 1")),
    "missing texture": lambda folder: textured(folder, "gone.png"),
    "damaged texture": lambda folder: textured(folder, "data:image/png;base64,aGVsbG8="),
    "not a height field": text_file("terrain.npz", "no zip"),
}

BAD_LIGHTS = {
    "missing": lambda folder: folder / "gone.hdr",
    "unknown format": text_file("light.xyzw", "what is this"),
    "not what it says": text_file("light.hdr", "no picture"),
    "truncated hdr": cut_image("cut.hdr", 0.6),
    "truncated exr": cut_image("cut.exr", 0.6),
    "truncated pfm": cut_image("cut.pfm", 0.6),
    "NaN radiance": radiance("nan.exr", value_at((3, 4, 1), np.nan)),
    "infinite radiance": radiance("inf.exr", value_at((3, 4, 1), np.inf)),
    "negative radiance": radiance("negative.exr", half_negative),
    "wrong aspect ratio": lambda folder: shape(folder, (10, 31)),
}
