"""Pictures with the light evaluated at every pixel (paper 000, figs. 12 and 15).

Renders correspondence, vectorized and distance-field per fragment, and prints their PSNR against
the reference, evaluations and seconds. With --out it also writes the pictures and, for each scene,
a figure: the whole images, each beside its difference from the reference, and both again where the
reference's strongest shadow boundaries are.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

import jaxvis
from experiments.crops import smooth_parts, strongest_boundaries
from experiments.measuring import Image, best_of, reference_image, white, write_images
from experiments.output import Output, Row
from experiments.settings import Common, execute, setting
from jaxvis.image import display, displayed_error, exposure_of, psnr
from jaxvis.methods import create
from jaxvis.report.figures import error_map, error_scale
from jaxvis.scene import Scene, Surface

METHODS = {
    "correspondence": "correspondence:shading=fragment,vectors={vectors}",
    "vectorized": "vectorized:shading=fragment,vectors={vectors}",
    "distance-field": "distance-field",
}


@dataclass(frozen=True)
class Settings(Common):
    scene: tuple[str, ...] = setting(("duck", "teapot"), "what is lit")
    environment: str = setting("stpeters", "what lights it")
    size: tuple[int, int] = setting((256, 256), "of the images", metavar=("W", "H"))
    vectors: int = setting(128, "most position vectors of a polygon")
    error: float = setting(0.01, "standard error of the reference, relative to its mean")
    repeats: int = setting(5, "rounds of timing")
    own_materials: bool = setting(False, "instead of white diffuse")


def render(
    scene: Scene, environment: jaxvis.Environment, settings: Settings
) -> tuple[list[dict[str, Any]], dict[str, Image], Surface]:
    """A row for each method, and the images, the reference's first."""
    camera = jaxvis.default_camera(scene, aspect=settings.size[0] / settings.size[1])
    surface = jaxvis.trace_surface(scene, camera, settings.size)
    covered = np.asarray(surface.coverage) > 0.0
    images = {"reference": reference_image(scene, environment, surface, settings.error)}
    shades, rows = {}, []
    for name, spec in METHODS.items():
        method = create(spec.format(vectors=settings.vectors))
        visibility = method.precompute(scene, progress=False)
        light = method.light(environment)
        shades[name] = lambda m=method, v=visibility, l=light: np.asarray(m.shade(v, l, surface))
        images[name] = shades[name]()
        rows.append(
            {
                "scene": scene.name,
                "method": name,
                "PSNR dB": psnr(images[name], images["reference"], covered),
                "evaluations": method.evaluations(visibility, light, surface),
                "MB": visibility.nbytes / 1e6,
            }
        )
    for row, seconds in zip(rows, best_of(settings.repeats, *shades.values()), strict=True):
        row["frame s"] = seconds
    usual = next(row["frame s"] for row in rows if row["method"] == "vectorized")
    for row in rows:
        row["vectorized's / frame s"] = usual / row["frame s"]
    return rows, images, surface


def figure(
    images: Mapping[str, Image], rows: Sequence[Row], surface: Surface, exposure: float
) -> Figure:
    """A row for each image: all of it and two crops, each beside its difference."""
    reference, covered = images["reference"], np.asarray(surface.coverage) > 0.0
    height, width = covered.shape
    side = min(height, width) // 6
    inside = smooth_parts(surface)
    crops = strongest_boundaries(display(reference, exposure), inside, side, 2)
    windows = [(slice(0, height), slice(0, width))]
    windows += [(slice(r, r + side), slice(c, c + side)) for r, c in crops]
    drawing = Figure((2.7 * 2 * len(windows), 2.9 * len(images) + 0.7), layout="constrained")
    axes = drawing.subplots(len(images), 2 * len(windows), squeeze=False)
    captions = {row["method"]: f"{row['PSNR dB']:.2f} dB, {row['frame s']:.3g} s" for row in rows}
    for i, (name, image) in enumerate(images.items()):
        error = displayed_error(image, reference, covered, exposure)
        pictures = display(image, exposure), error_map(error, covered)
        for k, window in enumerate(windows):
            for j in range(2 if name != "reference" else 1):
                axes[i, 2 * k + j].imshow(pictures[j][window], interpolation="nearest")
        axes[i, 0].set_title(f"{name}  {captions.get(name, '')}", fontsize=10, loc="left")
    for axis in axes.flat:
        axis.set_axis_off()
    for row, column in crops:
        corner = column - 0.5, row - 0.5
        box = Rectangle(corner, side, side, fill=False, edgecolor="#ffb000", linewidth=1.2)
        axes[0, 0].add_patch(box)
    error_scale(drawing, axes, shrink=0.5)
    return drawing


def write(
    output: Output, name: str, images: Mapping[str, Image], rows: Sequence[Row], surface: Surface
) -> None:
    """Writes a scene's pictures and its figure, if files are wanted."""
    exposure = exposure_of(images["reference"], np.asarray(surface.coverage) > 0.0)
    write_images(output, name, images, exposure)
    path = output.path(f"{name}/per_fragment.png")
    if path is not None:
        figure(images, rows, surface, exposure).savefig(path, dpi=110, bbox_inches="tight")


def run(settings: Settings, output: Output) -> None:
    """All scenes under one light."""
    environment = jaxvis.load_environment(settings.environment)
    every = []
    for name in settings.scene:
        scene = jaxvis.load_scene(name)
        scene = scene if settings.own_materials else white(scene)
        rows, images, surface = render(scene, environment, settings)
        every += rows
        write(output, scene.name, images, rows, surface)
    size = f"{settings.size[0]} x {settings.size[1]}"
    output.say(f"{environment.name}, {size}, {settings.vectors} vectors")
    output.table("methods", "Per fragment", every)


if __name__ == "__main__":
    execute(Settings, run, __doc__)
