"""A scene by name or file."""

import ast
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

from jaxvis import datasets, specs
from jaxvis.scene.animation import Animation, still
from jaxvis.scene.builtin import ANIMATIONS, builtin_animation, builtin_scene, builtin_scenes
from jaxvis.scene.scene import Scene
from jaxvis.scene.terrain import load_height_field


def load_scene(source: str | os.PathLike, *, two_sided: bool | None = None) -> Scene:
    """Loads a scene.

    Args:
        source: a built-in scene, with parameters or without (``courtyard:triangles=100000``); a
            data set (:mod:`jaxvis.datasets`); or a file: any mesh that trimesh reads, or an .npz
            height field with ``z`` and ``dx``.
        two_sided: makes all materials two-sided, or none; as the file says if None.

    Raises:
        FileNotFoundError: ``source`` looks like a file and is not there.
        ValueError: ``source`` is no known name; the message suggests one.
        InvalidScene: the file is damaged, lacks a texture or holds no usable mesh.
    """
    scene = _load(source)
    if two_sided is None:
        return scene
    return _sided(scene, two_sided)


def load_animation(source: str | os.PathLike, *, two_sided: bool | None = None) -> Animation:
    """Loads all frames of a scene; a scene that does not move has one.

    Args:
        source: as for :func:`load_scene`, without the parameter ``frame``.
        two_sided: makes all materials two-sided, or none; as the file says if None.

    Raises:
        FileNotFoundError, ValueError, InvalidScene: as :func:`load_scene` does; or ``source`` asks
            for a single frame.
    """
    if not isinstance(source, str) or specs.name_of(source) not in ANIMATIONS:
        return still(load_scene(source, two_sided=two_sided))
    texts = specs.parameters_of(source, "scene")
    if "frame" in texts:
        raise ValueError(f"scene {source!r} is a single frame; leave out frame= to get them all")
    values = {key: _value(text) for key, text in texts.items()}
    animation = builtin_animation(specs.name_of(source), **values)
    if two_sided is None:
        return animation
    return replace(animation, base=_sided(animation.base, two_sided))


def _sided(scene: Scene, two_sided: bool) -> Scene:
    return scene.with_materials(tuple(replace(m, two_sided=two_sided) for m in scene.materials))


def _load(source: str | os.PathLike) -> Scene:
    if isinstance(source, str):
        name = specs.name_of(source)
        if name in builtin_scenes():
            texts = specs.parameters_of(source, "scene")
            return builtin_scene(name, **{key: _value(text) for key, text in texts.items()})
        if source in datasets.names("scene"):
            return _load_file(datasets.find(source), source)
        if name in datasets.names("scene"):
            raise ValueError(f"scene {source!r}: the data set {name!r} has no parameters")
    path = Path(source).expanduser()
    if path.is_file():
        return _load_file(path, path.stem)
    if path.is_dir():
        raise FileNotFoundError(f"{path} is a folder; give the mesh file in it")
    if specs.is_file_name(source):
        raise specs.no_such_file(path)
    known = (*builtin_scenes(), *datasets.names("scene"))
    raise ValueError(specs.unknown(str(source), known, "scene"))


def _load_file(path: Path, name: str) -> Scene:
    if path.suffix.lower() == ".npz":
        return load_height_field(path, name)
    from jaxvis.scene.files import load_mesh_file  # only now: it imports trimesh

    return load_mesh_file(path, name)


def _value(text: str) -> Any:
    """A number, true or false, or the text itself."""
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError):
        return text
