"""Where the time and the memory of cone tracing go, and what light leaks through thin walls.

Used by :mod:`experiments.cone_table`.
"""

import statistics
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

import jaxvis
from experiments.cone_runs import Lit, hybrid_of, name_of, peak_memory, voxel_of
from experiments.cone_scenes import Sheltered, room, slab
from experiments.measuring import Row, seconds_of, stopwatch
from experiments.output import Output
from experiments.settings import Common, setting
from jaxvis.compare.setting import Setting, prepare
from jaxvis.methods import HybridCones, Reference
from jaxvis.methods.cones import method as method_module
from jaxvis.methods.cones import visibility as visibility_module

PREPARATIONS = {
    "height_field_meshes": "classify s",
    "voxelize": "voxelize s",
    "look_down": "heights s",
}
"""Functions of the precomputation that are timed, and what tables call them."""


@dataclass(frozen=True)
class StageSettings(Common):
    hybrids: tuple[str, ...] = setting(
        ("128x2048", "128x1024", "64x2048", "64x1024"),
        "voxels x texels; the first is compared with --voxel",
    )
    voxel: tuple[int, ...] = setting((256, 128), "of the baseline, first the usual")
    voxels: tuple[int, ...] = setting((64, 128, 256), "of sweeps and leaks")
    texels: tuple[int, ...] = setting((512, 1024, 2048), "of sweeps; leaks take the last")
    error: float = setting(0.01, "standard error of the reference, relative to its mean")
    rays: int = setting(1024, "of the reference's bounce, from each pixel")
    repeats: int = setting(3, "of what is timed")
    wall: float = setting(0.02, "thickness of walls that leak, metres")
    leak_size: tuple[int, int] = setting((48, 36), "of images of leaks", metavar=("W", "H"))
    sizes: tuple[str, ...] = setting(
        ("320x180", "640x360", "1280x720"), "of images of growth", metavar="WxH"
    )
    large: str = setting("terrain:triangles=1850000", "scene of growth's voxelisation")


def prepared(method: HybridCones, view: Setting) -> tuple[Any, Row]:
    """(visibility, seconds of the precomputation and of its parts)."""
    with stopwatch(visibility_module, *PREPARATIONS) as spent:
        visibility, seconds = seconds_of(lambda: method.precompute(view.scene, progress=False))
    parts = {PREPARATIONS[name]: spent[name] for name in PREPARATIONS}
    return visibility, {"precompute s": seconds, **parts}


def stage_rows(view: Setting, settings: StageSettings, output: Output) -> Iterator[Row]:
    """Both methods by stages; the repeats of one lie between those of the other.

    What compiles is counted in the first frame alone: ``compile s`` is what that takes longer than
    a later one (a program that an earlier run left in the compilation cache is only read).
    """
    methods = [hybrid_of(settings.hybrids[0]), voxel_of(settings.voxel[0])]
    rows, calls = [], []
    jax.clear_caches()
    for method in methods:
        visibility, row = prepared(method, view)
        light, row["light s"] = seconds_of(lambda m=method: m.light(view.environment))

        def shade(m: HybridCones = method, v: Any = visibility, e: Any = light) -> jax.Array:
            return m.shade(v, e, view.surface)

        _, row["compile s"] = seconds_of(shade)
        _, row["light s"] = seconds_of(lambda m=method: m.light(view.environment))
        lit = Lit(method, visibility, light, method.lightmaps(visibility, light))
        rows.append({"scene": view.scene.name, "method": name_of(method), **row})
        calls.append((lit, shade))
    found: list[list[Row]] = [[] for _ in methods]
    for _ in range(settings.repeats):
        for mine, (lit, shade) in zip(found, calls, strict=True):
            mine.append(_frame(lit, shade, view))
    for row, mine in zip(rows, found, strict=True):
        row |= {name: statistics.median(one[name] for one in mine) for name in mine[0]}
        row["compile s"] = max(row["compile s"] - row["shade s"], 0.0)
        yield row
    first, second = rows
    ratios = {k: first[k] / second[k] for k in first if k.endswith(" s") and second[k] > 0.0}
    yield {"scene": view.scene.name, "method": "ratio", **ratios}


