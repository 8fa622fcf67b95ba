"""Where the time and the memory of cone tracing go, and what light leaks through thin walls.

Used by :mod:`experiments.cone_table`.
"""

import argparse
import statistics
import time
from collections.abc import Callable, Iterator
from typing import Any

import jax
import numpy as np

import jaxvis
from experiments.adaptive_runs import stopwatch
from experiments.cone_runs import Lit, Row, hybrid_of, name_of, peak_memory, voxel_of
from experiments.cone_scenes import Sheltered, room, slab
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


def timed(function: Callable[[], Any]) -> tuple[Any, float]:
    """(result, seconds), waiting for the device."""
    start = time.perf_counter()
    result = jax.block_until_ready(function())
    return result, time.perf_counter() - start


def prepared(method: HybridCones, setting: Setting) -> tuple[Any, Row]:
    """(visibility, seconds of the precomputation and of its parts)."""
    with stopwatch(visibility_module, *PREPARATIONS) as spent:
        visibility, seconds = timed(lambda: method.precompute(setting.scene, progress=False))
    parts = {PREPARATIONS[name]: spent[name] for name in PREPARATIONS}
    return visibility, {"precompute s": seconds, **parts}


def stage_rows(setting: Setting, options: argparse.Namespace) -> Iterator[Row]:
    """Both methods by stages; the repeats of one lie between those of the other.

    What compiles is counted in the first frame alone: ``compile s`` is what that takes longer than
    a later one (a program that an earlier run left in the compilation cache is only read).
    """
    methods = [hybrid_of(options.hybrids[0]), voxel_of(options.voxel[0])]
    rows, calls = [], []
    jax.clear_caches()
    for method in methods:
        visibility, row = prepared(method, setting)
        light, row["light s"] = timed(lambda m=method: m.light(setting.environment))

        def shade(m: HybridCones = method, v: Any = visibility, e: Any = light) -> jax.Array:
            return m.shade(v, e, setting.surface)

        _, row["compile s"] = timed(shade)
        _, row["light s"] = timed(lambda m=method: m.light(setting.environment))
        lit = Lit(method, visibility, light, method.lightmaps(visibility, light))
        rows.append({"scene": setting.scene.name, "method": name_of(method), **row})
        calls.append((lit, shade))
    found: list[list[Row]] = [[] for _ in methods]
    for _ in range(options.repeats):
        for mine, (lit, shade) in zip(found, calls, strict=True):
            mine.append(_frame(lit, shade, setting))
    for row, mine in zip(rows, found, strict=True):
        row |= {name: statistics.median(one[name] for one in mine) for name in mine[0]}
        row["compile s"] = max(row["compile s"] - row["shade s"], 0.0)
        yield row
    first, second = rows
    ratios = {k: first[k] / second[k] for k in first if k.endswith(" s") and second[k] > 0.0}
    yield {"scene": setting.scene.name, "method": "ratio", **ratios}


def _frame(lit: Lit, shade: Callable[[], jax.Array], setting: Setting) -> Row:
    """Seconds of a frame and of its stages."""
    method = lit.method
    _, inject = timed(lambda: method.lightmaps(lit.visibility, lit.light))
    _, gather = timed(lambda: lit.gather(setting))
    with stopwatch(method_module, "lit") as spent:
        _, whole = timed(shade)
    return {"inject s": inject, "gather s": gather, "suns s": spent["lit"], "shade s": whole}


def growth_rows(setting: Setting, options: argparse.Namespace) -> Iterator[Row]:
    """Gathering at more and more pixels: its time, and the memory that the process holds."""
    for method in (hybrid_of(options.hybrids[0]), voxel_of(options.voxel[0])):
        lit = Lit.of(method, setting)
        for width, height in options.sizes:
            larger = prepare(setting.scene, setting.environment, (width, height))
            lit.gather(larger)
            with peak_memory() as memory:
                times = [
                    timed(lambda t=lit, s=larger: t.gather(s))[1] for _ in range(options.repeats)
                ]
            pixels = int(np.asarray(larger.surface.mask).sum())
            seconds = statistics.median(times)
            yield {
                "scene": setting.scene.name,
                "method": name_of(method),
                "size": f"{width} x {height}",
                "shaded pixels": pixels,
                "gather s": seconds,
                "µs a pixel": 1e6 * seconds / pixels,
                "held before MB": memory.before,
                "most MB": memory.most,
                "added MB": memory.most - memory.before,
            }


def large_rows(options: argparse.Namespace) -> Iterator[Row]:
    """Voxelisation of the largest terrain."""
    scene = jaxvis.load_scene(options.large)
    setting = prepare(scene, "sky", (32, 20))
    for method in (hybrid_of(options.hybrids[0]), voxel_of(options.voxel[0])):
        with peak_memory() as memory:
            visibility, row = prepared(method, setting)
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


def leak_rows(options: argparse.Namespace) -> Iterator[Row]:
    """Mean radiance of what is hidden beside that in the open, under a uniform sky of 1."""
    environment = jaxvis.load_environment("uniform")
    methods = [hybrid_of(f"{n}x{options.texels[-1]}") for n in options.voxels]
    methods += [voxel_of(n) for n in options.voxels]
    for shelter in shelters(options.wall):
        views = [
            prepare(shelter.scene, environment, options.leak_size, camera=camera)
            for camera in (shelter.inside, shelter.outside)
        ]
        truth = Reference(error=options.error, bounces=1, bounce_rays=options.rays)
        seen = [_mean_by_reference(truth, view) for view in views]
        usual = {"scene": shelter.scene.name, "wall m": options.wall}
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
