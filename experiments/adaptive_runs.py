"""What the tables of adaptive visibility sampling share: frames, fills and fits.

Used by :mod:`experiments.adaptive_table`.
"""

import time
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float32, Int
from numpy.typing import ArrayLike

import jaxvis
from experiments.measuring import seconds_of
from jaxvis.compare.measurement import finite_image
from jaxvis.compare.setting import Setting, prepare
from jaxvis.image import psnr, relative_rmse
from jaxvis.methods import Method, Reference
from jaxvis.methods.distance_field import AdaptiveVisibility, build
from jaxvis.methods.distance_field.build import EVEN, Angular, Sampling, Vertices
from jaxvis.methods.distance_field.field import DistanceFields
from jaxvis.methods.distance_field.maps import Traced
from jaxvis.methods.distance_field.neighbours import Places
from jaxvis.scene import Animation, Scene

Pixels = Float32[np.ndarray, "height width 3"]


@dataclass(frozen=True, eq=False)
class Moving:
    """An animation before a camera that stands still, under one light."""

    animation: Animation
    environment: jaxvis.Environment
    size: tuple[int, int]

    @property
    def name(self) -> str:
        return self.animation.base.name

    def at(self, frame: int) -> Setting:
        """What pixels see of a frame."""
        return self.of(self.animation.scene(frame))

    def of(self, scene: Scene) -> Setting:
        """What pixels see of a scene in place of the animation's."""
        return prepare(scene, self.environment, self.size)

    def with_part(self, part: int, first: int, second: int) -> Scene:
        """Frame ``first`` with one part as it is in frame ``second``; -1 is no part."""
        here, there = self.animation.scene(first), self.animation.scene(second)
        chosen = (self.animation.parts == part)[:, None]
        return here.with_positions(
            np.where(chosen, there.positions, here.positions),
            np.where(chosen, there.normals, here.normals),
        )


@dataclass(frozen=True, eq=False)
class Truth:
    """A reference image, and its own standard error relative to its mean."""

    setting: Setting
    image: Pixels
    error: float

    @staticmethod
    def of(setting: Setting, error: float = 0.01) -> "Truth":
        """The image of ``reference``, from the disk if it was rendered before."""
        method = Reference(error=error)
        visibility = method.precompute(setting.scene, progress=False)
        light = method.light(setting.environment)
        solution, _ = method.solve_cached(visibility, light, setting.surface)
        return Truth(setting, np.asarray(solution.image), solution.error)

    def relative_rmse(self, image: Pixels) -> float:
        return relative_rmse(image, self.image, self.setting.covered)

    def psnr(self, image: Pixels) -> float:
        return psnr(image, self.image, self.setting.covered)


class Shaded(NamedTuple):
    """A picture of one setting and what it took, in seconds."""

    visibility: Any
    image: Pixels
    precompute: float
    light: float
    shade: float

    @property
    def seconds(self) -> float:
        """All of it."""
        return self.precompute + self.light + self.shade


def shaded(
    method: Method,
    setting: Setting,
    repeats: int = 1,
    *,
    previous: Any = None,
    warm: bool = True,
) -> Shaded:
    """All three verbs; each time is the median of ``repeats`` calls after one that is not timed."""
    key = jax.random.key(0)

    def precompute() -> Any:
        return method.precompute_for(
            setting.scene, setting.surface, previous=previous, progress=False
        )

    if warm:
        precompute()
    visibility, precompute_s = seconds_of(precompute, repeats)
    method.light(setting.environment)
    light, light_s = seconds_of(lambda: method.light(setting.environment), repeats)

    def shade() -> jax.Array:
        return method.shade(visibility, light, setting.surface, key=key)

    if warm:
        shade()
    image, shade_s = seconds_of(shade, repeats)
    return Shaded(visibility, finite_image(image), precompute_s, light_s, shade_s)


def placed(method: AdaptiveVisibility, setting: Setting) -> DistanceFields:
    """Samples of one view."""
    return method.precompute_for(setting.scene, setting.surface, progress=False)


def angular_of(method: AdaptiveVisibility) -> Angular:
    return Angular(method.resolution, method.fill, method.coarsest)


def filled(
    vertices: Vertices,
    angular: Angular,
    ids: Int[np.ndarray, "samples"],
    places: Places | None,
) -> tuple[Traced, float]:
    """The maps of vertices in blocks as a sampling fills them, and the seconds that took."""
    step = build.AT_ONCE
    start = time.perf_counter()
    parts = [
        build.fill_maps(vertices, angular, ids[k : k + step], places)
        for k in range(0, len(ids), step)
    ]
    seconds = time.perf_counter() - start
    maps = np.concatenate([part.maps for part in parts])
    return Traced(maps, sum(part.rays for part in parts)), seconds


def every_vertex_in_view(setting: Setting, angular: Angular) -> DistanceFields:
    """As :func:`build.sample_every_vertex`, but only of the vertices at what pixels see."""
    vertices = Vertices.of(setting.scene)
    candidates = np.flatnonzero(build.in_view(vertices, setting.surface))
    hidden = build.buried(vertices, candidates)
    places = vertices.places(EVEN)
    sampling = Sampling.none(vertices, angular)
    sampling.add(candidates[~hidden], places)
    near = 4 if hidden.any() else 1
    return build.distance_fields(sampling, places, candidates, near=near, interpolation="inverse")


@dataclass(frozen=True)
class Noise:
    """What a Monte Carlo estimator of n rays a pixel does: RMSE^2 = spread^2 / n + floor^2 against
    a reference of error ``floor``, in ``start + each`` x n seconds."""

    spread: float
    floor: float
    start: float
    each: float

    @staticmethod
    def fit(spp: ArrayLike, rmse: ArrayLike, seconds: ArrayLike, floor: float) -> "Noise":
        """All measurements count alike, in parts of their own size.

        Raises:
            ValueError: fewer than two sample counts, or errors no larger than the reference's.
        """
        n, t = np.asarray(spp, float), np.asarray(seconds, float)
        if len(n) < 2:
            raise ValueError("give at least two numbers of rays a pixel")
        excess = np.square(rmse) - floor**2
        if not (excess > 0.0).all():
            raise ValueError(
                "errors are no larger than the reference's own: take fewer rays a pixel or a "
                "better reference"
            )
        each, start = np.polyfit(n, t, 1, w=1.0 / t)
        spread = np.sqrt(np.exp(np.mean(np.log(excess * n))))
        return Noise(float(spread), floor, float(max(start, 0.0)), float(each))

    def rmse(self, spp: float) -> float:
        return float(np.sqrt(self.spread**2 / spp + self.floor**2))

    def seconds(self, spp: float) -> float:
        return self.start + self.each * spp

    def spp_at_rmse(self, rmse: float) -> float:
        """Rays a pixel for an error; infinite for one that is not above the reference's."""
        excess = rmse**2 - self.floor**2
        return self.spread**2 / excess if excess > 0.0 else float("inf")

    def spp_at_seconds(self, seconds: float) -> int:
        """Rays a pixel in a time, at least one."""
        return max(1, round((seconds - self.start) / self.each))
