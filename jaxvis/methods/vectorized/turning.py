"""Visibility polygons of a scene that has turned about +Y: the same light falls from elsewhere."""

import math
from dataclasses import replace

import jax
import numpy as np

from jaxvis.chunks import map_on_host
from jaxvis.methods.vectorized.correspondence.interpolated import Outlines
from jaxvis.methods.vectorized.correspondence.triples import CorrespondingPolygons
from jaxvis.methods.vectorized.mesh import Mesh
from jaxvis.methods.vectorized.polygons import VisibilityPolygons
from jaxvis.scene import Surface


def turned_polygons(
    visibility: VisibilityPolygons | CorrespondingPolygons, yaw: float
) -> VisibilityPolygons | CorrespondingPolygons:
    """Polygons turned by ``yaw`` radians, counter-clockwise seen from above (+Z to +X).

    What is kept with them is turned, too, and not built anew.
    """
    if isinstance(visibility, CorrespondingPolygons):
        outlines = Outlines.of(visibility)
        polygons = _turned(visibility.polygons, yaw)
        found = replace(visibility, polygons=polygons)
        rows = jax.device_put(np.moveaxis(np.asarray(polygons.vectors), 1, 2).reshape(-1, 4))
        vars(found)["_outlines"] = outlines._replace(lists=replace(outlines.lists, vectors=rows))
        return found
    return _turned(visibility, yaw)


def turned_surface(surface: Surface, yaw: float) -> Surface:
    """The same of what a camera sees, which turns with the scene."""
    names = "position", "normal", "geometric_normal", "view", "eye"
    fields = {name: getattr(surface, name) for name in names}
    return replace(surface, **map_on_host(lambda leaf: turn(leaf, yaw), fields))


def turn(vectors: np.ndarray, yaw: float, axis: int = -1) -> np.ndarray:
    """Vectors turned about +Y; a fourth component stays as it is."""
    cosine, sine = np.float32(math.cos(yaw)), np.float32(math.sin(yaw))
    x, y, z, *rest = np.moveaxis(vectors, axis, 0)
    return np.stack([cosine * x + sine * z, y, cosine * z - sine * x, *rest], axis=axis)


def _turned(visibility: VisibilityPolygons, yaw: float) -> VisibilityPolygons:
    mesh = Mesh.of(visibility)
    found = replace(
        visibility,
        vectors=map_on_host(lambda leaf: turn(leaf, yaw, axis=1), visibility.vectors),
        positions=map_on_host(lambda leaf: turn(leaf, yaw), visibility.positions),
        normals=map_on_host(lambda leaf: turn(leaf, yaw), visibility.normals),
    )
    vars(found)["_mesh"] = mesh._replace(planes=turn(mesh.planes, yaw))
    return found
