"""Quality at equal time, and time at equal quality (paper 000, figs. 16 to 18).

Renders scenes by precomputed methods, over their tessellation quality, and by estimators, over
their samples a pixel, alone and denoised; with Mitsuba, if it is installed. Prints every frame, how
far each precomputed frame is above what the others reach in its time, and how many times longer the
others take to its PSNR. The best frame of a scene is the one furthest above both mc-ides and
Mitsuba. Writes CSV, the curves, and pictures at equal time to --out.

Where a method's quickest frame takes longer than the time asked for, that frame stands for it, and
where none of its frames reaches the PSNR asked for, the longest one does: the value is marked as a
bound then.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.contenders import Contender, Race, Rendered, curve_of, of_method, of_mitsuba, run
from experiments.curves import Curve, Found, Frame, margin, speedup
from experiments.equal_time_pictures import draw_curves, draw_equal_time, draw_samples
from experiments.measuring import WHITE, reference_image
from experiments.mitsuba_bridge import load_mitsuba
from experiments.output import Output, markdown
from experiments.settings import Common, execute, setting
from jaxvis.compare import prepare
from jaxvis.compare.setting import Setting
from jaxvis.image import exposure_of
from jaxvis.methods.denoised import SUFFIX

RIVAL, PEER = "mc-ides", "Mitsuba"
"""Those that the best frame is chosen against: the estimator, and every name that begins so."""


@dataclass(frozen=True)
class Settings(Common):
    scene: tuple[str, ...] = setting(("duck", "utah-teapot"), "what is lit")
    environment: tuple[str, ...] = setting(("stpeters",), "what lights it, one after another")
    size: tuple[int, int] = setting((256, 256), "of the images", metavar=("W", "H"))
    methods: tuple[str, ...] = setting(
        ("correspondence:vectors=128", "vectorized:vectors=128"), "precomputed ones"
    )
    zeta: tuple[float, ...] = setting((0.0, 1.0, 2.0, 3.0, 4.0), "tessellation qualities")
    estimators: tuple[str, ...] = setting(
        ("mc-mis", "mc-ides", "mc-ides-acdf", "mc-adaptive"), "Monte Carlo methods", empty=True
    )
    denoised: tuple[str, ...] = setting(
        ("mc-mis+denoise", "mc-ides+denoise", "mc-adaptive+denoise"), "those denoised", empty=True
    )
    mitsuba: bool = setting(True, "race Mitsuba too, if it is installed")
    variant: str | None = setting(None, "of Mitsuba; llvm_ad_rgb if it works, else scalar_rgb")
    own_materials: bool = setting(False, "instead of white diffuse; without Mitsuba")
    seconds: float = setting(4.0, "a method's last frame is the first that takes longer")
    samples: int = setting(4096, "most samples a pixel")
    error: float = setting(0.005, "standard error of the reference, relative to its mean")
    peer_spp: int = setting(2048, "samples a pixel of Mitsuba's converged image")
    repeats: int = setting(3, "rounds of timing")


def measure(
    settings: Settings, output: Output, scene: str, environment: str, mi: Any
) -> dict[str, list[dict[str, Any]]]:
    """The tables' rows of one scene under one light; draws its pictures."""
    albedo = None if settings.own_materials else WHITE
    stage = prepare(scene, environment, settings.size, albedo=albedo)
    truth = reference_image(stage.scene, stage.environment, stage.surface, settings.error)
    ours, others = contenders(settings, stage, truth, mi)
    race = Race(settings.seconds, settings.repeats)
    rendered = run(ours, others, stage.covered, race)
    curves = {name: curve_of(name, variants) for name, variants in rendered.items()}
    where = {"scene": scene, "environment": environment}
    mine = [curves[c.name] for c in ours]
    rivals = [curves[c.name] for c in others]
    frames = [
        {
            **where,
            "method": curve.name,
            "setting": frame.setting,
            "seconds": frame.seconds,
            "PSNR dB": frame.decibels,
        }
        for curve in curves.values()
        for frame in curve.frames
    ]
    margins, ratios, best = compared(mine, rivals)
    stored = [{**where, "method": c.name, "build s": c.build, "MB": c.stored / 1e6} for c in ours]
    if output.folder is not None:
        name = f"{stage.scene.name}-{stage.environment.name}"
        pictures(output, name, stage, rendered, curves, (ours, others), best)
    return {
        "frames": frames,
        "margins": [{**where, **row} for row in margins],
        "ratios": [{**where, **row} for row in ratios],
        "stored": stored,
        "best": [{**where, **summary(best, rivals)}],
    }


def contenders(
    settings: Settings, stage: Setting, truth: np.ndarray, mi: Any
) -> tuple[list[Contender], list[Contender]]:
    """The precomputed methods, and the estimators with Mitsuba's."""
    ours, others = (
        [of_method(s, stage, truth, zeta=settings.zeta, most=settings.samples) for s in specs]
        for specs in (settings.methods, (*settings.estimators, *settings.denoised))
    )
    if mi is not None:
        others += of_mitsuba(mi, stage, settings.peer_spp, settings.samples)
    return ours, others


