"""What a discrete visibility field saves and costs (paper 001, table 1, figs. 6, 7, 9 and 10).

First a row for each view: a frame with the field beside one without, from the same rays, and how
far their images are apart. Every flag adds a table: rays a pixel (--spp-sweep), samples of the
surface (--samples-sweep), sizes of cells (--cell-sweep), labels (--labels), the file's own glossy
materials (--glossy), finer masks (--finer) and light of all frequencies (--all-frequency). All
materials are diffuse except with --glossy. --paper starts from the paper's settings instead of the
defaults; --out also writes the pictures and how they differ, five times enlarged.

Targets (Sponza, from the default view): frames 2.8 times faster at 128 rays a pixel, 2.5 at 16, 4
where glossy, 4 with a finer field of no more than 49,088 KB; RMSE at most 0.2 % of the mean with
10 million samples; at most 1 pixel in 10,000 differs; bytes at most 10 % of the dense layout;
precomputation 1.25 times as long as tracing its rays alone, in 2 GiB; all-frequency means within 4
standard errors.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np

import jaxvis
from experiments.correspondence_table import show
from experiments.visibility_field_runs import (
    PAPER,
    SPONZA_CELL,
    SPONZA_VIEWS,
    Row,
    View,
    compare,
    edge_of,
    empty_cache,
    peak_megabytes,
    precomputed,
    same_without_field,
    seconds_alone,
    settings_of,
    views_of,
)
from jaxvis.methods import Reference
from jaxvis.methods.visibility_field.masks import labels as occlusion_labels
from jaxvis.methods.visibility_field.method import CELLS_ALONG_DIAGONAL
from jaxvis.scene import Scene

SPP = (16, 32, 64, 128)
SAMPLES = (80_000, 400_000, 2_000_000, 10_000_000)
COARSER = (1, 2, 4, 8)
"""Cells of the sweep, in cells of the field."""

PAPER_TABLE_1 = {16: (6.69, 2.23), 32: (13.79, 4.02), 64: (27.28, 7.81), 128: (55.19, 15.74)}
"""Milliseconds without and with the field, at 1920 x 1080 on an RTX 3080."""

PAPER_GLOSSY = (54.64, 10.14)
"""Likewise, for Sponza with a glossy BRDF (fig. 10)."""

LABELS = ("four-state", "balanced", "paper", "visible")
ALL_FREQUENCY = ("windows", "stpeters")


def base_method(scene: Scene, options: argparse.Namespace) -> jaxvis.VisibilityField:
    """The field of the command line."""
    cell = options.cell
    if cell is None:
        usual = scene.diagonal / CELLS_ALONG_DIAGONAL
        cell = SPONZA_CELL if scene.name == "sponza" else usual
    settings = PAPER if options.paper else {}
    return jaxvis.VisibilityField(
        cell=cell, masks=options.masks, samples=options.samples, spp=options.spp, **settings
    )


def row_of(
    view: View, method: jaxvis.VisibilityField, options: argparse.Namespace, what: str, name: str
) -> Row:
    """A row that starts with ``what`` is ``name``; its pictures are named after it."""
    picture = None
    if options.out:
        stem = "-".join([view.scene.name, view.name, what, name]).replace(",", "").replace(" ", "-")
        picture = Path(options.out) / stem
    columns = compare(view, method, options.repeats, picture=picture)
    return {"scene": view.scene.name, what: name, **columns}


def both_settings(method: jaxvis.VisibilityField) -> dict[str, jaxvis.VisibilityField]:
    """The given settings and the paper's, once if they are the same."""
    paper = replace(method, **PAPER)
    return {"paper": method} if method == paper else {"given": method, "paper": paper}


def spp_rows(
    view: View, method: jaxvis.VisibilityField, options: argparse.Namespace
) -> Iterator[Row]:
    """Table 1."""
    for spp in options.spp_sweep or SPP:
        row = row_of(view, replace(method, spp=spp), options, "rays", str(spp))
        without, with_field = PAPER_TABLE_1.get(spp, (np.nan, np.nan))
        paper = {"paper's ms": without, "with": with_field, "paper's ratio": without / with_field}
        yield row | paper


