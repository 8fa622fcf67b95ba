"""Every kind of bad input (DESIGN §4) through the command line: one line, exit code 2, no files.

What can be mended is mended with a counted warning instead, and exit code 0.
"""

import base64
import json
import struct
from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np
import pytest

from jaxvis import cli
from jaxvis.image import write_image

QUAD = "v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\n"
GOOD = f"{QUAD}f 1 3 2\nf 1 4 3\n"


pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")  # they would be more lines


@pytest.fixture(scope="module", autouse=True)
def own_caches(tmp_path_factory):
    """References and compiled programs of these tests stay out of the user's cache."""
    folder = tmp_path_factory.mktemp("cache")
    before = jax.config.values["jax_compilation_cache_dir"]
    jax.config.update("jax_compilation_cache_dir", str(folder / "xla"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JAXVIS_CACHE", str(folder))
        yield folder
    jax.config.update("jax_compilation_cache_dir", before)


def _good_mesh(folder: Path) -> Path:
    path = folder / "good.obj"
    path.write_text(GOOD)
    return path


def _good_light(folder: Path) -> Path:
    path = folder / "good.exr"
    write_image(path, np.ones((8, 16, 3), np.float32))
    return path


def _text(name: str, content: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        (folder / name).write_text(content)
        return folder / name

    return write


def _cut(name: str, content: Callable[[], bytes], share: float) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        data = content()
        (folder / name).write_bytes(data[: int(share * len(data))])
        return folder / name

    return write


def _radiance(name: str, change: Callable[[np.ndarray], None]) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        pixels = np.ones((16, 32, 3), np.float32)
        change(pixels)
        write_image(folder / name, pixels)
        return folder / name

    return write


def _cut_image(name: str, share: float) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        pixels = np.random.default_rng(0).uniform(0.1, 9.0, (32, 64, 3)).astype(np.float32)
        write_image(folder / name, pixels)
        data = (folder / name).read_bytes()
        (folder / name).write_bytes(data[: int(share * len(data))])
        return folder / name

    return write


def _ply() -> bytes:
    """The quad as a binary .ply."""
    header = (
        b"ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\n"
        b"property float y\nproperty float z\nelement face 2\n"
        b"property list uchar int vertex_indices\nend_header\n"
    )
    corners = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]], "<f4").tobytes()
    faces = b"".join(struct.pack("<Biii", 3, *face) for face in ((0, 2, 1), (0, 3, 2)))
    return header + corners + faces


