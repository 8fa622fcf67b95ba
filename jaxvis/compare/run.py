"""Runs methods on one scene, light and camera, and measures them against one reference."""

import contextlib
import datetime
import math
import os
import re
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax
import numpy as np
from tqdm import tqdm

from jaxvis import methods as registry
from jaxvis.cache import cached_arrays, content_hash
from jaxvis.compare.compilation import use_compilation_cache
from jaxvis.compare.machine import machine, versions
from jaxvis.compare.measurement import (
    Pixels,
    Prepared,
    Yardstick,
    finite,
    finite_image,
    measure,
    prepared,
    rays_traced,
)
from jaxvis.compare.result import REFERENCE, Comparison, file_stem, output_folder
from jaxvis.compare.setting import (
    DEFAULT_ENVIRONMENT,
    DEFAULT_REFERENCE,
    DEFAULT_SCENE,
    DEFAULT_SIZE,
    Setting,
    checked_count,
    checked_exposure,
    prepare,
)
from jaxvis.errors import JaxvisWarning
from jaxvis.image import exposure_of
from jaxvis.image.metrics import FLIP_PIXELS_PER_DEGREE, RELMSE_EPSILON
from jaxvis.image.tonemap import WHITE_PERCENTILE
from jaxvis.lighting import Environment, SphereLights
from jaxvis.methods import Denoised, Method, Reference
from jaxvis.methods.denoised import SUFFIX
from jaxvis.reflectance import Reflectance
from jaxvis.scene import Camera, Scene

SCHEMA = 1

FAILED = dict.fromkeys(
    ("psnr_db", "rmse", "relative_rmse", "relmse", "flip", "precompute_s", "light_s", "compile_s")
    + ("frame_s", "frames_timed", "visibility_bytes", "rays_traced", "evaluations", "image", "png")
)
"""The values of a row whose method failed."""


def compare(
    scene: Scene | str | os.PathLike = DEFAULT_SCENE,
    environment: Environment | str | os.PathLike = DEFAULT_ENVIRONMENT,
    methods: str | Sequence[str | Method] | None = None,
    size: Sequence[int] = DEFAULT_SIZE,
    *,
    spp: int | None = None,
    seed: int = 0,
    out: str | os.PathLike | None = None,
    camera: Camera | None = None,
    reflectance: Reflectance | str | None = None,
    albedo: float | None = None,
    supersampling: int = 1,
    rotate: float = 0.0,
    two_sided: bool | None = None,
    spheres: SphereLights | None = None,
    reference: str | Method = DEFAULT_REFERENCE,
    exposure: float | None = None,
    progress: bool = True,
    stop_on_error: bool = False,
) -> Comparison:
    """Runs methods on one scene under one light and measures each against the reference.

    Args:
        scene, environment: objects, or names and files as in DESIGN §5.
        methods: ``"a,b:parameter=value"``, ``"all"``, or a sequence of such names and Method
            objects; by default one representative of each family.
        size: width and height of the image.
        spp: samples per pixel of those methods that take samples and do not name their own.
        seed: of everything that is random.
        out: folder for ``results.json`` and the images; nothing is written without it. Reports are
            written by :func:`jaxvis.report.write_report`.
        camera: by default the scene's own, or one that frames it.
        reflectance: replaces the scene's model.
        albedo: replaces all materials by one diffuse grey.
        supersampling: camera rays per pixel along each axis.
        rotate: radians by which the environment turns about +Y.
        two_sided: overrides what the mesh file says of its materials.
        spheres: local lights, instead of any that the environment has. Methods that know none fail.
        reference: what the others are measured against; its image is cached on disk.
        exposure: of the .png images. By default that of the metric.
        progress: show progress bars if standard error is a terminal.
        stop_on_error: raise what a method raises. By default its row holds an ``error`` instead.

    Returns:
        The content of ``results.json``, a dict, with the images (see :class:`Comparison`).

    Raises:
        ValueError, FileNotFoundError, OSError: bad input, before anything is rendered.
    """
    chosen = choose_methods(methods, spp)
    seed = checked_count(seed, "seed", least=0)
    exposure = checked_exposure(exposure)
    truth = registry.create(reference)
    progress = progress and sys.stderr.isatty()
    use_compilation_cache()
    notes: list[str] = []
    with _noting_warnings(notes):
        setting = prepare(
            scene,
            environment,
            size,
            camera=camera,
            reflectance=reflectance,
            albedo=albedo,
            supersampling=supersampling,
            rotate=rotate,
            two_sided=two_sided,
            spheres=spheres,
        )
    with (
        contextlib.nullcontext() if out is None else output_folder(out) as folder,
        tqdm(total=1 + len(chosen), unit="method", leave=False, disable=not progress) as bar,
    ):
        bar.set_description(REFERENCE)
        image, reference_row = render_reference(truth, setting, seed, progress)
        yardstick = Yardstick(image, setting.covered, exposure_of(image, setting.covered))
        images, rows = {REFERENCE: image}, []
        for label, method in chosen.items():
            bar.update()
            row, image = method_row(
                label,
                method,
                setting,
                yardstick,
                seed,
                progress=progress,
                stop_on_error=stop_on_error,
                tell=lambda verb, label=label: bar.set_description(f"{label}: {verb}"),
            )
            rows.append(row)
            if image is not None:
                images[label] = image
        bar.update()
        results = {
            "schema": SCHEMA,
            **setting.describe(),
            "notes": [n for n in notes if not any(known in n for known in setting.scene.notes)],
            "seed": seed,
            "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            "versions": versions(),
            "machine": machine(),
            "metric": _metric(yardstick, rows),
            "display": {"exposure": exposure or yardstick.exposure, "transfer": "sRGB"},
            "reference": reference_row,
            "results": rows,
        }
        comparison = Comparison(results, images, setting.coverage, setting.background)
        if folder is not None:
            comparison.save(folder)
    return comparison


