"""How fast the spherical distance transforms are, beside SciPy's flat one and brute force.

Milliseconds a map, for random blobs and for what vertices of a built-in scene see, of one map and
of many, and the largest errors against brute force. All take turns in one run. SciPy's transform is
Euclidean on the texels' indices: another answer, on the same maps, one sign.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter

import jaxvis
from experiments.measuring import Row
from experiments.output import Output
from experiments.settings import Common, execute, setting
from jaxvis.scene import RayTracer, Scene
from jaxvis.scene.rays import offset_origins
from jaxvis.sphere.distance_host import signed_distances
from jaxvis.sphere.distance_transform import distance_to, hemispherical_distance
from jaxvis.sphere.frames import to_world
from jaxvis.sphere.hemisphere_grid import texel_directions


@dataclass(frozen=True)
class Settings(Common):
    resolution: tuple[int, ...] = setting((64, 128, 256), "texels along a side of a map")
    scene: str = setting("courtyard", "whose vertices' maps are transformed")
    maps: int = setting(128, "of 128 x 128; as many texels of all")
    checked: int = setting(1, "maps compared with brute force")
    repeats: int = setting(9, "of what is timed")


def medians(repeats: int, functions: dict[str, Callable[[], object]]) -> dict[str, float]:
    """Median seconds of each function, taking turns so that all meet the same machine."""
    seconds = {name: [] for name in functions}
    for function in functions.values():
        jax.block_until_ready(function())
    for _ in range(repeats):
        for name, function in functions.items():
            start = time.perf_counter()
            jax.block_until_ready(function())
            seconds[name].append(time.perf_counter() - start)
    return {name: float(np.median(times)) for name, times in seconds.items()}


def blobs(count: int, size: int) -> np.ndarray:
    """Smoothed noise, half of it visible: bool [count, size, size]."""
    noise = np.random.default_rng(0).normal(size=(count, size, size))
    return gaussian_filter(noise, (0.0, size / 16.0, size / 16.0)) > 0.0


def traced(scene: Scene, count: int, size: int) -> np.ndarray:
    """What vertices see in their own frames: bool [count, size, size]; maps of two classes only."""
    tracer = RayTracer(scene.positions, scene.triangles)
    local = jnp.asarray(texel_directions(size).reshape(-1, 3))
    order = np.random.default_rng(0).permutation(len(scene.positions))
    maps = []
    for vertex in order:
        normal = scene.normals[vertex]
        directions = np.asarray(to_world(local, jnp.asarray(normal)[None]))
        origin = offset_origins(scene.positions[vertex], normal)
        origins = np.broadcast_to(origin, directions.shape)
        visible = ~tracer.occluded(origins, directions).reshape(size, size)
        if visible.any() and not visible.all():
            maps.append(visible)
        if len(maps) == count:
            break
    if not maps:
        raise ValueError(f"{scene.name}: no vertex is partly occluded; choose another scene")
    # A scene with few such vertices repeats them.
    return np.stack([maps[i % len(maps)] for i in range(count)])


def brute_force(seeds: np.ndarray) -> np.ndarray:
    """Angles (float64) to the nearest seed by the dot products with all of them, one map."""
    size = seeds.shape[0]
    angle = np.pi * (np.arange(size) + 0.5) / size
    theta, phi = np.meshgrid(angle, angle, indexing="ij")
    ring = np.sin(theta)
    points = np.stack([np.cos(theta), ring * np.cos(phi), ring * np.sin(phi)], axis=-1)
    places = points[seeds]
    if not len(places):
        return np.full(seeds.shape, np.pi)
    nearest = np.empty_like(points)
    for i, row in enumerate(points):
        nearest[i] = places[np.argmax(row @ places.T, axis=1)]
    between, beyond = points - nearest, points + nearest
    return 2.0 * np.arctan2(np.linalg.norm(between, axis=-1), np.linalg.norm(beyond, axis=-1))


def compare(name: str, maps: np.ndarray, repeats: int, checked: int) -> tuple[Row, Row]:
    """A row of times (ms a map) and one of errors (rad)."""
    on_device = jnp.asarray(maps)
    count, size = len(maps), maps.shape[-1]

    def flat() -> None:
        for visible in maps:
            distance_transform_edt(~visible)

    seconds = medians(
        repeats,
        {
            "one sign": lambda: distance_to(on_device),
            "scipy EDT": flat,
            "signed": lambda: hemispherical_distance(on_device),
            "signed, host": lambda: signed_distances(maps),
        },
    )
    start = time.perf_counter()
    exact = [(brute_force(visible), brute_force(~visible)) for visible in maps[:checked]]
    slow = (time.perf_counter() - start) / (2 * checked)
    to_visible = np.stack([pair[0] for pair in exact])
    signed = np.stack([pair[1] for pair in exact]) - to_visible
    label = {"maps": name, "count": count, "n": size}
    times = {f"{key} ms": 1e3 * value / count for key, value in seconds.items()}
    found = {
        "one sign": (distance_to(on_device[:checked]), to_visible),
        "signed": (hemispherical_distance(on_device[:checked]), signed),
        "signed, host": (signed_distances(maps[:checked]), signed),
    }
    errors = {
        key: float(np.max(np.abs(np.asarray(a, np.float64) - b))) for key, (a, b) in found.items()
    }
    times["EDT / one sign"] = seconds["scipy EDT"] / seconds["one sign"]
    return label | times | {"brute force ms": 1e3 * slow}, label | errors


def measure(settings: Settings, output: Output) -> None:
    """Both tables."""
    scene = jaxvis.load_scene(settings.scene)
    times, errors = [], []
    for size in settings.resolution:
        count = max(settings.checked, settings.maps * 128**2 // size**2)
        for name, maps in {
            "blobs": blobs(count, size),
            scene.name: traced(scene, count, size),
        }.items():
            taken, apart = compare(name, maps, settings.repeats, settings.checked)
            times.append(taken)
            errors.append(apart)
    output.table("times", "Milliseconds a map (median)", times)
    output.table("errors", "Largest error against brute force (rad)", errors)


if __name__ == "__main__":
    execute(Settings, measure, __doc__)