def samples_rows(
    view: View, method: jaxvis.VisibilityField, options: argparse.Namespace
) -> Iterator[Row]:
    """Fig. 6: both ways to sample the surface, each field from scratch.

    "alone s" is to trace the same rays and nothing else; "Embree s" what Embree's calls took within
    the precomputation. The peak is the process's so far, pictures and textures included.
    """
    for samples in options.samples_sweep or SAMPLES:
        for sampling in ("random", "stratified"):
            one = replace(method, samples=samples, sampling=sampling)
            with empty_cache():
                precomputed(view.scene, replace(one, samples=1))  # compiles
                _, cost = precomputed(view.scene, one)
                peak = peak_megabytes()
                alone = seconds_alone(view.scene, settings_of(one))
                row = row_of(view, one, options, "samples", f"{samples} {sampling}")
            yield row | {
                "precompute s": cost["precompute s"],
                "Embree s": cost["Embree s"],
                "alone s": alone,
                "times alone": cost["precompute s"] / alone,
                "peak MB": peak,
            }


def cell_rows(
    view: View, method: jaxvis.VisibilityField, options: argparse.Namespace
) -> Iterator[Row]:
    """Fig. 7."""
    for cell in options.cell_sweep or [edge_of(method) * times for times in COARSER]:
        yield row_of(view, replace(method, cell=cell), options, "cell", f"{cell:g}")


def label_rows(
    view: View, method: jaxvis.VisibilityField, options: argparse.Namespace
) -> Iterator[Row]:
    """Fig. 9: all labels, with texels that no sample looked at traced and not."""
    for conservative in (True, False):
        for labels in LABELS:
            one = replace(method, labels=labels, conservative=conservative)
            name = labels + (" conservative" if conservative else "")
            row = row_of(view, one, options, "labels", name)
            yield row | {"% of label 0": label_0_percent(view.scene, one)}


def label_0_percent(scene: Scene, method: jaxvis.VisibilityField) -> float:
    """Of the occupied cells; those where the occluded directions are traced."""
    if method.labels == "four-state":
        return np.nan
    stored, _ = precomputed(scene, method)
    label = occlusion_labels(
        np.asarray(stored.visible), np.asarray(stored.occluded), stored.size, method.labels
    )
    return 100.0 * float(np.mean(~np.asarray(label)))


def glossy_rows(
    view: View, method: jaxvis.VisibilityField, options: argparse.Namespace
) -> Iterator[Row]:
    """Fig. 10: the file's own materials."""
    without, with_field = PAPER_GLOSSY
    for name, one in both_settings(method).items():
        paper = {"paper's ms": without, "with": with_field, "paper's ratio": without / with_field}
        yield row_of(view, one, options, "glossy", name) | paper


def finer_rows(
    view: View, method: jaxvis.VisibilityField, options: argparse.Namespace
) -> Iterator[Row]:
    """A finer field beside the usual one."""
    cell = edge_of(method) if options.finer_cell is None else options.finer_cell
    finer = replace(method, cell=cell, masks=options.finer_masks, dilation=options.finer_dilation)
    for one in (method, finer):
        name = f"{edge_of(one):g}, {one.masks} x {one.masks}"
        yield row_of(view, one, options, "cell and masks", name)


def all_frequency_rows(
    view: View, method: jaxvis.VisibilityField, options: argparse.Namespace
) -> Iterator[Row]:
    """The whole environment: means of covered pixels over keys, against ``reference``.

    Standard errors of both means: over the keys, with the reference's own added in quadrature.
    "field - unculled" is of the same keys, so that their noise cancels; its own standard error
    stands behind it.
    """
    method = replace(method, lighting="environment", conservative=True)
    plain, truth = same_without_field(method), Reference(error=options.error)
    stored, _ = precomputed(view.scene, method)
    bare = plain.precompute(view.scene, progress=False)
    for name in ALL_FREQUENCY:
        here = replace(view, environment=jaxvis.load_environment(name))
        solution, _ = truth.solve_cached(bare, truth.light(here.environment), view.surface)
        expected = float(np.mean(np.asarray(solution.image, np.float64)[view.covered]))
        light = method.light(here.environment)
        means = np.array(
            [
                [
                    np.mean(np.asarray(shaded, np.float64)[view.covered])
                    for shaded in (
                        method.shade(stored, light, view.surface, key=key),
                        plain.shade(bare, light, view.surface, key=key),
                    )
                ]
                for key in jax.random.split(jax.random.key(1), options.keys)
            ]
        )
        paired = means[:, 0] - means[:, 1]
        noise = means.std(axis=0, ddof=1) / np.sqrt(options.keys)
        apart = (means.mean(axis=0) - expected) / np.hypot(noise, solution.error * expected)
        yield row_of(here, method, options, "light", name) | {
            "keys": options.keys,
            "noise %": 100.0 * noise[0] / expected,
            "reference %": 100.0 * solution.error,
            "standard errors": apart[0],
            "unculled's": apart[1],
            "field - unculled %": 100.0 * float(paired.mean()) / expected,
            "+-": 100.0 * float(paired.std(ddof=1)) / np.sqrt(options.keys) / expected,
        }


