"""The sharpness of vsat's beta, fitted by gradient, over scenes, lights, resolutions and budgets.

Each row fits alpha' (paper 000, eq. 11) to random polygons of a scene, against the same polygons
with edges cut below a texel. Errors are root mean squares over the mean unoccluded irradiance, in
per cent: with beta = 1/2, at the paper's 5.8 / radian, with the fitted alpha', and with the fitted
alpha' over the edge's length. alpha' x edge length tells whether the constant is one of the edges
(5 is expected) or of the map. With --images, the last columns are the PSNR of fragment images by
vsat at 5.8, and what the fitted alpha' adds, against the image of the finely cut polygons
(integration alone) and against brute force (everything).
"""

import argparse
from dataclasses import replace
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd

import jaxvis
from experiments.zeta_sweep import reference_image, white
from jaxvis.image import psnr
from jaxvis.methods.vectorized import VectorizedVisibility, VisibilityPolygons, tuning
from jaxvis.methods.vectorized.light import PolygonLight
from jaxvis.scene import Scene


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
    options: argparse.Namespace,
) -> dict[str, object]:
    """PSNR of the first light's image, and the second one's gain."""
    surface = jaxvis.trace_surface(scene, jaxvis.default_camera(scene), tuple(options.size))
    covered = np.asarray(surface.coverage) > 0.0
    method = VectorizedVisibility(
        vectors=visibility.capacity,
        shading="fragment",
        integration="vsat",
        lookup=options.lookup,
    )
    before, after = (np.asarray(method.shade(visibility, light, surface)) for light in lights)
    fine = replace(method, integration="split", pieces=8, lookup="bilinear")
    targets = {
        "integration": np.asarray(fine.shade(visibility, fine.light(environment), surface)),
        "image": reference_image(scene, environment, surface, options.error),
    }
    row: dict[str, object] = {}
    for name, target in targets.items():
        at_paper = psnr(before, target, covered)
        row[f"{name} dB"] = at_paper
        row[f"{name} gain"] = psnr(after, target, covered) - at_paper
    return row


def tune(
    scene: Scene, environment: jaxvis.Environment, vectors: int, options: argparse.Namespace
) -> dict[str, object]:
    """One row."""
    method = VectorizedVisibility(vectors=vectors, lookup=options.lookup, sharpness="paper")
    visibility, light = method.precompute(scene, progress=False), method.light(environment)
    key = jax.random.key(options.seed)
    one, scaled = (
        tuning.fit_sharpness(
            visibility,
            light,
            key,
            scaled=scaled,
            polygons=options.polygons,
            steps=options.steps,
            lookup=options.lookup,
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
    if options.images:
        lights = (light, tuning.tuned(light, one))
        row |= image_gain(scene, environment, visibility, lights, options)
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", nargs="+", default=["duck", "teapot"])
    parser.add_argument("--environment", nargs="+", default=["stpeters", "windows"])
    parser.add_argument("--rows", nargs="+", type=int, default=[64, 256])
    parser.add_argument("--vectors", nargs="+", type=int, default=[16, 32, 64, 128])
    parser.add_argument("--lookup", choices=["nearest", "bilinear"], default="nearest")
    parser.add_argument("--polygons", type=int, default=256)
    parser.add_argument("--steps", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0, help="of the choice of polygons")
    parser.add_argument("--images", action="store_true", help="and what images gain")
    parser.add_argument("--size", nargs=2, type=int, default=[192, 192], metavar=("W", "H"))
    parser.add_argument("--error", type=float, default=0.01, help="of the images' reference")
    parser.add_argument("--quick", action="store_true", help="teapot, windows, 256 rows")
    options = parser.parse_args()
    if options.quick:
        options.scene, options.environment, options.rows = ["teapot"], ["windows"], [256]
    rows = []
    for name in options.scene:
        scene = white(jaxvis.load_scene(name))
        for light, height, vectors in product(options.environment, options.rows, options.vectors):
            environment = jaxvis.load_environment(light).resize(height)
            rows.append(tune(scene, environment, vectors, options))
    print(pd.DataFrame(rows).to_string(index=False, float_format="{:.4g}".format))


if __name__ == "__main__":
    main()
