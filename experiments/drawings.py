"""Drawings of what the methods store (paper 001, fig. 4; paper 002, figs. 4 and 5).

The masks of one layer of a visibility field's cells; a sample's visibility map at every level of
its refinement, with the rays that were traced, and its signed distances; the samples that adaptive
sampling placed, on the picture that they light. With --out the drawings are written; tables say
what is in them.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

import jaxvis
from experiments.adaptive_runs import placed
from experiments.output import Output, Row
from experiments.settings import Common, execute, setting
from experiments.visibility_field_runs import SPONZA_CELL
from jaxvis.compare.result import composite
from jaxvis.compare.setting import Setting, prepare
from jaxvis.image import exposure_of
from jaxvis.methods.distance_field import AdaptiveVisibility
from jaxvis.methods.distance_field.build import Vertices
from jaxvis.methods.distance_field.field import DistanceFields
from jaxvis.methods.distance_field.maps import adaptive_maps
from jaxvis.methods.visibility_field.field import FieldVisibility
from jaxvis.scene import RayTracer, Scene

STATES = ("nobody looked", "visible", "occluded", "both")
STATE_COLOURS = ListedColormap(["#d9d9d9", "#f5c542", "#35557a", "#a03c78"])
NO_SURFACE = "#ffffff"

SKY, SOLID, TRACED = (0.97, 0.97, 0.97), (0.25, 0.28, 0.33), (0.84, 0.15, 0.16)
COARSEST = 16


@dataclass(frozen=True)
class Settings(Common):
    scene: str = setting("sponza", "whose visibility field is drawn")
    samples: float = setting(1_000_000, "points of its surface")
    height: float = setting(0.3, "of the layer that is drawn, 0 lowest, 1 highest")
    moving: str = setting("hat", "whose visibility maps and samples are drawn")
    environment: str = setting("windows", "what lights it")
    frame: int = setting(12, "of the moving scene")
    size: tuple[int, int] = setting((320, 240), "of the picture", metavar=("W", "H"))
    resolution: int = setting(128, "texels along a side of a visibility map")


def tiled(field: FieldVisibility, height: int) -> Int[np.ndarray, "rows columns"]:
    """The masks of one layer side by side, seen from above: +X to the right, +Z down, and in each
    cell the octahedral map with +Y up; -1 where there is no surface."""
    x, y, z = np.unravel_index(field.keys, field.grid.shape)
    texels = field.texels()
    side = texels.shape[1]
    columns, _, rows = field.grid.shape
    drawn = np.full((rows, side, columns, side), -1)
    for row in np.flatnonzero(y == height):
        drawn[z[row], :, x[row], :] = texels[row].T[::-1]
    return drawn.reshape(rows * side, columns * side)


def draw_layer(states: Int[np.ndarray, "rows columns"], title: str) -> Figure:
    """Fig. 4 of paper 001."""
    rows, columns = states.shape
    drawing = Figure((11, 1.4 + 11 * rows / columns), layout="constrained")
    axis = drawing.subplots()
    shown = axis.imshow(
        np.ma.masked_less(states, 0), cmap=STATE_COLOURS, vmin=-0.5, vmax=3.5, interpolation="none"
    )
    axis.set_facecolor(NO_SURFACE)
    axis.set_xticks([])
    axis.set_yticks([])
    axis.set_title(title)
    bar = drawing.colorbar(
        shown, ax=axis, ticks=range(4), orientation="horizontal", shrink=0.5, aspect=40
    )
    bar.ax.set_xticklabels(STATES)
    return drawing


class Recording(RayTracer):
    """A tracer that remembers the directions it was asked about."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene.positions, scene.triangles, threads=1)
        self.directions: list[Float[np.ndarray, "rays 3"]] = []

    def occluded_block(self, origins, directions, *others):
        self.directions.append(directions)
        return super().occluded_block(origins, directions, *others)


@dataclass(frozen=True)
class Level:
    """A visibility map as one level of the refinement leaves it, and the texels traced for it."""

    seen: Bool[np.ndarray, "n n"]
    traced: Bool[np.ndarray, "n n"]


