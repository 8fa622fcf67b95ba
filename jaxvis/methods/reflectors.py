"""What rays meet, as diffuse reflectors: place, normal and albedo of closest hits (host)."""

from dataclasses import dataclass, fields
from os import PathLike
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Float32, Int

from jaxvis.cache import load_arrays, save_arrays
from jaxvis.compiled import compiled
from jaxvis.methods.traced import RayVisibility
from jaxvis.reflectance import Material, Texture, evaluate_materials
from jaxvis.scene import Hits, RayTracer, Scene
from jaxvis.scene.rays import offset_origins
from jaxvis.scene.trace import GRAZING

Values = Array | np.ndarray


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ReflectorVisibility(RayVisibility):
    """Visibility that is traced while shading, and what light from its triangles depends on.

    ``texture_of`` is each material's base colour texture, an index into ``textures`` (texels as
    :class:`~jaxvis.reflectance.Texture` keeps them, [height, width, channels]), or -1.
    """

    normals: Float[Values, "vertices 3"]
    material_ids: Int[Values, "triangles"]
    base_colour: Float[Values, "materials 3"]
    two_sided: Bool[Values, "materials"]
    texture_of: Int[Values, "materials"]
    textures: tuple[Float[Values, "_ _ _"], ...]
    uvs: Float[Values, "triangles 3 2"] | None
    colours: Float[Values, "triangles 3 3"] | None

    @classmethod
    def of(cls, scene: Scene) -> "ReflectorVisibility":
        textures = [material.base_colour_texture for material in scene.materials]
        stored = list(dict.fromkeys(t for t in textures if t is not None))  # each once
        return cls(
            scene.positions,
            scene.triangles,
            scene.tracer,
            scene.normals,
            scene.material_ids,
            np.array([material.base_colour for material in scene.materials], np.float32),
            np.array([material.two_sided for material in scene.materials]),
            np.array([-1 if t is None else stored.index(t) for t in textures], np.int32),
            tuple(texture.texels for texture in stored),
            scene.uvs,
            scene.colours,
        )

    @property
    def nbytes(self) -> int:
        return int(sum(leaf.nbytes for leaf in jax.tree.leaves(self)))

    def save(self, path: str | PathLike) -> None:
        """Writes an .npz file."""
        arrays: dict[str, Any] = {
            field.name: getattr(self, field.name)
            for field in fields(self)
            if field.name not in ("tracer", "textures") and getattr(self, field.name) is not None
        }
        arrays |= {f"texels_{i}": texels for i, texels in enumerate(self.textures)}
        save_arrays(path, "reflector-visibility", arrays)

    @classmethod
    def load(cls, path: str | PathLike) -> "ReflectorVisibility":
        """Reads what :meth:`save` wrote and rebuilds the Embree tree."""
        arrays, _ = load_arrays(path, "reflector-visibility")
        count = sum(name.startswith("texels_") for name in arrays)
        textures = tuple(arrays.pop(f"texels_{i}") for i in range(count))
        tracer = RayTracer(arrays["positions"], arrays["triangles"])
        whole: dict[str, Any] = {"uvs": None, "colours": None, **arrays}
        return cls(tracer=tracer, textures=textures, **whole)

    def materials(self) -> tuple[Material, ...]:
        """The materials' diffuse part."""
        textures = [None, *(Texture(np.asarray(texels)) for texels in self.textures)]
        return tuple(
            Material(colour.tolist(), base_colour_texture=textures[texture + 1])
            for colour, texture in zip(
                np.asarray(self.base_colour), np.asarray(self.texture_of), strict=True
            )
        )


class Reflecting(NamedTuple):
    """Places that light a ray's start if light reaches them. Normals are unit, on the ray's side;
    ``origin`` is where rays from the place start."""

    origin: Float32[np.ndarray, "hits 3"]
    normal: Float32[np.ndarray, "hits 3"]
    geometric_normal: Float32[np.ndarray, "hits 3"]
    view: Float32[np.ndarray, "hits 3"]
    albedo: Float32[np.ndarray, "hits 3"]
    ray: Int[np.ndarray, "hits"]