def _glb(image: str | None = None) -> bytes:
    """The quad as a .glb, with a base-colour texture in another file if ``image`` names one."""
    corners = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]], "<f4")
    uvs = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], "<f4").tobytes()
    faces = np.array([0, 2, 1, 0, 3, 2], "<u2").tobytes()
    binary = corners.tobytes() + uvs + faces
    views = [(0, 48), (48, 32), (80, 12)]
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
            {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"},
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


def _set(index: tuple, value: float) -> Callable[[np.ndarray], None]:
    def change(pixels: np.ndarray) -> None:
        pixels[index] = value

    return change


def _half_negative(pixels: np.ndarray) -> None:
    pixels[::2] = -1.0


BAD_MESHES = {
    "missing": lambda folder: folder / "gone.obj",
    "missing folder": lambda folder: folder / "nowhere" / "gone.obj",
    "a folder": lambda folder: folder,
    "unknown format": _text("mesh.xyzw", "what is this"),
    "not what it says": _text("mesh.glb", GOOD),
    "truncated ply": _cut("cut.ply", _ply, 0.8),
    "truncated ply header": _cut("cut.ply", _ply, 0.2),
    "truncated glb": _cut("cut.glb", _glb, 0.9),
    "truncated glb header": _cut("cut.glb", _glb, 0.01),
    "empty file": _text("empty.obj", ""),
    "no faces": _text("points.obj", QUAD),
    "only zero-area faces": _text("flat.obj", f"{QUAD}f 1 1 2\n"),
    "face index out of range": _text("index.obj", f"{QUAD}f 1 2 9\n"),
    "NaN vertex": _text("nan.obj", GOOD.replace("v 1 0 1", "v nan 0 1")),
    "infinite vertex": _text("inf.obj", GOOD.replace("v 1 0 1", "v inf 0 1")),
    "not a height field": _text("terrain.npz", "no zip"),
}

BAD_LIGHTS = {
    "missing": lambda folder: folder / "gone.hdr",
    "unknown format": _text("light.xyzw", "what is this"),
    "not what it says": _text("light.hdr", "no picture"),
    "truncated hdr": _cut_image("cut.hdr", 0.6),
    "truncated exr": _cut_image("cut.exr", 0.6),
    "truncated pfm": _cut_image("cut.pfm", 0.6),
    "NaN radiance": _radiance("nan.exr", _set((3, 4, 1), np.nan)),
    "infinite radiance": _radiance("inf.exr", _set((3, 4, 1), np.inf)),
    "negative radiance": _radiance("negative.exr", _half_negative),
    "wrong aspect ratio": lambda folder: _shape(folder, (10, 31)),
}


def _shape(folder: Path, shape: tuple[int, int]) -> Path:
    write_image(folder / "aspect.exr", np.ones((*shape, 3), np.float32))
    return folder / "aspect.exr"


def _refused(capsys: pytest.CaptureFixture, out: Path, *arguments: str) -> str:
    """Runs the command line and checks how it refuses; returns the line."""
    assert cli.main([*arguments, "--out", str(out)]) == 2
    printed, errors = capsys.readouterr()
    assert printed == ""
    assert errors.startswith("jaxvis: ")
    assert errors.endswith("\n")
    assert errors.count("\n") == 1, errors
    assert "Traceback" not in errors
    assert "[Errno" not in errors
    assert not out.exists()
    return errors


@pytest.mark.parametrize("kind", BAD_MESHES)
def test_bad_mesh(kind, tmp_path, capsys):
    path = BAD_MESHES[kind](tmp_path)
    line = _refused(capsys, tmp_path / "out", "render", "mc-mis:spp=1", "--scene", str(path))
    assert path.name in line


@pytest.mark.parametrize("kind", BAD_LIGHTS)
def test_bad_light(kind, tmp_path, capsys):
    path = BAD_LIGHTS[kind](tmp_path)
    mesh = _good_mesh(tmp_path)
    line = _refused(
        *(capsys, tmp_path / "out", "render", "mc-mis:spp=1", "--scene", str(mesh)),
        *("--environment", str(path), "--size", "8", "6"),
    )
    assert path.name in line


@pytest.mark.parametrize("kind", ["NaN vertex", "truncated glb", "missing", "no faces"])
def test_info_says_that_a_mesh_is_unusable(kind, tmp_path, capsys):
    path = BAD_MESHES[kind](tmp_path)
    assert cli.main(["info", str(path)]) == 2
    errors = capsys.readouterr().err
    assert errors.count("\n") == 1
    assert path.name in errors


@pytest.mark.parametrize("kind", ["NaN radiance", "truncated hdr", "missing", "wrong aspect ratio"])
def test_info_says_that_a_light_is_unusable(kind, tmp_path, capsys):
    path = BAD_LIGHTS[kind](tmp_path)
    assert cli.main(["info", str(path)]) == 2
    errors = capsys.readouterr().err
    assert errors.count("\n") == 1
    assert path.name in errors


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--scene", "tepot"], "teapot"),
        (["--scene", "courtyard:triangels=9"], "triangels"),
        (["--scene", "courtyard:triangles=-1"], "triangles"),
        (["--environment", "skie"], "sky"),
        (["--environment", "sky:turbidity=-3"], "turbidity"),
        (["--environment", "sky:turbity=3"], "turbity"),
        (["--environment", "uniform:radiance=nan"], "radiance"),
        (["--size", "0", "10"], "size"),
        (["--size", "-4", "10"], "size"),
        (["--spp", "0"], "spp"),
        (["--seed", "-1"], "seed"),
        (["--supersampling", "0"], "supersampling"),
        (["--supersampling", "99"], "supersampling"),
        (["--reflectance", "velvet"], "velvet"),
        (["--fov", "200"], "field_of_view"),
        (["--fov", "nan"], "field_of_view"),
        (["--eye", "0", "nan", "0"], "eye"),
        (["--eye", "0", "900", "0.1", "--target", "0", "1000", "0"], "no pixel sees the scene"),
        (["--exposure", "0"], "exposure"),
        (["--rotate", "inf"], "rotate"),
        (["--camera", "gone.json"], "gone.json"),
    ],
)
def test_bad_option(arguments, named, tmp_path, capsys):
    line = _refused(
        *(capsys, tmp_path / "out", "render", "mc-mis", "--scene", "teapot", "--environment"),
        *("uniform", "--size", "8", "6", *arguments),
    )
    assert named in line


@pytest.mark.parametrize(
    ("method", "named"),
    [
        ("mc-miss", "mc-mis"),
        ("mc-mis:spp=0", "spp"),
        ("mc-mis:spp=many", "spp"),
        ("mc-mis:ssp=3", "ssp"),
        ("mc-mis:spp", "spp"),
        ("reference:error=-1", "error"),
    ],
)
@pytest.mark.parametrize("command", ["render", "precompute", "compare"])
def test_bad_method(command, method, named, tmp_path, capsys):
    given = ["--methods", method] if command == "compare" else [method]
    assert named in _refused(capsys, tmp_path / "out", command, *given)


