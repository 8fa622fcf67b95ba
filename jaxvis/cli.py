"""The command line: ``jaxvis compare|render|precompute|sweep|view|info|methods`` (DESIGN §5).

Exit codes: 0 done, 1 a method failed in a comparison, 2 bad input or usage, 130 interrupted.
Nothing heavy is imported before it is needed, so that ``jaxvis --help`` answers at once.
"""

import argparse
import contextlib
import importlib.metadata
import math
import os
import sys
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from jaxvis import specs
from jaxvis.errors import JaxvisWarning
from jaxvis.importing import uncollected_imports

if TYPE_CHECKING:
    from jaxvis.compare import Setting
    from jaxvis.lighting import SphereLights
    from jaxvis.scene import Camera, Scene

SCENE, ENVIRONMENT, SIZE, OUT = "teapot", "windows", (256, 192), "jaxvis-out"
REFERENCE = "reference:error=0.01"
LIGHT_FILES = (".hdr", ".exr", ".pfm")


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command and returns its exit code."""
    try:
        options = _parser().parse_args(arguments)
    except SystemExit as stop:
        return int(stop.code or 0)
    try:
        with _warnings_in_one_line():
            return options.run(options)
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:  # the reader of our output has gone, as in `jaxvis methods | head -1`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (ValueError, OSError, ModuleNotFoundError) as error:
        if options.debug:
            raise
        print(f"jaxvis: {_one_line(error)}", file=sys.stderr)
        return 2


def _compare(options: argparse.Namespace) -> int:
    with uncollected_imports():
        from jaxvis.compare import choose_methods, compare, output_folder
        from jaxvis.report import correspondence_sections, has_correspondence, plain, write_report

    with output_folder(options.out) as folder:
        # A wrong name shows before a scene is loaded.
        chosen = choose_methods(options.methods, options.spp)
        if options.triangle is not None and not any(map(has_correspondence, chosen.values())):
            raise ValueError("--triangle draws `correspondence`: name it in --methods")
        scene, camera = _scene_and_camera(options)
        comparison = compare(
            scene,
            options.environment,
            options.methods,
            options.size,
            spp=options.spp,
            seed=options.seed,
            camera=camera,
            reflectance=options.reflectance,
            albedo=options.albedo,
            supersampling=options.supersampling,
            rotate=math.radians(options.rotate),
            spheres=_lamps(options),
            reference=options.reference,
            exposure=options.exposure,
            stop_on_error=options.debug,
        )
        comparison.save(folder)
        failed = {row["label"] for row in comparison.failed}
        shown = {label: method for label, method in chosen.items() if label not in failed}
        sections = correspondence_sections(
            shown, lambda: _setting(options, scene, camera), options.triangle
        )
        page = write_report(comparison, folder, sections)
    print(f"{plain(comparison)}\n\n{Path(options.out) / page.name}")
    return 1 if comparison.failed else 0


def _render(options: argparse.Namespace) -> int:
    with uncollected_imports():
        from jaxvis.compare import file_stem, output_folder, render
        from jaxvis.image import write_image
        from jaxvis.methods import create

    if options.frames is not None:
        return _render_frames(options)
    if options.frame_step != 1:
        raise ValueError("--frame-step needs --frames, as in --frames 0:60")
    with output_folder(options.out) as folder:
        method = create(options.method, spp=options.spp)
        setting = _setting(options, *_scene_and_camera(options))
        picture = render(method, setting, seed=options.seed, exposure=options.exposure)
        names = [f"{file_stem(options.method)}{suffix}" for suffix in (".exr", ".png")]
        for name, pixels in zip(names, (picture.radiance, picture.shown), strict=True):
            write_image(folder / name, pixels)
    for name in names:
        print(Path(options.out) / name)
    return 0


def _render_frames(options: argparse.Namespace) -> int:
    from jaxvis.compare import file_stem, frame_range, output_folder, render_frames
    from jaxvis.methods import create
    from jaxvis.scene import load_animation

    # Wrong ranges and names show before a scene is loaded.
    frames = frame_range(options.frames, options.frame_step)
    method = create(options.method, spp=options.spp)
    with output_folder(options.out) as folder:
        animation = load_animation(options.scene, two_sided=options.two_sided)
        names = render_frames(
            method,
            animation,
            frames,
            folder,
            file_stem(options.method),
            options.environment,
            options.size,
            camera=_camera(options, animation.base),
            reflectance=options.reflectance,
            albedo=options.albedo,
            supersampling=options.supersampling,
            rotate=math.radians(options.rotate),
            spheres=_lamps(options),
            seed=options.seed,
            exposure=options.exposure,
        )
    for name in names:
        print(Path(options.out) / name)
    return 0


def _precompute(options: argparse.Namespace) -> int:
    with uncollected_imports():
        from jaxvis.cluster import on_cluster
        from jaxvis.compare import file_stem, output_folder, use_compilation_cache
        from jaxvis.methods import create
        from jaxvis.report import numbers

    use_compilation_cache()
    with output_folder(options.out) as folder:
        method = create(options.method, spp=options.spp)
        scene, _ = _scene_and_camera(options)
        with contextlib.ExitStack() as stack:
            if options.workers is not None or options.scheduler is not None:
                stack.enter_context(on_cluster(options.scheduler, workers=options.workers))
            visibility = method.precompute(scene, progress=sys.stderr.isatty())
        name = f"{file_stem(options.method)}.npz"
        visibility.save(folder / name)
    print(f"{Path(options.out) / name} ({numbers.memory(visibility.nbytes)} in memory)")
    return 0


def _sweep(options: argparse.Namespace) -> int:
    from jaxvis.workers import start_importing

    if options.scheduler is None and options.workers != 0:
        start_importing()  # while this process imports, too
    with uncollected_imports():
        from jaxvis.sweep import read_grid, run_grid

    grid = read_grid(options.grid)
    frame = run_grid(
        grid,
        options.out,
        workers=options.workers,
        scheduler=options.scheduler,
        images=options.images,
        retry=options.retry,
    )
    shown = ["scene", "environment", "rotate", "method", "seed", "psnr_db", "frame_s"]
    print(frame[shown].to_string(index=False, na_rep="-"))
    failed: Any = frame[frame["error"].notna()]
    for values in failed[["scene", "environment", "method", "error"]].values.tolist():
        print(f"jaxvis: failed: {': '.join(map(str, values))}", file=sys.stderr)
    print(f"\n{Path(options.out) / 'table.csv'}")
    return 1 if len(failed) else 0


def _view(options: argparse.Namespace) -> int:
    with uncollected_imports():
        from jaxvis.lighting import load_environment
        from jaxvis.scene import load_scene
        from jaxvis.view import App

    scene = load_scene(options.scene)
    if options.reflectance is not None:
        from jaxvis.reflectance import reflectance_by_name

        scene = scene.with_reflectance(reflectance_by_name(options.reflectance))
    environment = load_environment(options.environment)
    app = App(
        scene,
        environment,
        options.method,
        height=options.height,
        host=options.host,
        port=options.port,
    )
    print(f"{app.url} (Ctrl+C ends it)", flush=True)
    try:
        app.wait()
    except KeyboardInterrupt:
        pass
    finally:
        app.stop()
    return 0


def _info(options: argparse.Namespace) -> int:
    from jaxvis import datasets
    from jaxvis.lighting import environment_info
    from jaxvis.scene import scene_info

    source = options.file
    if source not in datasets.names("probe") and not _names_a_light(source):
        print(scene_info(source))
        return 0
    facts = environment_info(source)
    problem = facts.pop("problem", None)
    notes = facts.pop("warnings", [])
    usable = "usable" if facts.pop("usable") else "not usable"
    print(f"{facts.pop('name')}: {usable} as an environment")
    for key, value in facts.items():
        print(f"  {key.replace('_', ' ')}: {_fact(value)}")
    for note in notes:
        print(f"  note: {note}")
    if problem is not None:
        raise ValueError(problem)
    return 0


def _names_a_light(source: str) -> bool:
    from jaxvis.lighting import BUILTIN

    path = Path(source)
    return specs.name_of(source) in BUILTIN or path.suffix.lower() in LIGHT_FILES or path.is_dir()


def _fact(value: Any) -> str:
    """A value of an info dictionary as text: a list is a size."""
    if isinstance(value, float):
        return f"{value:.6g}"
    return " x ".join(map(str, value)) if isinstance(value, list) else str(value)


def _methods(options: argparse.Namespace) -> int:
    with uncollected_imports():
        from jaxvis import methods
        from jaxvis.methods.denoised import SUFFIX

    for entry in methods.table():
        mark = " *" if entry.representative else ""
        settings = (entry.representative or entry.name).removeprefix(entry.name).lstrip(":")
        print(f"{entry.name}{mark}{settings and f' with {settings}'}\n    {entry.summary}")
        if entry.defaults():
            print("    " + ", ".join(f"{k}={v}" for k, v in entry.defaults().items()))
    print("\n* run by `jaxvis compare` unless --methods names others")
    print(
        f"{SUFFIX} after the name of a method that takes samples (mc-mis+denoise:spp=4) "
        "removes the noise with\n  Open Image Denoise, by albedo and normal: pip install "
        '"jaxvis[denoise]"'
    )
    return 0


def _scene_and_camera(options: argparse.Namespace) -> tuple["Scene", "Camera | None"]:
    """The scene, and a camera if any option asks for another than the scene's."""
    from jaxvis.scene import load_scene

    scene = load_scene(options.scene, two_sided=options.two_sided)
    return scene, _camera(options, scene)


