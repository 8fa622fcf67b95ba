"""What is lit and seen: a scene, a light and a camera, from names or objects."""

import json
import math
import operator
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float32

from jaxvis.lighting import Environment, SphereLights, load_environment
from jaxvis.reflectance import Reflectance, reflectance_by_name
from jaxvis.scene import Camera, Scene, Surface, default_camera, load_scene, trace_surface

DEFAULT_SCENE = "teapot"
DEFAULT_ENVIRONMENT = "windows"
DEFAULT_SIZE = (256, 192)
DEFAULT_REFERENCE = "reference:error=0.01"
"""A standard error of 1 % is 55 dB or better: far above what is compared with it."""


@dataclass(frozen=True, eq=False)
class Setting:
    """A scene, a light and a camera, and what each pixel of an image sees. Host."""

    scene: Scene
    environment: Environment
    camera: Camera
    surface: Surface

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the image."""
        return self.surface.width, self.surface.height

    @cached_property
    def coverage(self) -> Float32[np.ndarray, "height width"]:
        """Share of each pixel's rays that hit the scene."""
        return np.asarray(self.surface.coverage)

    @property
    def covered(self) -> Bool[np.ndarray, "height width"]:
        """The pixels that see the scene: those that metrics look at."""
        return self.coverage > 0.0

    @cached_property
    def background(self) -> Float32[np.ndarray, "height width 3"]:
        """Radiance of the environment behind each pixel's centre."""
        directions = jnp.asarray(self.camera.directions(*self.size), jnp.float32)
        return np.asarray(self.environment.towards(directions))

    @property
    def back_pixels(self) -> int:
        """Pixels that see the back of a one-sided face, which is black."""
        rays = np.asarray(self.surface.backs)
        n = self.surface.supersampling
        width, height = self.size
        return int(rays.reshape(height, n, width, n).any(axis=(1, 3)).sum())

    def describe(self) -> dict[str, Any]:
        """The part of results.json that says what was rendered."""
        scene, camera = self.scene, self.camera
        return {
            "scene": scene.name,
            "environment": self.environment.name,
            "size": list(self.size),
            "supersampling": self.surface.supersampling,
            "reflectance": repr(scene.reflectance),
            "camera": {
                "eye": list(camera.eye),
                "target": list(camera.target),
                "up": list(camera.up),
                "field_of_view": camera.field_of_view,
            },
            "scene_info": {
                "vertices": len(scene.positions),
                "triangles": len(scene.triangles),
                "materials": len(scene.materials),
                "covered_pixels": int(self.covered.sum()),
                "back_pixels": self.back_pixels,
                "notes": list(scene.notes),
            },
            "environment_info": {
                "height": self.environment.height,
                "width": self.environment.width,
                "largest_radiance": float(jnp.max(self.environment.radiance)),
            },
            "lamps": _lamps(self.environment.spheres),
        }


def _lamps(spheres: SphereLights | None) -> list[dict[str, Any]]:
    """Sphere lights in plain numbers, as short as float32 has them."""
    if spheres is None:
        return []
    columns = {
        name: np.vectorize(lambda number: float(str(np.float32(number))))(getattr(spheres, name))
        for name in ("position", "radius", "radiance")
    }
    return [
        {name: column[light].tolist() for name, column in columns.items()}
        for light in range(spheres.count)
    ]


def prepare(
    scene: Scene | str | os.PathLike = DEFAULT_SCENE,
    environment: Environment | str | os.PathLike = DEFAULT_ENVIRONMENT,
    size: Sequence[int] = DEFAULT_SIZE,
    *,
    camera: Camera | None = None,
    reflectance: Reflectance | str | None = None,
    albedo: float | None = None,
    supersampling: int = 1,
    rotate: float = 0.0,
    two_sided: bool | None = None,
    spheres: SphereLights | None = None,
) -> Setting:
    """Loads what is named and traces one camera ray per pixel (more with supersampling).

    Args:
        scene, environment: objects, or names and files as in DESIGN §5.
        size: width and height of the image, in pixels.
        camera: by default the scene's own, or one that frames it.
        reflectance: replaces the scene's model.
        albedo: replaces all materials by one diffuse grey.
        supersampling: camera rays per pixel along each axis.
        rotate: radians by which the environment turns about +Y.
        two_sided: overrides what the mesh file says of its materials.
        spheres: local lights, instead of any that the environment has.

    Raises:
        ValueError, FileNotFoundError: input that cannot be used, or a camera that sees nothing.
    """
    width, height = checked_size(size)
    supersampling = checked_count(supersampling, "supersampling")
    if not math.isfinite(rotate):
        raise ValueError(f"rotate must be finite, got {rotate}")
    if isinstance(reflectance, str):
        reflectance = reflectance_by_name(reflectance)
    if not isinstance(scene, Scene):
        scene = load_scene(scene, two_sided=two_sided)
    elif two_sided is not None:
        materials = tuple(replace(m, two_sided=two_sided) for m in scene.materials)
        scene = scene.with_materials(materials)
    if albedo is not None:
        scene = scene.with_albedo(albedo)
    if reflectance is not None:
        scene = scene.with_reflectance(reflectance)
    if not isinstance(environment, Environment):
        environment = load_environment(environment)
    if spheres is not None:
        environment = environment.with_spheres(spheres)
    if rotate:
        environment = environment.rotate(rotate)
    camera = camera or scene.camera or default_camera(scene, aspect=width / height)
    surface = trace_surface(scene, camera, (width, height), supersampling=supersampling)
    setting = Setting(scene, environment, camera, surface)
    if not setting.covered.any():
        raise ValueError(
            f"no pixel sees the scene {scene.name!r}: move the camera (eye {camera.eye}, "
            f"target {camera.target})"
        )
    return setting


def read_camera(path: str | os.PathLike) -> Camera:
    """The camera of a JSON file: eye, target, and optionally up and field_of_view (radians).

    A results.json will do: its camera is taken.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is not JSON or does not describe a camera.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such camera file")
    try:
        fields = json.loads(path.read_text())
        fields = fields.get("camera", fields)
        return Camera(**fields)
    except (ValueError, TypeError, AttributeError) as error:
        raise ValueError(f"{path}: not a camera ({error})") from error


def checked_size(size: Sequence[int]) -> tuple[int, int]:
    """Width and height as integers of at least 1."""
    try:
        width, height = size
    except (TypeError, ValueError):
        raise ValueError(f"size must be width and height, got {size!r}") from None
    return checked_count(width, "size: width"), checked_count(height, "size: height")


def checked_count(value: Any, name: str, least: int = 1) -> int:
    """``value`` as an integer of at least ``least``."""
    try:
        count = operator.index(value)
    except TypeError:
        raise ValueError(f"{name} must be an integer, got {value!r}") from None
    if count < least:
        raise ValueError(f"{name} must be at least {least}, got {count}")
    return count


def checked_exposure(exposure: float | None) -> float | None:
    """A positive finite display exposure, or None for the automatic one."""
    if exposure is not None and not (math.isfinite(exposure) and exposure > 0.0):
        raise ValueError(f"exposure must be positive and finite, got {exposure}")
    return exposure
