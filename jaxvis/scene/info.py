"""What a scene holds, in words and numbers: ``jaxvis info FILE``."""

import os
import warnings
from dataclasses import dataclass

import numpy as np

from jaxvis.errors import JaxvisWarning
from jaxvis.reflectance import Material
from jaxvis.scene.load import load_scene
from jaxvis.scene.scene import Scene
from jaxvis.scene.weld import edge_sides, equal_rows


@dataclass(frozen=True)
class SceneInfo:
    """Counts and properties of a scene; ``str`` of it is a short text."""

    name: str
    vertices: int
    triangles: int
    bounds: tuple[tuple[float, ...], tuple[float, ...]]
    materials: int
    textures: int
    two_sided_triangles: int
    has_uvs: bool
    has_colours: bool
    has_camera: bool
    reflectance: str
    border_edges: int
    """Edges of one triangle."""
    non_manifold_edges: int
    """Edges of more than two triangles, or of two that wind against each other."""
    notes: tuple[str, ...]
    """What was mended or left out."""

    @property
    def watertight(self) -> bool:
        """Whether every edge joins two triangles that wind alike."""
        return self.border_edges == 0 and self.non_manifold_edges == 0

    def __str__(self) -> str:
        low, high = self.bounds
        size = " x ".join(f"{b - a:.6g}" for a, b in zip(low, high, strict=True))
        shape = "watertight" if self.watertight else "open"
        if not self.watertight:
            shape += (
                f" ({self.border_edges} border edges, {self.non_manifold_edges} non-manifold edges)"
            )
        extras = [
            word
            for word, there in (
                ("texture coordinates", self.has_uvs),
                ("vertex colours", self.has_colours),
                ("a camera", self.has_camera),
            )
            if there
        ]
        lines = [
            f"{self.name}: usable as a scene",
            f"  {self.triangles} triangles, {self.vertices} vertices (welded), {shape}",
            f"  from {_point(low)} to {_point(high)}, size {size}",
            f"  {self.materials} materials, {self.textures} textures, shaded as {self.reflectance}",
            f"  {self.two_sided_triangles} two-sided triangles",
            f"  has {', '.join(extras) if extras else 'positions only'}",
            *(f"  note: {note}" for note in self.notes),
        ]
        return "\n".join(lines)


def scene_info(source: Scene | str | os.PathLike) -> SceneInfo:
    """What a scene, or the file or name that :func:`load_scene` takes, holds.

    What loading mends stands in the notes rather than in warnings.

    Raises:
        ValueError, FileNotFoundError, InvalidScene: it is not usable; the message says why.
    """
    if isinstance(source, Scene):
        scene = source
    else:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", JaxvisWarning)
            scene = load_scene(source)
    border, non_manifold = _edge_counts(scene)
    two_sided = np.array([material.two_sided for material in scene.materials])
    textures = {id(t) for material in scene.materials for t in _textures(material)}
    low, high = scene.bounds.tolist()
    return SceneInfo(
        name=scene.name,
        vertices=len(scene.positions),
        triangles=len(scene.triangles),
        bounds=(tuple(low), tuple(high)),
        materials=len(scene.materials),
        textures=len(textures),
        two_sided_triangles=int(two_sided[scene.material_ids].sum()),
        has_uvs=scene.uvs is not None,
        has_colours=scene.colours is not None,
        has_camera=scene.camera is not None,
        reflectance=str(scene.reflectance),
        border_edges=border,
        non_manifold_edges=non_manifold,
        notes=scene.notes,
    )


def _edge_counts(scene: Scene) -> tuple[int, int]:
    _, place = equal_rows(*scene.positions.T)
    triangles = place[scene.triangles]
    sides = edge_sides(triangles)
    start = triangles.reshape(-1)[sides.side]
    end = np.roll(triangles, -1, axis=1).reshape(-1)[sides.side]
    count = sides.count
    # Neighbours that wind alike run along their edge in opposite directions: these sum to 0.
    balance = np.bincount(sides.edge, np.where(start < end, 1, -1))
    odd = (count > 2) | ((count == 2) & (balance != 0))
    return int(np.sum(count == 1)), int(np.sum(odd))


def _textures(material: Material) -> list:
    found = (
        material.base_colour_texture,
        material.specular_texture,
        material.roughness_texture,
    )
    return [texture for texture in found if texture is not None]


def _point(values: tuple[float, ...]) -> str:
    return "(" + ", ".join(f"{value:.6g}" for value in values) + ")"