def _frame(lit: Lit, shade: Callable[[], jax.Array], view: Setting) -> Row:
    """Seconds of a frame and of its stages."""
    method = lit.method
    _, inject = seconds_of(lambda: method.lightmaps(lit.visibility, lit.light))
    _, gather = seconds_of(lambda: lit.gather(view))
    with stopwatch(method_module, "lit") as spent:
        _, whole = seconds_of(shade)
    return {"inject s": inject, "gather s": gather, "suns s": spent["lit"], "shade s": whole}


def growth_rows(view: Setting, settings: StageSettings, output: Output) -> Iterator[Row]:
    """Gathering at more and more pixels: its time, and the memory that the process holds."""
    for method in (hybrid_of(settings.hybrids[0]), voxel_of(settings.voxel[0])):
        lit = Lit.of(method, view)
        for size in map(size_of, settings.sizes):
            larger = prepare(view.scene, view.environment, size)
            lit.gather(larger)
            with peak_memory() as memory:
                _, seconds = seconds_of(lambda t=lit, s=larger: t.gather(s), settings.repeats)
            pixels = int(np.asarray(larger.surface.mask).sum())
            yield {
                "scene": view.scene.name,
                "method": name_of(method),
                "size": f"{size[0]} x {size[1]}",
                "shaded pixels": pixels,
                "gather s": seconds,
                "µs a pixel": 1e6 * seconds / pixels,
                "held before MB": memory.before,
                "most MB": memory.most,
                "added MB": memory.most - memory.before,
            }


def size_of(text: str) -> tuple[int, int]:
    """``640x360`` as width and height.

    Raises:
        ValueError: not two whole numbers.
    """
    try:
        width, height = map(int, text.split("x"))
    except ValueError:
        raise ValueError(f"a size is WIDTHxHEIGHT, as 640x360; got {text!r}") from None
    return width, height


def large_rows(settings: StageSettings) -> Iterator[Row]:
    """Voxelisation of the largest terrain."""
    scene = jaxvis.load_scene(settings.large)
    view = prepare(scene, "sky", (32, 20))
    for method in (hybrid_of(settings.hybrids[0]), voxel_of(settings.voxel[0])):
        with peak_memory() as memory:
            visibility, row = prepared(method, view)
        yield {
            "scene": scene.name,
            "triangles": len(scene.triangles),
            "method": name_of(method),
            **row,
            "most MB": memory.most,
            "visibility MB": visibility.nbytes / 1e6,
        }


def shelters(wall: float) -> list[Sheltered]:
    """What the table of leaks is of: walls of a thickness in metres."""
    return [
        room(wall=wall),
        slab(thickness=wall),
        slab(width=3.0, length=40.0, thickness=wall, name="bridge"),
    ]


def leak_rows(settings: StageSettings) -> Iterator[Row]:
    """Mean radiance of what is hidden beside that in the open, under a uniform sky of 1."""
    environment = jaxvis.load_environment("uniform")
    methods = [hybrid_of(f"{n}x{settings.texels[-1]}") for n in settings.voxels]
    methods += [voxel_of(n) for n in settings.voxels]
    for shelter in shelters(settings.wall):
        views = [
            prepare(shelter.scene, environment, settings.leak_size, camera=camera)
            for camera in (shelter.inside, shelter.outside)
        ]
        truth = Reference(error=settings.error, bounces=1, bounce_rays=settings.rays)
        seen = [_mean_by_reference(truth, view) for view in views]
        usual = {"scene": shelter.scene.name, "wall m": settings.wall}
        yield {**usual, "method": "reference", **_leak(seen, seen)}
        for method in methods:
            lit = Lit.of(method, views[0])
            means = [float(lit.whole(view)[view.covered].mean()) for view in views]
            voxel = None if lit.maps.grid is None else float(lit.maps.grid.voxel)
            row = {**usual, "method": name_of(method), "voxel m": voxel}
            yield {**row, **_leak(means, seen)}


def _mean_by_reference(method: Reference, view: Setting) -> float:
    visibility = method.precompute(view.scene, progress=False)
    found, _ = method.solve_cached(visibility, method.light(view.environment), view.surface)
    return float(np.asarray(found.image)[view.covered].mean())


def _leak(means: list[float], truth: list[float]) -> Row:
    inside, outside = means
    return {
        "inside": inside,
        "outside": outside,
        "inside / outside %": 100.0 * inside / outside,
        "too much inside, % of outside": 100.0 * (inside - truth[0]) / truth[1],
    }
