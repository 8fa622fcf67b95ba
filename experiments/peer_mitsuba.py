"""jaxvis beside Mitsuba 3: the same mesh, camera, light and material in both.

First table: do the images agree? Mean ratio and RMSE over the pixels that are covered in both,
beside the noise floor (what two renders with the noise of these would differ by). Second table:
PSNR and seconds of both at 1 to 256 samples a pixel, each against its own converged image. A sample
is one ray in jaxvis and two in Mitsuba, whose integrator traces one to the light and one by the
BRDF. --out also writes the images and their difference.
"""

from dataclasses import dataclass
from typing import Any, Literal

import jax
import numpy as np

import jaxvis
from experiments.measuring import Image, Row, seconds_of
from experiments.mitsuba_bridge import (
    MITSUBA_BSDFS,
    direct_integrator,
    load_mitsuba,
    mitsuba_scene,
    rough_metal,
    white_diffuse,
)
from experiments.output import Output
from experiments.settings import Common, execute, setting
from jaxvis.image import display, psnr, write_image
from jaxvis.methods import MonteCarlo, Reference
from jaxvis.scene import Scene, Surface


@dataclass(frozen=True)
class Settings(Common):
    scene: tuple[str, ...] = setting(("teapot",), "what is lit")
    environment: str = setting("windows", "what lights it")
    size: tuple[int, int] = setting((256, 256), "of the images", metavar=("W", "H"))
    spp: int = setting(1024, "samples a pixel for the agreement, per render")
    renders: int = setting(4, "for the agreement")
    materials: tuple[Literal["diffuse", "metal"], ...] = setting(
        ("diffuse", "metal"), "one after another"
    )
    variant: str | None = setting(None, "of Mitsuba; llvm_ad_rgb if it works, else scalar_rgb")


def ours(
    scene: Scene, environment: jaxvis.Environment, surface: Surface, spp: int, renders: int
) -> tuple[Image, Image]:
    """Mean of independent mc-mis renders and its standard error, per pixel."""
    method = MonteCarlo("mis", spp)
    visibility, light = method.precompute(scene), method.light(environment)
    images = [
        np.asarray(method.shade(visibility, light, surface, key=jax.random.key(i)))
        for i in range(renders)
    ]
    return np.mean(images, axis=0), np.std(images, axis=0, ddof=1) / np.sqrt(renders)


def theirs(mi: Any, scene: Any, spp: int, renders: int) -> tuple[Image, Image]:
    """The same of Mitsuba's direct integrator."""
    integrator = direct_integrator(mi)
    images = [
        np.array(mi.render(scene, integrator=integrator, spp=spp, seed=i)) for i in range(renders)
    ]
    return np.mean(images, axis=0), np.std(images, axis=0, ddof=1) / np.sqrt(renders)


def comparable(scene: Scene, surface: Surface) -> np.ndarray:
    """Pixels [height, width] in which every interpolated normal faces the viewer.

    Where one faces away, along the silhouettes of coarse meshes, Mitsuba shades black and jaxvis
    turns the normal towards the view.
    """
    triangle = np.asarray(surface.triangle)
    corners = scene.triangles[np.maximum(triangle, 0)]
    normal = np.einsum("rck,rckx->rcx", np.asarray(surface.barycentrics), scene.normals[corners])
    away = np.sum(normal * np.asarray(surface.view), axis=-1) < 0.0
    away &= np.asarray(surface.mask)
    n = surface.supersampling
    return ~away.reshape(surface.height, n, surface.width, n).any(axis=(1, 3))