def _camera(options: argparse.Namespace, scene: "Scene") -> "Camera | None":
    """A camera if any option asks for another than the scene's."""
    from jaxvis.compare import checked_size, read_camera
    from jaxvis.scene import default_camera

    camera = None if options.camera is None else read_camera(options.camera)
    changes: dict[str, Any] = {}
    for name in ("eye", "target"):
        if getattr(options, name) is not None:
            changes[name] = tuple(getattr(options, name))
    if options.fov is not None:
        changes["field_of_view"] = math.radians(options.fov)
    if changes:
        width, height = checked_size(options.size)
        base = camera or scene.camera or default_camera(scene, aspect=width / height)
        camera = replace(base, **changes)
    return camera


def _setting(options: argparse.Namespace, scene: "Scene", camera: "Camera | None") -> "Setting":
    from jaxvis.compare import prepare

    return prepare(
        scene,
        options.environment,
        options.size,
        camera=camera,
        reflectance=options.reflectance,
        albedo=options.albedo,
        supersampling=options.supersampling,
        rotate=math.radians(options.rotate),
        spheres=_lamps(options),
    )


def _lamps(options: argparse.Namespace) -> "SphereLights | None":
    from jaxvis.lighting import SphereLights

    if options.lamp is None:
        return None
    lamps = [(lamp[:3], lamp[3], lamp[4:] * 3) for lamp in options.lamp]
    return SphereLights.of(*(list(column) for column in zip(*lamps, strict=True)))


