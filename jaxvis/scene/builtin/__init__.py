"""Scenes made by code: to try jaxvis without any file, and to test it against closed forms."""

import inspect
from collections.abc import Callable
from typing import Any

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


def builtin_scene(name: str, **parameters: Any) -> Scene:
    """Makes a built-in scene.

    Args:
        name: one of :func:`builtin_scenes`.
        parameters: those of the scene's function in this package, all of which have defaults.

    Raises:
        ValueError: unknown name or parameter, or a value out of its range.
    """
    if name not in MAKERS:
        raise ValueError(f"unknown built-in scene {name!r}; there are {', '.join(MAKERS)}")
    known = inspect.signature(MAKERS[name]).parameters
    for parameter in parameters:
        if parameter not in known:
            raise ValueError(
                f"scene {name!r} has no parameter {parameter!r}; it takes {', '.join(known)}"
            )
    try:
        return MAKERS[name](**parameters)
    except ValueError as error:
        raise ValueError(f"scene {name!r}: {error}") from error
