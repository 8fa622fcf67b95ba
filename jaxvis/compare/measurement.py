"""One method on one setting: its image, its errors, its times and its counts."""

import dataclasses
import math
import statistics
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float32

from jaxvis.compare.setting import Setting
from jaxvis.image import flip, psnr, relative_rmse, relmse, rmse
from jaxvis.methods import Denoised, Method

FRAMES = 5
"""Warm frames that are timed, unless they take longer than :data:`SECONDS` together."""

SECONDS = 3.0

Pixels = Float32[np.ndarray, "height width 3"]
Tell = Callable[[str], None]


@dataclasses.dataclass(frozen=True, eq=False)
class Yardstick:
    """What every image is compared with."""

    reference: Pixels
    covered: Bool[np.ndarray, "height width"]
    exposure: float

    def errors(self, image: Pixels) -> dict[str, float | None]:
        """The metrics of DESIGN §5. JSON knows no infinity: an infinite value is None."""
        return {
            "psnr_db": self.psnr(image),
            "rmse": rmse(image, self.reference, self.covered),
            "relative_rmse": finite(relative_rmse(image, self.reference, self.covered)),
            "relmse": relmse(image, self.reference, self.covered, self.exposure),
            "flip": flip(image, self.reference, self.covered, self.exposure),
        }

    def psnr(self, image: Pixels) -> float | None:
        return finite(psnr(image, self.reference, self.covered, self.exposure))


class Prepared(NamedTuple):
    """A method's visibility and light, with the seconds that each took.

    ``light_s`` is warm; what the first call took longer is ``compile_s``. ``precompute_s`` is one
    call, compilation included.
    """

    visibility: Any
    light: Any
    precompute_s: float
    light_s: float
    compile_s: float


def prepared(method: Method, setting: Setting, tell: Tell, *, progress: bool = True) -> Prepared:
    """Runs the two verbs before shading.

    Raises:
        ValueError: the method refuses the scene or the light.
    """
    # The light first: what a method cannot do with it shows before the time goes to visibility.
    tell("light")
    light, first_light_s = _timed(lambda: method.light(setting.environment))
    light, light_s = _timed(lambda: method.light(setting.environment))
    tell("precompute")
    visibility, precompute_s = _timed(
        lambda: method.precompute_for(setting.scene, setting.surface, progress=progress)
    )
    return Prepared(visibility, light, precompute_s, light_s, max(0.0, first_light_s - light_s))


def measure(
    method: Method,
    ready: Prepared,
    setting: Setting,
    yardstick: Yardstick,
    key: jax.Array,
    tell: Tell,
    *,
    progress: bool = True,
    curve: bool = True,
) -> tuple[dict[str, Any], Pixels]:
    """Shades and returns (row of results.json, image).

    ``tell`` hears what runs. Times are in seconds, waiting for the device. ``frame_s`` is warm;
    what the first frame and the first light took longer is ``compile_s``. With ``curve``, methods
    that take samples are also measured with fewer of them.

    Raises:
        ValueError: the method refuses the scene, or returns radiance that is not finite.
    """
    visibility, light = ready.visibility, ready.light

    def shade(progress: bool = False) -> jax.Array:
        return method.shade(visibility, light, setting.surface, key=key, progress=progress)

    tell("shade")
    rays_before = rays_traced(visibility)
    radiance, first_s = _timed(lambda: shade(progress))
    rays = rays_traced(visibility) - rays_before
    image = finite_image(radiance)
    tell("time")
    times = _warm_times(shade)
    frame_s = statistics.median(times)
    row = {
        **yardstick.errors(image),
        "precompute_s": ready.precompute_s,
        "light_s": ready.light_s,
        "compile_s": ready.compile_s + max(0.0, first_s - frame_s),
        "frame_s": frame_s,
        "frames_timed": len(times),
        "visibility_bytes": int(visibility.nbytes),
        "rays_traced": rays,
        "evaluations": int(method.evaluations(visibility, light, setting.surface)),
    }
    if curve and hasattr(method, "spp"):
        row["curve"] = _curve(method, visibility, light, setting, yardstick, key, row, tell)
    return row, image


def _curve(
    method: Any,
    visibility: Any,
    light: Any,
    setting: Setting,
    yardstick: Yardstick,
    key: jax.Array,
    row: dict[str, Any],
    tell: Tell,
) -> list[dict[str, Any]]:
    """PSNR and warm frame time at 1, 4, 16, ... samples per pixel, up to the method's own."""
    points = []
    spp = 1
    while spp < method.spp:
        tell(f"{spp} spp")
        fewer = _with_samples(method, spp)

        def shade(fewer: Method = fewer) -> jax.Array:
            return fewer.shade(visibility, light, setting.surface, key=key)

        image = finite_image(shade())
        frame_s = statistics.median(_warm_times(shade))
        points.append({"spp": spp, "frame_s": frame_s, "psnr_db": yardstick.psnr(image)})
        spp *= 4
    last = {"spp": method.spp, "frame_s": row["frame_s"], "psnr_db": row["psnr_db"]}
    return [*points, last]


def _with_samples(method: Any, spp: int) -> Method:
    """The same method with other samples per pixel."""
    if isinstance(method, Denoised):
        return dataclasses.replace(method, method=_with_samples(method.method, spp))
    return dataclasses.replace(method, spp=spp)


def _timed(function: Callable[[], Any]) -> tuple[Any, float]:
    start = time.perf_counter()
    result = jax.block_until_ready(function())
    return result, time.perf_counter() - start


def _warm_times(function: Callable[[], Any]) -> list[float]:
    times: list[float] = []
    while not times or (len(times) < FRAMES and sum(times) < SECONDS):
        times.append(_timed(function)[1])
    return times


def rays_traced(visibility: Any) -> int:
    """Rays traced through a Visibility so far; 0 for those that trace none."""
    return int(getattr(visibility, "rays_traced", 0))


def finite_image(radiance: Any) -> Pixels:
    """What ``shade`` returned, on the host.

    Raises:
        ValueError: some of it is not finite.
    """
    image = np.asarray(radiance, np.float32)
    bad = int(np.sum(~np.isfinite(image).all(axis=-1)))
    if bad:
        raise ValueError(f"the radiance of {bad} pixels is not finite")
    return image


def finite(value: float) -> float | None:
    """The value as JSON can hold it: None if it is not finite."""
    return value if math.isfinite(value) else None
