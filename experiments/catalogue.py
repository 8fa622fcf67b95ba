"""The experiments: what each shows, what it needs, and how it is run in full and quickly."""

import importlib.util
from collections.abc import Sequence
from dataclasses import dataclass

from experiments.papers import ITEMS, PAPERS, shown_by
from jaxvis import datasets

SMALL = ("--size", "96", "72")
SQUARE = ("--size", "96", "96")
TORUS = "torus-on-plane:cells=8,around=12"
"""A built-in scene of 392 triangles."""


@dataclass(frozen=True)
class Experiment:
    """A script ``experiments/NAME.py``.

    Attributes:
        shows: what it measures, one line.
        full: its arguments where none are given: all that it can show.
        quick: those that make it small: built-in scenes and lights, seconds to a minute.
        data: the data sets that ``full`` uses, by the names of :mod:`jaxvis.datasets`.
        needs: modules that are not always installed, each with the extra of jaxvis that has it.
    """

    name: str
    shows: str
    quick: tuple[str, ...]
    full: tuple[str, ...] = ()
    data: tuple[str, ...] = ()
    needs: tuple[tuple[str, str], ...] = ()

    @property
    def papers(self) -> str:
        """The tables and figures that it shows, as ``000: table 1, fig. 11``; may be empty."""
        found: dict[str, list[str]] = {}
        for item in shown_by(self.name):
            found.setdefault(item.paper, []).append(item.label)
        return "; ".join(f"{paper}: {', '.join(labels)}" for paper, labels in found.items())


