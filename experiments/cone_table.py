"""What hybrid cone tracing saves and costs beside voxel cone tracing (paper 003).

--what says which tables:

- memory (table 2): bytes of the lit maps, counted from the arrays that are allocated, with the
  error of each beside them. Both methods keep the same formats: of the 3D lightmap six directional
  faces of RGBA in 16-bit floats (radiance premultiplied by opacity), all levels; of the 2D lightmap
  RGB in 16-bit floats and a 16-bit height, all levels.
- quality (figs. 6 to 8): images with one bounce against the ray-traced reference.
- sweeps: sizes of the maps, cones, aperture, stepping and search.
- leaks: light within a closed room of thin walls, and below a slab and a bridge.
- stages (section VII's times): what each stage takes, both methods side by side.
- growth: time and memory of larger images, and of the largest terrain's voxelisation.

--out also writes pictures of quality: reference, hybrid and voxels, whole and then indirect light
alone.
"""

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal, get_args

import jax

from experiments.cone_runs import (
    Lit,
    Truth,
    hybrid_of,
    isotropic_bytes,
    name_of,
    sparse_bytes,
    table_bytes,
    voxel_of,
)
from experiments.cone_stages import (
    StageSettings,
    growth_rows,
    large_rows,
    leak_rows,
    size_of,
    stage_rows,
)
from experiments.measuring import Row, seconds_of, write_strip
from experiments.output import Output
from experiments.settings import execute, setting
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

What = Literal["memory", "quality", "sweeps", "leaks", "stages", "growth"]


@dataclass(frozen=True)
class Settings(StageSettings):
    what: tuple[What, ...] = setting(get_args(What), "which tables")
    scene: tuple[str, ...] = setting(("terrain",), "what is lit")
    environment: tuple[str, ...] = setting(("sky",), "what lights it, one after another")
    size: tuple[int, int] = setting((320, 200), "of the images", metavar=("W", "H"))


def memory_rows(view: Setting, settings: Settings, output: Output) -> Iterator[Row]:
    """Table 2. The first voxel size is what the others are compared with."""
    truth = Truth.of(view, settings.error, settings.rays)
    baseline = None
    methods = [*map(voxel_of, settings.voxel), *map(hybrid_of, settings.hybrids)]
    for method in methods:
        lit = Lit.of(method, view)
        maps, errors = lit.maps, truth.errors(lit)
        baseline = baseline or maps.nbytes
        parts = table_bytes(maps)
        usual = {"scene": view.scene.name, "maps": name_of(method)}
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


def quality_rows(view: Setting, settings: Settings, output: Output) -> Iterator[Row]:
    """Figs. 6 to 8, and how well the reference is known."""
    truth = Truth.of(view, settings.error, settings.rays)
    usual = {"scene": view.scene.name, "light": view.environment.name}
    yield {
        **usual,
        "method": "reference, its noise",
        "RMSE %": 100.0 * truth.error,
        "indirect RMSE %": 100.0 * truth.indirect_error,
    }
    methods = [hybrid_of(settings.hybrids[0]), *map(voxel_of, settings.voxel)]
    rows, whole, indirect = [], [truth.image], [truth.indirect]
    for method in methods:
        lit = Lit.of(method, view)
        rows.append({**usual, "method": name_of(method), **truth.errors(lit)})
        _, rows[-1]["gather s"] = seconds_of(lambda lit=lit: lit.gather(view))
        if output.folder is not None:
            whole.append(lit.whole(view))
            indirect.append(lit.indirect(view))
    for row in rows:
        for name in COMPARED:
            if rows[0][name] is not None and row is not rows[0]:
                row[f"hybrid's / its {name.removesuffix(' %')}"] = rows[0][name] / row[name]
        yield row
    name = f"{view.scene.name}-{view.environment.name}".replace(":", "-")
    of_all, of_bounce = output.path(f"{name}.png"), output.path(f"{name}-indirect.png")
    if of_all is not None and of_bounce is not None:
        write_strip(of_all, view, whole, truth.image)
        write_strip(of_bounce, view, indirect, truth.indirect)


def resolution_rows(view: Setting, settings: Settings, output: Output) -> Iterator[Row]:
    """Sizes of both maps."""
    truth = Truth.of(view, settings.error, settings.rays)
    hybrids = [
        hybrid_of(f"{n}x{m}") for n, m in itertools.product(settings.voxels, settings.texels)
    ]
    for method in (*hybrids, *map(voxel_of, settings.voxels)):
        lit = Lit.of(method, view)
        yield _swept(truth, lit, {"maps": name_of(method), "MB": lit.maps.nbytes / 1e6})


def march_rows(view: Setting, settings: Settings, output: Output) -> Iterator[Row]:
    """Cones, aperture, stepping and search, one at a time, through the same maps."""
    truth = Truth.of(view, settings.error, settings.rays)
    hybrid = hybrid_of(settings.hybrids[0])
    tried = [
        *({"cones": count} for count in CONES),
        *({"aperture": math.radians(degrees)} for degrees in APERTURES),
        *({"stepping": stepping} for stepping in get_args(Stepping)),
        *SEARCHES,
    ]
    for first, changes in (
        (hybrid, tried),
        (voxel_of(settings.voxel[0]), tried[: -len(SEARCHES)]),
    ):
        lit = Lit.of(first, view)
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
    _, seconds = seconds_of(lambda: lit.gather(truth.setting))
    return {"scene": truth.setting.scene.name, **row, **errors, "gather s": seconds}


Part = Callable[[Setting, Settings, Output], Iterator[Row]]

PARTS: dict[str, list[tuple[str, str, Part]]] = {
    "memory": [("memory", "Memory (table 2)", memory_rows)],
    "quality": [("quality", "One bounce against the reference (figs. 6 to 8)", quality_rows)],
    "sweeps": [
        ("sizes", "Sizes of the maps", resolution_rows),
        ("march", "The march", march_rows),
    ],
    "stages": [("stages", "Stages", stage_rows)],
    "growth": [("growth", "Larger images", growth_rows)],
}
"""Tables with the names of their files, by what is asked for."""

WITHOUT_SCENE: dict[str, tuple[str, str, Callable[[Settings], Iterator[Row]]]] = {
    "leaks": ("leaks", "Leaks under a uniform sky", leak_rows),
    "growth": ("largest", "The largest terrain", large_rows),
}


def measure(settings: Settings, output: Output) -> None:
    """The tables that were asked for, of all scenes."""
    for size in settings.sizes:
        size_of(size)  # a wrong one is told before anything is measured
    width, height = settings.size
    output.say(f"{width} x {height}, JAX on {jax.default_backend()}")
    for what in dict.fromkeys(settings.what):
        for name, title, part in PARTS.get(what, []):
            rows = []
            for scene, light in itertools.product(settings.scene, settings.environment):
                rows += part(prepare(scene, light, settings.size), settings, output)
            output.table(name, title, rows)
        if what in WITHOUT_SCENE:
            name, title, of_made = WITHOUT_SCENE[what]
            output.table(name, title, of_made(settings))


if __name__ == "__main__":
    execute(Settings, measure, __doc__)
