"""What the tables of visibility fields share: views, timed pairs of frames, timed precomputation.

Used by :mod:`experiments.visibility_field_table`.
"""

import contextlib
import os
import resource
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Bool

import jaxvis
from experiments.measuring import Image, Row
from jaxvis.image import display, write_image
from jaxvis.image.metrics import relative_rmse
from jaxvis.image.tonemap import exposure_of
from jaxvis.methods.visibility_field import FieldVisibility
from jaxvis.methods.visibility_field.build import BATCH, DRAWN, TRACED, Settings
from jaxvis.methods.visibility_field.grid import Grid
from jaxvis.methods.visibility_field.samples import Samples, draw, hemisphere_rays
from jaxvis.methods.visibility_field.samples import Surface as Sampled
from jaxvis.reflectance import Lambert
from jaxvis.sampling import hammersley
from jaxvis.sampling.hemisphere import sample_uniform
from jaxvis.scene import Camera, Scene, Surface

PAPER: Row = {"labels": "paper", "conservative": False, "sampling": "random", "dilation": "full"}
"""What makes the method the paper's."""

KILOBYTE = 1024
"""As the paper counts: 77 x 48 x 34 cells of 400 bytes are 49,088 KB."""

DIFFERS = 1e-5
"""Difference, in parts of the image's mean, from which on a pixel counts as another."""

DIFFERENCE = 5.0
"""By which the differences of displayed images are enlarged, about a middle grey."""

SPONZA_CELL = 50.0
"""The paper's, in centimetres."""

SPONZA_VIEWS = {
    "upper": Camera((-900.0, 900.0, -38.0), (500.0, 300.0, -38.0), field_of_view=1.2),
    "floor": Camera((900.0, 170.0, -40.0), (-900.0, 400.0, -40.0), field_of_view=1.1),
    "roof": Camera((0.0, 1600.0, -1100.0), (0.0, 1300.0, 600.0), field_of_view=1.2),
}
"""Besides the default one: along the atrium from high up and from near the floor, and over the
roof, where most directions are visible and labels matter (paper 001, fig. 9)."""

REPLAYED = 4
"""Batches of samples whose rays are traced alone, at most."""

BLOCKS_AT_ONCE = 32
"""Blocks of rays that are held to be traced alone: about 50 MB."""


@dataclass(frozen=True)
class View:
    """A picture to make: a scene from one place under one light."""

    scene: Scene
    name: str
    surface: Surface
    environment: jaxvis.Environment

    @property
    def covered(self) -> Bool[np.ndarray, "height width"]:
        """Pixels that see the scene."""
        return np.asarray(self.surface.coverage) > 0.0

    def diffuse(self) -> "View":
        """The same with every material diffuse."""
        surface = replace(self.surface, reflectance=Lambert())
        return replace(self, scene=self.scene.with_reflectance(Lambert()), surface=surface)


def views_of(
    scene: Scene, environment: jaxvis.Environment, size: Sequence[int], names: Sequence[str]
) -> list[View]:
    """The views with these names; those of Sponza are left out elsewhere, the default one never."""
    width, height = size
    cameras = {"default": jaxvis.default_camera(scene, aspect=width / height)}
    if scene.name == "sponza":
        cameras |= SPONZA_VIEWS
    wanted = dict.fromkeys(name for name in names if name in cameras) or ["default"]
    return [
        View(scene, name, jaxvis.trace_surface(scene, cameras[name], (width, height)), environment)
        for name in wanted
    ]


def precomputed(scene: Scene, method: jaxvis.VisibilityField) -> tuple[FieldVisibility, Row]:
    """The field, and what it took: seconds, of them in Embree (mean over the threads)."""
    tracer = scene.tracer
    rays, embree, start = tracer.rays_traced, tracer.embree_seconds, time.perf_counter()
    visibility = method.precompute(scene, progress=False)
    seconds = time.perf_counter() - start
    if tracer.rays_traced == rays:
        return visibility, {"precompute s": "cached", "Embree s": 0.0}
    return visibility, {
        "precompute s": seconds,
        "Embree s": (tracer.embree_seconds - embree) / tracer.threads,
    }


@contextlib.contextmanager
def empty_cache() -> Iterator[None]:
    """A cache of results that is empty at first and gone afterwards."""
    before = os.environ.get("JAXVIS_CACHE")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["JAXVIS_CACHE"] = folder
        try:
            yield
        finally:
            del os.environ["JAXVIS_CACHE"]
            if before is not None:
                os.environ["JAXVIS_CACHE"] = before


def peak_megabytes() -> float:
    """The most memory that this process has held so far (10^6 bytes; Linux)."""
    return 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6


def edge_of(method: jaxvis.VisibilityField) -> float:
    """The edge of the field's cells, which experiments always give."""
    if method.cell is None:
        raise ValueError("cell must be given, in the scene's units")
    return method.cell


def settings_of(method: jaxvis.VisibilityField) -> Settings:
    """How its surface is sampled and traced."""
    return Settings(
        edge_of(method), method.masks, method.samples, method.rays, method.sampling, method.seed
    )


