"""Every kind of bad input (DESIGN §4) through the command line: one line, exit code 2, no files.

What can be mended is mended with a counted warning instead, and exit code 0.
"""

import base64
import json
from pathlib import Path

import numpy as np
import pytest

from jaxvis import cli
from jaxvis.cache import FORMAT
from jaxvis.image import write_image
from tests.bad_files import (
    BAD_LIGHTS,
    BAD_MESHES,
    GOOD,
    good_light,
    good_mesh,
    text_file,
    textured,
)

pytestmark = [
    pytest.mark.usefixtures("own_caches"),
    pytest.mark.filterwarnings("error::RuntimeWarning"),  # they would be more lines
]


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
    mesh = good_mesh(tmp_path)
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
        (["--lamp", "0", "1", "0", "0", "5"], "radius must be positive"),
        (["--lamp", "0", "nan", "0", "1", "5"], "position must be finite"),
        (["--lamp", "0", "1", "0", "1", "-5"], "radiance must be finite and >= 0"),
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
    path = text_file("camera.json", text)(tmp_path)
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
        (f"{GOOD}f 1 1 2\nf 2 2 3\n", "2"),
        (f"{GOOD}v 0 -1 0\nf 1 3 5\nf 3 1 5\n", None),  # four faces at an edge
        ("v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nf 1 3 2\nf 1 4 3\n", None),
    ],
    ids=["zero-area faces", "not a manifold", "a flat square"],
)
def test_meshes_that_are_mended_or_work(mesh, counted, tmp_path, capsys):
    path = text_file("odd.obj", mesh)(tmp_path)
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


def test_embedded_texture_is_fine(tmp_path, capsys):
    write_image(tmp_path / "red.png", np.array([[[1.0, 0.0, 0.0]]], np.float32))
    data = base64.b64encode((tmp_path / "red.png").read_bytes()).decode()
    path = textured(tmp_path, f"data:image/png;base64,{data}")
    assert cli.main([*RENDER, "--scene", str(path), "--out", str(tmp_path / "out")]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("damage", ["truncated", "another kind"])
def test_a_bad_cache_entry_is_rebuilt_with_a_warning(damage, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("JAXVIS_CACHE", str(tmp_path / "cache"))
    mesh, light = good_mesh(tmp_path), good_light(tmp_path)
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
        arrays["header"] = np.array(json.dumps({"format": FORMAT, "kind": "another"}))
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