class _Parser(argparse.ArgumentParser):
    """An ArgumentParser that reports wrong usage in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"jaxvis: {message} (see `{self.prog} --help`)\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="jaxvis",
        description="Environment lighting with precomputed and sampled visibility.",
        allow_abbrev=False,
    )
    version = importlib.metadata.version("jaxvis")
    parser.add_argument("--version", action="version", version=f"jaxvis {version}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    compare = _command(commands, "compare", _compare, "run methods side by side and write a report")
    compare.add_argument(
        "--methods",
        metavar="A,B,...",
        help="names as `jaxvis methods` lists them, with parameters as in mc-mis:spp=16, or all; "
        "by default one of each family",
    )
    compare.add_argument(
        "--reference",
        metavar="METHOD",
        default=REFERENCE,
        help=f"what the others are measured against (default {REFERENCE})",
    )
    compare.add_argument(
        "--triangle",
        type=int,
        metavar="N",
        help="draw the entity layout and Voronoi diagram of this triangle for `correspondence`",
    )
    _common_options(compare)
    render = _command(commands, "render", _render, "one method: DIR/METHOD.exr and .png")
    render.add_argument("method", metavar="METHOD")
    render.add_argument(
        "--frames",
        metavar="A:B",
        help="frames A to B - 1 of a scene that moves: DIR/METHOD_0000.png and so on, and all of "
        "them as DIR/METHOD.webp",
    )
    render.add_argument(
        "--frame-step", type=int, default=1, metavar="N", help="every Nth of them (default 1)"
    )
    _common_options(render)
    precompute = _command(
        commands, "precompute", _precompute, "a method's visibility: DIR/METHOD.npz"
    )
    precompute.add_argument("method", metavar="METHOD")
    _common_options(precompute)
    _cluster_options(
        precompute, "share it out among processes of one core each (default: this process alone)"
    )
    sweep = _command(
        commands, "sweep", _sweep, "every combination in a TOML file, resumed where it stopped"
    )
    sweep.add_argument("grid", metavar="GRID.toml")
    sweep.add_argument(
        "--out", help=f"folder to keep rows in (default {OUT})", default=OUT, metavar="DIR"
    )
    _cluster_options(
        sweep, "processes of one core each (default: as many as cores); 0: this process, all cores"
    )
    sweep.add_argument("--images", action="store_true", help="keep those of all rows, too")
    sweep.add_argument("--retry", action="store_true", help="run rows that failed again")
    view = _command(commands, "view", _view, "orbit a scene and turn its light in the browser")
    for name, summary, default in (
        ("scene", "built-in name, data set or mesh file", SCENE),
        ("environment", "built-in name, data set or .hdr, .exr, .pfm file", ENVIRONMENT),
        ("method", "to begin with", "correspondence"),
        ("host", "where the server listens", "127.0.0.1"),
    ):
        view.add_argument(f"--{name}", help=f"{summary} (default {default})", default=default)
    view.add_argument("--height", help="of the images (default 256)", type=int, default=256)
    view.add_argument("--port", help="of the server (default 8080)", type=int, default=8080)
    view.add_argument("--reflectance", help="replaces the scene's model")
    info = _command(commands, "info", _info, "what a mesh or light-probe file holds")
    info.add_argument("file", metavar="FILE")
    _command(commands, "methods", _methods, "names, parameters with defaults, one line each")
    return parser


def _command(commands: Any, name: str, run: Any, summary: str) -> argparse.ArgumentParser:
    command = commands.add_parser(name, help=summary, description=summary, allow_abbrev=False)
    command.set_defaults(run=run)
    command.add_argument(
        "--debug", action="store_true", help="stop at the first error and show its traceback"
    )
    return command


def _cluster_options(parser: argparse.ArgumentParser, workers: str) -> None:
    parser.add_argument("--workers", type=int, metavar="N", help=workers)
    parser.add_argument("--scheduler", metavar="ADDRESS", help="a Dask cluster: tcp://HOST:PORT")


def _common_options(parser: argparse.ArgumentParser) -> None:
    def add(name: str, summary: str, **settings: Any) -> None:
        parser.add_argument(name, help=summary, **settings)

    add("--scene", f"built-in name, data set or mesh file (default {SCENE})", default=SCENE)
    add(
        "--environment",
        f"built-in name, data set or .hdr, .exr, .pfm file (default {ENVIRONMENT})",
        default=ENVIRONMENT,
    )
    size = {"nargs": 2, "type": int, "metavar": ("W", "H"), "default": SIZE}
    add("--size", f"pixels (default {SIZE[0]} {SIZE[1]})", **size)
    add("--supersampling", "camera rays per pixel along each axis", type=int, default=1)
    add("--spp", "samples per pixel of methods that sample", type=int)
    add("--seed", "of everything random (default 0)", type=int, default=0)
    add("--out", f"folder to write to (default {OUT})", default=OUT, metavar="DIR")
    vector = {"nargs": 3, "type": float, "metavar": ("X", "Y", "Z")}
    add("--camera", "JSON file with a camera, such as a results.json", metavar="FILE")
    add("--eye", "where the camera is, world coordinates", **vector)
    add("--target", "what it looks at", **vector)
    add("--fov", "vertical field of view", type=float, metavar="DEGREES")
    add("--reflectance", "lambert, phong, blinn-phong, ggx or beckmann; by default the scene's")
    add("--albedo", "makes all materials one diffuse grey, in [0, 1]", type=float)
    add("--rotate", "turns the environment about +Y", type=float, metavar="DEGREES", default=0.0)
    lamp = {"nargs": 5, "type": float, "metavar": ("X", "Y", "Z", "RADIUS", "RADIANCE")}
    add("--lamp", "a sphere that shines (world coordinates); repeatable", action="append", **lamp)
    add("--exposure", "of the .png images (default: automatic)", type=float)
    add(
        "--two-sided",
        "make all materials two-sided, or none; by default as the file says",
        action=argparse.BooleanOptionalAction,
    )


def _one_line(error: BaseException) -> str:
    """The message of an error in one line, with the file that an operating system's error names."""
    if isinstance(error, OSError) and error.strerror:
        text = f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    else:
        text = str(error) or type(error).__name__
    return " ".join(text.split())


@contextlib.contextmanager
def _warnings_in_one_line() -> Iterator[None]:
    """Shows each JaxvisWarning once, as one line; other warnings as ever."""
    shown: set[str] = set()
    with warnings.catch_warnings():
        ordinary = warnings.showwarning

        def show(message: Any, category: Any, *rest: Any, **named: Any) -> None:
            if not issubclass(category, JaxvisWarning):
                ordinary(message, category, *rest, **named)
            elif str(message) not in shown:
                shown.add(str(message))
                print(f"jaxvis: warning: {' '.join(str(message).split())}", file=sys.stderr)

        warnings.showwarning = show
        warnings.simplefilter("always", JaxvisWarning)
        yield


if __name__ == "__main__":
    sys.exit(main())
