"""In the time of a frame of vectorized visibility, how good are Monte Carlo images?

Renders a white diffuse scene by ``vectorized``, tessellated, and then by mc-mis, and by Mitsuba's
``direct`` if it is installed, at 1, 2, 4, ... samples a pixel: their PSNR at the frame's seconds is
interpolated between the runs, over the logarithm of the time. Where even one sample takes longer,
its PSNR stands for them, and the row says so. Target: 14 dB above both.
"""

import argparse
from collections.abc import Callable
from typing import Any

import jax
import numpy as np
import pandas as pd

import jaxvis
from experiments.mitsuba_bridge import (
    MITSUBA_BSDFS,
    direct_integrator,
    load_mitsuba,
    mitsuba_scene,
)
from experiments.zeta_sweep import Image, median_seconds, reference_image, white
from jaxvis.image import psnr
from jaxvis.methods import MonteCarlo
from jaxvis.methods.vectorized import VectorizedVisibility
from jaxvis.scene import Camera, Scene, Surface

MOST_SAMPLES = 1024
Render = Callable[[int], Callable[[], Any]]
"""Samples a pixel -> what renders the image."""


def mis(scene: Scene, environment: jaxvis.Environment, surface: Surface) -> Render:
    """jaxvis' multiple importance sampling."""

    def render(spp: int) -> Callable[[], Any]:
        method = MonteCarlo("mis", spp)
        visibility, light = method.precompute(scene), method.light(environment)
        return lambda: method.shade(visibility, light, surface, key=jax.random.key(7))

    return render


def mitsuba_direct(
    mi: Any,
    scene: Scene,
    camera: Camera,
    environment: jaxvis.Environment,
    size: tuple[int, int],
) -> Render:
    """Mitsuba's direct light."""
    peer = mitsuba_scene(mi, scene, camera, environment, size, MITSUBA_BSDFS["diffuse"])
    integrator = direct_integrator(mi)

    def render(spp: int) -> Callable[[], Any]:
        return lambda: np.array(mi.render(peer, integrator=integrator, spp=spp, seed=7))

    return render


def at_seconds(
    render: Render, truth: Image, covered: np.ndarray, seconds: float, repeats: int
) -> tuple[float, str]:
    """PSNR at a frame time, and how it was found."""
    times, decibels, spp = [], [], 1
    while spp <= MOST_SAMPLES and not (times and times[-1] > seconds):
        frame = render(spp)
        decibels.append(psnr(np.asarray(frame()), truth, covered))
        times.append(median_seconds(frame, repeats))
        spp *= 2
    if times[0] > seconds:
        return decibels[0], f"1 spp takes {times[0]:.3g} s"
    if times[-1] < seconds:
        return decibels[-1], f"{spp // 2} spp take {times[-1]:.3g} s"
    value = np.interp(np.log(seconds), np.log(times), decibels)
    samples = np.interp(np.log(seconds), np.log(times), np.arange(len(times)))
    return float(value), f"{2.0**samples:.3g} spp"


def race(
    mi: Any, scene: Scene, environment: jaxvis.Environment, options: argparse.Namespace
) -> list[dict[str, object]]:
    """The rows of one scene."""
    camera, size = jaxvis.default_camera(scene), tuple(options.size)
    surface = jaxvis.trace_surface(scene, camera, size)
    covered = np.asarray(surface.coverage) > 0.0
    truth = reference_image(scene, environment, surface, options.error)
    method = VectorizedVisibility(zeta=options.zeta, vectors=options.vectors)
    visibility, light = method.precompute(scene, progress=False), method.light(environment)

    def frame() -> jax.Array:
        return method.shade(visibility, light, surface)

    seconds = median_seconds(frame, options.repeats)
    ours = psnr(np.asarray(frame()), truth, covered)
    rows = [_row(scene, f"vectorized, zeta {options.zeta:g}", ours, ours, seconds, "")]
    mc, how = at_seconds(mis(scene, environment, surface), truth, covered, seconds, options.repeats)
    rows.append(_row(scene, "mc-mis", mc, ours, seconds, how))
    if mi is not None:
        # Mitsuba's own converged image: pixels where the two programs differ say nothing here.
        direct = mitsuba_direct(mi, scene, camera, environment, size)
        converged = direct(options.peer_spp)()
        theirs, how = at_seconds(direct, converged, covered, seconds, options.repeats)
        rows.append(_row(scene, "Mitsuba direct", theirs, ours, seconds, how))
    return rows


def _row(
    scene: Scene, name: str, value: float, ours: float, seconds: float, how: str
) -> dict[str, object]:
    return {
        "scene": scene.name,
        "method": name,
        "seconds": seconds,
        "PSNR dB": value,
        "margin dB": ours - value,
        "samples": how,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", nargs="+", default=["duck", "teapot"])
    parser.add_argument("--environment", default="stpeters")
    parser.add_argument("--size", nargs=2, type=int, default=[512, 512], metavar=("W", "H"))
    parser.add_argument("--vectors", type=int, default=128)
    parser.add_argument("--zeta", type=float, default=4.0)
    parser.add_argument("--error", type=float, default=0.005, help="of the reference")
    parser.add_argument("--peer-spp", type=int, default=512, help="Mitsuba's converged image")
    parser.add_argument("--variant", help="of Mitsuba; llvm_ad_rgb if it works, else scalar_rgb")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--quick", action="store_true", help="the teapot at 192 x 192")
    options = parser.parse_args()
    if options.quick:
        options.scene, options.size, options.error = ["teapot"], [192, 192], 0.01
    try:
        mi = load_mitsuba(options.variant)
    except ImportError as error:
        print(f"without Mitsuba: {error}")
        mi = None
    environment = jaxvis.load_environment(options.environment)
    rows = []
    for name in options.scene:
        rows += race(mi, white(jaxvis.load_scene(name)), environment, options)
    print(f"{environment.name}, {options.size}, {options.vectors} vectors")
    print(pd.DataFrame(rows).to_string(index=False, float_format="{:.4g}".format))


if __name__ == "__main__":
    main()
