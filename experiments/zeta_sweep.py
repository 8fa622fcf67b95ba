"""What dividing triangles buys (paper 000, figs. 10, 11 and 13): PSNR, evaluations, frame time.

One row for every zeta and for evaluation at vertices and fragments, on the same visibility, light
and reference. PSNR must rise with zeta and end near the fragment image's. With --out it also writes
the pictures, the reference's among them, and a figure.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import jax
import numpy as np
from matplotlib.figure import Figure

import jaxvis
from experiments.measuring import median_seconds, reference_image, white, write_images
from experiments.output import Output, Row
from experiments.settings import Common, execute, setting
from jaxvis.image import exposure_of, psnr
from jaxvis.methods.vectorized import VectorizedVisibility
from jaxvis.scene import Scene


@dataclass(frozen=True)
class Settings(Common):
    scene: tuple[str, ...] = setting(("duck", "teapot"), "what is lit")
    environment: str = setting("stpeters", "what lights it")
    zeta: tuple[float, ...] = setting((0.0, 1.0, 2.0, 3.0, 4.0), "tessellation qualities")
    size: tuple[int, int] = setting((512, 512), "of the images", metavar=("W", "H"))
    vectors: int = setting(128, "most position vectors of a polygon")
    error: float = setting(0.005, "standard error of the reference, relative to its mean")
    repeats: int = setting(3, "timed calls")
    own_materials: bool = setting(False, "instead of white diffuse")


def sweep(
    scene: Scene, environment: jaxvis.Environment, settings: Settings, output: Output
) -> list[dict[str, object]]:
    """A row for each method; writes the pictures if wanted."""
    surface = jaxvis.trace_surface(scene, jaxvis.default_camera(scene), settings.size)
    truth = reference_image(scene, environment, surface, settings.error)
    covered = np.asarray(surface.coverage) > 0.0
    base = VectorizedVisibility(vectors=settings.vectors)
    visibility, light = base.precompute(scene, progress=False), base.light(environment)
    methods = {
        "vertex": replace(base, shading="vertex"),
        **{f"zeta {zeta:g}": replace(base, zeta=zeta) for zeta in settings.zeta},
        "fragment": replace(base, shading="fragment"),
    }
    rows, images = [], {"reference": truth}
    for name, method in methods.items():

        def shade(method=method) -> jax.Array:
            return method.shade(visibility, light, surface)

        images[name] = np.asarray(shade())
        rows.append(
            {
                "scene": scene.name,
                "shading": name,
                "PSNR dB": psnr(images[name], truth, covered),
                "evaluations": method.evaluations(visibility, light, surface),
                "frame s": median_seconds(shade, settings.repeats),
            }
        )
    write_images(output, scene.name, images, exposure_of(truth, covered))
    return rows


def draw(path: Path, rows: Sequence[Row]) -> None:
    """What the rows measured over the tessellation quality, a curve for each scene."""
    figure = Figure((12, 3.6), layout="constrained")
    axes = figure.subplots(1, 3)
    for scene in dict.fromkeys(row["scene"] for row in rows):
        part = [row for row in rows if row["scene"] == scene]
        shading = [row["shading"] for row in part]
        for axis, column in zip(axes, ("PSNR dB", "evaluations", "frame s"), strict=True):
            axis.plot(shading, [row[column] for row in part], marker="o", label=scene)
            axis.set_ylabel(column)
            axis.tick_params(axis="x", rotation=45)
    axes[1].set_yscale("log")
    axes[2].set_yscale("log")
    axes[0].legend()
    figure.savefig(path, dpi=120)


def run(settings: Settings, output: Output) -> None:
    """All scenes under one light."""
    environment = jaxvis.load_environment(settings.environment)
    rows = []
    for name in settings.scene:
        scene = jaxvis.load_scene(name)
        scene = scene if settings.own_materials else white(scene)
        rows += sweep(scene, environment, settings, output)
    size = f"{settings.size[0]} x {settings.size[1]}"
    output.say(f"{environment.name}, {size}, {settings.vectors} vectors")
    output.table("sweep", "Over the tessellation quality", rows)
    path = output.path("zeta_sweep.png")
    if path is not None:
        draw(path, rows)


if __name__ == "__main__":
    execute(Settings, run, __doc__)
