"""What adaptive visibility sampling saves and costs (paper 002, table 1, figs. 6, 7 and 8).

``--what`` says which tables: ``maps`` (texels and rays of adaptive maps beside dense ones),
``placement`` (samples placed beside one at every vertex in view), ``thresholds`` (fig. 6),
``resolution`` (fig. 7), ``equal`` (fig. 8: against ``mc-mis``), ``frames`` (carrying samples over
from frame to frame, also where only a part moves, and memory) and ``table1``. Tables are Markdown;
``--out`` also writes pictures and pages of ``equal``.

Targets, on all three scenes: at least 99 % of texels as in the dense map with at most 20 % of its
rays; samples at no more than 12 % of the vertices with an image within 1 dB of sampling all; equal
RMSE at least 10 times as fast as ``mc-mis``; no rays where nothing moved; memory flat within 5 %.
"""

import argparse
import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import jaxvis
from experiments.adaptive_frames import frames_rows, part_rows, table_1_rows
from experiments.adaptive_runs import (
    Moving,
    Noise,
    Row,
    Shaded,
    Truth,
    angular_of,
    every_vertex_in_view,
    filled,
    markdown,
    placed,
    seconds_of,
    shaded,
    write_strip,
)
from jaxvis.compare.setting import Setting
from jaxvis.methods import MonteCarlo, registry
from jaxvis.methods.distance_field import AdaptiveVisibility
from jaxvis.methods.distance_field.build import Angular, Vertices

LARGEST = (0.20, 0.10, 0.05)
COARSER = (64, 128)
RESOLUTIONS = (64, 128, 256)
FILLS = ("adaptive", "dense", "rasterized")
LIGHTS = {"cells": 512, "fitted": 32}
FREE_BUDGET = 0.5
"""Share of vertices that may be samples where thresholds decide."""


def maps_rows(
    view: Moving, method: AdaptiveVisibility, options: argparse.Namespace
) -> Iterator[Row]:
    """Maps at the samples that were placed: as the rounds left them, and all filled at once."""
    setting = view.at(options.frame)
    fields, angular = placed(method, setting), angular_of(method)
    vertices, ids = Vertices.of(setting.scene), np.asarray(fields.samples)
    places = vertices.places(method.alpha)
    dense, dense_s = filled(vertices, angular._replace(fill="dense"), ids, None)
    again, adaptive_s = filled(vertices, angular, ids, places)
    alone, alone_s = filled(vertices, angular, ids, None)
    known = fields.maps()
    for name, maps, rays, seconds in (
        ("as placed", known, fields.rays_traced, None),
        ("at once", again.maps, again.rays, adaptive_s),
        ("no hints", alone.maps, alone.rays, alone_s),
    ):
        equal = (maps == dense.maps).mean(axis=(1, 2))
        yield {
            "scene": view.name,
            "filled": name,
            "samples": len(ids),
            "equal %": 100.0 * float(equal.mean()),
            "worst map %": 100.0 * float(equal.min()),
            "rays %": 100.0 * rays / dense.rays,
            "s": seconds,
            "dense s": dense_s,
        }


def placement_rows(
    view: Moving, method: AdaptiveVisibility, options: argparse.Namespace
) -> Iterator[Row]:
    """Samples placed beside samples at every vertex in view, for both kinds of lobes."""
    setting = view.at(options.frame)
    truth = Truth.of(setting, options.error)
    fields, seconds = seconds_of(lambda: placed(method, setting))
    everywhere, all_s = seconds_of(lambda: every_vertex_in_view(setting, angular_of(method)))
    total, in_view = len(fields.positions), int(np.any(np.asarray(everywhere.weights), 1).sum())
    for lobes, lights in LIGHTS.items():
        one = replace(method, lobes=lobes, lights=lights)
        light = one.light(setting.environment)
        few, every = (
            np.asarray(one.shade(f, light, setting.surface)) for f in (fields, everywhere)
        )
        yield {
            "scene": view.name,
            "lobes": f"{lights} {lobes}",
            "vertices": total,
            "in view": in_view,
            "samples": len(fields.samples),
            "% of vertices": 100.0 * len(fields.samples) / total,
            "% of those in view": 100.0 * len(fields.samples) / in_view,
            "dB": truth.psnr(few),
            "dB of all": truth.psnr(every),
            "less dB": truth.psnr(every) - truth.psnr(few),
            "RMSE %": 100.0 * truth.relative_rmse(few),
            "RMSE % of all": 100.0 * truth.relative_rmse(every),
            "s": seconds,
            "s of all": all_s,
        }


