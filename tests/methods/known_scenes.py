"""Scenes, lights and materials that every method is held to, with what is known of them."""

from dataclasses import dataclass, replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np

from jaxvis.lighting import Environment, SphereLights
from jaxvis.reflectance import CookTorrance, Lambert, Material, Phong, Reflectance
from jaxvis.scene import Camera, Scene, Surface, trace_surface
from jaxvis.scene.builtin import builtin_scene


@dataclass(frozen=True)
class KnownScene:
    """A built-in scene seen by a camera that covers what matters."""

    name: str
    camera: Camera
    size: tuple[int, int] = (18, 14)

    @cache  # noqa: B019 - a handful of module-level scenes, alive for the whole session
    def load(self) -> Scene:
        return builtin_scene(self.name)

    def with_material(self, material: Material, reflectance: Reflectance) -> Scene:
        """The scene made of one material."""
        scene = self.load()
        ids = np.zeros(len(scene.triangles), np.int32)
        return replace(
            scene, materials=(material,), material_ids=ids, colours=None, reflectance=reflectance
        )

    def surface(self, material: Material, reflectance: Reflectance) -> Surface:
        return trace_surface(self.with_material(material, reflectance), self.camera, self.size)


SCENES = [
    KnownScene("plane", Camera((0.0, 3.0, 3.0), (0.0, 0.0, 0.0))),
    KnownScene("wall", Camera((2.5, 2.0, 2.5), (0.0, 0.5, 0.0))),
    KnownScene("box-on-plane", Camera((2.5, 2.0, 3.0), (0.0, 0.3, 0.0))),
    KnownScene("sphere-on-plane", Camera((2.5, 2.0, 3.0), (0.0, 0.5, 0.0))),
]

MATERIALS: dict[str, tuple[Material, Reflectance]] = {
    "diffuse": (Material(base_colour=(0.8, 0.6, 0.4)), Lambert()),
    "phong": (Material(base_colour=(0.4,) * 3, specular=(0.5,) * 3, roughness=0.5), Phong()),
    "ggx": (
        Material(base_colour=(0.3, 0.2, 0.1), specular=(0.6,) * 3, roughness=0.45),
        CookTorrance("ggx"),
    ),
}


def contrasted(height: int = 8, seed: int = 0) -> Environment:
    """A dim random map with a few texels a hundred times as bright, one of them at the seam."""
    rng = np.random.default_rng(seed)
    radiance = rng.uniform(0.1, 0.3, (height, 2 * height, 3))
    radiance[1, 0] = radiance[2, height + 2] = (40.0, 30.0, 20.0)
    radiance[0, 5] = (10.0, 20.0, 30.0)
    return Environment(jnp.asarray(radiance, jnp.float32), "contrasted")


def uniform_light(value: float = 1.0, height: int = 4) -> Environment:
    return Environment(jnp.full((height, 2 * height, 3), value, jnp.float32), "uniform")


def ground_pixels(known: KnownScene, points: list[tuple[float, float]]) -> list[Surface]:
    """One pixel each that sees a point (x, z) of the ground and nothing else, white and diffuse."""
    scene = known.with_material(Material(base_colour=(1.0,) * 3), Lambert())
    return [
        trace_surface(
            scene,
            Camera((x, 0.3, z), (x, 0.0, z), up=(0.0, 0.0, -1.0), field_of_view=0.01),
            (1, 1),
        )
        for x, z in points
    ]


def lamps(*lights: tuple[tuple[float, float, float], float, float]) -> Environment:
    """Spheres (centre, radius, radiance) in the dark."""
    places, radii, radiances = zip(*lights, strict=True)
    colours = [(radiance, 0.5 * radiance, 0.25 * radiance) for radiance in radiances]
    return uniform_light(0.0).with_spheres(SphereLights.of(places, radii, colours))


def lamp_radiance(
    environment: Environment, position: np.ndarray, normal: tuple[float, float, float] = (0, 1, 0)
) -> np.ndarray:
    """L (r / d)^2 cos at points of a white diffuse plane: exact if lamps are above the horizon."""
    leaves = (np.asarray(leaf, np.float64) for leaf in jax.tree.leaves(environment.spheres))
    total = np.zeros_like(position, np.float64)
    for centre, radius, radiance in zip(*leaves, strict=True):
        away = centre - position
        distance = np.linalg.norm(away, axis=-1)
        share = (radius / distance) ** 2 * (away @ np.asarray(normal, float)) / distance
        total += share[..., None] * radiance
    return total
