"""One method's picture of one setting."""

import sys
import time
from dataclasses import dataclass

import jax
from tqdm import tqdm

from jaxvis.compare.compilation import use_compilation_cache
from jaxvis.compare.measurement import Pixels, finite_image
from jaxvis.compare.result import composite
from jaxvis.compare.setting import Setting, checked_count, checked_exposure
from jaxvis.image import exposure_of
from jaxvis.methods import Method


@dataclass(frozen=True, eq=False)
class Picture:
    """An image: linear radiance, 0 where no scene is seen, and as a display shows it.

    ``seconds`` is what all three verbs took, compilation included.
    """

    radiance: Pixels
    shown: Pixels
    seconds: float


def render(
    method: Method,
    setting: Setting,
    *,
    seed: int = 0,
    exposure: float | None = None,
    progress: bool = True,
) -> Picture:
    """Runs the three verbs of one method.

    Args:
        seed: of what is random.
        exposure: of the shown image; by default the 99.5th percentile of its luminance becomes 1.
        progress: show a progress bar if standard error is a terminal.

    Raises:
        ValueError: the method refuses the scene, or its radiance is not finite.
    """
    key = jax.random.key(checked_count(seed, "seed", least=0))
    exposure = checked_exposure(exposure)
    use_compilation_cache()
    progress = progress and sys.stderr.isatty()
    start = time.perf_counter()
    with tqdm(total=3, leave=False, disable=not progress) as bar:
        bar.set_description("light")
        light = jax.block_until_ready(method.light(setting.environment))
        bar.update()
        bar.set_description("precompute")
        visibility = method.precompute_for(setting.scene, setting.surface, progress=progress)
        bar.update()
        bar.set_description("shade")
        radiance = finite_image(
            method.shade(visibility, light, setting.surface, key=key, progress=progress)
        )
        bar.update()
    if exposure is None:
        exposure = exposure_of(radiance, setting.covered)
    shown = composite(radiance, setting.coverage, setting.background, exposure)
    return Picture(radiance, shown, time.perf_counter() - start)