def threshold_rows(
    view: Moving, method: AdaptiveVisibility, options: argparse.Namespace
) -> Iterator[Row]:
    """Fig. 6. The initial samples are as many as usual, but thresholds end insertion, not the
    budget; E_min is half of E_max."""
    setting = view.at(options.frame)
    truth = Truth.of(setting, options.error)
    light = method.light(setting.environment)
    initial = method.initial * method.budget / options.budget
    for largest, resolution in itertools.product(LARGEST, options.resolutions or COARSER):
        one = replace(
            method,
            largest=largest,
            least=0.5 * largest,
            resolution=resolution,
            budget=options.budget,
            initial=min(initial, 1.0),
        )
        fields, seconds = seconds_of(lambda one=one: placed(one, setting))
        image = np.asarray(one.shade(fields, light, setting.surface))
        yield {
            "scene": view.name,
            "E_max %": round(100.0 * largest),
            "texels": f"{resolution}²",
            "samples": len(fields.samples),
            "% of vertices": 100.0 * len(fields.samples) / len(fields.positions),
            "M rays": fields.rays_traced / 1e6,
            "s": seconds,
            "MB": fields.nbytes / 1e6,
            "dB": truth.psnr(image),
            "RMSE %": 100.0 * truth.relative_rmse(image),
        }


