"""Scenes made by code: to try jaxvis without any file, and to test it against closed forms."""

import inspect
from collections.abc import Callable
from typing import Any

from jaxvis import specs
from jaxvis.scene.builtin.analytic import (
    box_on_plane,
    cap,
    furnace,
    plane,
    sphere,
    sphere_on_plane,
    torus_on_plane,
    wall,
)
from jaxvis.scene.builtin.courtyard import courtyard
from jaxvis.scene.builtin.teapot import teapot
from jaxvis.scene.scene import Scene

__all__ = ["builtin_scene", "builtin_scenes"]

MAKERS: dict[str, Callable[..., Scene]] = {
    "teapot": teapot,
    "courtyard": courtyard,
    "plane": plane,
    "wall": wall,
    "box-on-plane": box_on_plane,
    "sphere": sphere,
    "sphere-on-plane": sphere_on_plane,
    "torus-on-plane": torus_on_plane,
    "cap": cap,
    "furnace": furnace,
}


def builtin_scenes() -> tuple[str, ...]:
    """Names that :func:`builtin_scene` knows."""
    return tuple(MAKERS)


def builtin_scene(name: str, /, **parameters: Any) -> Scene:
    """Makes a built-in scene.

    Args:
        name: one of :func:`builtin_scenes`.
        parameters: those of the scene's function in this package, all of which have defaults.

    Raises:
        ValueError: unknown name or parameter, or a value out of its range.
    """
    if name not in MAKERS:
        raise ValueError(specs.unknown(name, MAKERS, "built-in scene"))
    known = inspect.signature(MAKERS[name]).parameters
    specs.check_parameters(parameters, known, f"scene {name!r}")
    try:
        return MAKERS[name](**parameters)
    except ValueError as error:
        raise ValueError(f"scene {name!r}: {error}") from error
