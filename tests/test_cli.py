"""The command line: files, exit codes, and what it prints."""

import json
import os
import subprocess
import sys
import warnings

import numpy as np
import pytest

from jaxvis import cli
from jaxvis.errors import JaxvisWarning
from jaxvis.image import read_image
from jaxvis.scene import Camera

pytestmark = pytest.mark.usefixtures("own_caches")

SMALL = ["--scene", "sphere-on-plane", "--environment", "uniform", "--size", "16", "12"]
COMPARE = ["compare", *SMALL, "--reference", "reference"]


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    out = tmp_path_factory.mktemp("compared") / "out"
    code = cli.main([*COMPARE, "--methods", "mc-mis:spp=4,mc-mis:spp=1", "--out", str(out)])
    return code, out


def test_compare_writes_everything(compared):
    code, out = compared
    assert code == 0
    results = json.loads((out / "results.json").read_text(), parse_constant=pytest.fail)
    assert [row["label"] for row in results["results"]] == ["mc-mis:spp=4", "mc-mis:spp=1"]
    names = {path.name for path in out.iterdir()}
    for row in results["results"]:
        assert {row["image"], row["png"]} <= names
    assert {"index.html", "results.md", "results.csv", "reference.exr", "coverage.exr"} <= names
    assert not any(name.startswith(".") for name in names)
    assert results["size"] == [16, 12]


def test_compare_prints_a_table_and_the_page(capsys, tmp_path):
    out = tmp_path / "out"
    assert cli.main([*COMPARE, "--methods", "mc-mis", "--spp", "1", "--out", str(out)]) == 0
    printed, errors = capsys.readouterr()
    lines = printed.strip().splitlines()
    assert lines[0].startswith("method")
    assert lines[1].startswith("mc-mis")
    assert lines[-1] == str(out / "index.html")
    assert errors == ""  # quiet: not a terminal
    assert json.loads((out / "results.json").read_text())["results"][0]["parameters"]["spp"] == 1


def test_bars_show_on_a_terminal(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    assert cli.main([*COMPARE, "--methods", "mc-mis:spp=1", "--out", str(tmp_path)]) == 0
    errors = capsys.readouterr().err
    for words in ("reference", "mc-mis:spp=1: shade", "report"):
        assert words in errors, words


def test_render(capsys, tmp_path):
    command = ["render", "mc-mis:spp=1", *SMALL, "--out", str(tmp_path)]
    grey = ["--albedo", "0.5", "--reflectance", "phong"]
    assert cli.main([*command, *grey, "--exposure", "0.5"]) == 0
    assert capsys.readouterr().out.split() == [
        str(tmp_path / "mc-mis-spp-1.exr"),
        str(tmp_path / "mc-mis-spp-1.png"),
    ]
    assert read_image(tmp_path / "mc-mis-spp-1.exr").shape == (12, 16, 3)
    assert read_image(tmp_path / "mc-mis-spp-1.png").shape == (12, 16, 3)


LAMPS = ["--lamp", "0.4", "3", "-1", "0.2", "60", "--lamp", "-2", "2.5", "0.5", "0.1", "40"]


def test_lamps_light_and_are_written_down(tmp_path):
    command = [*COMPARE, "--methods", "mc-mis:spp=4,vectorized", *LAMPS, "--out", str(tmp_path)]
    assert cli.main(command) == 1  # vectorized knows no lamps; the rest goes on
    results = json.loads((tmp_path / "results.json").read_text())
    assert results["lamps"] == [
        {"position": [0.4, 3.0, -1.0], "radius": 0.2, "radiance": [60.0] * 3},
        {"position": [-2.0, 2.5, 0.5], "radius": 0.1, "radiance": [40.0] * 3},
    ]
    lit, refused = results["results"]
    assert "error" not in lit
    assert lit["psnr_db"] > 15.0
    assert "no local lights" in refused["error"]
    assert "use reference, mc-*," in refused["error"]
    page = (tmp_path / "index.html").read_text()
    assert "position -2, 2.5, 0.5, radius 0.1, radiance 40, 40, 40" in page


def test_lamps_brighten_a_rendered_picture(tmp_path):
    pictures = []
    for options in ([], LAMPS):
        command = ["render", "mc-mis:spp=4", *SMALL, *options, "--out", str(tmp_path)]
        assert cli.main(command) == 0
        pictures.append(read_image(tmp_path / "mc-mis-spp-4.exr"))
    assert np.all(pictures[1] >= pictures[0])
    assert pictures[1].mean() > 1.02 * pictures[0].mean()


def test_methods_without_lamps_refuse_them_before_they_precompute(capsys, monkeypatch, tmp_path):
    from jaxvis.methods import VectorizedVisibility

    monkeypatch.setattr(VectorizedVisibility, "precompute", lambda *a, **k: pytest.fail("late"))
    command = ["render", "vectorized", *SMALL, *LAMPS, "--out", str(tmp_path / "out")]
    assert cli.main(command) == 2
    errors = capsys.readouterr().err
    assert errors.startswith("jaxvis: VectorizedVisibility has no local lights")
    assert errors.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_render_frames(capsys, tmp_path):
    command = ["render", "mc-mis:spp=1", "--scene", "balls:detail=16", "--environment", "uniform"]
    command += ["--size", "16", "12", "--out", str(tmp_path / "out"), *LAMPS]
    assert cli.main([*command, "--frames", "2:7", "--frame-step", "3"]) == 0
    names = ["mc-mis-spp-1_0002.png", "mc-mis-spp-1_0005.png", "mc-mis-spp-1.webp"]
    assert capsys.readouterr().out.split() == [str(tmp_path / "out" / name) for name in names]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(names)
    assert read_image(tmp_path / "out" / names[1]).shape == (12, 16, 3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--frames", "7"], "frames must be A:B"),
        (["--frames", "5:5"], "frames '5:5' are none"),
        (["--frames", "0:9", "--frame-step", "0"], "frame step must be at least 1"),
        (["--frames", "0:9999"], "scene 'balls' has frames 0 to 239, got 9998"),
        (["--frames", "0:9", "--scene", "plane"], "scene 'plane' does not move"),
        (["--frames", "0:9", "--scene", "balls:frame=1"], "leave out frame="),
        (["--frame-step", "2"], "--frame-step needs --frames"),
    ],
)
def test_render_refuses_frames_in_one_line(capsys, tmp_path, options, message):
    out = tmp_path / "none"
    command = ["render", "mc-mis:spp=1", "--scene", "balls:detail=16", "--out", str(out)]
    assert cli.main([*command, *options]) == 2
    errors = capsys.readouterr().err
    assert errors.startswith("jaxvis: ")
    assert errors.count("\n") == 1
    assert message in errors
    assert not out.exists()


