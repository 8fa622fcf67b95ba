"""Mesh files through trimesh: every format's geometry, transforms, colours and materials."""

import contextlib
import io
import logging
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import PIL.Image
import trimesh
from jaxtyping import Float64, Int64
from trimesh.resolvers import FilePathResolver
from trimesh.visual import ColorVisuals, TextureVisuals

from jaxvis.errors import InvalidScene, JaxvisWarning
from jaxvis.reflectance import Material
from jaxvis.reflectance.texture import srgb_to_linear
from jaxvis.scene.build import build_scene
from jaxvis.scene.file_materials import Losses, convert_material, file_reflectance
from jaxvis.scene.framing import close_up
from jaxvis.scene.gltf import find_camera, primitive_materials, read_header
from jaxvis.scene.scene import Scene

# What trimesh logs of parts that it leaves out would reach the terminal, tracebacks and all.
logging.getLogger("trimesh").addHandler(logging.NullHandler())

GLTF = (".glb", ".gltf")
IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tga", ".tif", ".tiff", ".webp", ".gif", ".dds")


def load_mesh_file(path: Path, name: str) -> Scene:
    """The Scene that a mesh file holds: its whole scene graph, in world coordinates.

    Colours: glTF vertex colours are linear, as its specification says; those of other formats
    (PLY, OBJ, OFF) count as sRGB-encoded, as 8-bit colours are. Colour textures are sRGB; MTL's
    Kd and Ks are linear.

    Raises:
        InvalidScene: the file cannot be read, holds no triangles, or lacks a texture.
    """
    resolver, losses = _Resolver(str(path)), Losses()
    loaded = _read(path, resolver)
    _refuse_missing_images(resolver, path)
    with _damage(path):
        header = _header(path)
        parts = _parts(loaded, path)
        exact = _exact_materials(loaded, header)
        sources, materials, ids = _materials(parts, exact, losses)
    if losses.missing_textures:
        which = ", ".join(name or "unnamed" for name in losses.missing_textures[:5])
        raise InvalidScene(
            f"{path}: textures of {len(losses.missing_textures)} materials ({which}) are missing, "
            "damaged or of an unknown format; mend them or take them out of the materials"
        )
    notes = _report(losses, resolver.missing, path)
    others = len(loaded.geometry) - len({part.geometry for part in parts})
    if others:
        notes.append(f"left out {others} parts that are points or lines, or not in the scene graph")
    scene = build_scene(
        **_corner_arrays(parts),
        materials=tuple(materials),
        material_ids=ids,
        reflectance=file_reflectance(sources, materials),
        name=str(path),
        notes=notes,
    )
    with _damage(path):
        camera = None if header is None else find_camera(header, scene.origin)
    return replace(scene, name=name, camera=camera and close_up(scene, camera))


@dataclass
class _Part:
    """One node of the scene graph, in world coordinates."""

    geometry: str
    positions: Float64[np.ndarray, "vertices 3"]
    faces: Int64[np.ndarray, "triangles 3"]
    normals: Float64[np.ndarray, "vertices 3"] | None
    uvs: Float64[np.ndarray, "vertices 2"] | None
    colours: Float64[np.ndarray, "triangles 3 3"] | None
    source: Any


class _Resolver(FilePathResolver):
    """Finds the files that a mesh file refers to, and keeps the names of unusable ones.

    Names may be encoded as in URIs (glTF), have backslashes (MTL of Windows programs), and lead out
    of the mesh's folder.
    """

    def __init__(self, source: str) -> None:
        super().__init__(source)
        self.allow_anywhere = True  # trimesh 4 always does
        self.missing: list[str] = []
        self.damaged: list[str] = []

    def get(self, name: str) -> bytes:
        names = (name, unquote(name), name.replace("\\", "/"))
        there = [n for n in names if (Path(self.parent) / n.strip()).is_file()]
        if not there:
            self.missing.append(name)
            raise FileNotFoundError(f"{name}: no such file")
        data = super().get(there[0])
        if Path(name).suffix.lower() in IMAGES:
            try:
                PIL.Image.open(io.BytesIO(data)).close()
            except (OSError, SyntaxError):
                self.damaged.append(name)
                raise
        return data


