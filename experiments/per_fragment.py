"""Pictures with the light evaluated at every pixel (paper 000, figs. 12 and 15).

Renders ``correspondence``, ``vectorized`` and, once there is one, ``distance-field`` per fragment,
and prints their PSNR against the reference, evaluations and seconds. With --out it also writes the
pictures and, for each scene, a figure: the whole images with the differences from the reference
below them, and both again where the reference's strongest shadow boundaries are.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Bool
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from scipy.ndimage import binary_erosion, gaussian_filter, uniform_filter

import jaxvis
from experiments.speed_rays import best_of
from experiments.zeta_sweep import Image, reference_image, white
from jaxvis.image import display, displayed_error, psnr, write_image
from jaxvis.image.tonemap import exposure_of
from jaxvis.methods import create, names
from jaxvis.report.figures import (
    ERROR_LABEL,
    ERROR_MAP,
    ERROR_RANGE,
    ERROR_TICKS,
    error_map,
    tick_text,
)
from jaxvis.scene import Scene, Surface

METHODS = {
    "correspondence": "correspondence:shading=fragment,vectors={vectors}",
    "vectorized": "vectorized:shading=fragment,vectors={vectors}",
    "distance-field": "distance-field",
}


def render(
    scene: Scene, environment: jaxvis.Environment, options: argparse.Namespace
) -> tuple[list[dict[str, Any]], dict[str, Image], Surface]:
    """A row for each method, and the images, the reference's first."""
    camera = jaxvis.default_camera(scene, aspect=options.size[0] / options.size[1])
    surface = jaxvis.trace_surface(scene, camera, tuple(options.size))
    covered = np.asarray(surface.coverage) > 0.0
    images = {"reference": reference_image(scene, environment, surface, options.error)}
    shades, rows = {}, []
    for name, spec in METHODS.items():
        if name not in names():
            print(f"{name}: there is no such method yet")
            continue
        method = create(spec.format(vectors=options.vectors))
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
    for row, seconds in zip(rows, best_of(options.repeats, *shades.values()), strict=True):
        row["frame s"] = seconds
    usual = next(row["frame s"] for row in rows if row["method"] == "vectorized")
    for row in rows:
        row["vectorized's / frame s"] = usual / row["frame s"]
    return rows, images, surface


def smooth_parts(surface: Surface) -> Bool[np.ndarray, "height width"]:
    """Pixels that do not lie where one body hides another, at a fold, or at the outline."""
    shape = surface.mask.shape
    position = np.asarray(surface.position).reshape(*shape, 3)
    normal = np.asarray(surface.normal).reshape(*shape, 3)
    smooth = np.asarray(surface.mask)
    usual = 0.0
    for axis in (0, 1):
        step = np.linalg.norm(position - np.roll(position, 1, axis), axis=-1)
        usual = usual or float(np.median(step[smooth]))
        turned = np.sum(normal * np.roll(normal, 1, axis), axis=-1) < 0.9
        smooth = smooth & ~turned & (step < 6.0 * usual)
    return binary_erosion(smooth, iterations=3)


def strongest_boundaries(
    shown: Image, inside: Bool[np.ndarray, "height width"], side: int, count: int
) -> list[tuple[int, int]]:
    """First row and column of the squares with the most contrast, which do not overlap.

    Contrast is the gradient of what is shown, slightly blurred, of the pixels inside.
    """
    blurred = gaussian_filter(shown.mean(axis=-1), 1.0)
    down, right = np.gradient(blurred)
    slope = np.where(inside, np.sqrt(down**2 + right**2), 0.0)
    total = uniform_filter(slope, side, mode="constant")
    height, width = inside.shape
    found: list[tuple[int, int]] = []
    for _ in range(count):
        row, column = np.unravel_index(np.argmax(total), total.shape)
        row = int(np.clip(row - side // 2, 0, height - side))
        column = int(np.clip(column - side // 2, 0, width - side))
        found.append((row, column))
        near = side + side // 2
        total[max(row - side // 2, 0) : row + near, max(column - side // 2, 0) : column + near] = 0
    return found


def figure(images: dict[str, Image], rows: list[dict], surface: Surface, exposure: float) -> Figure:
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
    scale = ScalarMappable(LogNorm(*ERROR_RANGE), ERROR_MAP)
    bar = drawing.colorbar(scale, ax=axes, location="bottom", shrink=0.5, aspect=60)
    bar.set_ticks(ERROR_TICKS, labels=[tick_text(tick) for tick in ERROR_TICKS], fontsize=8)
    bar.minorticks_off()
    bar.set_label(ERROR_LABEL, fontsize=8)
    return drawing


def write(images: dict[str, Image], rows: list[dict], surface: Surface, folder: Path) -> None:
    """Writes the pictures and the figure."""
    folder.mkdir(parents=True, exist_ok=True)
    exposure = exposure_of(images["reference"], np.asarray(surface.coverage) > 0.0)
    for name, image in images.items():
        write_image(folder / f"{name}.png", display(image, exposure))
    figure(images, rows, surface, exposure).savefig(
        folder / "per_fragment.png", dpi=110, bbox_inches="tight"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", nargs="+", default=["duck", "teapot"])
    parser.add_argument("--environment", default="stpeters")
    parser.add_argument("--size", nargs=2, type=int, default=[256, 256], metavar=("W", "H"))
    parser.add_argument("--vectors", type=int, default=128)
    parser.add_argument("--error", type=float, default=0.01, help="of the reference")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--own-materials", action="store_true", help="instead of white diffuse")
    parser.add_argument("--out", help="folder for the pictures and the figure")
    options = parser.parse_args()
    environment = jaxvis.load_environment(options.environment)
    every = []
    for name in options.scene:
        scene = jaxvis.load_scene(name)
        scene = scene if options.own_materials else white(scene)
        rows, images, surface = render(scene, environment, options)
        every += rows
        if options.out:
            write(images, rows, surface, Path(options.out) / scene.name)
    print(f"{environment.name}, {options.size}, {options.vectors} vectors")
    print(pd.DataFrame(every).to_string(index=False, float_format="{:.4g}".format))


if __name__ == "__main__":
    main()