def compared(
    ours: Sequence[Curve], others: Sequence[Curve]
) -> tuple[list[dict[str, Any]], list[dict[str, Any]], tuple[str, Frame]]:
    """Decibels above the others at equal time, times quicker at equal PSNR, and the best frame."""
    margins, ratios = [], []
    for curve in ours:
        for frame in curve.frames:
            of = {"method": curve.name, "setting": frame.setting, "seconds": frame.seconds}
            of["PSNR dB"] = frame.decibels
            margins.append({**of, **{c.name: shown(margin, frame, c) for c in others}})
            ratios.append({**of, **{c.name: shown(speedup, frame, c) for c in others}})
    every = [(curve.name, frame) for curve in ours for frame in curve.frames]
    return margins, ratios, max(every, key=lambda each: least_margin(each[1], others))


def least_margin(frame: Frame, others: Sequence[Curve]) -> float:
    """Decibels above mc-ides and Mitsuba, whichever is better; above all where neither raced."""
    rivals = [c for c in others if c.name == RIVAL or c.name.startswith(PEER)] or others
    return min(margin(frame, curve).value for curve in rivals)


Value = Callable[[Frame, Curve], Found]
BOUNDS: dict[tuple[Value, str], str] = {(margin, "slower"): "≥ ", (margin, "more"): "≤ "}
BOUNDS |= {(speedup, "slower"): "≤ ", (speedup, "more"): "≥ "}
"""What a value is of the true one, where a measured frame stands for one that was not."""


def shown(value: Value, frame: Frame, other: Curve) -> str:
    """A margin or a speedup in three digits, marked where it is a bound."""
    found = value(frame, other)
    return f"{BOUNDS.get((value, found.bound), '')}{found.value:.3g}"


def summary(best: tuple[str, Frame], others: Sequence[Curve]) -> dict[str, Any]:
    """The best frame beside its closest rivals."""
    name, frame = best

    def least(curves: Sequence[Curve], value: Value) -> tuple[str, str]:
        if not curves:
            return "", ""
        closest = min(curves, key=lambda curve: value(frame, curve).value)
        return closest.name, shown(value, frame, closest)

    denoised = [c for c in others if c.name.endswith(SUFFIX)]
    peers = [c for c in others if c.name.startswith(PEER)]
    rival = [c for c in others if c.name == RIVAL]
    quicker_than, quicker = least(denoised, speedup)
    return {
        "best": f"{name} {frame.setting}",
        "seconds": frame.seconds,
        "PSNR dB": frame.decibels,
        f"dB over {RIVAL}": least(rival, margin)[1],
        f"dB over {PEER}": least(peers, margin)[1],
        "dB over the best denoised": least(denoised, margin)[1],
        "times quicker than the best denoised": quicker,
        "which is": quicker_than,
    }


def pictures(
    output: Output,
    name: str,
    stage: Setting,
    rendered: Mapping[str, Mapping[str, Rendered]],
    curves: Mapping[str, Curve],
    raced: tuple[Sequence[Contender], Sequence[Contender]],
    best: tuple[str, Frame],
) -> None:
    """The curves, the pictures at the best frame's time, and those of mc-ides over its samples."""
    ours, others = raced
    truths = {contender.name: contender.truth for contender in (*ours, *others)}
    reference = ours[0].truth
    exposure = exposure_of(reference, stage.covered)
    precomputed = {contender.name for contender in ours}
    draw_curves(output.path(f"{name}-curves.png"), list(curves.values()), precomputed)
    draw_equal_time(
        output.path(f"{name}-equal-time.png"),
        (rendered, truths),
        list(curves.values()),
        (stage.surface, reference, exposure),
        best,
        precomputed,
    )
    if RIVAL in rendered:
        draw_samples(
            output.path(f"{name}-{RIVAL}.png"), rendered[RIVAL], reference, stage.covered, exposure
        )


TITLES = {
    "best": "The best frame of each scene",
    "margins": "Decibels above the others at equal time",
    "ratios": "Times longer that the others take to equal PSNR",
    "stored": "What is stored",
    "frames": "Every frame",
}


def race(settings: Settings, output: Output) -> None:
    """All scenes under all lights."""
    mi = None
    if settings.mitsuba and not settings.own_materials:
        try:
            mi = load_mitsuba(settings.variant)
        except ImportError as error:
            output.say(f"Without Mitsuba: {error}")
    tables: dict[str, list[dict[str, Any]]] = {name: [] for name in TITLES}
    for environment in settings.environment:
        for scene in settings.scene:
            found = measure(settings, output, scene, environment, mi)
            output.say(f"{scene}, {environment}:\n\n{markdown(found['best'])}")
            for name, rows in found.items():
                tables[name] += rows
    peer = "" if mi is None else f", Mitsuba {mi.__version__} ({mi.variant()})"
    output.say(f"{settings.size[0]} x {settings.size[1]}, one seed{peer}")
    for name, title in TITLES.items():
        output.table(name, title, tables[name])


if __name__ == "__main__":
    execute(Settings, race, __doc__)
