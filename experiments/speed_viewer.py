"""How fast the viewer's frames come while the environment turns, without a browser.

For each method the median time of a frame, whole and quick (what the viewer shows while something
moves, if whole frames are slow), the picture for the window included, and how far both are from the
reference at one turn.
"""

import statistics
import time
from dataclasses import dataclass, replace

from experiments.output import Output
from experiments.settings import Common, execute, setting
from jaxvis.compare import prepare
from jaxvis.view import Look, Session


@dataclass(frozen=True)
class Settings(Common):
    scene: str = setting("duck", "what is looked at")
    environment: str = setting("stpeters", "what lights it")
    size: tuple[int, int] = setting((256, 256), "of the frames", metavar=("W", "H"))
    method: tuple[str, ...] = setting(("correspondence", "vectorized", "mc-mis:spp=4"), "methods")
    reflectance: tuple[str, ...] = setting(("own", "lambert"), "models; own: the scene's")
    frames: int = setting(20, "that are timed")


def turning(session: Session, look: Look, frames: int) -> float:
    """Median seconds of a frame, each at another turn."""
    times = []
    for k in range(frames + 3):
        start = time.perf_counter()
        frame = session.frame(replace(look, yaw=0.1 * (k + 1)))
        frame.shown(frame.exposure)
        times.append(time.perf_counter() - start)
    return statistics.median(times[3:])  # the first ones compile


def run(settings: Settings, output: Output) -> None:
    """All methods on one scene."""
    rows = []
    for model in settings.reflectance:
        chosen = None if model == "own" else model
        found = prepare(settings.scene, settings.environment, settings.size, reflectance=chosen)
        session = Session(found.scene, found.environment)
        whole = Look("", found.camera, settings.size, yaw=1.0)
        truth = session.reference(whole)
        for name in settings.method:
            for quick in (False, True):
                look = replace(whole, method=name, quick=quick)
                seconds = turning(session, look, settings.frames)
                frame = session.frame(look)
                same = frame.setting.size == truth.setting.size
                rows.append(
                    {
                        "reflectance": model,
                        "method": name,
                        "frame": "quick" if quick else "whole",
                        "size": "{} x {}".format(*frame.setting.size),
                        "ms": 1e3 * seconds,
                        "frames/s": 1.0 / seconds,
                        "PSNR dB": frame.psnr(truth) if same else None,
                    }
                )
    output.table("frames", "Frames while the light turns", rows)


if __name__ == "__main__":
    execute(Settings, run, __doc__)