def test_precompute_writes_what_load_reads(tmp_path):
    from jaxvis.methods.traced import RayVisibility

    assert (
        cli.main(["precompute", "mc-mis", "--scene", "sphere-on-plane", "--out", str(tmp_path)])
        == 0
    )
    assert [path.name for path in tmp_path.iterdir()] == ["mc-mis.npz"]
    assert RayVisibility.load(tmp_path / "mc-mis.npz").nbytes > 1000


def test_methods_lists_every_name_with_its_defaults(capsys):
    from jaxvis import methods

    assert cli.main(["methods"]) == 0
    printed = capsys.readouterr().out
    for name in methods.names():
        assert f"\n{name}" in f"\n{printed}"
    assert "spp=64" in printed
    for spec in methods.representatives():
        name, _, settings = spec.partition(":")
        assert f"{name} *" in printed
        assert settings in printed


def test_info_of_a_light_and_a_scene(capsys):
    assert cli.main(["info", "windows"]) == 0
    printed = capsys.readouterr().out
    assert "maximum" in printed
    assert "dynamic range" in printed
    assert cli.main(["info", "teapot"]) == 0
    assert "triangles" in capsys.readouterr().out


def test_camera_options(tmp_path):
    parser = cli._parser()
    options = parser.parse_args(
        ["render", "mc-mis", *SMALL, "--eye", "1", "-2", "3.5", "--fov", "30"]
    )
    _scene, camera = cli._scene_and_camera(options)
    assert camera.eye == (1.0, -2.0, 3.5)
    assert camera.field_of_view == pytest.approx(np.pi / 6)
    _plain, none = cli._scene_and_camera(parser.parse_args(["render", "mc-mis", *SMALL]))
    assert none is None
    file = tmp_path / "camera.json"
    file.write_text('{"eye": [1, 2, 3], "target": [0, 0, 0]}')
    options = parser.parse_args(
        ["render", "mc-mis", *SMALL, "--camera", str(file), "--target", "0", "1", "0"]
    )
    assert cli._scene_and_camera(options)[1] == Camera((1.0, 2.0, 3.0), (0.0, 1.0, 0.0))


def test_a_results_file_gives_its_camera_back(compared, tmp_path):
    _, out = compared
    command = [*COMPARE, "--methods", "mc-mis:spp=1", "--out", str(tmp_path)]
    assert cli.main([*command, "--camera", str(out / "results.json")]) == 0
    again = json.loads((tmp_path / "results.json").read_text())
    first = json.loads((out / "results.json").read_text())
    assert again["camera"] == first["camera"]
    assert again["reference"]["from_cache"]


def test_a_failed_method_gives_exit_code_1_and_a_report(capsys, monkeypatch, tmp_path):
    from jaxvis.methods import MonteCarlo

    def refuse(self, scene, progress=True):
        raise ValueError("overflow: raise polygons above 64")

    monkeypatch.setattr(MonteCarlo, "precompute", refuse)
    assert cli.main([*COMPARE, "--methods", "mc-mis", "--out", str(tmp_path)]) == 1
    assert "raise polygons above 64" in capsys.readouterr().out
    assert "raise polygons above 64" in (tmp_path / "index.html").read_text()
    # A command that has nothing else to do stops with that line.
    assert cli.main(["render", "mc-mis", *SMALL, "--out", str(tmp_path / "other")]) == 2
    assert capsys.readouterr().err == "jaxvis: overflow: raise polygons above 64\n"
    assert not (tmp_path / "other").exists()
    with pytest.raises(ValueError, match="overflow"):
        cli.main(["render", "mc-mis", *SMALL, "--debug", "--out", str(tmp_path / "other")])


