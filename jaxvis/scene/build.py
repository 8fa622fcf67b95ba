"""From arrays to a Scene: checked, mended, welded, centred, read-only."""

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float64, Integer
from numpy.typing import ArrayLike

from jaxvis.errors import InvalidScene, JaxvisWarning
from jaxvis.reflectance import Lambert, Material, Reflectance
from jaxvis.scene.camera import Camera
from jaxvis.scene.normals import area_vectors, crease_normals, face_front
from jaxvis.scene.scene import Scene
from jaxvis.scene.weld import equal_rows

CREASE_ANGLE = float(np.radians(50.0))
"""Default dihedral angle from which an edge is sharp, radians."""

NORMAL_STEPS = 4096
"""Normals at one position that agree when rounded to this fraction are one vertex."""


def build_scene(
    positions: ArrayLike,
    triangles: ArrayLike,
    *,
    normals: ArrayLike | None = None,
    uvs: ArrayLike | None = None,
    colours: ArrayLike | None = None,
    materials: Sequence[Material] = (Material(),),
    material_ids: ArrayLike | None = None,
    reflectance: Reflectance = Lambert(),  # noqa: B008 (frozen and without state)
    camera: Camera | None = None,
    crease_angle: float = CREASE_ANGLE,
    name: str = "scene",
    notes: Sequence[str] = (),
) -> Scene:
    """Makes a :class:`Scene` of arrays.

    Triangles without area are dropped, with a warning that counts them; vertices are welded where
    position and normal agree; unused vertices go; positions are centred on their bounding box in
    float64 before they become float32. What was mended stands in ``Scene.notes``.

    Args:
        positions: [vertices, 3], any coordinates and scale.
        triangles: [triangles, 3] vertex indices, counter-clockwise seen from the front.
        normals: [triangles, 3, 3] per corner, any length; zero or NaN ones are computed. All are
            computed if None: area-weighted, over the triangles around the vertex that no crease
            separates. Those that point to the back are turned to the front.
        uvs: [triangles, 3, 2] per corner, v up.
        colours: [triangles, 3, 3] per corner, linear Rec. 709 in [0, 1], multiplied with the base
            colour.
        materials: at least one.
        material_ids: [triangles] indices into ``materials``; all 0 if None.
        reflectance: model that the scene's materials are meant for.
        camera: view that the scene comes with, in world coordinates.
        crease_angle: dihedral angle in radians from which an edge is sharp; 0 gives flat triangles.
        name: for messages and results.
        notes: what the caller has mended, kept in ``Scene.notes``.

    Raises:
        InvalidScene: anything that cannot be mended, in one line with the scene's name.
    """
    points, faces = _checked_mesh(positions, triangles, name)
    count = len(faces)
    if not materials:
        raise InvalidScene(f"{name}: needs at least one material")
    if not 0.0 <= crease_angle <= np.pi:
        raise InvalidScene(f"{name}: crease_angle must be in [0, pi] radians, got {crease_angle}")
    corner_normals = _floats(normals, (count, 3, 3), "normals", name)
    corner_uvs = _floats(uvs, (count, 3, 2), "uvs", name)
    corner_colours = _floats(colours, (count, 3, 3), "colours", name)
    ids = _checked_ids(material_ids, count, len(materials), name)
    _check_values(corner_uvs, corner_colours, name)
    _check_textures(materials, corner_uvs is not None, name)

    mended = list(notes)
    centred, origin, kept = _centre(points, faces, name)
    if dropped := count - int(kept.sum()):
        mended.append(f"dropped {dropped} of {count} triangles without area")
        warnings.warn(f"{name}: {mended[-1]}", JaxvisWarning, stacklevel=2)
        faces, ids = faces[kept], ids[kept]
    _, place = equal_rows(*centred[faces.reshape(-1)].T)
    place = place.reshape(-1, 3)
    given = None if corner_normals is None else corner_normals[kept]
    front = _front_normals(given, place, area_vectors(centred[faces]), crease_angle, mended)

    flat_normals = front.reshape(-1, 3)
    steps = np.rint(flat_normals * NORMAL_STEPS).astype(np.int64)
    first, vertex = equal_rows(place.reshape(-1), *steps.T)
    return Scene(
        positions=_frozen(centred[faces.reshape(-1)[first]]),
        normals=_frozen(flat_normals[first].astype(np.float32)),
        triangles=_frozen(vertex.reshape(-1, 3).astype(np.int32)),
        material_ids=_frozen(ids.astype(np.int32)),
        materials=tuple(materials),
        uvs=None if corner_uvs is None else _frozen(corner_uvs[kept].astype(np.float32)),
        colours=None
        if corner_colours is None
        else _frozen(corner_colours[kept].astype(np.float32)),
        origin=_frozen(origin),
        reflectance=reflectance,
        camera=camera,
        name=name,
        notes=tuple(mended),
    )


