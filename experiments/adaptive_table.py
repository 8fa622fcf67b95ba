"""What adaptive visibility sampling saves and costs (paper 002, table 1, figs. 6, 7 and 8).

--what says which tables: maps (texels and rays of adaptive maps beside dense ones), placement
(samples placed beside one at every vertex in view), thresholds (fig. 6), resolution (fig. 7), equal
(fig. 8: against mc-mis), frames (carrying samples over from frame to frame, also where only a part
moves, and memory) and table1. --out also writes pictures and pages of equal.

Targets, on all three scenes: at least 99 % of texels as in the dense map with at most 20 % of its
rays; samples at no more than 12 % of the vertices with an image within 1 dB of sampling all; equal
RMSE at least 10 times as fast as mc-mis; no rays where nothing moved; memory flat within 5 %.
"""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

import jaxvis
from experiments.adaptive_frames import FrameSettings, frames_rows, part_rows, table_1_rows
from experiments.adaptive_runs import (
    Moving,
    Noise,
    Shaded,
    Truth,
    angular_of,
    every_vertex_in_view,
    filled,
    placed,
    shaded,
)
from experiments.measuring import Row, seconds_of, write_strip
from experiments.output import Output
from experiments.settings import execute, setting
from jaxvis.compare.setting import Setting
from jaxvis.methods import MonteCarlo, registry
from jaxvis.methods.distance_field import AdaptiveVisibility
from jaxvis.methods.distance_field.build import Angular, Vertices

LARGEST = (0.20, 0.10, 0.05)
COARSER = (64, 128)
RESOLUTIONS = (64, 128, 256)
FILLS = ("adaptive", "dense", "rasterized")
LIGHTS = {"cells": 512, "fitted": 32}


@dataclass(frozen=True)
class Settings(FrameSettings):
    what: tuple[
        Literal[
            "all", "maps", "placement", "thresholds", "resolution", "equal", "frames", "table1"
        ],
        ...,
    ] = setting(("all",), "which tables")
    scene: tuple[str, ...] = setting(("hat", "balls", "walker"), "what moves")
    environment: str = setting("windows", "what lights it")
    size: tuple[int, int] = setting((320, 240), "of the images", metavar=("W", "H"))
    method: str = setting("adaptive", "with parameters")
    error: float = setting(0.01, "standard error of the reference, relative to its mean")
    spp: tuple[int, ...] = setting((16, 64, 256), "of mc-mis, to fit its error")
    limit: float = setting(60.0, "seconds that mc-mis may take to confirm the fit")
    budget: float = setting(0.5, "share of vertices that may be samples, for thresholds")
    resolutions: tuple[int, ...] = setting(
        (), "of maps; default: 64 128, for --what resolution also 256"
    )
    maps: int = setting(500, "that --what resolution fills, about")


def maps_rows(
    view: Moving, method: AdaptiveVisibility, settings: Settings, output: Output
) -> Iterator[Row]:
    """Maps at the samples that were placed: as the rounds left them, and all filled at once."""
    stage = view.at(settings.frame)
    fields, angular = placed(method, stage), angular_of(method)
    vertices, ids = Vertices.of(stage.scene), np.asarray(fields.samples)
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
    view: Moving, method: AdaptiveVisibility, settings: Settings, output: Output
) -> Iterator[Row]:
    """Samples placed beside samples at every vertex in view, for both kinds of lobes."""
    stage = view.at(settings.frame)
    truth = Truth.of(stage, settings.error)
    fields, seconds = seconds_of(lambda: placed(method, stage))
    everywhere, all_s = seconds_of(lambda: every_vertex_in_view(stage, angular_of(method)))
    total, in_view = len(fields.positions), int(np.any(np.asarray(everywhere.weights), 1).sum())
    for lobes, lights in LIGHTS.items():
        one = replace(method, lobes=lobes, lights=lights)
        light = one.light(stage.environment)
        few, every = (np.asarray(one.shade(f, light, stage.surface)) for f in (fields, everywhere))
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
    view: Moving, method: AdaptiveVisibility, settings: Settings, output: Output
) -> Iterator[Row]:
    """Fig. 6. The initial samples are as many as usual, but thresholds end insertion, not the
    budget; E_min is half of E_max."""
    stage = view.at(settings.frame)
    truth = Truth.of(stage, settings.error)
    light = method.light(stage.environment)
    initial = method.initial * method.budget / settings.budget
    for largest, resolution in itertools.product(LARGEST, settings.resolutions or COARSER):
        one = replace(
            method,
            largest=largest,
            least=0.5 * largest,
            resolution=resolution,
            budget=settings.budget,
            initial=min(initial, 1.0),
        )
        fields, seconds = seconds_of(lambda one=one: placed(one, stage))
        image = np.asarray(one.shade(fields, light, stage.surface))
        yield {
            "scene": view.name,
            "E_max %": round(100.0 * largest),
            "texels a side": resolution,
            "samples": len(fields.samples),
            "% of vertices": 100.0 * len(fields.samples) / len(fields.positions),
            "M rays": fields.rays_traced / 1e6,
            "s": seconds,
            "MB": fields.nbytes / 1e6,
            "dB": truth.psnr(image),
            "RMSE %": 100.0 * truth.relative_rmse(image),
        }


