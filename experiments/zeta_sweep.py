"""What dividing triangles buys (paper 000, figs. 10, 11 and 13): PSNR, evaluations, frame time.

One row for every zeta and for evaluation at vertices and fragments, on the same visibility, light
and reference. PSNR must rise with zeta and end near the fragment image's. With --out it also writes
the pictures, the reference's among them, and a figure.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pandas as pd
from jaxtyping import Float

import jaxvis
from jaxvis.image import display, psnr, write_image
from jaxvis.image.tonemap import exposure_of
from jaxvis.methods import Reference
from jaxvis.methods.vectorized import VectorizedVisibility
from jaxvis.reflectance import Lambert
from jaxvis.scene import Scene, Surface

Image = Float[np.ndarray, "height width 3"]


def white(scene: Scene, albedo: float = 0.8) -> Scene:
    """The scene in one diffuse grey; materials keep their sides."""
    grey = tuple(
        jaxvis.Material(base_colour=(albedo,) * 3, two_sided=m.two_sided) for m in scene.materials
    )
    return replace(scene.with_materials(grey), colours=None, reflectance=Lambert())


def median_seconds(function: Callable[[], object], repeats: int) -> float:
    """Of warm calls: the first one compiles and is not counted."""
    jax.block_until_ready(function())
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        jax.block_until_ready(function())
        seconds.append(time.perf_counter() - start)
    return float(np.median(seconds))


def reference_image(
    scene: Scene, environment: jaxvis.Environment, surface: Surface, error: float
) -> Image:
    """Ground truth, from the disk if it was computed before."""
    truth = Reference(error=error)
    solution, _ = truth.solve_cached(truth.precompute(scene), truth.light(environment), surface)
    return np.asarray(solution.image)


def sweep(
    scene: Scene, environment: jaxvis.Environment, options: argparse.Namespace
) -> list[dict[str, object]]:
    """A row for each method; writes the pictures if wanted."""
    surface = jaxvis.trace_surface(scene, jaxvis.default_camera(scene), tuple(options.size))
    truth = reference_image(scene, environment, surface, options.error)
    covered = np.asarray(surface.coverage) > 0.0
    base = VectorizedVisibility(vectors=options.vectors)
    visibility, light = base.precompute(scene, progress=False), base.light(environment)
    methods = {
        "vertex": replace(base, shading="vertex"),
        **{f"zeta {zeta:g}": replace(base, zeta=zeta) for zeta in options.zeta},
        "fragment": replace(base, shading="fragment"),
    }
    rows, pictures = [], {"reference": truth}
    for name, method in methods.items():

        def shade(method=method) -> jax.Array:
            return method.shade(visibility, light, surface)

        image = np.asarray(shade())
        pictures[name] = image
        rows.append(
            {
                "scene": scene.name,
                "shading": name,
                "PSNR dB": psnr(image, truth, covered),
                "evaluations": method.evaluations(visibility, light, surface),
                "frame s": median_seconds(shade, options.repeats),
            }
        )
    if options.out:
        _write(pictures, Path(options.out) / scene.name, exposure_of(truth, covered))
    return rows


def _write(pictures: dict[str, Image], folder: Path, exposure: float) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, image in pictures.items():
        write_image(folder / f"{name.replace(' ', '-')}.png", display(image, exposure))


def _figure(table: pd.DataFrame, path: Path) -> None:
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(12, 3.6), layout="constrained")
    for scene, part in table.groupby("scene"):
        for axis, column in zip(axes, ("PSNR dB", "evaluations", "frame s"), strict=True):
            axis.plot(part["shading"], part[column], marker="o", label=scene)
            axis.set_ylabel(column)
            axis.tick_params(axis="x", rotation=45)
    axes[1].set_yscale("log")
    axes[2].set_yscale("log")
    axes[0].legend()
    figure.savefig(path, dpi=120)
    plt.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", nargs="+", default=["duck", "teapot"])
    parser.add_argument("--environment", default="stpeters")
    parser.add_argument("--zeta", nargs="+", type=float, default=[0.0, 1.0, 2.0, 3.0, 4.0])
    parser.add_argument("--size", nargs=2, type=int, default=[512, 512], metavar=("W", "H"))
    parser.add_argument("--vectors", type=int, default=128)
    parser.add_argument("--error", type=float, default=0.005, help="of the reference")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--own-materials", action="store_true", help="instead of white diffuse")
    parser.add_argument("--quick", action="store_true", help="the teapot at 192 x 192")
    parser.add_argument("--out", help="folder for the pictures and the figure")
    options = parser.parse_args()
    if options.quick:
        options.scene, options.size, options.error = ["teapot"], [192, 192], 0.01
    environment = jaxvis.load_environment(options.environment)
    rows = []
    for name in options.scene:
        scene = jaxvis.load_scene(name)
        rows += sweep(scene if options.own_materials else white(scene), environment, options)
    table = pd.DataFrame(rows)
    print(f"{environment.name}, {options.size}, {options.vectors} vectors")
    print(table.to_string(index=False, float_format="{:.4g}".format))
    if options.out:
        _figure(table, Path(options.out) / "zeta_sweep.png")


if __name__ == "__main__":
    main()
