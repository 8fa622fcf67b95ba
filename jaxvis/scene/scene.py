"""A static scene: triangles with materials, ready to trace."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Float64, Int32

from jaxvis.cache import content_hash
from jaxvis.errors import InvalidScene
from jaxvis.reflectance import Lambert, Material, Reflectance, checked_albedo
from jaxvis.scene.camera import Camera
from jaxvis.scene.normals import area_vectors
from jaxvis.scene.rays import RayTracer


@dataclass(frozen=True, eq=False)
class Scene:
    """Triangles with materials, on the host. Immutable: arrays are read-only.

    Vertices are welded: no two share both position and normal, so that a vertex of a smooth surface
    stands once and one on a crease once per side. What may differ between the triangles at a vertex
    (uv, colour) is stored per corner.

    Positions are centred: world = positions + origin. Triangles wind counter-clockwise seen from
    the front.
    """

    positions: Float32[np.ndarray, "vertices 3"]
    normals: Float32[np.ndarray, "vertices 3"]
    triangles: Int32[np.ndarray, "triangles 3"]
    material_ids: Int32[np.ndarray, "triangles"]
    materials: tuple[Material, ...] = (Material(),)
    uvs: Float32[np.ndarray, "triangles 3 2"] | None = None
    colours: Float32[np.ndarray, "triangles 3 3"] | None = None
    origin: Float64[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    reflectance: Reflectance = field(default_factory=Lambert)
    camera: Camera | None = None
    name: str = "scene"
    notes: tuple[str, ...] = ()
    """What was mended while loading, one line each."""

    # build_scene (scene/build.py) validates, welds, centres and makes the arrays read-only.

    def with_reflectance(self, reflectance: Reflectance) -> "Scene":
        """The same scene under another reflectance model."""
        return self._with(reflectance=reflectance)

    def with_materials(self, materials: tuple[Material, ...]) -> "Scene":
        """The same scene with as many other materials."""
        if len(materials) != len(self.materials):
            raise ValueError(f"needs {len(self.materials)} materials, got {len(materials)}")
        return self._with(materials=materials)

    def with_albedo(self, albedo: float | int) -> "Scene":
        """The same scene, all of it one diffuse grey; materials keep their sides.

        Args:
            albedo: the share of light that is reflected, in [0, 1].
        """
        grey = tuple(
            Material((checked_albedo(albedo),) * 3, two_sided=m.two_sided) for m in self.materials
        )
        note = f"all materials are one diffuse grey of albedo {albedo:g}"
        return self._with(
            materials=grey, colours=None, reflectance=Lambert(), notes=(*self.notes, note)
        )

    def with_camera(self, camera: Camera | None) -> "Scene":
        """The same scene with another view of its own."""
        return self._with(camera=camera)

    def with_positions(
        self,
        positions: Float[np.ndarray, "vertices 3"],
        normals: Float[np.ndarray, "vertices 3"],
    ) -> "Scene":
        """The same triangles with their vertices elsewhere: another frame of an animation.

        Vertices, triangles and materials keep their numbers; the origin stays.

        Args:
            positions: centred as ``Scene.positions`` are: world coordinates less ``origin``.
            normals: unit, on the front.

        Raises:
            InvalidScene: other shapes, values that are not finite, normals that are not unit, or a
                triangle without area.
        """
        moved = {"positions": positions, "normals": normals}
        for what, values in moved.items():
            array = np.array(values, np.float32)
            if array.shape != self.positions.shape:
                raise InvalidScene(
                    f"{self.name}: {what} must be {list(self.positions.shape)} as before, "
                    f"got {list(array.shape)}"
                )
            if not np.isfinite(array).all():
                raise InvalidScene(f"{self.name}: {what} are NaN or infinite; mend the pose")
            array.setflags(write=False)
            moved[what] = array
        lengths = np.linalg.norm(moved["normals"], axis=-1)
        if not np.allclose(lengths, 1.0, atol=1e-3):
            raise InvalidScene(f"{self.name}: normals must be unit vectors")
        flat = ~area_vectors(moved["positions"][self.triangles]).any(axis=-1)
        if flat.any():
            raise InvalidScene(
                f"{self.name}: {int(flat.sum())} triangles have no area; mend the pose"
            )
        return replace(self, **moved)

    def _with(self, **changes: Any) -> "Scene":
        changed = replace(self, **changes)
        # The triangles stay the same, and so does all that was computed from them alone.
        for name in ("tracer", "bounds", "geometric_normals", "geometry_hash"):
            if name in self.__dict__:
                changed.__dict__[name] = self.__dict__[name]
        return changed

    @cached_property
    def tracer(self) -> RayTracer:
        """Embree structure over the triangles, built at the first use."""
        return RayTracer(self.positions, self.triangles)

    @cached_property
    def bounds(self) -> Float64[np.ndarray, "2 3"]:
        """Lowest and highest corner in world coordinates."""
        low, high = self.positions.min(axis=0), self.positions.max(axis=0)
        return np.stack([low, high]).astype(np.float64) + self.origin

    @property
    def diagonal(self) -> float:
        """Length of the bounding box's diagonal."""
        return float(np.linalg.norm(self.bounds[1] - self.bounds[0]))

    @cached_property
    def geometric_normals(self) -> Float32[np.ndarray, "triangles 3"]:
        """Unit normals of the triangles, on their front."""
        a, b, c = np.moveaxis(self.positions[self.triangles].astype(np.float64), 1, 0)
        cross = np.cross(b - a, c - a)
        return (cross / np.linalg.norm(cross, axis=-1, keepdims=True)).astype(np.float32)

    @cached_property
    def geometry_hash(self) -> str:
        """Content hash of what precomputed visibility depends on."""
        return content_hash(self.positions, self.normals, self.triangles)
