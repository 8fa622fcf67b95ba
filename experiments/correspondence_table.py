"""What correspondence costs and gains (paper 000, table 1, figs. 11 and 13).

First tables: sizes of both structures and the time to build them; triples a triangle, in all and
evaluated, and the share of faces that keep three evaluations; build times of ever finer meshes.
With --sweep: PSNR against the reference, evaluations and frame time of ``vectorized`` and
``correspondence`` for every zeta and for fragments, the two taking turns. With --seams: how much
the light at inner edges of the mesh differs between the triples of the faces on either side,
relative to the image's mean.

Targets: PSNR no less than that of ``vectorized`` from zeta 3 on; frame times 1.35 times shorter at
zeta 1, 2.3 at zeta 4 and 2.5 for fragments; 10 ms to build a triangle, in proportion to their
number; at most 4.6 KB of triples and 2 % of faces with three evaluations; seams below 1 %.
"""

import argparse
import time
from dataclasses import replace
from itertools import pairwise
from typing import get_args

import jax
import numpy as np
import pandas as pd

import jaxvis
from experiments.speed_rays import best_of
from experiments.zeta_sweep import reference_image, white
from jaxvis.image import psnr
from jaxvis.methods.vectorized import VectorizedVisibility, precompute_polygons
from jaxvis.methods.vectorized.correspondence import CorrespondingPolygons, build
from jaxvis.methods.vectorized.correspondence.build import Construction
from jaxvis.methods.vectorized.correspondence.interpolated import Interpolation
from jaxvis.methods.vectorized.correspondence.method import VisibilityCorrespondence
from jaxvis.methods.vectorized.correspondence.seams import (
    differences,
    mean_irradiance,
    sides_of_edges,
)
from jaxvis.methods.vectorized.light import PolygonLight
from jaxvis.methods.vectorized.mesh import Mesh
from jaxvis.methods.vectorized.precompute import Settings
from jaxvis.scene import Scene, Surface

SMALL = "torus-on-plane:cells=4,around=8"
"""A scene that compiles everything."""

FINER = (8, 12, 16, 24)
"""Cells along the plane; twice as many go around the torus."""

BIN_ENDS = (0.0, 1e-5, 1e-4, 1e-3, 3e-3, 0.01, 0.03, 0.1, np.inf)


def built(
    scene: Scene, method: VisibilityCorrespondence, options: argparse.Namespace
) -> tuple[CorrespondingPolygons, dict[str, float]]:
    """The correspondence, and the seconds that polygons and triples took."""
    start = time.perf_counter()
    if options.quick:
        polygons = three_evaluations(method).precompute(scene, progress=False)
        polygon_seconds = np.nan
    else:
        polygons = precompute_polygons(scene, Settings(vectors=method.vectors), progress=False)
        polygon_seconds = time.perf_counter() - start
    settings = build.Settings(
        construction=method.construction, seed=method.seed, interpolation=method.interpolation
    )
    start = time.perf_counter()
    found = build.build_correspondence(polygons, scene.tracer, settings)
    jax.block_until_ready(found)
    return found, {"polygons": polygon_seconds, "triples": time.perf_counter() - start}


def three_evaluations(method: VisibilityCorrespondence) -> VectorizedVisibility:
    """The same with three evaluations."""
    return VectorizedVisibility(vectors=method.vectors, shading=method.shading, zeta=method.zeta)


def sizes(
    scene: Scene, found: CorrespondingPolygons, seconds: dict[str, float]
) -> tuple[dict[str, object], dict[str, object]]:
    """A row of bytes and seconds, and one of counts."""
    polygons = found.polygons
    mesh = Mesh.of(polygons)
    faces = int((mesh.faces >= 0).all(axis=1).sum())
    separate = int(np.asarray(found.separate).sum())
    joint = max(faces - separate, 1)
    vectors = float(np.mean(np.asarray(polygons.counts)))
    evaluated = int(np.asarray(found.evaluated).sum()) / joint
    cost = {
        "scene": scene.name,
        "vertices": len(polygons.counts),
        "triangles": faces,
        "polygons MB": polygons.nbytes / 1e6,
        "triples MB (24 B each)": found.paper_triple_bytes / 1e6,
        "triples MB (real)": (found.nbytes - polygons.nbytes) / 1e6,
        "KB/triangle (24 B)": found.paper_triple_bytes / faces / 1e3,
        "KB/triangle (real)": (found.nbytes - polygons.nbytes) / faces / 1e3,
        "polygons s": seconds["polygons"],
        "triples s": seconds["triples"],
        "ms/triangle": 1e3 * seconds["triples"] / faces,
    }
    return cost, {
        "scene": scene.name,
        "vectors/polygon": vectors,
        "triples/triangle": len(found.triples) / joint,
        "evaluated": evaluated,
        "3 vectors / evaluated": 3.0 * vectors / evaluated,
        "separate faces": separate,
        "% of faces": 100.0 * separate / faces,
    }


def scaling(method: VisibilityCorrespondence, options: argparse.Namespace) -> list[dict]:
    """Build times of one shape in ever more triangles."""
    rows = []
    for cells in FINER[:2] if options.quick else FINER:
        scene = jaxvis.load_scene(f"torus-on-plane:cells={cells},around={2 * cells}")
        cost, count = sizes(scene, *built(scene, method, options))
        kept = ("triangles", "triples s", "ms/triangle")
        rows.append({name: cost[name] for name in kept} | {"% separate": count["% of faces"]})
    return rows


