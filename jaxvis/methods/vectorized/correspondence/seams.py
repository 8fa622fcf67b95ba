"""Seams: the light at inner edges of the mesh, by the triples of the face on either side (host).

Faces share along an edge what was selected for both, but the rest of their lists is their own. What
differs there would show in pixels, which use the lists of the faces that they see.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float32, Float64

from jaxvis.methods.vectorized.correspondence.interpolated import Outlines, polygons_of
from jaxvis.methods.vectorized.correspondence.triples import CorrespondingPolygons
from jaxvis.methods.vectorized.evaluation import Sites
from jaxvis.methods.vectorized.irradiance import Quadrature, irradiance
from jaxvis.methods.vectorized.light import PolygonLight
from jaxvis.methods.vectorized.mesh import Mesh, inner_edges, places_in_faces
from jaxvis.methods.vectorized.method import VectorizedVisibility, Visibility
from jaxvis.methods.vectorized.plan import without_buried
from jaxvis.scene import Surface


def sides_of_edges(
    visibility: Visibility,
    light: PolygonLight,
    quadrature: Quadrature,
    *,
    clipped: bool = True,
) -> Float32[np.ndarray, "edges 2 3"]:
    """Irradiance at the midpoints of inner edges, as a pixel of each face would have it.

    Args:
        visibility: the polygons, and perhaps their correspondence.
        light: that shines.
        quadrature: how it is integrated.
        clipped: whether nothing is seen below the planes of the faces, as in pixels. These differ
            by themselves where the mesh is bent; without them only the triples do.
    """
    polygons = polygons_of(visibility)
    mesh = Mesh.of(polygons)
    face, corner = np.divmod(inner_edges(mesh.faces, mesh.edges).reshape(-1), 3)
    weight = np.full((len(face), 3), 0.5, np.float32)
    weight[np.arange(len(face)), corner] = 0.0
    position, normal, plane = places_in_faces(polygons, face, weight)
    corners = mesh.faces.take(face, axis=0)
    polygon, weight = without_buried(polygons, corners, weight)
    if isinstance(visibility, CorrespondingPolygons):
        outline = Outlines.of(visibility).of_face.take(face)
    else:
        outline = np.full(len(face), -1, np.int32)
    plane = plane if clipped else normal
    sites = Sites(position, normal, plane, polygon, weight, outline)
    found = irradiance(visibility, light, sites, quadrature, light.vector)
    return np.asarray(found).reshape(-1, 2, 3)


def differences(sides: Float32[np.ndarray, "edges 2 3"]) -> Float64[np.ndarray, "edges"]:
    """By how much the two sides of each edge differ, on average over the channels."""
    return np.abs(sides[:, 0].astype(np.float64) - sides[:, 1]).mean(axis=-1)


def mean_irradiance(
    method: VectorizedVisibility, visibility: Visibility, light: PolygonLight, surface: Surface
) -> float:
    """Of the shaded pixels and their channels."""
    plan = replace(method, shading="fragment").plan(visibility, light, surface)
    values = irradiance(visibility, light, plan.sites, method.quadrature, light.vector)
    return float(np.mean(np.asarray(values), dtype=np.float64))