def test_bad_reference(tmp_path, capsys):
    assert "truth" in _refused(capsys, tmp_path / "out", "compare", "--reference", "truth")


@pytest.mark.parametrize("text", ["{", "[1, 2]", '{"eye": [1, 2, 3]}'])
def test_bad_camera_file(text, tmp_path, capsys):
    path = _text("camera.json", text)(tmp_path)
    line = _refused(capsys, tmp_path / "out", "render", "mc-mis", "--camera", str(path))
    assert "camera.json" in line


@pytest.mark.parametrize("command", ["render", "precompute", "compare"])
def test_output_folder_below_a_file(command, tmp_path, capsys):
    (tmp_path / "file").write_text("mine")
    out = tmp_path / "file" / "out"
    given = ["--methods", "mc-mis"] if command == "compare" else ["mc-mis"]
    assert str(out) in _refused(capsys, out, command, *given)
    assert (tmp_path / "file").read_text() == "mine"


def test_output_folder_that_is_a_file(tmp_path, capsys):
    out = tmp_path / "file"
    out.write_text("mine")
    assert cli.main(["render", "mc-mis", "--out", str(out)]) == 2
    assert str(out) in capsys.readouterr().err
    assert out.read_text() == "mine"


def test_read_only_output_folder(tmp_path, capsys, monkeypatch):
    def refuse(*args, **kwargs):
        raise PermissionError(13, "Permission denied", str(tmp_path / "out"))

    monkeypatch.setattr("tempfile.mkdtemp", refuse)  # root may write anywhere
    line = _refused(capsys, tmp_path / "out", "render", "mc-mis")
    assert f"{tmp_path / 'out'}: cannot write to this folder (Permission denied)" in line


RENDER = ["render", "mc-mis:spp=1", "--environment", "uniform", "--size", "8", "6"]


@pytest.mark.parametrize(
    ("mesh", "counted"),
    [
        (f"{GOOD}f 1 1 2\nf 2 2 3\n", "2"),  # zero-area faces
        (f"{GOOD}v 0 1 0\nf 1 3 5\nf 3 1 5\n", None),  # four faces at an edge: not a manifold
    ],
    ids=["zero-area faces", "not a manifold"],
)
def test_meshes_that_are_mended_or_work(mesh, counted, tmp_path, capsys):
    path = _text("odd.obj", mesh)(tmp_path)
    out = tmp_path / "out"
    assert cli.main([*RENDER, "--scene", str(path), "--out", str(out)]) == 0
    errors = capsys.readouterr().err
    assert len(list(out.iterdir())) == 2
    if counted is None:
        assert errors == ""
    else:
        assert errors.startswith("jaxvis: warning: ")
        assert errors.count("\n") == 1
        assert counted in errors


def test_missing_texture(tmp_path, capsys):
    path = tmp_path / "textured.glb"
    path.write_bytes(_glb("gone.png"))
    line = _refused(capsys, tmp_path / "out", *RENDER, "--scene", str(path))
    assert "gone.png" in line


def test_embedded_texture_is_fine(tmp_path, capsys):
    write_image(tmp_path / "red.png", np.array([[[1.0, 0.0, 0.0]]], np.float32))
    data = base64.b64encode((tmp_path / "red.png").read_bytes()).decode()
    path = tmp_path / "textured.glb"
    path.write_bytes(_glb(f"data:image/png;base64,{data}"))
    assert cli.main([*RENDER, "--scene", str(path), "--out", str(tmp_path / "out")]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("damage", ["truncated", "another version"])
def test_a_bad_cache_entry_is_rebuilt_with_a_warning(damage, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("JAXVIS_CACHE", str(tmp_path / "cache"))
    mesh, light = _good_mesh(tmp_path), _good_light(tmp_path)
    command = [
        "compare",
        "--methods",
        "mc-mis:spp=1",
        "--size",
        "8",
        "6",
        "--reference",
        "reference",
    ]
    command += ["--scene", str(mesh), "--environment", str(light), "--out", str(tmp_path / "out")]
    assert cli.main(command) == 0
    (entry,) = (tmp_path / "cache" / "reference").iterdir()
    if damage == "truncated":
        entry.write_bytes(entry.read_bytes()[:100])
    else:
        with np.load(entry) as file:
            arrays = dict(file)
        arrays["header"] = np.array(json.dumps({"format": -1, "kind": "reference"}))
        np.savez(entry, **arrays)
    capsys.readouterr()
    assert cli.main(command) == 0
    errors = capsys.readouterr().err
    assert errors.startswith("jaxvis: warning: ")
    assert errors.count("\n") == 1
    assert entry.name in errors
    assert cli.main(command) == 0
    assert capsys.readouterr().err == ""
    assert json.loads((tmp_path / "out" / "results.json").read_text())["reference"]["from_cache"]