Part = Callable[[View, jaxvis.VisibilityField, argparse.Namespace], Iterator[Row]]

PARTS: dict[str, tuple[str, Part]] = {
    "spp_sweep": ("Rays a pixel (table 1)", spp_rows),
    "samples_sweep": ("Samples of the surface (fig. 6)", samples_rows),
    "cell_sweep": ("Cells (fig. 7)", cell_rows),
    "labels": ("Labels (fig. 9)", label_rows),
    "glossy": ("Glossy (fig. 10)", glossy_rows),
    "finer": ("A finer field", finer_rows),
    "all_frequency": ("All frequencies", all_frequency_rows),
}


def wanted(options: argparse.Namespace, part: str) -> bool:
    """Whether a table was asked for; sweeps without values have the usual ones."""
    value = getattr(options, part)
    return value is not None and value is not False


def number(text: str) -> int:
    """A whole number, also as 1e6."""
    return int(float(text))


def options_of_command_line(arguments: list[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    add = parser.add_argument
    add("--scene", nargs="+", default=["sponza"])
    add("--environment", default="uffizi")
    views = ["default", *SPONZA_VIEWS]
    add("--view", nargs="+", default=["default"], choices=views, help="all but default: Sponza's")
    add("--size", nargs=2, type=int, default=[640, 480], metavar=("W", "H"))
    add("--cell", type=float, help="default: 50 in Sponza, elsewhere the method's own")
    add("--masks", type=int, default=jaxvis.VisibilityField.masks, help="default: %(default)s")
    add("--samples", type=number, default=1_000_000)
    add("--spp", type=int, default=128)
    add("--paper", action="store_true", help="the paper's settings instead of the defaults")
    add("--repeats", type=int, default=5)
    add("--spp-sweep", nargs="*", type=int, metavar="SPP", help="default: 16 32 64 128")
    add("--samples-sweep", nargs="*", type=number, metavar="N", help="default: 80e3 to 10e6")
    add("--cell-sweep", nargs="*", type=float, metavar="CELL", help="default: 1, 2, 4, 8 cells")
    add("--labels", action="store_true", help="all labels, in Sponza over the roof, too")
    add("--glossy", action="store_true", help="the file's own materials")
    add("--finer", action="store_true", help="a finer field")
    add("--finer-cell", type=float, help="default: that of --cell")
    add("--finer-masks", type=int, default=48, help="default: %(default)s")
    add("--finer-dilation", default="half", help="full, half or none; default: %(default)s")
    add("--all-frequency", action="store_true", help="windows and stpeters against reference")
    add("--keys", type=int, default=16, help="frames averaged for --all-frequency")
    add("--error", type=float, default=0.01, help="of the reference's pixels")
    add(
        "--light-size",
        nargs=2,
        type=int,
        default=[160, 120],
        metavar=("W", "H"),
        help="for --all-frequency",
    )
    add("--out", help="folder for the pictures")
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> None:
    options = options_of_command_line(arguments)
    environment = jaxvis.load_environment(options.environment)
    for scene_name in options.scene:
        scene = jaxvis.load_scene(scene_name)
        method = base_method(scene, options)
        print(f"{scene.name}: {len(scene.triangles)} triangles, {environment.name}, {method}")
        views = views_of(scene, environment, options.size, options.view)
        rows = [row_of(view.diffuse(), method, options, "field", "given") for view in views]
        show("Views", rows)
        for part, (title, table) in PARTS.items():
            if not wanted(options, part):
                continue
            names = [*options.view, "roof"] if part == "labels" else options.view
            size = options.light_size if part == "all_frequency" else options.size
            rows = []
            for view in views_of(scene, environment, size, names):
                rows += table(view if part == "glossy" else view.diffuse(), method, options)
            show(title, rows)


if __name__ == "__main__":
    main()