def structure(difference: Image, noise: Image, mask: np.ndarray, block: int = 8) -> float:
    """Root mean square over blocks of pixels of (mean difference / its standard error).

    1 is what independent noise gives; a visible structure in the difference gives more.
    """
    height, width = (n // block * block for n in mask.shape)

    def blocks(values: np.ndarray) -> np.ndarray:
        tiles = values[:height, :width].reshape(height // block, block, width // block, block)
        return tiles.sum(axis=(1, 3))

    value = blocks(np.where(mask, difference.mean(axis=-1), 0.0))
    variance = blocks(np.where(mask, noise.mean(axis=-1) ** 2, 0.0))
    full = blocks(mask.astype(float)) == block * block
    return float(np.sqrt(np.mean(value[full] ** 2 / variance[full]))) if full.any() else np.nan


def agreement(
    mi: Any,
    scene: Scene,
    environment: jaxvis.Environment,
    material: str,
    settings: Settings,
    output: Output,
) -> Row:
    """One row of the first table; writes the pictures."""
    size = settings.size
    camera = jaxvis.default_camera(scene)
    surface = jaxvis.trace_surface(scene, camera, size, supersampling=4)
    peer = mitsuba_scene(mi, scene, camera, environment, size, MITSUBA_BSDFS[material])
    spp, renders = settings.spp, settings.renders
    a, a_error = ours(scene, environment, surface, max(2, spp // 16), renders)
    b, b_error = theirs(mi, peer, spp, renders)
    # Pixels that every ray of both covers, with normals that Mitsuba shades too.
    facing = comparable(scene, surface)
    inside = (np.asarray(surface.coverage) == 1.0) & facing
    difference = a - b
    noise = np.hypot(a_error, b_error)
    ratios = a[inside].mean(axis=0) / b[inside].mean(axis=0)
    white = float(np.quantile(b[inside].max(axis=-1), 0.99))
    shown = {
        "jaxvis": a,
        "mitsuba": b,
        "difference-x10": 0.5 * white + 10.0 * np.where(inside[..., None], difference, 0.0),
    }
    for name, image in shown.items():
        path = output.path(f"{scene.name}-{material}-{name}.png")
        if path is not None:
            write_image(path, display(image, 1.0 / white))
    return {
        "scene": scene.name,
        "material": material,
        "pixels": int(inside.sum()),
        "left out": int((~facing).sum()),
        "mean ratio": float(a[inside].mean() / b[inside].mean()),
        "worst channel": float(ratios[np.argmax(np.abs(ratios - 1.0))]),
        "RMSE/mean": float(np.sqrt(np.mean(difference[inside] ** 2)) / b[inside].mean()),
        "noise floor": float(np.sqrt(np.mean(noise[inside] ** 2)) / b[inside].mean()),
        "structure": structure(difference, noise, inside),
    }


def race(
    mi: Any, scene: Scene, environment: jaxvis.Environment, material: str, size: tuple[int, int]
) -> list[Row]:
    """PSNR and seconds of both at each number of samples, taking turns."""
    camera = jaxvis.default_camera(scene)
    surface = jaxvis.trace_surface(scene, camera, size)
    peer = mitsuba_scene(mi, scene, camera, environment, size, MITSUBA_BSDFS[material])
    integrator = direct_integrator(mi)
    truth = Reference(error=0.002)
    ours_truth, _ = truth.solve_cached(truth.precompute(scene), truth.light(environment), surface)
    their_truth, _ = theirs(mi, peer, 1024, 4)
    inside = np.asarray(surface.coverage) > 0.0
    rows = []
    for spp in (1, 4, 16, 64, 256):
        method = MonteCarlo("mis", spp)
        visibility, light = method.precompute(scene), method.light(environment)

        def render_ours(method=method, visibility=visibility, light=light) -> np.ndarray:
            return np.asarray(method.shade(visibility, light, surface, key=jax.random.key(99)))

        def render_theirs(spp=spp) -> np.ndarray:
            return np.array(mi.render(peer, integrator=integrator, spp=spp, seed=99))

        row: Row = {"scene": scene.name, "material": material, "spp": spp}
        for who, render, reference in (
            ("jaxvis", render_ours, np.asarray(ours_truth.image)),
            ("mitsuba", render_theirs, their_truth),
        ):
            image = render()  # compiles
            _, seconds = seconds_of(render, 3)
            row[f"{who} dB"] = psnr(image, reference, inside)
            row[f"{who} s"] = seconds
        rows.append(row)
    return rows


def measure(settings: Settings, output: Output) -> None:
    """Both tables, of every scene in every material."""
    try:
        mi = load_mitsuba(settings.variant)
    except ImportError as error:
        raise ValueError(str(error)) from error
    environment = jaxvis.load_environment(settings.environment)
    agreements, races = [], []
    for name in settings.scene:
        plain = jaxvis.load_scene(name)
        for material in settings.materials:
            scene = white_diffuse(plain) if material == "diffuse" else rough_metal(plain)
            agreements.append(agreement(mi, scene, environment, material, settings, output))
            races += race(mi, scene, environment, material, settings.size)
    width, height = settings.size
    variant = f"Mitsuba {mi.__version__} ({mi.variant()})"
    output.say(f"{variant}, {settings.environment}, {width} x {height}")
    output.table("agreement", "Agreement", agreements)
    output.table("race", "PSNR and seconds", races)


if __name__ == "__main__":
    execute(Settings, measure, __doc__)
