"""What hybrid cone tracing saves and costs beside voxel cone tracing (paper 003).

``--what`` says which tables:

- ``memory`` (table 2): bytes of the lit maps, counted from the arrays that are allocated, with the
  error of each beside them. Both methods keep the same formats: of the 3D lightmap six directional
  faces of RGBA in 16-bit floats (radiance premultiplied by opacity), all levels; of the 2D lightmap
  RGB in 16-bit floats and a 16-bit height, all levels.
- ``quality`` (figs. 6 to 8): images with one bounce against the ray-traced reference.
- ``sweeps``: sizes of the maps, cones, aperture, stepping and search.
- ``leaks``: light within a closed room of thin walls, and below a slab and a bridge.
- ``stages`` (section VII's times): what each stage takes, both methods side by side.
- ``growth``: time and memory of larger images, and of the largest terrain's voxelisation.

Tables are Markdown; ``--out`` also writes pictures of ``quality``: reference, hybrid and voxels,
whole and then indirect light alone.
"""

import argparse
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import get_args

import jax

from experiments.adaptive_runs import markdown, write_strip
from experiments.cone_runs import (
    Lit,
    Row,
    Truth,
    hybrid_of,
    isotropic_bytes,
    name_of,
    sparse_bytes,
    table_bytes,
    voxel_of,
)
from experiments.cone_stages import growth_rows, large_rows, leak_rows, stage_rows, timed
from jaxvis.compare.setting import Setting, prepare
from jaxvis.methods import HybridCones
from jaxvis.methods.cones.march import Stepping

PAPER = {"hybrid 128³ + 2048²": 117.0, "voxel 256³": 896.0}
"""Megabytes of table 2, formats unknown."""

CONES = (4, 6, 8, 12)
APERTURES = (30.0, 45.0, 60.0, 75.0)
"""Degrees."""

SEARCHES: tuple[dict[str, str], ...] = (
    {"search": "horizon"},
    {"search": "cells"},
    {"search": "cells", "ranges": "hsat"},
    {"search": "cells", "accumulation": "paper"},
    {"search": "cells", "fit": "paper", "accumulation": "paper", "ranges": "hsat"},
)
"""The last is the paper's own."""

COMPARED = ("RMSE %", "FLIP", "indirect RMSE %")


def memory_rows(setting: Setting, options: argparse.Namespace) -> Iterator[Row]:
    """Table 2. The first voxel size is what the others are compared with."""
    truth = Truth.of(setting, options.error, options.rays)
    baseline = None
    methods = [*map(voxel_of, options.voxel), *map(hybrid_of, options.hybrids)]
    for method in methods:
        lit = Lit.of(method, setting)
        maps, errors = lit.maps, truth.errors(lit)
        baseline = baseline or maps.nbytes
        parts = table_bytes(maps)
        usual = {"scene": setting.scene.name, "maps": name_of(method)}
        yield {
            **usual,
            "kept": "all (allocated)",
            "MB": maps.nbytes / 1e6,
            "of voxel %": 100.0 * maps.nbytes / baseline,
            "3D MB": parts["3D"] / 1e6,
            "2D MB": parts["2D"] / 1e6,
            "with receivers MB": (lit.visibility.nbytes - lit.visibility.maps.nbytes + maps.nbytes)
            / 1e6,
            **errors,
        }
        for kept, nbytes in (
            ("bricks of 8³ (computed)", sparse_bytes(maps)),
            ("one face for six (computed)", isotropic_bytes(maps)),
        ):
            ratio = 100.0 * nbytes / baseline
            yield {**usual, "kept": kept, "MB": nbytes / 1e6, "of voxel %": ratio}
    for name, megabytes in PAPER.items():
        ratio = 100.0 * megabytes / PAPER["voxel 256³"]
        yield {
            "scene": "the paper's",
            "maps": name,
            "kept": "formats unknown",
            "MB": megabytes,
            "of voxel %": ratio,
        }


def quality_rows(setting: Setting, options: argparse.Namespace) -> Iterator[Row]:
    """Figs. 6 to 8, and how well the reference is known."""
    truth = Truth.of(setting, options.error, options.rays)
    usual = {"scene": setting.scene.name, "light": setting.environment.name}
    yield {
        **usual,
        "method": "reference, its noise",
        "RMSE %": 100.0 * truth.error,
        "indirect RMSE %": 100.0 * truth.indirect_error,
    }
    methods = [hybrid_of(options.hybrids[0]), *map(voxel_of, options.voxel)]
    rows, whole, indirect = [], [truth.image], [truth.indirect]
    for method in methods:
        lit = Lit.of(method, setting)
        rows.append({**usual, "method": name_of(method), **truth.errors(lit)})
        _, rows[-1]["gather s"] = timed(lambda lit=lit: lit.gather(setting))
        if options.out:
            whole.append(lit.whole(setting))
            indirect.append(lit.indirect(setting))
    for row in rows:
        for name in COMPARED:
            if rows[0][name] is not None and row is not rows[0]:
                row[f"hybrid's / its {name.removesuffix(' %')}"] = rows[0][name] / row[name]
        yield row
    if options.out:
        name = f"{setting.scene.name}-{setting.environment.name}".replace(":", "-")
        folder = Path(options.out)
        write_strip(folder / f"{name}.png", setting, whole, truth.image)
        write_strip(folder / f"{name}-indirect.png", setting, indirect, truth.indirect)