def choose_methods(
    methods: str | Sequence[str | Method] | None, spp: int | None
) -> dict[str, Method]:
    """Methods by label: the text that named each, numbered where it occurs twice.

    Raises:
        ValueError: unknown names or parameters, or none given.
    """
    if spp is not None:
        spp = checked_count(spp, "spp")
    if methods is None:
        methods = registry.representatives()
    given = registry.parse_list(methods) if isinstance(methods, str) else methods
    if not given:
        raise ValueError("no methods given; `jaxvis methods` lists them")
    chosen: dict[str, Method] = {}
    for spec in given:
        method = registry.create(spec, spp=spp)
        label = name = spec if isinstance(spec, str) else _spec_of(method)
        count = 1
        while label in chosen or label == REFERENCE:
            count += 1
            label = f"{name} ({count})"
        chosen[label] = method
    return chosen


def registered_name(method: Method) -> str:
    """The name under which a method like this is registered, or its class's name."""
    if isinstance(method, Denoised):
        return registered_name(method.method) + SUFFIX
    for entry in registry.table():
        if type(method) is entry.cls and all(
            getattr(method, key) == value for key, value in entry.presets.items()
        ):
            return entry.name
    return type(method).__name__


def _spec_of(method: Method) -> str:
    """``name:parameter=value,...`` of what differs from the defaults."""
    if isinstance(method, Denoised):
        name, colon, parameters = _spec_of(method.method).partition(":")
        return f"{name}{SUFFIX}{colon}{parameters}"
    name = registered_name(method)
    defaults = {entry.name: entry.defaults() for entry in registry.table()}.get(name, {})
    changed = [f"{k}={getattr(method, k)}" for k, v in defaults.items() if getattr(method, k) != v]
    return f"{name}:{','.join(changed)}" if changed else name


def render_reference(
    method: Method, setting: Setting, seed: int, progress: bool
) -> tuple[Pixels, dict[str, Any]]:
    """The reference image, from the disk if it has been rendered before, and its row.

    A :class:`Reference` tells its own standard error; another method used as one does not.
    """

    def render() -> dict[str, Any]:
        start = time.perf_counter()
        visibility = method.precompute_for(setting.scene, setting.surface, progress=progress)
        light = method.light(setting.environment)
        rays_before = rays_traced(visibility)
        error, evaluations = math.nan, method.evaluations(visibility, light, setting.surface)
        if isinstance(method, Reference):
            radiance, error, directions = method.solve(
                visibility, light, setting.surface, progress=progress
            )
            evaluations = directions * int(np.sum(setting.surface.mask))
        else:
            radiance = method.shade(visibility, light, setting.surface, key=jax.random.key(seed))
        return {
            "radiance": finite_image(radiance),
            "relative_error": error,
            "seconds": time.perf_counter() - start,
            "rays_traced": rays_traced(visibility) - rays_before,
            "evaluations": evaluations,
        }

    surface = setting.surface
    key = content_hash(
        versions()["jaxvis"],
        repr(method),
        seed if method.stochastic else None,
        setting.scene.geometry_hash,
        [np.asarray(leaf) for leaf in jax.tree.leaves(surface)],
        surface.supersampling,
        repr(surface.reflectance),
        [np.asarray(leaf) for leaf in jax.tree.leaves(setting.environment)],
    )
    notes: list[str] = []
    with _noting_warnings(notes):
        stored, cached = cached_arrays("reference", key, render)
    row = {
        "method": registered_name(method),
        "parameters": _plain(method.parameters()),
        "relative_error": finite(float(stored["relative_error"])),
        "seconds": float(stored["seconds"]),
        "from_cache": cached,
        "rays_traced": int(stored["rays_traced"]),
        "evaluations": int(stored["evaluations"]),
        "image": f"{REFERENCE}.exr",
        "png": f"{REFERENCE}.png",
        "notes": notes,
    }
    return stored["radiance"], row


