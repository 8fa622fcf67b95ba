"""A scene that is looked at: frames of any method, camera and turn of the light."""

import time
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

import jax
import numpy as np
from jaxtyping import UInt8

from jaxvis import methods
from jaxvis.compare.compilation import use_compilation_cache
from jaxvis.compare.measurement import Pixels, finite_image
from jaxvis.compare.result import composite
from jaxvis.compare.setting import Setting
from jaxvis.image import displayed_error, exposure_of, psnr
from jaxvis.lighting import Environment
from jaxvis.methods import Method
from jaxvis.report.figures import error_map
from jaxvis.scene import Camera, Scene, Surface, trace_surface
from jaxvis.view.turning import turned

KEPT = 3
"""Of how many methods visibility and light are kept, and of how many views the camera rays."""

REFERENCE = "reference:error=0.01"
"""What frames are compared with."""

Shown = UInt8[np.ndarray, "height width 3"]
T = TypeVar("T")


@dataclass(frozen=True)
class Look:
    """What is to be seen: a method, by its name with parameters, from a camera, under a turned
    light.

    ``yaw`` is in radians, counter-clockwise seen from above; ``size`` is (width, height). ``quick``
    asks for less while something moves: polygons where triangles are not divided (zeta = 0), a
    quarter of the samples, and of other methods a quarter of the pixels.
    """

    method: str
    camera: Camera
    size: tuple[int, int]
    yaw: float = 0.0
    quick: bool = False


@dataclass(frozen=True, eq=False)
class Frame:
    """An image of a look.

    ``seconds`` is all that it took: the turned light, camera rays of a view that is new, shading,
    and whatever of precomputation and compilation had to be done for the first time.
    """

    look: Look
    setting: Setting
    radiance: Pixels
    seconds: float
    samples: int = 1

    @property
    def exposure(self) -> float:
        """By which the 99.5th percentile of the luminance becomes 1."""
        covered = self.setting.covered
        return exposure_of(self.radiance, covered) if covered.any() else 1.0

    def shown(self, exposure: float) -> Shown:
        """As a display shows it, before its environment."""
        setting = self.setting
        return _bytes(composite(self.radiance, setting.coverage, setting.background, exposure))

    def psnr(self, reference: "Frame") -> float | None:
        """In dB; none where no pixel sees the scene."""
        covered = self.setting.covered
        if not covered.any():
            return None
        return psnr(self.radiance, reference.radiance, covered, reference.exposure)

    def error(self, reference: "Frame") -> Shown:
        """How far each pixel is from the reference, in the colours of the report's error maps."""
        covered = self.setting.covered
        error = displayed_error(self.radiance, reference.radiance, covered, reference.exposure)
        colours = error_map(error.astype(np.float32), covered)
        return _bytes(colours[..., :3] * colours[..., 3:])

    def with_more(self, other: "Frame") -> "Frame":
        """The mean with another image of the same look, by numbers of samples."""
        count = self.samples + other.samples
        total = self.samples * self.radiance + other.samples * other.radiance
        return replace(other, radiance=(total / count).astype(np.float32), samples=count)


class Session:
    """Renders looks of one scene under one environment, and keeps what frames share."""

    def __init__(self, scene: Scene, environment: Environment) -> None:
        use_compilation_cache()
        self.scene, self.environment = scene, environment
        self._ready = _Kept[tuple[Method, Any, Any]](KEPT)
        self._surfaces = _Kept[Surface](KEPT)

    def frame(self, look: Look, seed: int = 0) -> Frame:
        """One image.

        Raises:
            ValueError, FileNotFoundError: a method that there is not, or that refuses the scene.
        """
        start = time.perf_counter()
        method, visibility, light = self._ready.get(look.method, lambda: self._prepare(look.method))
        method, size = quicker(method, look.size) if look.quick else (method, look.size)
        surface = self._surfaces.get(
            (look.camera, size), lambda: trace_surface(self.scene, look.camera, size)
        )
        environment = self.environment
        seen = visibility, light, surface
        if look.yaw:
            seen = turned(method, *seen, environment, look.yaw)
            environment = environment.rotate(look.yaw)
        radiance = finite_image(method.shade(*seen, key=jax.random.key(seed)))
        seconds = time.perf_counter() - start
        setting = Setting(self.scene, environment, look.camera, surface)
        return Frame(look, setting, radiance, seconds)

    def reference(self, look: Look) -> Frame:
        """What :meth:`frame` of this look should be."""
        return self.frame(replace(look, method=REFERENCE))

    def _prepare(self, name: str) -> tuple[Method, Any, Any]:
        method = methods.create(name)
        light = method.light(self.environment)  # first: quicker to refuse
        return method, method.precompute(self.scene, progress=False), light


def quicker(method: Method, size: tuple[int, int]) -> tuple[Method, tuple[int, int]]:
    """A method and size of the image for less time and the same visibility and light."""
    values = method.parameters()
    if values.get("zeta"):
        return replace(method, zeta=0.0), size  # pyright: ignore
    if values.get("spp", 1) > 1:
        return replace(method, spp=max(1, values["spp"] // 4)), size  # pyright: ignore
    return method, (max(1, size[0] // 2), max(1, size[1] // 2))


class _Kept(Generic[T]):
    """The last few results, by key."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._values: OrderedDict[Hashable, T] = OrderedDict()

    def get(self, key: Hashable, make: Callable[[], T]) -> T:
        if key not in self._values:
            while len(self._values) >= self._most:
                self._values.popitem(last=False)
            self._values[key] = make()
        self._values.move_to_end(key)
        return self._values[key]


def _bytes(colours: np.ndarray) -> Shown:
    return np.round(255.0 * np.clip(colours, 0.0, 1.0)).astype(np.uint8)