def _refuse_missing_images(resolver: _Resolver, path: Path) -> None:
    """Any file but a material library must be an image: others are missed while reading."""
    missing = [name for name in resolver.missing if Path(name.strip()).suffix.lower() != ".mtl"]
    for names, what in ((missing, "missing"), (resolver.damaged, "not readable images")):
        if names:
            which = ", ".join(sorted(set(names))[:5])
            raise InvalidScene(
                f"{path}: {len(set(names))} textures are {what} ({which}); restore them in "
                f"{resolver.parent} or take them out of the materials"
            )


def _read(path: Path, resolver: _Resolver) -> trimesh.Scene:
    formats = trimesh.available_formats()
    if path.suffix.lower().lstrip(".") not in formats:
        raise InvalidScene(
            f"{path}: {path.suffix or 'a file without suffix'} is not a mesh format that can be "
            f"read; use .glb, .gltf, .obj, .ply, .stl or .off"
        )
    # trimesh checks an STL's normals against vertices that build_scene is to refuse.
    with _damage(path), np.errstate(over="ignore", invalid="ignore"):
        # Unprocessed: trimesh's own clean-up drops NaN vertices and merges without saying so.
        return trimesh.load_scene(str(path), resolver=resolver, process=False)


@contextlib.contextmanager
def _damage(path: Path) -> Iterator[None]:
    """What trimesh, and we after it, stumble over in a damaged file."""
    try:
        yield
    except InvalidScene:
        raise
    except Exception as error:
        cause = (str(error).splitlines() or [""])[0][:120]
        raise InvalidScene(
            f"{path}: damaged or not a {path.suffix} mesh ({type(error).__name__}: {cause})"
        ) from error


def _header(path: Path) -> dict[str, Any] | None:
    return read_header(path) if path.suffix.lower() in GLTF else None


def _parts(loaded: trimesh.Scene, path: Path) -> list[_Part]:
    linear = path.suffix.lower() in GLTF
    parts = []
    for node in loaded.graph.nodes_geometry:
        matrix, key = loaded.graph[node]
        mesh = loaded.geometry[str(key)]
        if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
            parts.append(_part(mesh, str(key), np.asarray(matrix, np.float64), linear))
    if not parts:
        kinds = sorted({type(g).__name__ for g in loaded.geometry.values()} - {"Trimesh"})
        found = f"only {' and '.join(kinds)}" if kinds else "nothing"
        raise InvalidScene(f"{path}: holds no triangles ({found}); a scene needs a triangle mesh")
    for part in parts:
        if part.faces.min() < 0 or part.faces.max() >= len(part.positions):
            raise InvalidScene(
                f"{path}: {part.geometry!r} has vertex indices out of range; "
                f"there are {len(part.positions)} vertices"
            )
    return parts


def _part(
    mesh: trimesh.Trimesh, key: str, matrix: Float64[np.ndarray, "4 4"], linear: bool
) -> _Part:
    faces = np.asarray(mesh.faces, np.int64)
    positions = np.asarray(mesh.vertices, np.float64)
    linear_part = matrix[:3, :3]
    # Cofactors turn normals even where the matrix has no inverse, up to the determinant's sign.
    cofactors = np.stack(
        [np.cross(linear_part[(i + 1) % 3], linear_part[(i + 2) % 3]) for i in range(3)]
    )
    mirrored = np.linalg.det(linear_part) < 0.0
    normals = None
    # trimesh computes normals when asked for them: only those of the file are in its cache.
    if "vertex_normals" in mesh._cache.cache:
        normals = np.asarray(mesh.vertex_normals, np.float64) @ cofactors.T
        normals = -normals if mirrored else normals
    uv = getattr(mesh.visual, "uv", None)
    colours = _corner_colours(mesh, linear)
    if mirrored:
        faces = faces[:, ::-1]
        colours = None if colours is None else colours[:, ::-1]
    with np.errstate(invalid="ignore"):  # build_scene refuses vertices that are not finite
        positions = positions @ linear_part.T + matrix[:3, 3]
    return _Part(
        geometry=key,
        positions=positions,
        faces=faces,
        normals=normals,
        uvs=None if uv is None or len(uv) != len(positions) else np.asarray(uv[:, :2], np.float64),
        colours=colours,
        source=getattr(mesh.visual, "material", None),
    )