def resolution_rows(setting: Setting, options: argparse.Namespace) -> Iterator[Row]:
    """Sizes of both maps."""
    truth = Truth.of(setting, options.error, options.rays)
    hybrids = [hybrid_of(f"{n}x{m}") for n, m in itertools.product(options.voxels, options.texels)]
    for method in (*hybrids, *map(voxel_of, options.voxels)):
        lit = Lit.of(method, setting)
        yield _swept(truth, lit, {"maps": name_of(method), "MB": lit.maps.nbytes / 1e6})


def march_rows(setting: Setting, options: argparse.Namespace) -> Iterator[Row]:
    """Cones, aperture, stepping and search, one at a time, through the same maps."""
    truth = Truth.of(setting, options.error, options.rays)
    hybrid = hybrid_of(options.hybrids[0])
    settings = [
        *({"cones": count} for count in CONES),
        *({"aperture": math.radians(degrees)} for degrees in APERTURES),
        *({"stepping": stepping} for stepping in get_args(Stepping)),
        *SEARCHES,
    ]
    for first, changes in (
        (hybrid, settings),
        (voxel_of(options.voxel[0]), settings[: -len(SEARCHES)]),
    ):
        lit = Lit.of(first, setting)
        for change in changes:
            shown = (
                f"{k} {v:.3g}" if isinstance(v, float) else f"{k} {v}" for k, v in change.items()
            )
            row = {"maps": name_of(first), "changed": ", ".join(shown)}
            yield _swept(truth, lit.by(changed(first, change)), row)


def changed(method: HybridCones, change: dict) -> HybridCones:
    """With other parameters."""
    return replace(method, **change)


def _swept(truth: Truth, lit: Lit, row: Row) -> Row:
    """Errors first: they compile what is then timed."""
    errors = truth.errors(lit)
    _, seconds = timed(lambda: lit.gather(truth.setting))
    return {"scene": truth.setting.scene.name, **row, **errors, "gather s": seconds}


Part = Callable[[Setting, argparse.Namespace], Iterator[Row]]

PARTS: dict[str, list[tuple[str, Part]]] = {
    "memory": [("Memory (table 2)", memory_rows)],
    "quality": [("One bounce against the reference (figs. 6 to 8)", quality_rows)],
    "sweeps": [("Sizes of the maps", resolution_rows), ("The march", march_rows)],
    "stages": [("Stages", stage_rows)],
    "growth": [("Larger images", growth_rows)],
}

WITHOUT_SCENE: dict[str, tuple[str, Callable[[argparse.Namespace], Iterator[Row]]]] = {
    "leaks": ("Leaks under a uniform sky", leak_rows),
    "growth": ("The largest terrain", large_rows),
}

WHAT = ("memory", "quality", "sweeps", "leaks", "stages", "growth")


def options_of_command_line(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    add = parser.add_argument
    add("--what", nargs="+", default=list(WHAT), choices=WHAT)
    add("--scenes", nargs="+", default=["terrain"])
    add("--environments", nargs="+", default=["sky"])
    add("--size", nargs=2, type=int, default=[320, 200], metavar=("W", "H"))
    add(
        "--hybrids",
        nargs="+",
        default=["128x2048", "128x1024", "64x2048", "64x1024"],
        help="voxels x texels; the first is compared with --voxel; default: %(default)s",
    )
    add("--voxel", nargs="+", type=int, default=[256, 128], help="of the baseline, first the usual")
    add("--voxels", nargs="+", type=int, default=[64, 128, 256], help="of sweeps and leaks")
    add("--texels", nargs="+", type=int, default=[512, 1024, 2048], help="of sweeps")
    add("--error", type=float, default=0.01, help="of the reference, whole")
    add("--rays", type=int, default=1024, help="of the reference's bounce, from each pixel")
    add("--repeats", type=int, default=3, help="of what is timed")
    add("--wall", type=float, default=0.02, help="thickness of walls that leak, metres")
    add("--leak-size", nargs=2, type=int, default=[48, 36], metavar=("W", "H"))
    add(
        "--sizes",
        nargs="+",
        type=_size,
        default=[(320, 180), (640, 360), (1280, 720)],
        help="of growth, as 640x360",
    )
    add("--large", default="terrain:triangles=1850000", help="scene of growth's voxelisation")
    add("--out", help="folder for pictures of --what quality")
    return parser.parse_args(arguments)


def _size(text: str) -> tuple[int, int]:
    width, height = text.split("x")
    return int(width), int(height)


def main(arguments: Sequence[str] | None = None) -> None:
    options = options_of_command_line(arguments)
    width, height = options.size
    print(f"{width} x {height}, JAX on {jax.default_backend()}")
    for what in options.what:
        for title, part in PARTS.get(what, []):
            rows = []
            for scene, light in itertools.product(options.scenes, options.environments):
                rows += part(prepare(scene, light, (width, height)), options)
            print(markdown(title, rows), flush=True)
        if what in WITHOUT_SCENE:
            title, of_made = WITHOUT_SCENE[what]
            print(markdown(title, list(of_made(options))), flush=True)


if __name__ == "__main__":
    main()
