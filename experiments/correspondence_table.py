"""What correspondence costs and gains (paper 000, table 1, figs. 11 and 13).

First tables: sizes of both structures and the time to build them; triples a triangle, in all and
evaluated, and the share of faces that keep three evaluations; build times of ever finer meshes.
With --sweep: PSNR against the reference, evaluations and frame time of vectorized and
correspondence for every zeta and for fragments, the two taking turns. With --seams: how much the
light at inner edges of the mesh differs between the triples of the faces on either side, relative
to the image's mean.

Targets: PSNR no less than that of vectorized from zeta 3 on; frame times 1.35 times shorter at
zeta 1, 2.3 at zeta 4 and 2.5 for fragments; 10 ms to build a triangle, in proportion to their
number; at most 4.6 KB of triples and 2 % of faces with three evaluations; seams below 1 %.
"""

import time
from dataclasses import dataclass, replace
from itertools import pairwise

import jax
import numpy as np

import jaxvis
from experiments.measuring import WHITE, best_of, reference_image
from experiments.output import Output
from experiments.settings import Common, execute, setting
from jaxvis.image import psnr
from jaxvis.methods.vectorized import VectorizedVisibility, precompute_polygons
from jaxvis.methods.vectorized.correspondence import CorrespondingPolygons, build
from jaxvis.methods.vectorized.correspondence.interpolated import Interpolation
from jaxvis.methods.vectorized.correspondence.method import Construction, VisibilityCorrespondence
from jaxvis.methods.vectorized.correspondence.seams import (
    differences,
    mean_irradiance,
    sides_of_edges,
)
from jaxvis.methods.vectorized.light import PolygonLight
from jaxvis.methods.vectorized.mesh import Mesh
from jaxvis.methods.vectorized.precompute import Settings as PolygonSettings
from jaxvis.scene import Scene, Surface

SMALL = "torus-on-plane:cells=4,around=8"
"""A scene that compiles everything."""

FINER = (8, 12, 16, 24)
"""Cells along the plane; twice as many go around the torus."""

BIN_ENDS = (0.0, 1e-5, 1e-4, 1e-3, 3e-3, 0.01, 0.03, 0.1, np.inf)


@dataclass(frozen=True)
class Settings(Common):
    scene: tuple[str, ...] = setting(("duck", "utah-teapot", "bunny"), "what is lit")
    environment: str = setting("stpeters", "what lights it")
    sweep: bool = setting(False, "PSNR and frame times over zeta")
    seams: bool = setting(False, "differences across inner edges")
    scaling: bool = setting(True, "build times of ever finer meshes")
    construction: Construction = setting(VisibilityCorrespondence.construction, "of triples")
    interpolation: Interpolation = setting(VisibilityCorrespondence.interpolation, "inside faces")
    zeta: tuple[float, ...] = setting((0.0, 1.0, 2.0, 3.0, 4.0), "tessellation qualities")
    size: tuple[int, int] = setting((256, 256), "of the images", metavar=("W", "H"))
    vectors: int = setting(128, "most position vectors of a polygon")
    error: float = setting(0.01, "standard error of the reference, relative to its mean")
    repeats: int = setting(5, "rounds of timing")
    own_materials: bool = setting(False, "instead of white diffuse")
    cached: bool = setting(False, "polygons from the cache, not timed")


def built(
    scene: Scene, method: VisibilityCorrespondence, settings: Settings
) -> tuple[CorrespondingPolygons, dict[str, float]]:
    """The correspondence, and the seconds that polygons and triples took."""
    start = time.perf_counter()
    if settings.cached:
        polygons = three_evaluations(method).precompute(scene, progress=False)
        polygon_seconds = np.nan
    else:
        fine = PolygonSettings(vectors=method.vectors)
        polygons = precompute_polygons(scene, fine, progress=False)
        polygon_seconds = time.perf_counter() - start
    how = build.Settings(
        construction=method.construction, seed=method.seed, interpolation=method.interpolation
    )
    start = time.perf_counter()
    found = build.build_correspondence(polygons, scene.tracer, how)
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


def scaling(method: VisibilityCorrespondence, settings: Settings) -> list[dict[str, object]]:
    """Build times of one shape in ever more triangles."""
    rows = []
    for cells in FINER:
        scene = jaxvis.load_scene(f"torus-on-plane:cells={cells},around={2 * cells}")
        cost, count = sizes(scene, *built(scene, method, settings))
        kept = ("triangles", "triples s", "ms/triangle")
        rows.append({name: cost[name] for name in kept} | {"% separate": count["% of faces"]})
    return rows


def sweep(
    scene: Scene,
    environment: jaxvis.Environment,
    surface: Surface,
    found: CorrespondingPolygons,
    method: VisibilityCorrespondence,
    settings: Settings,
) -> list[dict[str, object]]:
    """A row for each zeta and for fragments: both methods, interleaved."""
    truth = reference_image(scene, environment, surface, settings.error)
    covered = np.asarray(surface.coverage) > 0.0
    light = method.light(environment)
    joint = {f"zeta {zeta:g}": replace(method, zeta=zeta) for zeta in settings.zeta}
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
        seconds = dict(zip(shades, best_of(settings.repeats, *shades.values()), strict=True))
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
) -> tuple[list[dict[str, object]], dict[str, object]]:
    """Rows of what the sides differ by, and a row of the shares of edges by the pixels' seams.

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
    shares = zip(labels, counts / max(len(pixels), 1), strict=True)
    return rows, {"scene": scene.name, **dict(shares)}


def run(settings: Settings, output: Output) -> None:
    """All scenes under one light."""
    method = VisibilityCorrespondence(
        vectors=settings.vectors,
        construction=settings.construction,
        interpolation=settings.interpolation,
    )
    built(jaxvis.load_scene(SMALL), method, settings)
    costs, counts, frames, edges, histograms = [], [], [], [], []
    environment = jaxvis.load_environment(settings.environment)
    for name in settings.scene:
        scene = jaxvis.load_scene(name)
        scene = scene if settings.own_materials else scene.with_albedo(WHITE)
        found, seconds = built(scene, method, settings)
        cost, count = sizes(scene, found, seconds)
        costs.append(cost)
        counts.append(count)
        surface = jaxvis.trace_surface(scene, jaxvis.default_camera(scene), settings.size)
        if settings.sweep:
            frames += sweep(scene, environment, surface, found, method, settings)
        if settings.seams:
            rows, histogram = seams(scene, surface, method.light(environment), found, method)
            edges += rows
            histograms.append(histogram)
    output.say(f"{environment.name}, {settings.size[0]} x {settings.size[1]}, {method}")
    output.table("sizes", "Sizes and times", costs)
    output.table("counts", "Counts", counts)
    if settings.scaling:
        output.table("scaling", "Ever finer meshes", scaling(method, settings))
    if settings.sweep:
        output.table("images", "Images", frames)
    if settings.seams:
        output.table("seams", "Seams, of the image's mean irradiance", edges)
        output.table("shares", "Share of edges, by the pixels' seams", histograms)


if __name__ == "__main__":
    execute(Settings, run, __doc__)