def sweep(
    scene: Scene,
    environment: jaxvis.Environment,
    surface: Surface,
    found: CorrespondingPolygons,
    method: VisibilityCorrespondence,
    options: argparse.Namespace,
) -> list[dict[str, object]]:
    """A row for each zeta and for fragments: both methods, interleaved."""
    truth = reference_image(scene, environment, surface, options.error)
    covered = np.asarray(surface.coverage) > 0.0
    light = method.light(environment)
    joint = {f"zeta {zeta:g}": replace(method, zeta=zeta) for zeta in options.zeta}
    joint["fragment"] = replace(method, shading="fragment")
    rows = []
    for name, ours in joint.items():
        pair = {
            "correspondence": (ours, found),
            "vectorized": (three_evaluations(ours), found.polygons),
        }
        shades = {
            key: lambda m=m, v=v: np.asarray(m.shade(v, light, surface))
            for key, (m, v) in pair.items()
        }
        decibels = {key: psnr(shade(), truth, covered) for key, shade in shades.items()}
        counts = {key: m.evaluations(v, light, surface) for key, (m, v) in pair.items()}
        seconds = dict(zip(shades, best_of(options.repeats, *shades.values()), strict=True))
        rows.append(
            {
                "scene": scene.name,
                "shading": name,
                "PSNR dB": decibels["correspondence"],
                "vectorized dB": decibels["vectorized"],
                "gain dB": decibels["correspondence"] - decibels["vectorized"],
                "evaluations": counts["correspondence"],
                "vectorized's": counts["vectorized"],
                "frame s": seconds["correspondence"],
                "vectorized s": seconds["vectorized"],
                "times faster": seconds["vectorized"] / seconds["correspondence"],
            }
        )
    return rows


def seams(
    scene: Scene,
    surface: Surface,
    light: PolygonLight,
    found: CorrespondingPolygons,
    method: VisibilityCorrespondence,
) -> tuple[list[dict[str, object]], pd.Series]:
    """Rows of what the sides differ by, and a histogram of the pixels' seams.

    Pixels of ``vectorized`` have seams, too: where the mesh is bent, the planes of the faces clip
    the polygons differently. Without these planes only triples differ.
    """
    mean = mean_irradiance(method, found, light, surface)
    rows, pixels = [], np.zeros(0)
    for name, visibility, clipped in (
        ("pixels", found, True),
        ("triples alone", found, False),
        ("vectorized: planes alone", found.polygons, True),
    ):
        sides = sides_of_edges(visibility, light, method.quadrature, clipped=clipped)
        percent = 100.0 * differences(sides) / mean
        pixels = percent if name == "pixels" else pixels
        low, middle, high = np.quantile(percent, (0.5, 0.95, 0.99))
        rows.append(
            {
                "scene": scene.name,
                "seams": name,
                "edges": len(percent),
                "mean %": percent.mean(),
                "median %": low,
                "95 %": middle,
                "99 %": high,
                "largest %": percent.max(),
            }
        )
    ends = 100.0 * np.array(BIN_ENDS)
    counts, _ = np.histogram(pixels, ends)
    labels = [f"{a:g} to {b:g} %" for a, b in pairwise(ends)]
    return rows, pd.Series(counts / max(len(pixels), 1), labels, name=scene.name)


def show(title: str, rows: list[dict]) -> None:
    """Prints a table."""
    table = pd.DataFrame(rows).to_string(index=False, float_format="{:.4g}".format)
    print(f"\n{title}\n{table}", flush=True)


def options_of_command_line() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--scene", nargs="+", default=["duck", "utah-teapot", "bunny"])
    add("--environment", default="stpeters")
    add("--sweep", action="store_true", help="PSNR and frame times over zeta")
    add("--seams", action="store_true", help="differences across inner edges")
    add("--no-scaling", action="store_true", help="skip the ever finer meshes")
    for name, options in (("construction", Construction), ("interpolation", Interpolation)):
        default = getattr(VisibilityCorrespondence, name)
        add(f"--{name}", default=default, choices=get_args(options), help="default: %(default)s")
    add("--zeta", nargs="+", type=float, default=[0.0, 1.0, 2.0, 3.0, 4.0])
    add("--size", nargs=2, type=int, default=[256, 256], metavar=("W", "H"))
    add("--vectors", type=int, default=128)
    add("--error", type=float, default=0.01, help="of the reference")
    add("--repeats", type=int, default=5)
    add("--own-materials", action="store_true", help="instead of white diffuse")
    add("--quick", action="store_true", help="polygons from the cache, not timed; few meshes")
    return parser.parse_args()


def main() -> None:
    options = options_of_command_line()
    method = VisibilityCorrespondence(
        vectors=options.vectors,
        construction=options.construction,
        interpolation=options.interpolation,
    )
    built(jaxvis.load_scene(SMALL), method, options)
    costs, counts, frames, edges, histograms = [], [], [], [], []
    environment = jaxvis.load_environment(options.environment)
    for name in options.scene:
        scene = jaxvis.load_scene(name)
        scene = scene if options.own_materials else white(scene)
        found, seconds = built(scene, method, options)
        cost, count = sizes(scene, found, seconds)
        costs.append(cost)
        counts.append(count)
        surface = jaxvis.trace_surface(scene, jaxvis.default_camera(scene), tuple(options.size))
        if options.sweep:
            frames += sweep(scene, environment, surface, found, method, options)
        if options.seams:
            rows, histogram = seams(scene, surface, method.light(environment), found, method)
            edges += rows
            histograms.append(histogram)
    print(f"{environment.name}, {options.size}, {method}")
    show("Sizes and times", costs)
    show("Counts", counts)
    if not options.no_scaling:
        show("Ever finer meshes", scaling(method, options))
    if options.sweep:
        show("Images", frames)
    if options.seams:
        show("Seams, of the image's mean irradiance", edges)
        shares = pd.concat(histograms, axis=1).to_string(float_format="{:.4f}".format)
        print(f"\nShare of edges\n{shares}")


if __name__ == "__main__":
    main()