def test_bugs_are_seen(monkeypatch, tmp_path):
    from jaxvis.methods import MonteCarlo

    def crash(self, scene, progress=True):
        raise TypeError("a bug")

    monkeypatch.setattr(MonteCarlo, "precompute", crash)
    with pytest.raises(TypeError, match="a bug"):
        cli.main(["render", "mc-mis", *SMALL, "--out", str(tmp_path / "out")])
    assert not (tmp_path / "out").exists()


def test_interruption_is_quiet_and_leaves_nothing(capsys, monkeypatch, tmp_path):
    from jaxvis.methods import MonteCarlo

    def interrupt(self, scene, progress=True):
        raise KeyboardInterrupt

    monkeypatch.setattr(MonteCarlo, "precompute", interrupt)
    command = [*COMPARE, "--methods", "mc-mis", "--out", str(tmp_path / "out")]
    assert cli.main(command) == 130
    assert capsys.readouterr().err == ""
    assert not (tmp_path / "out").exists()


def test_warnings_are_one_line_each_and_said_once(capsys):
    with cli._warnings_in_one_line():
        for _ in range(2):
            warnings.warn("3 faces\nwere dropped", JaxvisWarning, stacklevel=1)
        warnings.warn("4 more", JaxvisWarning, stacklevel=1)
    assert capsys.readouterr().err == (
        "jaxvis: warning: 3 faces were dropped\njaxvis: warning: 4 more\n"
    )


@pytest.mark.parametrize("arguments", [["--help"], ["compare", "--help"], ["--version"]])
def test_help(arguments, capsys):
    assert cli.main(arguments) == 0
    assert capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ([], "COMMAND"),
        (["paint"], "paint"),
        (["compare", "--colour", "red"], "--colour red"),
        (["compare", "--size", "12"], "--size"),
        (["compare", "--size", "12", "x"], "--size"),
        (["compare", "--spp", "many"], "many"),
        (["render"], "METHOD"),
        (["info"], "FILE"),
        (["methods", "more"], "more"),
    ],
)
def test_wrong_usage_is_one_line_and_exit_code_2(arguments, named, capsys):
    assert cli.main(arguments) == 2
    printed, errors = capsys.readouterr()
    assert printed == ""
    assert errors.startswith("jaxvis: ")
    assert errors.count("\n") == 1
    assert named in errors


def _run(*arguments: str, **environment: str) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, "-m", "jaxvis.cli", *arguments],
        capture_output=True,
        text=True,
        env={**os.environ, **environment},
        check=False,
    )


@pytest.mark.parametrize(
    ("run", "heavy"),
    [
        (
            "from jaxvis import cli; cli.main(['--help'])",
            "jax trimesh matplotlib pandas embreex tqdm",
        ),
        # Each worker process of a sweep waits for these as well.
        (
            "import jaxvis.sweep.work",
            "OpenImageIO trimesh networkx pandas matplotlib scipy.sparse scipy.spatial scipy.fft",
        ),
    ],
)
def test_only_what_is_needed_is_imported(run, heavy):
    code = f"import sys; {run}; print([m for m in {heavy.split()} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_a_real_process_renders_and_keeps_its_compiled_programs(tmp_path):
    cache = tmp_path / "cache"
    done = _run(
        *("render", "mc-mis:spp=1", *SMALL, "--out", str(tmp_path / "out")), JAXVIS_CACHE=str(cache)
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert list((cache / "xla").iterdir())


def test_a_real_process_reports_bad_input_in_one_line(tmp_path):
    missing = tmp_path / "gone.obj"
    done = _run("render", "mc-mis", "--scene", str(missing), "--out", str(tmp_path / "out"))
    assert done.returncode == 2
    assert done.stderr.startswith("jaxvis: ")
    assert done.stderr.count("\n") == 1
    assert "gone.obj" in done.stderr
    assert done.stdout == ""
    assert not list(tmp_path.iterdir())


def test_defaults_are_those_of_the_function():
    """They are written twice, so that the help needs no import."""
    import inspect

    from jaxvis.compare import compare

    parameters = inspect.signature(compare).parameters
    options = cli._parser().parse_args(["compare"])
    for name in ("scene", "environment", "size", "reference", "seed", "spp", "supersampling"):
        assert getattr(options, name) == parameters[name].default, name
    for name in ("methods", "camera", "reflectance", "albedo", "exposure", "two_sided", "rotate"):
        assert getattr(options, name) == parameters[name].default, name
