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

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import jax
import numpy as np

import jaxvis
from experiments.measuring import Row
from experiments.output import Output
from experiments.settings import Common, execute, setting
from experiments.visibility_field_runs import (
    PAPER,
    SPONZA_CELL,
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
from jaxvis.compare import file_stem
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


@dataclass(frozen=True)
class Settings(Common):
    scene: tuple[str, ...] = setting(("sponza",), "what is lit")
    environment: str = setting("uffizi", "what lights it")
    view: tuple[Literal["default", "upper", "floor", "roof"], ...] = setting(
        ("default",), "cameras; all but default are Sponza's"
    )
    size: tuple[int, int] = setting((640, 480), "of the images", metavar=("W", "H"))
    cell: float | None = setting(
        None, "edge of the cells; default: 50 in Sponza, elsewhere the method's own"
    )
    masks: int = setting(jaxvis.VisibilityField.masks, "texels along a side of a mask")
    samples: float = setting(1_000_000, "points of the surface")
    spp: int = setting(128, "rays a pixel")
    paper: bool = setting(False, "the paper's settings instead of the defaults")
    repeats: int = setting(5, "of what is timed")
    spp_sweep: tuple[int, ...] | None = setting(
        None, "rays a pixel; without values 16 32 64 128", metavar="SPP", empty=True
    )
    samples_sweep: tuple[float, ...] | None = setting(
        None, "samples of the surface; without values 8e4 4e5 2e6 1e7", metavar="N", empty=True
    )
    cell_sweep: tuple[float, ...] | None = setting(
        None, "sizes of cells; without values 1, 2, 4, 8 cells", metavar="CELL", empty=True
    )
    labels: bool = setting(False, "all labels, in Sponza over the roof, too")
    glossy: bool = setting(False, "the file's own materials")
    finer: bool = setting(False, "a finer field")
    finer_cell: float | None = setting(None, "its cells; default: that of --cell")
    finer_masks: int = setting(48, "its texels along a side of a mask")
    finer_dilation: Literal["full", "half", "none"] = setting("half", "its masks' dilation")
    all_frequency: bool = setting(False, "windows and stpeters against reference")
    keys: int = setting(16, "frames averaged for --all-frequency")
    error: float = setting(0.01, "standard error of the reference, relative to its mean")
    light_size: tuple[int, int] = setting(
        (160, 120), "of the images of --all-frequency", metavar=("W", "H")
    )


def base_method(scene: Scene, settings: Settings) -> jaxvis.VisibilityField:
    """The field of the command line."""
    cell = settings.cell
    if cell is None:
        usual = scene.diagonal / CELLS_ALONG_DIAGONAL
        cell = SPONZA_CELL if scene.name == "sponza" else usual
    method = jaxvis.VisibilityField(
        cell=cell, masks=settings.masks, samples=int(settings.samples), spp=settings.spp
    )
    return replace(method, **PAPER) if settings.paper else method


def row_of(
    view: View, method: jaxvis.VisibilityField, settings: Settings, output: Output, of: Row
) -> Row:
    """A row that starts with what it is of; its pictures are named after that."""
    values = [f"{value:g}" if isinstance(value, float) else str(value) for value in of.values()]
    name = "-".join([view.scene.name, view.name, next(iter(of)), *values]).replace(" ", "-")
    columns = compare(view, method, settings.repeats, picture=output.path(name))
    return {"scene": view.scene.name, **of, **columns}


def both_settings(method: jaxvis.VisibilityField) -> dict[str, jaxvis.VisibilityField]:
    """The given settings and the paper's, once if they are the same."""
    paper = replace(method, **PAPER)
    return {"paper": method} if method == paper else {"given": method, "paper": paper}


def spp_rows(
    view: View, method: jaxvis.VisibilityField, settings: Settings, output: Output
) -> Iterator[Row]:
    """Table 1."""
    for spp in settings.spp_sweep or SPP:
        row = row_of(view, replace(method, spp=spp), settings, output, {"rays": spp})
        without, with_field = PAPER_TABLE_1.get(spp, (np.nan, np.nan))
        paper = {"paper's ms": without, "with": with_field, "paper's ratio": without / with_field}
        yield row | paper


def samples_rows(
    view: View, method: jaxvis.VisibilityField, settings: Settings, output: Output
) -> Iterator[Row]:
    """Fig. 6: both ways to sample the surface, each field from scratch.

    "alone s" is to trace the same rays and nothing else; "Embree s" what Embree's calls took within
    the precomputation. The peak is the process's so far, pictures and textures included.
    """
    for samples in map(int, settings.samples_sweep or SAMPLES):
        for sampling in ("random", "stratified"):
            one = replace(method, samples=samples, sampling=sampling)
            with empty_cache():
                precomputed(view.scene, replace(one, samples=1))  # compiles
                _, cost = precomputed(view.scene, one)
                peak = peak_megabytes()
                alone = seconds_alone(view.scene, settings_of(one))
                of = {"samples": samples, "sampling": sampling}
                row = row_of(view, one, settings, output, of)
            yield row | {
                "precompute s": cost["precompute s"],
                "Embree s": cost["Embree s"],
                "alone s": alone,
                "times alone": cost["precompute s"] / alone,
                "peak MB": peak,
            }


def cell_rows(
    view: View, method: jaxvis.VisibilityField, settings: Settings, output: Output
) -> Iterator[Row]:
    """Fig. 7."""
    for cell in settings.cell_sweep or [edge_of(method) * times for times in COARSER]:
        yield row_of(view, replace(method, cell=cell), settings, output, {"cell": cell})


def label_rows(
    view: View, method: jaxvis.VisibilityField, settings: Settings, output: Output
) -> Iterator[Row]:
    """Fig. 9: all labels, with texels that no sample looked at traced and not."""
    for conservative in (True, False):
        for labels in LABELS:
            one = replace(method, labels=labels, conservative=conservative)
            name = labels + (" conservative" if conservative else "")
            row = row_of(view, one, settings, output, {"labels": name})
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
    view: View, method: jaxvis.VisibilityField, settings: Settings, output: Output
) -> Iterator[Row]:
    """Fig. 10: the file's own materials."""
    without, with_field = PAPER_GLOSSY
    for name, one in both_settings(method).items():
        paper = {"paper's ms": without, "with": with_field, "paper's ratio": without / with_field}
        yield row_of(view, one, settings, output, {"glossy": name}) | paper


