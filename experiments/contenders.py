"""What races for quality at equal time: methods over samples or tessellations, and Mitsuba."""

import dataclasses
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from jaxtyping import Float32

from experiments.curves import Curve, Frame
from experiments.mitsuba_bridge import MITSUBA_BSDFS, mitsuba_scene
from jaxvis.compare.measurement import finite_image
from jaxvis.compare.setting import Setting
from jaxvis.image import psnr
from jaxvis.methods import Denoised, Method
from jaxvis.methods.registry import create

Pixels = Float32[np.ndarray, "height width 3"]

KEY = 7
"""Seed of every render."""

MITSUBA = {
    "Mitsuba direct": {},
    "Mitsuba emitter": {"emitter_samples": 1, "bsdf_samples": 0},
}
"""Mitsuba's estimators of direct light: half of the rays by the BRDF, and all towards the light."""


@dataclass(frozen=True, eq=False)
class Variant:
    """A method as set for one frame.

    Attributes:
        setting: for tables, as ``8 spp`` or ``zeta 2``.
        render: gives the image.
    """

    setting: str
    render: Callable[[], Pixels]


@dataclass(frozen=True, eq=False)
class Contender:
    """A method with variants from cheap to dear, and what its images are compared with.

    Attributes:
        stored: bytes that it keeps of the visibility.
        build: seconds that this took.
    """

    name: str
    truth: Pixels
    variants: Callable[[], list[Variant]]
    stored: int = 0
    build: float = 0.0


def of_method(
    spec: str,
    setting: Setting,
    truth: Pixels,
    *,
    zeta: Sequence[float],
    most: int,
) -> Contender:
    """A method by name: over 1, 2, 4, ... ``most`` samples a pixel, if it takes samples; over the
    tessellation qualities ``zeta`` and per fragment, if it divides triangles; or as it is.
    """
    method = create(spec)
    start = time.perf_counter()
    visibility = method.precompute(setting.scene, progress=False)
    build = time.perf_counter() - start
    light = method.light(setting.environment)

    def variant(name: str, varied: Method) -> Variant:
        def render() -> Pixels:
            key = jax.random.key(KEY) if varied.stochastic else None
            return finite_image(varied.shade(visibility, light, setting.surface, key=key))

        return Variant(name, render)

    def variants() -> list[Variant]:
        if _takes_samples(method):
            counts = [2**k for k in range(most.bit_length()) if 2**k <= most]
            return [variant(f"{n} spp", with_samples(method, n)) for n in counts]
        if hasattr(method, "zeta"):
            whole: Any = method
            divided = [dataclasses.replace(whole, shading="tessellated", zeta=z) for z in zeta]
            last = dataclasses.replace(whole, shading="fragment")
            named = [f"zeta {z:g}" for z in zeta]
            return [*map(variant, named, divided), variant("fragment", last)]
        return [variant("", method)]

    return Contender(spec, truth, variants, int(visibility.nbytes), build)


def _takes_samples(method: Method) -> bool:
    return hasattr(method.method if isinstance(method, Denoised) else method, "spp")


def with_samples(method: Any, spp: int) -> Method:
    """The same method with other samples per pixel."""
    if isinstance(method, Denoised):
        return dataclasses.replace(method, method=with_samples(method.method, spp))
    return dataclasses.replace(method, spp=spp)


def of_mitsuba(mi: Any, setting: Setting, truth_spp: int, most: int) -> list[Contender]:
    """Mitsuba's direct light by each of its estimators, against its own converged image.

    Its own, because pixels where the two programs disagree (interpolated normals that face away,
    the filter of texels) say nothing about noise.
    """
    peer = mitsuba_scene(
        *(mi, setting.scene, setting.camera, setting.environment, setting.size),
        MITSUBA_BSDFS["diffuse"],
    )

    def image(integrator: Any, spp: int, seed: int) -> Pixels:
        return np.array(mi.render(peer, integrator=integrator, spp=spp, seed=seed), np.float32)

    integrators = {
        name: mi.load_dict({"type": "direct", "hide_emitters": True, **options})
        for name, options in MITSUBA.items()
    }
    most_at_once = 1024
    passes = max(1, truth_spp // most_at_once)
    direct = integrators["Mitsuba direct"]
    truth = np.mean(
        [image(direct, min(truth_spp, most_at_once), 1000 + k) for k in range(passes)], axis=0
    )
    counts = [2**k for k in range(most.bit_length()) if 2**k <= most]
    return [
        Contender(
            name,
            truth,
            lambda integrator=integrator: [
                Variant(f"{n} spp", lambda n=n, i=integrator: image(i, n, KEY)) for n in counts
            ],
        )
        for name, integrator in integrators.items()
    ]


@dataclass(frozen=True)
class Race:
    """How long frames may take: a contender renders none after one over ``seconds``. Frames over
    ``once`` seconds are timed once, others ``repeats`` times.
    """

    seconds: float
    repeats: int
    once: float = 1.0


@dataclass(eq=False)
class Rendered:
    """A variant's picture, its PSNR, and the seconds of its frames so far."""

    variant: Variant
    picture: Pixels
    decibels: float
    seconds: list[float]


def run(
    ours: Sequence[Contender], others: Sequence[Contender], covered: np.ndarray, race: Race
) -> dict[str, dict[str, Rendered]]:
    """Every variant rendered and timed, by contender and setting.

    Variants are rendered first, which compiles them, and then timed in rounds, all in turn: what
    else the machine does falls on all alike. The ``others`` stop where they are as good as the best
    of ``ours``.
    """
    found = {c.name: _rendered(c, covered, race.seconds, np.inf) for c in ours}
    enough = max(each.decibels for variants in found.values() for each in variants.values())
    found |= {c.name: _rendered(c, covered, race.seconds, enough) for c in others}
    every = [each for variants in found.values() for each in variants.values()]
    for _ in range(race.repeats):
        for each in every:
            if not each.seconds or each.seconds[0] < race.once:
                each.seconds.append(_timed(each.variant)[1])
    return found


def curve_of(name: str, rendered: dict[str, Rendered]) -> Curve:
    """The frames of a contender, at the median of their seconds."""
    return Curve(
        name,
        tuple(
            Frame(setting, float(np.median(each.seconds)), each.decibels)
            for setting, each in rendered.items()
        ),
    )


def _rendered(
    contender: Contender, covered: np.ndarray, seconds: float, enough: float
) -> dict[str, Rendered]:
    found = {}
    for variant in contender.variants():
        picture, taken = _timed(variant)
        decibels = psnr(picture, contender.truth, covered)
        found[variant.setting] = Rendered(variant, picture, decibels, [])
        # The first frame of a variant compiles, which is not counted.
        if decibels > enough or (taken > seconds and _timed(variant)[1] > seconds):
            break
    return found


def _timed(variant: Variant) -> tuple[Pixels, float]:
    start = time.perf_counter()
    picture = variant.render()
    return picture, time.perf_counter() - start