def resolution_rows(
    view: Moving, method: AdaptiveVisibility, options: argparse.Namespace
) -> Iterator[Row]:
    """Fig. 7: the maps of the same samples, filled in three ways."""
    setting = view.at(options.frame)
    vertices, ids = Vertices.of(setting.scene), np.asarray(placed(method, setting).samples)
    ids = ids[:: max(len(ids) // options.maps, 1)]
    places = vertices.places(method.alpha)
    filled(vertices, angular_of(method)._replace(fill="rasterized"), ids[:2], None)  # compiles
    for resolution in options.resolutions or RESOLUTIONS:
        row: Row = {"scene": view.name, "texels": f"{resolution}²", "maps": len(ids)}
        for fill in FILLS:
            angular = Angular(resolution, fill, method.coarsest)
            traced, seconds = filled(vertices, angular, ids, places)
            row[f"{fill} s"] = seconds
            if fill != "rasterized":
                row[f"{fill} M rays"] = traced.rays / 1e6
        row["dense / adaptive"] = row["dense s"] / row["adaptive s"]
        row["rasterized / adaptive"] = row["rasterized s"] / row["adaptive s"]
        yield row


def equal_rows(
    view: Moving, method: AdaptiveVisibility, options: argparse.Namespace
) -> Iterator[Row]:
    """Fig. 8: ``mc-mis`` at equal quality and at equal time.

    Times are those of a frame placed anew, of one carried over from the frame before, and of
    shading alone; all of ``mc-mis`` counts.
    """
    setting = view.at(options.frame)
    truth = Truth.of(setting, options.error)
    anew = shaded(method, setting, options.repeats)
    rmse = truth.relative_rmse(anew.image)
    before = placed(method, view.at(max(options.frame - 1, 0)))
    carried = shaded(method, setting, options.repeats, previous=before)
    noise = noise_of(setting, truth, options)
    spp = noise.spp_at_rmse(rmse)
    needed, confirmed = noise.seconds(spp), None
    if needed < options.limit:
        spp = max(1, round(spp))
        confirmed = monte_carlo(setting, spp)
        needed = confirmed.seconds
    usual = {
        "scene": view.name,
        "RMSE %": 100.0 * rmse,
        "dB": truth.psnr(anew.image),
        "mc spp": round(spp) if np.isfinite(spp) else "-",
        "mc s": needed,
        "confirmed RMSE %": confirmed and 100.0 * truth.relative_rmse(confirmed.image),
    }
    at_equal_time = []
    for name, seconds, error in (
        ("anew", anew.seconds, rmse),
        ("carried", carried.seconds, truth.relative_rmse(carried.image)),
        ("shading", anew.shade, rmse),
    ):
        count = noise.spp_at_seconds(seconds)
        same = monte_carlo(setting, count)
        at_equal_time.append(same.image)
        yield {
            **usual,
            "RMSE %": 100.0 * error,
            "counted": name,
            "s": seconds,
            "times as fast": needed / seconds,
            "spp at equal time": count,
            "its s": same.seconds,
            "its RMSE %": 100.0 * truth.relative_rmse(same.image),
            "its dB": truth.psnr(same.image),
        }
    if options.out:
        pictures = [anew.image, at_equal_time[0], at_equal_time[2], truth.image]
        write_strip(Path(options.out) / f"{view.name}.png", setting, pictures, truth.image)
        write_page(setting, method, noise.spp_at_seconds(anew.seconds), options)


def monte_carlo(setting: Setting, spp: int) -> Shaded:
    """``mc-mis``, warm."""
    return shaded(MonteCarlo(spp=spp), setting)


def noise_of(setting: Setting, truth: Truth, options: argparse.Namespace) -> Noise:
    """What ``mc-mis`` does with few and more rays."""
    found = [monte_carlo(setting, spp) for spp in options.spp]
    errors = [truth.relative_rmse(one.image) for one in found]
    return Noise.fit(options.spp, errors, [one.seconds for one in found], truth.error)


def write_page(
    setting: Setting, method: AdaptiveVisibility, spp: int, options: argparse.Namespace
) -> None:
    """The usual page: the method beside ``mc-mis`` in as much time."""
    folder = Path(options.out) / setting.scene.name
    comparison = jaxvis.compare(
        setting.scene,
        setting.environment,
        [method, MonteCarlo(spp=spp)],
        setting.size,
        reference=f"reference:error={options.error}",
        out=folder,
        progress=False,
    )
    jaxvis.write_report(comparison, folder, progress=False)


Part = Callable[[Moving, AdaptiveVisibility, argparse.Namespace], Iterator[Row]]

PARTS: dict[str, list[tuple[str, Part]]] = {
    "maps": [("Adaptive maps beside dense ones", maps_rows)],
    "placement": [("Placed samples beside every vertex in view", placement_rows)],
    "thresholds": [("Thresholds and resolution (fig. 6)", threshold_rows)],
    "resolution": [("Filling maps (fig. 7)", resolution_rows)],
    "equal": [("Equal quality and equal time (fig. 8)", equal_rows)],
    "frames": [("Frames", frames_rows), ("What moves", part_rows)],
    "table1": [("Table 1", table_1_rows)],
}


def options_of_command_line(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    add = parser.add_argument
    add("--what", nargs="+", default=["all"], choices=["all", *PARTS])
    add("--scenes", nargs="+", default=["hat", "balls", "walker"])
    add("--environment", default="windows")
    add("--size", nargs=2, type=int, default=[320, 240], metavar=("W", "H"))
    add("--method", default="adaptive", help="with parameters; default: %(default)s")
    add("--frame", type=int, default=12, help="that stands still; default: %(default)s")
    add("--error", type=float, default=0.01, help="of the reference")
    add("--repeats", type=int, default=3, help="of what is timed")
    add("--spp", nargs="+", type=int, default=[16, 64, 256], help="of mc-mis, to fit its error")
    add("--limit", type=float, default=60.0, help="seconds that mc-mis may take to confirm the fit")
    add("--budget", type=float, default=FREE_BUDGET, help="share of vertices, for thresholds")
    add(
        "--resolutions",
        nargs="+",
        type=int,
        help="of maps; default: 64 128, for --what resolution also 256",
    )
    add("--maps", type=int, default=500, help="that --what resolution fills, about")
    add("--frames", type=int, default=8, help="carried over; the issue's number is 60")
    add("--every", type=int, default=10, help="frames to a row of --what frames")
    add("--carried-only", action="store_true", help="no frames placed anew, to look at memory")
    add("--parts", type=int, default=3, help="that move alone, the largest")
    add("--mean", type=int, default=4, help="frames that table 1 averages")
    add("--out", help="folder for pictures and pages of --what equal")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> None:
    options = options_of_command_line(arguments)
    environment = jaxvis.load_environment(options.environment)
    method = registry.create(options.method)
    if not isinstance(method, AdaptiveVisibility):
        raise SystemExit(f"--method must be adaptive or shadow-map, got {options.method!r}")
    width, height = options.size
    print(f"{environment.name}, {width} x {height}, {method}")
    for what in PARTS if "all" in options.what else options.what:
        for title, part in PARTS[what]:
            rows = []
            for name in options.scenes:
                view = Moving(jaxvis.load_animation(name), environment, (width, height))
                rows += part(view, method, options)
            print(markdown(title, rows), flush=True)


if __name__ == "__main__":
    main()