def resolution_rows(
    view: Moving, method: AdaptiveVisibility, settings: Settings, output: Output
) -> Iterator[Row]:
    """Fig. 7: the maps of the same samples, filled in three ways."""
    stage = view.at(settings.frame)
    vertices, ids = Vertices.of(stage.scene), np.asarray(placed(method, stage).samples)
    ids = ids[:: max(len(ids) // settings.maps, 1)]
    places = vertices.places(method.alpha)
    filled(vertices, angular_of(method)._replace(fill="rasterized"), ids[:2], None)  # compiles
    for resolution in settings.resolutions or RESOLUTIONS:
        row: Row = {"scene": view.name, "texels a side": resolution, "maps": len(ids)}
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
    view: Moving, method: AdaptiveVisibility, settings: Settings, output: Output
) -> Iterator[Row]:
    """Fig. 8: ``mc-mis`` at equal quality and at equal time.

    Times are those of a frame placed anew, of one carried over from the frame before, and of
    shading alone; all of ``mc-mis`` counts.
    """
    stage = view.at(settings.frame)
    truth = Truth.of(stage, settings.error)
    anew = shaded(method, stage, settings.repeats)
    rmse = truth.relative_rmse(anew.image)
    before = placed(method, view.at(max(settings.frame - 1, 0)))
    carried = shaded(method, stage, settings.repeats, previous=before)
    noise = noise_of(stage, truth, settings)
    spp = noise.spp_at_rmse(rmse)
    needed, confirmed = noise.seconds(spp), None
    if needed < settings.limit:
        spp = max(1, round(spp))
        confirmed = monte_carlo(stage, spp)
        needed = confirmed.seconds
    usual = {
        "scene": view.name,
        "RMSE %": 100.0 * rmse,
        "dB": truth.psnr(anew.image),
        "mc spp": round(spp) if np.isfinite(spp) else spp,
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
        same = monte_carlo(stage, count)
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
    picture, folder = output.path(f"{view.name}.png"), output.path(view.name)
    if picture is not None and folder is not None:
        pictures = [anew.image, at_equal_time[0], at_equal_time[2], truth.image]
        write_strip(picture, stage, pictures, truth.image)
        write_page(folder, stage, method, noise.spp_at_seconds(anew.seconds), settings)


def monte_carlo(stage: Setting, spp: int) -> Shaded:
    """``mc-mis``, warm."""
    return shaded(MonteCarlo(spp=spp), stage)


def noise_of(stage: Setting, truth: Truth, settings: Settings) -> Noise:
    """What ``mc-mis`` does with few and more rays."""
    found = [monte_carlo(stage, spp) for spp in settings.spp]
    errors = [truth.relative_rmse(one.image) for one in found]
    return Noise.fit(settings.spp, errors, [one.seconds for one in found], truth.error)


def write_page(
    folder: Path, stage: Setting, method: AdaptiveVisibility, spp: int, settings: Settings
) -> None:
    """The usual page: the method beside ``mc-mis`` in as much time."""
    comparison = jaxvis.compare(
        stage.scene,
        stage.environment,
        [method, MonteCarlo(spp=spp)],
        stage.size,
        reference=f"reference:error={settings.error}",
        out=folder,
        progress=False,
    )
    jaxvis.write_report(comparison, folder, progress=False)


Part = Callable[[Moving, AdaptiveVisibility, Settings, Output], Iterator[Row]]

PARTS: dict[str, list[tuple[str, str, Part]]] = {
    "maps": [("maps", "Adaptive maps beside dense ones", maps_rows)],
    "placement": [("placement", "Placed samples beside every vertex in view", placement_rows)],
    "thresholds": [("thresholds", "Thresholds and resolution (fig. 6)", threshold_rows)],
    "resolution": [("resolution", "Filling maps (fig. 7)", resolution_rows)],
    "equal": [("equal", "Equal quality and equal time (fig. 8)", equal_rows)],
    "frames": [("frames", "Frames", frames_rows), ("parts", "What moves", part_rows)],
    "table1": [("table1", "Table 1", table_1_rows)],
}
"""Tables with the names of their files, by what is asked for."""


def measure(settings: Settings, output: Output) -> None:
    """The tables that were asked for, of all scenes."""
    environment = jaxvis.load_environment(settings.environment)
    method = registry.create(settings.method)
    if not isinstance(method, AdaptiveVisibility):
        raise ValueError(f"--method must be adaptive or shadow-map, got {settings.method!r}")
    width, height = settings.size
    output.say(f"{environment.name}, {width} x {height}, {method}")
    chosen = PARTS if "all" in settings.what else dict.fromkeys(settings.what)
    for what in chosen:
        for name, title, part in PARTS[what]:
            rows = []
            for scene in settings.scene:
                view = Moving(jaxvis.load_animation(scene), environment, settings.size)
                rows += part(view, method, settings, output)
            output.table(name, title, rows)


if __name__ == "__main__":
    execute(Settings, measure, __doc__)