def seconds_alone(scene: Scene, settings: Settings, batches: int = REPLAYED) -> float:
    """Seconds to trace the rays of a precomputation in all threads and do nothing else.

    The rays, their order and the blocks in which they are traced are those of
    :func:`jaxvis.methods.visibility_field.build.trace_masks`. Of many batches only a few, evenly
    spaced, are traced and stand for the others.
    """
    tracer, total = scene.tracer, settings.samples
    grid = Grid.covering(scene.positions, settings.edge)
    sampled = Sampled.of(scene, grid, settings.sampling)
    hemisphere = np.asarray(sample_uniform(hammersley(settings.rays)))
    block = max(1, TRACED // settings.rays)
    starts = range(0, total, BATCH)
    chosen = starts[:: -(-len(starts) // batches)]
    seconds, traced = 0.0, 0
    with ThreadPoolExecutor(tracer.threads) as pool:
        for start in chosen:
            stop = min(start + BATCH, total)
            firsts = range(start, stop, DRAWN)
            parts = [
                draw(sampled, grid, i, min(i + DRAWN, stop), total=total, seed=settings.seed)
                for i in firsts
            ]
            samples = Samples(*map(np.concatenate, zip(*parts, strict=True))).by_cell()
            for first in range(0, stop - start, BLOCKS_AT_ONCE * block):
                last = min(first + BLOCKS_AT_ONCE * block, stop - start)
                rays = [
                    hemisphere_rays(samples, slice(i, min(i + block, last)), hemisphere)
                    for i in range(first, last, block)
                ]
                begin = time.perf_counter()
                list(pool.map(lambda pair: tracer.occluded_block(*pair), rays))
                seconds += time.perf_counter() - begin
            traced += stop - start
    return seconds * total / traced


def same_without_field(method: jaxvis.VisibilityField) -> jaxvis.Unculled:
    """What the method is compared with."""
    return jaxvis.Unculled(
        spp=method.spp, lighting=method.lighting, rays_per_chunk=method.rays_per_chunk
    )


def exact_in_places(method: jaxvis.VisibilityField, surface: Surface) -> bool:
    """Whether some cells have exact irradiance (eq. 11), so that noise differs, too."""
    simple = method.lighting == "harmonics" and isinstance(surface.reflectance, Lambert)
    return simple and method.control_variate and method.labels in ("paper", "balanced")


def pixels_that_differ(
    image: Image, other: Image, covered: Bool[np.ndarray, "height width"]
) -> float:
    """Of 10,000 covered pixels, those with a channel off by more than :data:`DIFFERS`."""
    mean = float(np.mean(other[covered]))
    return 1e4 * float(np.mean(np.abs(image - other)[covered].max(axis=-1) > DIFFERS * mean))


def compare(
    view: View,
    method: jaxvis.VisibilityField,
    repeats: int,
    *,
    seed: int = 0,
    picture: Path | None = None,
) -> Row:
    """A row: frames with and without the field, from the same rays.

    Seconds are medians of warm frames, the two taking turns, and the ratio is the median of the
    pairs' ratios. "RMSE %" is of the image's mean. "culls %" and the pixels that differ tell what
    wrong decisions alone do: cells of label 0 take their irradiance from the same rays there.
    Memory is in KB of 1024 bytes.
    """
    visibility, cost = precomputed(view.scene, method)
    plain = same_without_field(method)
    bare, light = plain.precompute(view.scene, progress=False), method.light(view.environment)
    key = jax.random.key(seed)

    def culled(method: jaxvis.VisibilityField = method) -> Image:
        return np.asarray(method.shade(visibility, light, view.surface, key=key))

    def unculled() -> Image:
        return np.asarray(plain.shade(bare, light, view.surface, key=key))

    tracer, images, rays = view.scene.tracer, [], []
    for frame in (unculled, culled):
        before = tracer.rays_traced
        images.append(frame())
        rays.append(tracer.rays_traced - before)
    seconds = np.array([[_seconds(unculled), _seconds(culled)] for _ in range(repeats)])
    without, with_field = images
    same_noise = with_field
    if exact_in_places(method, view.surface):
        same_noise = culled(replace(method, control_variate=False))
    if picture is not None:
        write_pictures(picture, with_field, without, view.covered)
    return {
        "view": view.name,
        "spp": method.spp,
        "unculled s": np.median(seconds[:, 0]),
        "field s": np.median(seconds[:, 1]),
        "ratio": np.median(seconds[:, 0] / seconds[:, 1]),
        "% traced": 100.0 * rays[1] / max(rays[0], 1),
        "RMSE %": 100.0 * relative_rmse(with_field, without, view.covered),
        "culls %": 100.0 * relative_rmse(same_noise, without, view.covered),
        "differ/10k": pixels_that_differ(same_noise, without, view.covered),
        "KB": round(visibility.nbytes / KILOBYTE),
        "% of dense": 100.0 * visibility.nbytes / visibility.dense_bytes,
        "dense KB": round(visibility.dense_bytes / KILOBYTE),
        "precompute s": cost["precompute s"],
    }


def _seconds(frame: Any) -> float:
    start = time.perf_counter()
    frame()
    return time.perf_counter() - start


def write_pictures(
    stem: Path, culled: Image, unculled: Image, covered: Bool[np.ndarray, "height width"]
) -> None:
    """Both images, with the exposure of the second, and their difference enlarged."""
    exposure = exposure_of(unculled, covered)
    shown, right = (np.asarray(display(image, exposure)) for image in (culled, unculled))
    write_image(stem.with_name(f"{stem.name}-culled.png"), shown)
    write_image(stem.with_name(f"{stem.name}-unculled.png"), right)
    difference = (0.5 + DIFFERENCE * (shown - right)).clip(0.0, 1.0)
    write_image(stem.with_name(f"{stem.name}-difference.png"), difference)