class Reflectors:
    """The triangles of a scene as diffuse reflectors, ready to be looked up.

    What a hit is like is what :func:`~jaxvis.scene.trace_surface` says of a camera at the ray's
    start, the turning of grazing normals included.
    """

    def __init__(self, visibility: ReflectorVisibility) -> None:
        def host(leaf: Values | None) -> np.ndarray | None:
            return None if leaf is None else np.asarray(leaf)

        self._materials = visibility.materials()
        self._positions = np.asarray(visibility.positions)
        self._normals = np.asarray(visibility.normals)
        self._triangles = np.asarray(visibility.triangles)
        self._material_ids = np.asarray(visibility.material_ids)
        self._two_sided = np.asarray(visibility.two_sided)
        self._textured = any(material.textured for material in self._materials)
        self._uvs, self._colours = host(visibility.uvs), host(visibility.colours)

    def at(self, hits: Hits, directions: Float32[np.ndarray, "rays 3"]) -> Reflecting:
        """Those of the hits that reflect: rays that miss, or that meet the back of a one-sided
        face, bring nothing. ``ray`` says which are left, in order.

        Args:
            hits: of rays in centred coordinates.
            directions: of the rays, unit.
        """
        count = len(directions)
        position, normal, plane = (np.empty((count, 3), np.float32) for _ in range(3))
        ray = np.empty(count, np.int64)
        left = _places(
            hits.triangle,
            hits.barycentrics,
            directions,
            self._positions,
            self._normals,
            self._triangles,
            self._material_ids,
            self._two_sided,
            GRAZING,
            position,
            normal,
            plane,
            ray,
        )
        position, normal, plane, ray = position[:left], normal[:left], plane[:left], ray[:left]
        triangle = hits.triangle[ray]
        weights = hits.barycentrics[ray].astype(np.float64)
        uv = colour = None
        if self._textured and self._uvs is not None:
            uv = np.einsum("hk,hkc->hc", weights, self._uvs[triangle])
        if self._colours is not None:
            colour = np.einsum("hk,hkc->hc", weights, self._colours[triangle])
        values = evaluate_materials(self._materials, self._material_ids[triangle], uv, colour)
        origin = offset_origins(position, plane)
        view = -directions[ray]
        return Reflecting(origin, normal, plane, view, np.asarray(values.base_colour), ray)


@compiled
def _places(
    triangle,
    barycentrics,
    directions,
    positions,
    normals,
    triangles,
    material_ids,
    two_sided,
    grazing,
    position_out,
    normal_out,
    plane_out,
    ray_out,
):
    """Positions, shading and geometric normals of the hits that reflect; returns their number."""
    count = 0
    point, normal = np.empty(3), np.empty(3)
    first, second, plane = np.empty(3), np.empty(3), np.empty(3)
    for ray in range(triangle.shape[0]):
        face = triangle[ray]
        if face < 0:
            continue
        corners = triangles[face]
        for axis in range(3):
            corner = np.float64(positions[corners[0], axis])
            first[axis] = positions[corners[1], axis] - corner
            second[axis] = positions[corners[2], axis] - corner
            point[axis] = 0.0
            normal[axis] = 0.0
            for k in range(3):
                weight = np.float64(barycentrics[ray, k])
                point[axis] += weight * positions[corners[k], axis]
                normal[axis] += weight * normals[corners[k], axis]
        plane[0] = first[1] * second[2] - first[2] * second[1]
        plane[1] = first[2] * second[0] - first[0] * second[2]
        plane[2] = first[0] * second[1] - first[1] * second[0]
        towards = 0.0  # how far the ray goes along the front's normal
        area, length = 0.0, 0.0
        for axis in range(3):
            towards += plane[axis] * directions[ray, axis]
            area += plane[axis] * plane[axis]
            length += normal[axis] * normal[axis]
        if towards > 0.0 and not two_sided[material_ids[face]]:
            continue
        side = -1.0 if towards > 0.0 else 1.0
        area, length = side / np.sqrt(area), side / np.sqrt(max(length, 1e-300))
        facing = 0.0
        for axis in range(3):
            normal[axis] *= length
            facing -= normal[axis] * directions[ray, axis]
        lacking = grazing - facing
        if lacking > 0.0:
            length = 0.0
            for axis in range(3):
                normal[axis] -= lacking * directions[ray, axis]
                length += normal[axis] * normal[axis]
            length = 1.0 / np.sqrt(max(length, 1e-300))
            for axis in range(3):
                normal[axis] *= length
        for axis in range(3):
            position_out[count, axis] = point[axis]
            normal_out[count, axis] = normal[axis]
            plane_out[count, axis] = area * plane[axis]
        ray_out[count] = ray
        count += 1
    return count
