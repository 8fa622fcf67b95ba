"""Adaptive visibility from frame to frame: what carrying samples over costs and saves, and table 1.

Used by :mod:`experiments.adaptive_table`.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import jax
import numpy as np

from experiments.adaptive_runs import Moving, placed
from experiments.measuring import Row, resident_megabytes, seconds_of, stopwatch
from experiments.output import Output
from experiments.settings import Common, setting
from jaxvis.compare.setting import Setting
from jaxvis.image import relative_rmse
from jaxvis.methods.distance_field import AdaptiveVisibility, build
from jaxvis.methods.distance_field.field import DistanceFields
from jaxvis.scene.animation import moved_vertices
from jaxvis.sphere.gaussians import SphericalGaussians

PAPER_SAMPLE_BYTES = 34 * 1024
"""As the paper counts at 128 x 128: 2 KB of map and 32 KB of distances."""

PAPER_TABLE_1 = {
    "hat": (1282, 47, 95, 28, 5.9),
    "balls": (1824, 56, 183, 40, 3.6),
    "walker": (3527, 53, 557, 77, 1.5),
}
"""Samples, t_I, t_V and t_S in milliseconds, and frames a second on a GTX 680 at 640 x 480."""


@dataclass(frozen=True)
class FrameSettings(Common):
    frame: int = setting(12, "that stands still")
    repeats: int = setting(3, "of what is timed")
    frames: int = setting(8, "carried over; 60 show whether memory grows")
    every: int = setting(10, "frames to a row of --what frames")
    carried_only: bool = setting(False, "no frames placed anew, to look at memory")
    parts: int = setting(3, "that move alone, the largest")
    mean: int = setting(4, "frames that table 1 averages")


def frames_rows(
    view: Moving, method: AdaptiveVisibility, settings: FrameSettings, output: Output
) -> Iterator[Row]:
    """Samples carried from frame to frame; every so often a frame beside one placed anew.

    Memory is what the process holds after the frame. With ``--carried-only`` nothing is placed
    anew, so that it is that of the animation alone; programs for new lengths are compiled at first.
    """
    light = method.light(view.environment)
    fields = placed(method, view.at(settings.frame))
    last = settings.frame
    kept: Row = {"s": [], "shade s": [], "M rays": []}
    for frame in range(settings.frame + 1, settings.frame + settings.frames + 1):
        frame %= view.animation.frames
        stage, before = view.at(frame), fields
        fields, seconds = seconds_of(
            lambda s=stage, p=before: method.precompute_for(s.scene, s.surface, p, progress=False)
        )
        image, shade_s = seconds_of(lambda s=stage, f=fields: method.shade(f, light, s.surface))
        kept["s"].append(seconds)
        kept["shade s"].append(shade_s)
        kept["M rays"].append(fields.rays_traced / 1e6)
        number = len(kept["s"])
        if number % settings.every and number != settings.frames:
            last = frame
            continue
        moved = 100.0 * float(np.mean(view.animation.moved(last, frame)))
        last = frame
        row = {
            "scene": view.name,
            "frame": frame,
            "moved %": moved,
            "samples": len(fields.samples),
            **{f"carried {name}": float(np.median(values)) for name, values in kept.items()},
            "MB held": resident_megabytes(),
        }
        yield row if settings.carried_only else row | _beside(method, light, stage, fields, image)


def _beside(
    method: AdaptiveVisibility,
    light: SphericalGaussians,
    stage: Setting,
    fields: DistanceFields,
    image: jax.Array,
) -> Row:
    """Samples that were carried over beside ones placed anew."""
    fresh, seconds = seconds_of(lambda: placed(method, stage))
    other = method.shade(fresh, light, stage.surface)
    return {
        "anew": len(fresh.samples),
        "anew s": seconds,
        "anew M rays": fresh.rays_traced / 1e6,
        "rays %": 100.0 * fields.rays_traced / max(fresh.rays_traced, 1),
        "images differ %": 100.0 * relative_rmse(image, other, stage.covered),
    }


def part_rows(
    view: Moving, method: AdaptiveVisibility, settings: FrameSettings, output: Output
) -> Iterator[Row]:
    """The next frame if nothing, each of a few parts, or everything moves."""
    first = settings.frame
    second = (first + 1) % view.animation.frames
    before = placed(method, view.at(first))
    moving = view.animation.moved(first, second)
    share = np.bincount(view.animation.parts[moving], minlength=view.animation.parts.max() + 1)
    most = [int(p) for p in np.argsort(-share, kind="stable") if share[p]][: settings.parts]
    cases = {"nothing": view.with_part(-1, first, second)}
    cases |= {f"part {p}": view.with_part(p, first, second) for p in most}
    cases["all"] = view.animation.scene(second)
    here = view.animation.scene(first)
    for name, scene in cases.items():
        stage = view.of(scene)
        fields, seconds = seconds_of(
            lambda s=stage: method.precompute_for(s.scene, s.surface, before, progress=False),
            settings.repeats,
        )
        moved = moved_vertices(here, scene)
        yield {
            "scene": view.name,
            "what moves": name,
            "moved %": 100.0 * float(np.mean(moved)),
            "M rays": fields.rays_traced / 1e6,
            "rays % of placing": 100.0 * fields.rays_traced / max(before.rays_traced, 1),
            "s": seconds,
            "samples": len(fields.samples),
        }


def table_1_rows(
    view: Moving, method: AdaptiveVisibility, settings: FrameSettings, output: Output
) -> Iterator[Row]:
    """Means over a few frames, carried over and placed anew; the scene itself is not timed.

    t_V is the maps, t_S the distances, t_I the shading; "other" is where samples go and what they
    weigh. "MB by the paper" counts 34 KiB a sample, without the tree of triangles.
    """
    light = method.light(view.environment)
    before = placed(method, view.at(settings.frame))
    first = view.at(settings.frame)
    jax.block_until_ready(method.shade(before, light, first.surface))
    totals: dict[str, list[Row]] = {"carried": [], "anew": []}
    for frame in range(settings.frame + 1, settings.frame + settings.mean + 1):
        stage = view.at(frame % view.animation.frames)
        for name, previous in (("carried", before), ("anew", None)):
            with stopwatch(build, "fill_maps", "signed_distances") as spent:
                fields, seconds = seconds_of(
                    lambda s=stage, p=previous: method.precompute_for(
                        s.scene, s.surface, p, progress=False
                    )
                )
            method.shade(fields, light, stage.surface)  # compiles, where lengths are new
            _, shade_s = seconds_of(lambda s=stage, f=fields: method.shade(f, light, s.surface))
            maps_s, distances_s = spent["fill_maps"], spent["signed_distances"]
            totals[name].append(
                {
                    "pixels": int(stage.covered.sum()),
                    "vertices": len(fields.positions),
                    "samples": len(fields.samples),
                    "MB": fields.nbytes / 1e6,
                    "MB by the paper": len(fields.samples) * PAPER_SAMPLE_BYTES / 1e6,
                    "t_I ms": 1e3 * shade_s,
                    "t_V ms": 1e3 * maps_s,
                    "t_S ms": 1e3 * distances_s,
                    "other ms": 1e3 * (seconds - maps_s - distances_s),
                    "frame s": seconds + shade_s,
                }
            )
            if name == "carried":
                carried = fields
        before = carried
    for name, rows in totals.items():
        mean = {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}
        yield {"scene": view.name, "samples were": name, **mean, "FPS": 1.0 / mean["frame s"]}
    paper = PAPER_TABLE_1.get(view.name)
    if paper:
        names = ("samples", "t_I ms", "t_V ms", "t_S ms", "FPS")
        yield {
            "scene": view.name,
            "samples were": "paper's",
            **dict(zip(names, paper, strict=True)),
        }
