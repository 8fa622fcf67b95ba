"""What samples between the vertices buy: bytes, errors at probes, and PSNR.

A row for the polygons at the vertices of each scene, and one for each target. Errors are of a
uniform sky's irradiance, as parts of pi, at the places that refinement probes: its own prediction.
PSNR is under a real light probe, tessellated and per fragment, and tessellated with correspondence.
With --out it also writes the pictures and how they differ from the reference, five times enlarged.
"""

import time
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

import jaxvis
from experiments.measuring import WHITE, Image, reference_image
from experiments.output import Output
from experiments.settings import Common, execute, setting
from jaxvis.image import display, exposure_of, psnr, write_image
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

SCENES = ("wall", "sphere-on-plane", "box-on-plane", "torus-on-plane", "teapot", "duck")


@dataclass(frozen=True)
class Settings(Common):
    scene: tuple[str, ...] = setting(SCENES, "what is lit")
    environment: str = setting("stpeters", "what lights it")
    refine: tuple[float, ...] = setting((0.05, 0.02), "error targets, as parts of pi")
    growth: float = setting(4.0, "most bytes, in those of the vertices alone")
    zeta: float = setting(3.0, "tessellation quality")
    size: tuple[int, int] = setting((256, 256), "of the images", metavar=("W", "H"))
    error: float = setting(0.003, "standard error of the reference, relative to its mean")


def errors(at_probes: Float32[np.ndarray, "probes"]) -> dict[str, float]:
    """Columns about errors at probes."""
    return {
        "error max": float(at_probes.max()),
        "p99": float(np.percentile(at_probes, 99)),
        "mean": float(at_probes.mean()),
    }


def rows_of(
    scene: Scene, environment: jaxvis.Environment, settings: Settings, output: Output
) -> list[dict[str, object]]:
    """A row for the vertices alone and for each target."""
    surface = jaxvis.trace_surface(scene, jaxvis.default_camera(scene), settings.size)
    truth = reference_image(scene, environment, surface, settings.error)
    covered = np.asarray(surface.coverage) > 0.0
    exposure = exposure_of(truth, covered)
    methods = {
        f"tessellated (zeta {settings.zeta:g})": VectorizedVisibility(zeta=settings.zeta),
        "fragment": VectorizedVisibility(shading="fragment"),
    }
    joint = VisibilityCorrespondence(zeta=settings.zeta)
    base = methods["fragment"].precompute(scene, progress=False)
    both = build_correspondence(base, scene.tracer)
    light = methods["fragment"].light(environment)

    def row(refine: float | None, polygons: VisibilityPolygons) -> dict[str, object]:
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
            aim = "none" if refine is None else f"{refine:g}"
            stem = f"{scene.name}-{aim}-{name.split()[0]}"
            _write(output, stem, image, truth, exposure)
        return columns

    rows = [row(None, base)]
    for target in settings.refine:
        start = time.perf_counter()
        goal = Goal(target, settings.growth)
        polygons, record = refine_polygons(scene, base, goal, progress=False)
        seconds = time.perf_counter() - start
        rows[0] |= errors(record.before)
        rows.append(
            row(target, polygons)
            | errors(record.after)
            | {"traced": record.traced, "met": record.met, "s": seconds}
        )
    return rows


def _write(output: Output, stem: str, image: Image, truth: Image, exposure: float) -> None:
    """Writes a picture and its difference from the reference, if files are wanted."""
    shown, right = display(image, exposure), display(truth, exposure)
    difference = 0.5 + DIFFERENCE * (np.asarray(shown) - np.asarray(right))
    for name, picture in ((stem, shown), (f"{stem}-difference", difference.clip(0.0, 1.0))):
        path = output.path(f"{name}.png")
        if path is not None:
            write_image(path, picture)


def run(settings: Settings, output: Output) -> None:
    """All scenes under one light."""
    environment = jaxvis.load_environment(settings.environment)
    rows = []
    for name in settings.scene:
        rows += rows_of(jaxvis.load_scene(name).with_albedo(WHITE), environment, settings, output)
    size = f"{settings.size[0]} x {settings.size[1]}"
    output.say(f"{environment.name}, {size}, growth {settings.growth:g}")
    output.table("refinement", "Samples between the vertices, over the error target", rows)


if __name__ == "__main__":
    execute(Settings, run, __doc__)