def _checked_mesh(
    positions: ArrayLike, triangles: ArrayLike, name: str
) -> tuple[Float64[np.ndarray, "vertices 3"], Integer[np.ndarray, "triangles 3"]]:
    try:
        points, faces = np.asarray(positions, np.float64), np.asarray(triangles)
    except (TypeError, ValueError) as error:
        raise InvalidScene(f"{name}: positions or triangles are not numeric arrays") from error
    if points.size == 0 or faces.size == 0:
        raise InvalidScene(f"{name}: the mesh is empty (it has no vertices or no triangles)")
    if points.ndim != 2 or points.shape[1] != 3:
        raise InvalidScene(f"{name}: positions must be [vertices, 3], got {list(points.shape)}")
    if faces.ndim != 2 or faces.shape[1] != 3 or not np.issubdtype(faces.dtype, np.integer):
        raise InvalidScene(
            f"{name}: triangles must be integers [triangles, 3], got {faces.dtype} "
            f"{list(faces.shape)}"
        )
    if faces.min() < 0 or faces.max() >= len(points):
        worst = int(faces.min() if faces.min() < 0 else faces.max())
        raise InvalidScene(
            f"{name}: vertex index {worst} is out of range; there are {len(points)} vertices"
        )
    used = points[np.unique(faces)]
    if bad := int(np.sum(~np.isfinite(used).all(axis=-1))):
        raise InvalidScene(
            f"{name}: {bad} of {len(used)} vertices are NaN or infinite; mend the file"
        )
    return points, faces


def _floats(
    values: ArrayLike | None, shape: tuple[int, ...], what: str, name: str
) -> Float64[np.ndarray, "..."] | None:
    if values is None:
        return None
    try:
        array = np.asarray(values, np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidScene(f"{name}: {what} is not a numeric array") from error
    if array.shape != shape:
        raise InvalidScene(
            f"{name}: {what} must be per corner, {list(shape)}, got {list(array.shape)}"
        )
    return array


def _checked_ids(
    material_ids: ArrayLike | None, count: int, materials: int, name: str
) -> Integer[np.ndarray, "triangles"]:
    ids = np.zeros(count, np.int32) if material_ids is None else np.asarray(material_ids)
    if ids.shape != (count,) or not np.issubdtype(ids.dtype, np.integer):
        raise InvalidScene(
            f"{name}: material_ids must be integers [{count}], got {ids.dtype} {list(ids.shape)}"
        )
    if ids.min() < 0 or ids.max() >= materials:
        raise InvalidScene(f"{name}: material_ids must be in 0..{materials - 1}")
    return ids


def _check_values(
    uvs: Float64[np.ndarray, "triangles 3 2"] | None,
    colours: Float64[np.ndarray, "triangles 3 3"] | None,
    name: str,
) -> None:
    if uvs is not None and not np.isfinite(uvs).all():
        raise InvalidScene(f"{name}: texture coordinates are NaN or infinite; mend the file")
    if colours is not None and not np.all((colours >= 0.0) & (colours <= 1.0)):
        raise InvalidScene(f"{name}: colours must be in [0, 1]")


def _check_textures(materials: Sequence[Material], uvs: bool, name: str) -> None:
    for material in materials:
        textures = (
            material.base_colour_texture,
            material.specular_texture,
            material.roughness_texture,
        )
        if not uvs and any(texture is not None for texture in textures):
            raise InvalidScene(f"{name}: material {material.name!r} has a texture but uvs are None")


def _centre(
    points: Float64[np.ndarray, "vertices 3"], faces: Integer[np.ndarray, "triangles 3"], name: str
) -> tuple[
    Float[np.ndarray, "vertices 3"], Float64[np.ndarray, "3"], Bool[np.ndarray, "triangles"]
]:
    """Centred float32 positions, the centre, and which triangles have an area in float32."""
    corners = points[faces]
    # Triangles without area must not move the centre, so they are looked for before and after.
    spread = np.any(area_vectors(corners) != 0.0, axis=-1)
    if not spread.any():
        raise InvalidScene(f"{name}: none of the {len(faces)} triangles has an area")
    low, high = corners[spread].min(axis=(0, 1)), corners[spread].max(axis=(0, 1))
    origin = 0.5 * low + 0.5 * high
    with np.errstate(over="ignore", invalid="ignore"):
        centred = (points - origin).astype(np.float32)
    if not np.isfinite(centred[faces[spread]]).all():
        raise InvalidScene(f"{name}: the mesh is larger than float32 can hold; scale it down")
    with np.errstate(over="ignore", invalid="ignore"):
        kept = spread & np.any(area_vectors(centred[faces]) != 0.0, axis=-1)
    if not kept.any():
        raise InvalidScene(f"{name}: none of the {len(faces)} triangles has an area in float32")
    return centred, origin, kept


def _front_normals(
    given: Float64[np.ndarray, "triangles 3 3"] | None,
    place: Integer[np.ndarray, "triangles 3"],
    areas: Float64[np.ndarray, "triangles 3"],
    crease_angle: float,
    mended: list[str],
) -> Float64[np.ndarray, "triangles 3 3"]:
    if given is None:
        return crease_normals(place, areas, crease_angle)
    finite = np.where(np.isfinite(given), given, 0.0)
    length = np.linalg.norm(finite, axis=-1, keepdims=True)
    usable = (length > 1e-12) & np.isfinite(given).all(axis=-1, keepdims=True)
    unit = np.divide(finite, length, out=np.zeros_like(finite), where=usable)
    if missing := int(np.sum(~usable)):
        mended.append(f"computed {missing} corner normals that were zero or not finite")
        unit = np.where(usable, unit, crease_normals(place, areas, crease_angle))
    unit, turned, replaced = face_front(unit, areas)
    if turned:
        mended.append(f"turned the normals of {turned} triangles to the front of their winding")
    if replaced:
        mended.append(f"replaced {replaced} corner normals that pointed behind their triangle")
    return unit


def _frozen(array: Any) -> Any:
    array = np.ascontiguousarray(array)
    array.setflags(write=False)
    return array