def method_row(
    label: str,
    method: Method,
    setting: Setting,
    yardstick: Yardstick,
    seed: int,
    *,
    progress: bool,
    stop_on_error: bool = False,
    tell: Callable[[str], None] = lambda verb: None,
    curve: bool = True,
    prepare: Callable[[], Prepared] | None = None,
) -> tuple[dict[str, Any], Pixels | None]:
    """The row of results.json of one method, and its image unless it failed.

    Args:
        curve: also measure a method that takes samples with fewer of them.
        prepare: where visibility and light come from, instead of being made here.
    """
    parameters = _plain(method.parameters())
    row: dict[str, Any] = {
        "method": registered_name(method),
        "label": label,
        "parameters": parameters,
        "shading": parameters.get("shading"),
    }
    notes: list[str] = []
    try:
        with _noting_warnings(notes):
            ready = prepare() if prepare else prepared(method, setting, tell, progress=progress)
            measured, image = measure(
                method,
                ready,
                setting,
                yardstick,
                jax.random.key(seed),
                tell,
                progress=progress,
                curve=curve,
            )
    except Exception as error:
        if stop_on_error:
            raise
        return {**row, **FAILED, "notes": notes, "error": without_folders(one_line(error))}, None
    stem = file_stem(label)
    files = {"image": f"{stem}.exr", "png": f"{stem}.png"}
    return {**row, **measured, **files, "notes": notes}, image


@contextlib.contextmanager
def _noting_warnings(notes: list[str]) -> Iterator[None]:
    """Appends the text of each JaxvisWarning to ``notes``; every warning goes on afterwards."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", JaxvisWarning)
        try:
            yield
        finally:
            ours = (w for w in caught if issubclass(w.category, JaxvisWarning))
            notes += [without_folders(str(w.message)) for w in ours]
    for w in caught:
        warnings.warn_explicit(w.message, w.category, w.filename, w.lineno)


def one_line(error: BaseException) -> str:
    """What went wrong, in one line; the type's name unless jaxvis itself said it."""
    text = " ".join(str(error).split())
    return text if type(error) is ValueError else f"{type(error).__name__}: {text}".rstrip(": ")


def without_folders(text: str) -> str:
    """The text with absolute paths cut to file names: results are for others to read."""
    return re.sub(r"(?<![\w./])/(?:[^\s/:]+/)+", "", text)


def _metric(yardstick: Yardstick, rows: list[dict[str, Any]]) -> dict[str, Any]:
    metric = {
        "exposure": yardstick.exposure,
        "peak": 1.0,
        "transfer": "sRGB",
        "white_percentile": WHITE_PERCENTILE,
        "relmse_epsilon": RELMSE_EPSILON / yardstick.exposure**2,
        "flip_pixels_per_degree": FLIP_PIXELS_PER_DEGREE,
        "notes": ["psnr_db is null where an image equals the reference (rmse is 0)"],
    }
    if any("error" not in row and row["flip"] is None for row in rows):
        metric["notes"].append("flip is null: install flip-evaluator (pip install jaxvis[metrics])")
    return metric


def _plain(parameters: dict[str, Any]) -> dict[str, Any]:
    """Parameters as JSON can hold them."""
    return {k: _plain_value(v) for k, v in parameters.items()}


def _plain_value(value: Any) -> Any:
    if isinstance(value, dict):
        return _plain(value)
    if isinstance(value, (list, tuple)):
        return [_plain_value(v) for v in value]
    if value is None or isinstance(value, (str, bool, int)):
        return value
    if isinstance(value, float) and np.isfinite(value):
        return value
    return str(value)
