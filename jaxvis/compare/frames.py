"""One method's pictures of the frames of an animation."""

import os
import re
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import jax
from PIL import Image
from tqdm import tqdm

from jaxvis.cache import whole_file
from jaxvis.compare.compilation import use_compilation_cache
from jaxvis.compare.measurement import finite_image
from jaxvis.compare.result import composite
from jaxvis.compare.setting import checked_count, checked_exposure, prepare
from jaxvis.image import exposure_of, write_image
from jaxvis.lighting import Environment, SphereLights
from jaxvis.methods import Method
from jaxvis.reflectance import Reflectance
from jaxvis.scene import Animation, Camera

QUALITY = 90
"""Of the animation's lossy compression; the .png files are exact."""


def frame_range(text: str, step: int = 1) -> range:
    """The frames that ``A:B`` means: A, A + step, ... below B.

    Raises:
        ValueError: that is no range, it is empty, or the step is less than 1.
    """
    numbers = re.fullmatch(r"\s*(\d+)\s*:\s*(\d+)\s*", text)
    if numbers is None:
        raise ValueError(f"frames must be A:B, two whole numbers as in 0:60, got {text!r}")
    first, end = int(numbers[1]), int(numbers[2])
    if first >= end:
        raise ValueError(f"frames {text!r} are none: the end must be larger, as in 0:60")
    return range(first, end, checked_count(step, "frame step"))


def render_frames(
    method: Method,
    animation: Animation,
    frames: Sequence[int],
    folder: str | os.PathLike,
    stem: str,
    environment: Environment | str | os.PathLike,
    size: Sequence[int],
    *,
    camera: Camera | None = None,
    reflectance: Reflectance | str | None = None,
    albedo: float | None = None,
    supersampling: int = 1,
    rotate: float = 0.0,
    spheres: SphereLights | None = None,
    seed: int = 0,
    exposure: float | None = None,
    progress: bool = True,
) -> list[str]:
    """Renders frames to ``stem_0000.png`` and so on, and to one moving picture ``stem.webp``.

    Methods may carry visibility from frame to frame (:meth:`Method.precompute_for`). All frames
    have the same random numbers, so that each is the picture that :func:`jaxvis.compare.render`
    makes of its scene. The animation plays as fast as the scene moves, also if frames are left out.

    Args:
        method: what renders them.
        animation: what moves.
        frames: their numbers, evenly spaced.
        folder: where the files go; it exists.
        stem: of the files' names.
        environment, size, camera, reflectance, albedo, supersampling, rotate, spheres: as for
            :func:`jaxvis.compare.prepare`. The camera and the lights stand still.
        seed: of what is random.
        exposure: of all frames; by default that of the first frame alone.
        progress: show a progress bar if standard error is a terminal.

    Returns:
        The names of the files, the moving picture last.

    Raises:
        ValueError: the animation has no such frame, or the method refuses a scene.
    """
    if not frames:
        raise ValueError("no frames to render: give at least one")
    for frame in (frames[0], frames[-1]):
        animation.checked(frame)
    key = jax.random.key(checked_count(seed, "seed", least=0))
    exposure = checked_exposure(exposure)
    use_compilation_cache()
    folder = Path(folder)
    names: list[str] = []
    visibility: Any = None
    light: Any = None
    options: dict[str, Any] = {
        "camera": camera,
        "reflectance": reflectance,
        "albedo": albedo,
        "supersampling": supersampling,
        "spheres": spheres,
    }
    bar = tqdm(frames, leave=False, disable=not (progress and sys.stderr.isatty()), unit="frame")
    for frame in bar:
        setting = prepare(animation.scene(frame), environment, size, rotate=rotate, **options)
        if light is None:
            # The light is loaded, and turned, once.
            environment, rotate = setting.environment, 0.0
            light = jax.block_until_ready(method.light(environment))
        visibility = method.precompute_for(
            setting.scene, setting.surface, previous=visibility, progress=False
        )
        radiance = finite_image(method.shade(visibility, light, setting.surface, key=key))
        if exposure is None:
            exposure = exposure_of(radiance, setting.covered)
        names.append(f"{stem}_{frame:04d}.png")
        shown = composite(radiance, setting.coverage, setting.background, exposure)
        write_image(folder / names[-1], shown)
    step = frames[1] - frames[0] if len(frames) > 1 else 1
    moving = f"{stem}.webp"
    write_animation(
        folder / moving,
        [folder / name for name in names],
        animation.frames_per_second / step,
    )
    return [*names, moving]


def write_animation(
    path: str | os.PathLike, images: Sequence[str | os.PathLike], frames_per_second: float
) -> None:
    """One looping WebP animation of image files of one size, whole or not at all.

    WebP counts whole milliseconds; frames last one more or less so that the rate is kept on the
    whole.
    """
    ends = [round(1000.0 * k / frames_per_second) for k in range(len(images) + 1)]
    durations = [after - before for before, after in pairwise(ends)]
    with whole_file(path) as temporary:
        first, *others = (Image.open(image) for image in images)
        # A single duration of a single image may not be a list.
        first.save(
            temporary,
            save_all=True,
            append_images=others,
            duration=durations if others else durations[0],
            loop=0,
            quality=QUALITY,
            method=2,
        )
        for image in (first, *others):
            image.close()