EXPERIMENTS = (
    Experiment(
        "correspondence_table",
        "sizes, build times and triples of correspondence; PSNR, frame times and seams",
        quick=(
            *("--scene", TORUS, "--environment", "windows", *SQUARE, "--cached", "--sweep"),
            *("--seams", "--zeta", "0", "2", "--error", "0.03", "--repeats", "1"),
            *("--vectors", "64", "--no-scaling"),
        ),
        full=("--sweep", "--seams"),
        data=("duck", "utah-teapot", "bunny", "stpeters"),
    ),
    Experiment(
        "zeta_sweep",
        "PSNR, evaluations and frame time of vectorized over the tessellation quality",
        quick=(
            *("--scene", TORUS, "--environment", "windows", *SQUARE, "--zeta", "0", "2"),
            *("--error", "0.03", "--vectors", "64"),
        ),
        data=("duck", "stpeters"),
    ),
    Experiment(
        "per_fragment",
        "correspondence, vectorized and distance-field per fragment beside the reference",
        quick=(
            *("--scene", TORUS, "--environment", "windows", *SQUARE, "--error", "0.03"),
            *("--vectors", "64"),
        ),
        data=("duck", "stpeters"),
    ),
    Experiment(
        "equal_time",
        "PSNR at equal time and time at equal PSNR: precomputed methods, estimators, Mitsuba",
        quick=(
            *("--scene", TORUS, "--environment", "windows", *SQUARE, "--error", "0.03"),
            *("--methods", "vectorized:vectors=64", "correspondence:vectors=64", "--zeta", "2"),
            *("--estimators", "mc-mis", "mc-ides", "--denoised", "mc-ides+denoise"),
            *("--repeats", "1", "--samples", "64", "--peer-spp", "256"),
        ),
        data=("duck", "utah-teapot", "stpeters"),
    ),
    Experiment(
        "vertex_irradiance",
        "irradiance at vertices by vectorized visibility (eqs. 9 to 12 of paper 000) against rays",
        quick=(
            *("--scene", TORUS, "--environment", "windows", "--rows", "32", "--vertices", "64"),
            *("--vectors", "64", "--polygons", "32"),
        ),
        data=("duck", "sponza", "stpeters"),
    ),
    Experiment(
        "tune_beta",
        "vsat's sharpness (eq. 11 of paper 000) fitted by gradient",
        quick=(
            *("--scene", TORUS, "--environment", "windows", "--rows", "64", "--vectors", "32"),
            *("--polygons", "32", "--steps", "10"),
        ),
        full=("--images",),
        data=("duck", "stpeters"),
    ),
    Experiment(
        "refinement_table",
        "PSNR and bytes of samples between the vertices, over the error target",
        quick=(
            *("--scene", TORUS, "--environment", "windows", *SQUARE),
            *("--error", "0.03", "--refine", "0.05", "--zeta", "2"),
        ),
        data=("duck", "stpeters"),
    ),
    Experiment(
        "speed_shading",
        "polygons evaluated a second beside what the machine's row-gather rate allows",
        quick=(
            *("--scene", TORUS, "--environment", "windows", "--vectors", "64"),
            *("--polygons", "2048", "--repeats", "2"),
        ),
        data=("stpeters",),
    ),
    Experiment(
        "visibility_field_table",
        "frame time, rays, errors and bytes of visibility-field beside unculled",
        quick=(
            *("--scene", "courtyard:triangles=20000", "--environment", "windows", *SMALL),
            *("--samples", "2e4", "--spp", "16", "--repeats", "1", "--spp-sweep", "4", "16"),
            *("--samples-sweep", "5e3", "2e4", "--cell-sweep", "1", "2", "--labels", "--glossy"),
            *("--finer", "--finer-masks", "24"),
        ),
        full=(
            *("--cell", "50", "--spp-sweep", "--samples-sweep", "--cell-sweep", "--labels"),
            *("--glossy", "--finer", "--all-frequency"),
        ),
        data=("sponza", "uffizi", "stpeters"),
    ),
    Experiment(
        "adaptive_table",
        "adaptive, distance-field and shadow-map: maps, samples, thresholds, equal time, frames",
        quick=(
            *("--scene", "balls", *SMALL, "--error", "0.03", "--repeats", "1", "--spp", "4"),
            *("16", "--limit", "5", "--resolutions", "32", "--maps", "40", "--frames", "2"),
            *("--every", "1", "--parts", "1", "--mean", "1", "--budget", "0.2"),
            *("--method", "adaptive:resolution=32,lights=64"),
        ),
    ),
    Experiment(
        "drawings",
        "drawings of masks, visibility maps and samples as they are stored",
        quick=(
            *("--scene", "courtyard:triangles=20000", "--samples", "2e4"),
            *("--moving", "balls:detail=32", *SMALL, "--resolution", "32"),
        ),
        data=("sponza",),
    ),
    Experiment(
        "spherical_gaussian_table",
        "errors of fits, cells, lobes and visibility integrals (eqs. 2 and 5 of paper 002)",
        quick=(
            *("--environment", "windows", "--rows", "32", "--masks", "4", "--lobes", "8", "16"),
            *("--steps", "100", "--cells", "64", "256", "--roughness", "0.4"),
        ),
        data=("stpeters",),
    ),
    Experiment(
        "speed_distance_transform",
        "milliseconds a map of the distance transforms beside SciPy's, and their errors",
        quick=("--resolution", "32", "64", "--maps", "16", "--repeats", "2"),
    ),
    Experiment(
        "inverse_lighting",
        "a light's lobes recovered from one picture by gradient",
        quick=("--size", "48", "36", "--lobes", "1", "--steps", "60", "--resolution", "32"),
    ),
    Experiment(
        "cone_table",
        "hybrid-cones and voxel-cones: memory, errors, sweeps, leaks, times of the stages, growth",
        quick=(
            *("--what", "memory", "quality", "--hybrids", "32x128", "--voxel", "32"),
            *("--size", "64", "40", "--error", "0.05", "--rays", "32", "--repeats", "1"),
        ),
    ),
    Experiment(
        "speed_viewer",
        "frames a second while the environment turns, as the viewer asks for them",
        quick=(
            *("--scene", TORUS, "--environment", "windows", *SQUARE, "--frames", "3"),
            *("--method", "correspondence:vectors=64", "mc-mis:spp=4"),
        ),
        data=("duck", "stpeters"),
    ),
    Experiment(
        "speed_devices",
        "frames shaded by one JAX device and by several, and whether the images are the same",
        quick=(
            *("--scene", TORUS, "--environment", "windows", *SQUARE, "--frames", "1"),
            *("--method", "mc-mis:spp=4", "distance-field:resolution=32,lights=64"),
        ),
        data=("duck", "stpeters"),
    ),
    Experiment(
        "speed_sweep",
        "seconds of a sweep of 200 rows on one worker process and on two, and their tables",
        quick=(
            *("--scene", "box-on-plane", "--environment", "uniform", "--size", "32", "24"),
            *("--method", "mc-mis:spp=1", "--seeds", "2", "--pairs", "1"),
        ),
    ),
    Experiment(
        "speed_rays",
        "ray throughput against bare embreex, and Embree's share of a Monte Carlo frame",
        quick=(
            *("--scene", "courtyard:triangles=20000", *SMALL, "--spp", "8"),
            *("--rays", "100000", "--repeats", "1"),
        ),
    ),
    Experiment(
        "peer_mitsuba",
        "agreement with Mitsuba 3, and PSNR and seconds of both",
        quick=("--size", "48", "48", "--spp", "32", "--renders", "2"),
        needs=(("mitsuba", "peers"),),
    ),
    Experiment(
        "large_frame",
        "time and peak memory of a large frame of each family, and of gradients",
        quick=(
            *("--scene", TORUS, "--size", "160", "90", "--gradient", "distance-field:lights=64"),
            *("--method", "mc-mis:spp=8", "mc-mis:spp=8,rays_per_chunk=65536"),
        ),
    ),
)

BY_NAME = {experiment.name: experiment for experiment in EXPERIMENTS}


def lacking(experiment: Experiment, data: bool = True) -> str:
    """Why an experiment cannot run here: an extra or (if asked) data that is missing; or ''."""
    for module, extra in experiment.needs:
        if importlib.util.find_spec(module) is None:
            return f'{module} is not installed: pip install "jaxvis[{extra}]"'
    for name in experiment.data if data else ():
        try:
            datasets.find(name)
        except (FileNotFoundError, ValueError) as error:
            return str(error)
    return ""


def listing(experiments: Sequence[Experiment] = EXPERIMENTS) -> str:
    """Markdown: the experiments, and every table and figure of the papers with what shows it."""
    rows = ["| experiment | what it shows | of the papers |", "|---|---|---|"]
    rows += [f"| `{e.name}` | {e.shows} | {e.papers} |" for e in experiments]
    for paper, title in PAPERS.items():
        rows += ["", f"Paper {paper}: {title}", "", "| item | what | shown by |", "|---|---|---|"]
        for item in (item for item in ITEMS if item.paper == paper):
            by = "; ".join(f"`{by}`" for by in item.by)
            if not by:
                by = "a diagram or list: nothing to measure" if item.diagram else "**missing**"
            rows.append(f"| {item.label} | {item.what} | {by}{item.lacks and f' ({item.lacks})'} |")
    return "\n".join(rows)