def levels(vertices: Vertices, vertex: int, resolution: int) -> list[Level]:
    """The refinement of one vertex's map, from the coarsest level on."""
    views = vertices.views(np.asarray([vertex]))
    tracer = Recording(vertices.scene)
    found: list[Level] = []
    for side in (COARSEST << k for k in range((resolution // COARSEST).bit_length())):
        tracer.directions.clear()
        maps = adaptive_maps(tracer, views, side, COARSEST).maps
        # Every level's rays come in one block, the finest one's last.
        local = tracer.directions[-1] @ views.frames[0].T
        theta = np.arccos(np.clip(local[:, 0], -1.0, 1.0))
        phi = np.arctan2(local[:, 2], local[:, 1])
        traced = np.zeros((side, side), np.bool_)
        traced[(theta * side / np.pi).astype(int), (phi * side / np.pi).astype(int)] = True
        found.append(Level(maps[0], traced))
    return found


def busiest(fields: DistanceFields) -> int:
    """The sample with the longest boundary."""
    maps = fields.maps()
    changes = [np.count_nonzero(np.diff(maps, axis=axis), axis=(1, 2)) for axis in (1, 2)]
    return int(np.argmax(sum(changes)))


def draw_levels(
    refined: list[Level], signed_distance: Float[np.ndarray, "n n"], title: str
) -> Figure:
    """Fig. 4 of paper 002: what was traced in red, and the signed distances of the last map."""
    drawing = Figure((3.0 * (len(refined) + 1), 3.7), layout="constrained")
    axes = drawing.subplots(1, len(refined) + 1)
    for axis, level in zip(axes, refined, strict=False):
        shown = np.where(level.seen[..., None], SKY, SOLID)
        traced = level.traced & (level is not refined[0])
        shown = np.where(traced[..., None], 0.35 * shown + 0.65 * np.asarray(TRACED), shown)
        axis.imshow(shown, interpolation="none")
        side, rays = len(level.seen), np.count_nonzero(level.traced)
        axis.set_title(f"{side} x {side}: {rays:,} rays")
    degrees = np.degrees(signed_distance.astype(np.float32))
    last = axes[-1].imshow(degrees, cmap="RdBu", vmin=-60, vmax=60, interpolation="none")
    axes[-1].set_title("signed distance")
    drawing.colorbar(last, ax=axes[-1], label="degrees", shrink=0.8)
    for axis in axes:
        axis.set_xticks([])
        axis.set_yticks([])
    drawing.suptitle(title)
    return drawing


def pixels_of(stage: Setting, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "seen 2"]:
    """The pixel (column, row) that sees each point, without points that none sees."""
    position = np.asarray(stage.surface.position).reshape(*stage.covered.shape, 3)
    row, column = np.nonzero(stage.covered)
    distance, nearest = cKDTree(position[stage.covered]).query(points)
    tolerance = 2.0 * np.median(np.linalg.norm(np.diff(position, axis=1), axis=-1))
    chosen = nearest[distance < tolerance]
    return np.stack([column[chosen], row[chosen]], axis=1).astype(float)


def draw_samples(
    picture: Float[np.ndarray, "height width 3"], at: Float[np.ndarray, "samples 2"], title: str
) -> Figure:
    """Fig. 5 of paper 002: the picture, and the samples that it shows."""
    height, width, _ = picture.shape
    drawing = Figure((11, 0.6 + 5.5 * height / width), layout="constrained")
    plain, dotted = drawing.subplots(1, 2)
    for axis in (plain, dotted):
        axis.imshow(picture)
        axis.set_axis_off()
    dotted.scatter(at[:, 0], at[:, 1], s=5, c="#d62728", linewidths=0)
    drawing.suptitle(title)
    return drawing


def write(output: Output, name: str, drawing: Figure) -> None:
    """Writes a drawing, if files are wanted."""
    path = output.path(f"{name}.png")
    if path is not None:
        drawing.savefig(path, dpi=110)


def draw_field(settings: Settings, output: Output) -> None:
    """Fig. 4 of paper 001."""
    if not 0.0 <= settings.height <= 1.0:
        raise ValueError(f"--height must be from 0 to 1, got {settings.height:g}")
    scene = jaxvis.load_scene(settings.scene)
    cell = SPONZA_CELL if scene.name == "sponza" else None
    method = jaxvis.VisibilityField(cell=cell, samples=int(settings.samples))
    field = method.precompute(scene, progress=False)
    height = int(settings.height * (field.grid.shape[1] - 1))
    states = tiled(field, height)
    cells = int(np.count_nonzero(np.unravel_index(field.keys, field.grid.shape)[1] == height))
    row: Row = {"scene": scene.name, "layer": height, "of": field.grid.shape[1], "cells": cells}
    kept = states[states >= 0]
    row |= {f"{name} %": 100.0 * float(np.mean(kept == k)) for k, name in enumerate(STATES)}
    output.table("layer", "Masks of a layer of cells (fig. 4 of paper 001)", [row])
    title = f"{scene.name}: layer {height} of {field.grid.shape[1]}, {cells} cells"
    write(output, f"{scene.name}-layer", draw_layer(states, title))


def draw_adaptive(settings: Settings, output: Output) -> None:
    """Figs. 4 and 5 of paper 002."""
    scene = jaxvis.load_animation(settings.moving).scene(settings.frame)
    stage = prepare(scene, jaxvis.load_environment(settings.environment), settings.size)
    method = AdaptiveVisibility(resolution=settings.resolution)
    fields = placed(method, stage)
    sample = busiest(fields)
    vertices = Vertices.of(scene)
    refined = levels(vertices, int(np.asarray(fields.samples)[sample]), settings.resolution)
    rows: list[Row] = [
        {
            "texels a side": len(level.seen),
            "rays": np.count_nonzero(level.traced),
            "of all %": 100.0 * float(level.traced.mean()),
            "sky %": 100.0 * float(level.seen.mean()),
        }
        for level in refined
    ]
    output.table("levels", "A map and its rays, level by level (fig. 4 of paper 002)", rows)
    distance = np.asarray(fields.signed_distance[sample], np.float32)
    title = f"{scene.name}: the sample with the longest boundary; traced texels in red"
    write(output, f"{scene.name}-levels", draw_levels(refined, distance, title))

    at = pixels_of(stage, np.asarray(fields.positions)[np.asarray(fields.samples)])
    image = np.asarray(method.shade(fields, method.light(stage.environment), stage.surface))
    count, total = len(fields.samples), len(fields.positions)
    row: Row = {"scene": scene.name, "samples": count, "in the picture": len(at)}
    row |= {"vertices": total, "samples, of the vertices %": 100.0 * count / total}
    output.table("samples", "Samples placed (fig. 5 of paper 002)", [row])
    exposure = exposure_of(image, stage.covered)
    shown = composite(image, stage.coverage, stage.background, exposure)
    title = f"{scene.name}: {count:,} samples for {total:,} vertices, {len(at):,} in the picture"
    write(output, f"{scene.name}-samples", draw_samples(shown, at, title))


def run(settings: Settings, output: Output) -> None:
    """All drawings."""
    draw_field(settings, output)
    draw_adaptive(settings, output)


if __name__ == "__main__":
    execute(Settings, run, __doc__)