def finer_rows(
    view: View, method: jaxvis.VisibilityField, settings: Settings, output: Output
) -> Iterator[Row]:
    """A finer field beside the usual one."""
    cell = edge_of(method) if settings.finer_cell is None else settings.finer_cell
    finer = replace(method, cell=cell, masks=settings.finer_masks, dilation=settings.finer_dilation)
    for one in (method, finer):
        of = {"cell": edge_of(one), "masks": one.masks}
        yield row_of(view, one, settings, output, of)


def all_frequency_rows(
    view: View, method: jaxvis.VisibilityField, settings: Settings, output: Output
) -> Iterator[Row]:
    """The whole environment: means of covered pixels over keys, against ``reference``.

    Standard errors of both means: over the keys, with the reference's own added in quadrature.
    "field - unculled" is of the same keys, so that their noise cancels; its own standard error
    stands behind it.
    """
    method = replace(method, lighting="environment", conservative=True)
    plain, truth = same_without_field(method), Reference(error=settings.error)
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
                for key in jax.random.split(jax.random.key(1), settings.keys)
            ]
        )
        paired = means[:, 0] - means[:, 1]
        noise = means.std(axis=0, ddof=1) / np.sqrt(settings.keys)
        apart = (means.mean(axis=0) - expected) / np.hypot(noise, solution.error * expected)
        yield row_of(here, method, settings, output, {"light": name}) | {
            "keys": settings.keys,
            "noise %": 100.0 * noise[0] / expected,
            "reference %": 100.0 * solution.error,
            "standard errors": apart[0],
            "unculled's": apart[1],
            "field - unculled %": 100.0 * float(paired.mean()) / expected,
            "+-": 100.0 * float(paired.std(ddof=1)) / np.sqrt(settings.keys) / expected,
        }


Part = Callable[[View, jaxvis.VisibilityField, Settings, Output], Iterator[Row]]

PARTS: dict[str, tuple[str, Part]] = {
    "spp_sweep": ("Rays a pixel (table 1)", spp_rows),
    "samples_sweep": ("Samples of the surface (fig. 6)", samples_rows),
    "cell_sweep": ("Cells (fig. 7)", cell_rows),
    "labels": ("Labels (fig. 9)", label_rows),
    "glossy": ("Glossy (fig. 10)", glossy_rows),
    "finer": ("A finer field", finer_rows),
    "all_frequency": ("All frequencies", all_frequency_rows),
}
"""Tables by the setting that asks for them."""


def wanted(settings: Settings, part: str) -> bool:
    """Whether a table was asked for; sweeps without values have the usual ones."""
    value = getattr(settings, part)
    return value is not None and value is not False


def measure(settings: Settings, output: Output) -> None:
    """The tables that were asked for, scene after scene."""
    environment = jaxvis.load_environment(settings.environment)
    for spec in dict.fromkeys(settings.scene):
        scene = jaxvis.load_scene(spec)
        method = base_method(scene, settings)
        output.say(f"{spec}: {len(scene.triangles)} triangles, {environment.name}, {method}")
        views = views_of(scene, environment, settings.size, settings.view)
        usual = {"field": "given"}
        rows = [row_of(view.diffuse(), method, settings, output, usual) for view in views]
        output.table(f"{file_stem(spec)}-views", f"Views of {spec}", rows)
        for part, (title, table) in PARTS.items():
            if not wanted(settings, part):
                continue
            names = [*settings.view, "roof"] if part == "labels" else settings.view
            size = settings.light_size if part == "all_frequency" else settings.size
            rows = []
            for view in views_of(scene, environment, size, names):
                shown = view if part == "glossy" else view.diffuse()
                rows += table(shown, method, settings, output)
            output.table(f"{file_stem(spec)}-{part.replace('_', '-')}", f"{title}, {spec}", rows)


if __name__ == "__main__":
    execute(Settings, measure, __doc__)
