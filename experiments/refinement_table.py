"""What samples between the vertices buy: bytes, errors at probes, and PSNR.

A row for the polygons at the vertices of each scene, and one for each target. Errors are of a
uniform sky's irradiance, as parts of pi, at the places that refinement probes: its own prediction.
PSNR is under a real light probe, tessellated and per fragment, and tessellated with correspondence.
With --out it also writes the pictures and how they differ from the reference, five times enlarged.
"""

import argparse
import time
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float32

import jaxvis
from experiments.zeta_sweep import Image, reference_image, white
from jaxvis.image import display, psnr, write_image
from jaxvis.image.tonemap import exposure_of
from jaxvis.methods.vectorized import (
    VectorizedVisibility,
    VisibilityCorrespondence,
    VisibilityPolygons,
)
from jaxvis.methods.vectorized.correspondence.build import build_correspondence
from jaxvis.methods.vectorized.refine.refine import Goal, refine_polygons
from jaxvis.scene import Scene

DIFFERENCE = 5.0
"""By which the differences of displayed images are enlarged, about a middle grey."""


def errors(at_probes: Float32[np.ndarray, "probes"]) -> dict[str, float]:
    """Columns about errors at probes."""
    return {
        "error max": float(at_probes.max()),
        "p99": float(np.percentile(at_probes, 99)),
        "mean": float(at_probes.mean()),
    }


def rows_of(
    scene: Scene, environment: jaxvis.Environment, options: argparse.Namespace
) -> list[dict[str, object]]:
    """A row for the vertices alone and for each target."""
    surface = jaxvis.trace_surface(scene, jaxvis.default_camera(scene), tuple(options.size))
    truth = reference_image(scene, environment, surface, options.error)
    covered = np.asarray(surface.coverage) > 0.0
    exposure = exposure_of(truth, covered)
    methods = {
        f"tessellated (zeta {options.zeta:g})": VectorizedVisibility(zeta=options.zeta),
        "fragment": VectorizedVisibility(shading="fragment"),
    }
    joint = VisibilityCorrespondence(zeta=options.zeta)
    base = methods["fragment"].precompute(scene, progress=False)
    both = build_correspondence(base, scene.tracer)
    light = methods["fragment"].light(environment)

    def row(refine: str, polygons: VisibilityPolygons) -> dict[str, object]:
        columns: dict[str, object] = {
            "scene": scene.name,
            "refine": refine,
            "samples": len(polygons.counts),
            "triangles": len(polygons.triangles),
            "bytes": polygons.nbytes / base.nbytes,
        }
        corresponding = both if polygons is base else build_correspondence(polygons, scene.tracer)
        columns["with triples"] = corresponding.nbytes / both.nbytes
        image = np.asarray(joint.shade(corresponding, light, surface))
        columns["PSNR correspondence"] = psnr(image, truth, covered)
        for name, method in methods.items():
            image = np.asarray(method.shade(polygons, light, surface))
            columns[f"PSNR {name}"] = psnr(image, truth, covered)
            if options.out:
                stem = Path(options.out) / f"{scene.name}-{refine}-{name.split()[0]}"
                _write(image, truth, exposure, stem)
        return columns

    rows = [row("none", base)]
    for target in options.refine:
        start = time.perf_counter()
        goal = Goal(target, options.growth)
        polygons, record = refine_polygons(scene, base, goal, progress=False)
        seconds = time.perf_counter() - start
        rows[0] |= errors(record.before)
        rows.append(
            row(f"{target:g}", polygons)
            | errors(record.after)
            | {"traced": record.traced, "met": record.met, "s": seconds}
        )
    return rows


def _write(image: Image, truth: Image, exposure: float, stem: Path) -> None:
    shown, right = display(image, exposure), display(truth, exposure)
    difference = 0.5 + DIFFERENCE * (np.asarray(shown) - np.asarray(right))
    write_image(stem.with_name(stem.name + ".png"), shown)
    write_image(stem.with_name(stem.name + "-difference.png"), difference.clip(0.0, 1.0))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    scenes = ["wall", "sphere-on-plane", "box-on-plane", "torus-on-plane", "teapot", "duck"]
    parser.add_argument("--scene", nargs="+", default=scenes)
    parser.add_argument("--environment", default="stpeters")
    parser.add_argument("--refine", nargs="+", type=float, default=[0.05, 0.02])
    parser.add_argument("--growth", type=float, default=4.0)
    parser.add_argument("--zeta", type=float, default=3.0)
    parser.add_argument("--size", nargs=2, type=int, default=[256, 256], metavar=("W", "H"))
    parser.add_argument("--error", type=float, default=0.003, help="of the reference")
    parser.add_argument("--quick", action="store_true", help="the sphere at 128 x 128")
    parser.add_argument("--out", help="folder for the pictures")
    options = parser.parse_args()
    if options.quick:
        options.scene, options.size, options.error = ["sphere-on-plane"], [128, 128], 0.01
    environment = jaxvis.load_environment(options.environment)
    rows = []
    for name in options.scene:
        rows += rows_of(white(jaxvis.load_scene(name)), environment, options)
    table = pd.DataFrame(rows)
    print(f"{environment.name}, {options.size}, growth {options.growth:g}")
    print(table.to_string(index=False, na_rep="", float_format="{:.4g}".format))


if __name__ == "__main__":
    main()