def _corner_colours(
    mesh: trimesh.Trimesh, linear: bool
) -> Float64[np.ndarray, "triangles 3 3"] | None:
    """Vertex or face colours per corner, linear; None where the mesh has none."""
    visual = mesh.visual
    faces = np.asarray(mesh.faces)
    corners = None
    if isinstance(visual, TextureVisuals):
        values = visual.vertex_attributes.get("color")
        if values is not None and len(values) == len(mesh.vertices):
            corners = np.asarray(values)[faces]
    elif isinstance(visual, ColorVisuals) and visual.kind == "vertex":
        corners = np.asarray(visual.vertex_colors)[faces]
    elif isinstance(visual, ColorVisuals) and visual.kind == "face":
        corners = np.repeat(np.asarray(visual.face_colors)[:, None, :], 3, axis=1)
    if corners is None:
        return None
    scale = np.iinfo(corners.dtype).max if np.issubdtype(corners.dtype, np.integer) else 1.0
    colours = np.clip(corners[..., :3].astype(np.float64) / scale, 0.0, 1.0)
    return colours if linear else srgb_to_linear(colours)


def _exact_materials(
    loaded: trimesh.Scene, header: dict[str, Any] | None
) -> dict[str, dict[str, Any] | None]:
    """The glTF material of each geometry, by the geometry's name."""
    if header is None:
        return {}
    materials = primitive_materials(header)
    if len(materials) != len(loaded.geometry):
        return {}
    return dict(zip(loaded.geometry, materials, strict=True))


def _materials(
    parts: list[_Part], exact: dict[str, dict[str, Any] | None], losses: Losses
) -> tuple[list[Any], list[Material], Int64[np.ndarray, "triangles"]]:
    """Sources and materials, one for each that differs, and the material of each triangle."""
    numbers: dict[tuple, int] = {}
    sources, materials, ids = [], [], []
    for part in parts:
        has_uv, coloured = part.uvs is not None, part.colours is not None
        key = (id(part.source) if part.source is not None else None, has_uv, coloured)
        if key not in numbers:
            numbers[key] = len(materials)
            material = convert_material(part.source, exact.get(part.geometry), has_uv, losses)
            if part.source is None and coloured:
                material = replace(material, base_colour=(1.0, 1.0, 1.0))
            sources.append(part.source)
            materials.append(material)
        ids.append(np.full(len(part.faces), numbers[key], np.int64))
    return sources, materials, np.concatenate(ids)


def _report(losses: Losses, libraries: list[str], path: Path) -> list[str]:
    """One line for each kind of loss; missing material libraries and transparency also warn."""
    loud, quiet = [], []
    if libraries:
        which = ", ".join(sorted(set(libraries)))
        loud.append(f"the materials are missing ({which}); white diffuse stands in")
    if losses.transparent:
        which = ", ".join(losses.transparent[:5])
        loud.append(
            f"{len(losses.transparent)} materials with transparency ({which}) count as opaque: "
            f"{losses.transparent_texels} texels are see-through in the file"
        )
    if losses.normal_maps or losses.emitters:
        quiet.append(
            f"ignored {losses.normal_maps} normal maps and the light of {losses.emitters} materials"
        )
    for line in loud:
        warnings.warn(f"{path}: {line}", JaxvisWarning, stacklevel=2)
    return loud + quiet


def _corner_arrays(parts: list[_Part]) -> dict[str, Any]:
    """The parts joined, as :func:`build_scene` takes them."""
    starts = np.cumsum([0] + [len(part.positions) for part in parts[:-1]])
    arrays: dict[str, Any] = {
        "positions": np.concatenate([part.positions for part in parts]),
        "triangles": np.concatenate(
            [part.faces + start for part, start in zip(parts, starts, strict=True)]
        ),
    }

    def join(values: list[np.ndarray | None], shape: tuple[int, ...], filling: float) -> Any:
        if all(value is None for value in values):
            return None
        return np.concatenate(
            [
                np.full((len(part.faces), *shape), filling) if value is None else value
                for part, value in zip(parts, values, strict=True)
            ]
        )

    def corners(values: np.ndarray | None, part: _Part) -> np.ndarray | None:
        return None if values is None else values[part.faces]

    arrays["normals"] = join([corners(part.normals, part) for part in parts], (3, 3), np.nan)
    arrays["uvs"] = join([corners(part.uvs, part) for part in parts], (3, 2), 0.0)
    arrays["colours"] = join([part.colours for part in parts], (3, 3), 1.0)
    return arrays
