"""Scenes made by code: to try jaxvis without any file, and to test it against closed forms."""

import inspect
from collections.abc import Callable
from typing import Any, TypeVar

from jaxvis import specs
from jaxvis.scene.animation import Animation, still
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
from jaxvis.scene.builtin.balls import balls, balls_animation
from jaxvis.scene.builtin.courtyard import courtyard
from jaxvis.scene.builtin.hat import hat, hat_animation
from jaxvis.scene.builtin.teapot import teapot
from jaxvis.scene.builtin.terrain import terrain
from jaxvis.scene.builtin.walker import walker, walker_animation
from jaxvis.scene.scene import Scene

__all__ = ["builtin_animation", "builtin_scene", "builtin_scenes"]

Made = TypeVar("Made", Scene, Animation)

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
    "hat": hat,
    "balls": balls,
    "walker": walker,
    "terrain": terrain,
}

ANIMATIONS: dict[str, Callable[..., Animation]] = {
    "hat": hat_animation,
    "balls": balls_animation,
    "walker": walker_animation,
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
    return _made(MAKERS, name, parameters)


def builtin_animation(name: str, /, **parameters: Any) -> Animation:
    """All frames of a built-in scene; one frame of those that do not move.

    Args:
        name: one of :func:`builtin_scenes`.
        parameters: those of the scene's function in this package but for ``frame``.

    Raises:
        ValueError: unknown name or parameter, or a value out of its range.
    """
    if name in ANIMATIONS:
        return _made(ANIMATIONS, name, parameters)
    return still(builtin_scene(name, **parameters))


def _made(makers: dict[str, Callable[..., Made]], name: str, parameters: dict[str, Any]) -> Made:
    if name not in makers:
        raise ValueError(specs.unknown(name, makers, "built-in scene"))
    known = inspect.signature(makers[name]).parameters
    specs.check_parameters(parameters, known, f"scene {name!r}")
    try:
        return makers[name](**parameters)
    except ValueError as error:
        raise ValueError(f"scene {name!r}: {error}") from error
