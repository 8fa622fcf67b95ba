"""Pictures with the light evaluated at every pixel (paper 000, figs. 12 and 15).

Renders correspondence, vectorized and distance-field per fragment, and prints their PSNR against
the reference, evaluations and seconds. With --out it also writes the pictures and, for each scene,
a figure: the whole images, each beside its difference from the reference, and both again where the
reference's strongest shadow boundaries are.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from experiments.crops import smooth_parts, strongest_boundaries
from experiments.measuring import WHITE, Image
from experiments.output import Output, Row
from experiments.settings import execute, setting
from experiments.sweeping import Sweeping, Swept, folder_of, swept
from jaxvis.compare import prepare
from jaxvis.image import display, displayed_error, exposure_of
from jaxvis.report.figures import error_map, error_scale
from jaxvis.scene import Surface
from jaxvis.sweep import Grid

METHODS = {
    "correspondence": "correspondence:shading=fragment,vectors={vectors}",
    "vectorized": "vectorized:shading=fragment,vectors={vectors}",
    "distance-field": "distance-field",
}


@dataclass(frozen=True)
class Settings(Sweeping):
    scene: tuple[str, ...] = setting(("duck", "teapot"), "what is lit")
    environment: str = setting("stpeters", "what lights it")
    size: tuple[int, int] = setting((256, 256), "of the images", metavar=("W", "H"))
    vectors: int = setting(128, "most position vectors of a polygon")
    error: float = setting(0.01, "standard error of the reference, relative to its mean")
    own_materials: bool = setting(False, "instead of white diffuse")


def grid_of(settings: Settings) -> Grid:
    """The rows: for each scene, the methods in their order."""
    return Grid(
        tuple(spec.format(vectors=settings.vectors) for spec in METHODS.values()),
        settings.scene,
        (settings.environment,),
        size=settings.size,
        albedo=None if settings.own_materials else WHITE,
        reference=f"reference:error={settings.error}",
    )


def table_of(found: Sequence[Row]) -> list[Row]:
    """The rows of one scene, and how much faster than ``vectorized`` each was."""
    rows = [
        {
            "scene": row["scene"],
            "method": name,
            "PSNR dB": row["psnr_db"],
            "evaluations": row["evaluations"],
            "MB": row["visibility_bytes"] / 1e6,
            "frame s": row["frame_s"],
        }
        for name, row in zip(METHODS, found, strict=True)
    ]
    usual = next(row["frame s"] for row in rows if row["method"] == "vectorized")
    return [row | {"vectorized's / frame s": usual / row["frame s"]} for row in rows]


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
    output: Output, done: Swept, found: Sequence[Row], rows: Sequence[Row], settings: Settings
) -> None:
    """Writes a scene's pictures and its figure, if files are wanted."""
    images = {"reference": done.reference(found[0])}
    for name, row in zip(METHODS, found, strict=True):
        images[name] = done.image(row)
        done.write_pictures(output, row, name)
    scene = found[0]["scene"]
    stage = prepare(scene, settings.environment, settings.size)
    exposure = exposure_of(images["reference"], stage.covered)
    path = output.path(f"{folder_of(scene)}/per_fragment.png")
    if path is not None:
        drawing = figure(images, rows, stage.surface, exposure)
        drawing.savefig(path, dpi=110, bbox_inches="tight")


def run(settings: Settings, output: Output) -> None:
    """All scenes under one light."""
    pictured = output.folder is not None
    every: list[Row] = []
    with swept(grid_of(settings), settings, output, images=pictured) as done:
        for scene in settings.scene:
            found = [row for row in done.rows if row["scene"] == scene]
            rows = table_of(found)
            every += rows
            if pictured:
                write(output, done, found, rows, settings)
        size = f"{settings.size[0]} x {settings.size[1]}"
        output.say(f"{settings.environment}, {size}, {settings.vectors} vectors")
        output.table("methods", "Per fragment", every)


if __name__ == "__main__":
    execute(Settings, run, __doc__)
