"""The sharpness of vsat's beta, fitted by gradient, over scenes, lights, resolutions and budgets.

Each row fits alpha' (paper 000, eq. 11) to random polygons of a scene, against the same polygons
with edges cut below a texel. Errors are root mean squares over the mean unoccluded irradiance, in
per cent: with beta = 1/2, at the paper's 5.8 / radian, with the fitted alpha', and with the fitted
alpha' over the edge's length. alpha' x edge length tells whether the constant is one of the edges
(5 is expected) or of the map. With --images, the last columns are the PSNR of fragment images by
vsat at 5.8, and what the fitted alpha' adds, against the image of the finely cut polygons
(integration alone) and against brute force (everything).
"""

from dataclasses import dataclass, replace
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np

import jaxvis
from experiments.measuring import WHITE, reference_image
from experiments.output import Output
from experiments.settings import Common, execute, setting
from jaxvis.image import psnr
from jaxvis.methods.vectorized import VectorizedVisibility, VisibilityPolygons, tuning
from jaxvis.methods.vectorized.light import PolygonLight
from jaxvis.scene import Scene
from jaxvis.sphere.contours import Lookup


@dataclass(frozen=True)
class Settings(Common):
    scene: tuple[str, ...] = setting(("duck", "teapot"), "whose polygons it is fitted to")
    environment: tuple[str, ...] = setting(("stpeters", "windows"), "what lights them, in turn")
    rows: tuple[int, ...] = setting((64, 256), "of the environment")
    vectors: tuple[int, ...] = setting((16, 32, 64, 128), "most position vectors of a polygon")
    lookup: Lookup = setting("nearest", "in the table of the light")
    polygons: int = setting(256, "that it is fitted to")
    steps: int = setting(40, "of the descent")
    seed: int = setting(0, "of the choice of polygons")
    images: bool = setting(False, "and what images gain")
    size: tuple[int, int] = setting((192, 192), "of the images", metavar=("W", "H"))
    error: float = setting(0.01, "standard error of the images' reference, relative to its mean")


def mean_edge(visibility: VisibilityPolygons) -> float:
    """Mean length of the edges, in radians; repeated vectors are none."""
    every = jnp.arange(len(visibility.counts))
    points = np.stack(tuning.own_outlines(visibility, every), axis=-1)
    lengths = np.linalg.norm(np.roll(points, -1, axis=1) - points, axis=-1)
    return float(lengths[lengths > 1e-4].mean())


def image_gain(
    scene: Scene,
    environment: jaxvis.Environment,
    visibility: VisibilityPolygons,
    lights: tuple[PolygonLight, PolygonLight],
    settings: Settings,
) -> dict[str, object]:
    """PSNR of the first light's image, and the second one's gain."""
    surface = jaxvis.trace_surface(scene, jaxvis.default_camera(scene), settings.size)
    covered = np.asarray(surface.coverage) > 0.0
    method = VectorizedVisibility(
        vectors=visibility.capacity,
        shading="fragment",
        integration="vsat",
        lookup=settings.lookup,
    )
    before, after = (np.asarray(method.shade(visibility, light, surface)) for light in lights)
    fine = replace(method, integration="split", pieces=8, lookup="bilinear")
    targets = {
        "integration": np.asarray(fine.shade(visibility, fine.light(environment), surface)),
        "image": reference_image(scene, environment, surface, settings.error),
    }
    row: dict[str, object] = {}
    for name, target in targets.items():
        at_paper = psnr(before, target, covered)
        row[f"{name} dB"] = at_paper
        row[f"{name} gain"] = psnr(after, target, covered) - at_paper
    return row


def tune(
    scene: Scene, environment: jaxvis.Environment, vectors: int, settings: Settings
) -> dict[str, object]:
    """One row."""
    method = VectorizedVisibility(vectors=vectors, lookup=settings.lookup, sharpness="paper")
    visibility, light = method.precompute(scene, progress=False), method.light(environment)
    key = jax.random.key(settings.seed)
    one, scaled = (
        tuning.fit_sharpness(
            visibility,
            light,
            key,
            scaled=scaled,
            polygons=settings.polygons,
            steps=settings.steps,
            lookup=settings.lookup,
        )
        for scaled in (False, True)
    )
    row: dict[str, object] = {
        "scene": scene.name,
        "environment": environment.name,
        "rows": environment.height,
        "vectors": vectors,
        "1/2": 100.0 * one.error_half,
        "5.8": 100.0 * one.error_before,
        "fitted": 100.0 * one.error_after,
        "alpha'": one.sharpness,
        "alpha' x edge": one.sharpness * mean_edge(visibility),
        "fitted /edge": 100.0 * scaled.error_after,
        "alpha' (/edge)": scaled.sharpness,
    }
    if settings.images:
        lights = (light, tuning.tuned(light, one))
        row |= image_gain(scene, environment, visibility, lights, settings)
    return row


def run(settings: Settings, output: Output) -> None:
    """All scenes, lights, resolutions and budgets."""
    rows = []
    for name in settings.scene:
        scene = jaxvis.load_scene(name).with_albedo(WHITE)
        for light, height, vectors in product(
            settings.environment, settings.rows, settings.vectors
        ):
            environment = jaxvis.load_environment(light).resize(height)
            rows.append(tune(scene, environment, vectors, settings))
    output.table("sharpness", "Errors in per cent, by the sharpness of beta", rows)


if __name__ == "__main__":
    execute(Settings, run, __doc__)
