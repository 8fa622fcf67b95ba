"""Which sites a frame needs, and how pixels interpolate between them (host)."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float32, Int32

from jaxvis.methods.vectorized.correspondence.interpolated import joined_outlines, polygons_of
from jaxvis.methods.vectorized.correspondence.triples import CorrespondingPolygons
from jaxvis.methods.vectorized.evaluation import Sites
from jaxvis.methods.vectorized.mesh import Mesh, Pixels
from jaxvis.methods.vectorized.polygons import VisibilityPolygons
from jaxvis.scene import Surface


class Stencil(NamedTuple):
    """Every pixel's value as a weighted sum of values at nodes.

    Nodes are the plan's sites, padded to its capacity, and after them places between two sites.
    """

    ends: Int32[np.ndarray, "between 2"]
    """Sites between which those places lie."""
    fraction: Float32[np.ndarray, "between"]
    nodes: Int32[np.ndarray, "pixels corners"]
    """Of all pixels of the image, shaded or not."""
    weights: Float32[np.ndarray, "pixels corners"]


class Plan(NamedTuple):
    """The sites of a frame, and what its pixels make of them. Host.

    Shapes are padded to ``capacity`` and the like, so that XLA compiles few of them.
    """

    sites: Sites
    capacity: int
    stencil: Stencil
    clipped: bool
    """Whether sites see nothing below the planes of their triangles. Those that triangles share
    cannot know, and pixels make up for it."""
    evaluations: int
    """Polygons that are integrated, those that chose the sites included."""


def room(count: int) -> int:
    """``count`` rounded up to 16384, or 4, 16, ... times as many: other views seldom compile anew.

    What is padded to it are a few numbers each, looked up and not evaluated.
    """
    size = 16384
    while size < count:
        size *= 4
    return size


def padded(values: Array | np.ndarray, capacity: int) -> Array | np.ndarray:
    """``values`` with zeros after them: on the host, unless JAX transforms them."""
    if isinstance(values, Tracer):
        rest = jnp.zeros((capacity - len(values), *values.shape[1:]), values.dtype)
        return jnp.concatenate([values, rest])
    host = np.asarray(values)
    return np.concatenate([host, np.zeros((capacity - len(host), *host.shape[1:]), host.dtype)])


def needed_sites(plan: Plan) -> Int32[np.ndarray, "needed"]:
    """The sites that pixels use, ascending."""
    stencil = plan.stencil
    used = np.zeros(plan.capacity + len(stencil.ends), bool)
    used[stencil.nodes[stencil.weights > 0.0]] = True
    between = np.flatnonzero(used[plan.capacity :])
    used[stencil.ends.take(between, axis=0).reshape(-1)] = True
    return np.flatnonzero(used[: len(plan.sites.normal)]).astype(np.int32)


def over_image(values: np.ndarray, pixels: Pixels, size: int) -> np.ndarray:
    """``values`` of the shaded pixels at their places in a flat image, 0 elsewhere."""
    image = np.zeros((size, *values.shape[1:]), values.dtype)
    image[pixels.index] = values
    return image


def corner_sites(visibility: VisibilityPolygons, polygons: Int32[np.ndarray, "corners"]) -> Sites:
    """The places of the polygons themselves."""
    normal = np.asarray(visibility.normals).take(polygons, axis=0)
    reference = np.full((len(polygons), 3), -1, np.int32)
    reference[:, 0] = polygons
    weight = np.zeros((len(polygons), 3), np.float32)
    weight[:, 0] = 1.0
    position = np.asarray(visibility.positions).take(polygons, axis=0)
    return Sites(position, normal, normal, reference, weight, np.full(len(polygons), -1, np.int32))


def without_buried(
    visibility: VisibilityPolygons,
    polygon: Int32[np.ndarray, "sites 3"],
    weight: Float32[np.ndarray, "sites 3"],
) -> tuple[Int32[np.ndarray, "sites 3"], Float32[np.ndarray, "sites 3"]]:
    """Polygons (-1 where the weight is 0) and weights, buried ones left out where others remain."""
    counts = ~np.asarray(visibility.buried).take(polygon) & (weight > 0.0)
    weight = renormalised(weight, counts)
    return np.where(weight > 0.0, polygon, np.int32(-1)), weight


def renormalised(
    weight: Float32[np.ndarray, "sites corners"], counts: Bool[np.ndarray, "sites corners"]
) -> Float32[np.ndarray, "sites corners"]:
    """Weights of those that count, with the sum that all had; all of them where none counts."""
    rows = np.flatnonzero(~counts.reshape(-1)) // weight.shape[-1]
    if not len(rows):
        return weight
    left = np.where(counts[rows], weight[rows], np.float32(0.0))
    rest, whole = (part.sum(axis=-1, keepdims=True) for part in (left, weight[rows]))
    some = rest > 1e-6
    changed = weight.copy()
    changed[rows] = np.where(some, left * (whole / np.where(some, rest, 1.0)), weight[rows])
    return changed


def sites_in_faces(
    visibility: VisibilityPolygons | CorrespondingPolygons,
    mesh: Mesh,
    face: Int32[np.ndarray, "sites"],
    weight: Float32[np.ndarray, "sites 3"],
    position: Float32[np.ndarray, "sites 3"],
    normal: Float32[np.ndarray, "sites 3"],
    plane: Float32[np.ndarray, "sites 3"],
) -> Sites:
    """Sites with the polygons of their faces' corners, joined to one outline if they correspond."""
    corners = mesh.faces.take(face, axis=0)
    polygon, weight = without_buried(polygons_of(visibility), corners, weight)
    joined = joined_outlines(visibility, mesh, face, polygon, weight)
    return Sites(position, normal, plane, *joined)


def plan_fragments(
    visibility: VisibilityPolygons | CorrespondingPolygons,
    mesh: Mesh,
    pixels: Pixels,
    surface: Surface,
) -> Plan:
    """A site at every shaded pixel, with the polygons of its triangle's corners (eq. 19)."""

    def at_pixels(field: Array) -> np.ndarray:
        return np.asarray(field).reshape(-1, 3).take(pixels.index, axis=0)

    sites = sites_in_faces(
        visibility,
        mesh,
        pixels.face,
        pixels.barycentrics,
        at_pixels(surface.position),
        at_pixels(surface.normal),
        at_pixels(surface.geometric_normal),
    )
    own = np.arange(len(pixels.index), dtype=np.int32)[:, None]
    size = surface.mask.size
    stencil = Stencil(
        np.zeros((0, 2), np.int32),
        np.zeros(0, np.float32),
        over_image(own, pixels, size),
        over_image(np.ones((len(own), 1), np.float32), pixels, size),
    )
    return Plan(sites, room(len(own)), stencil, True, sites.references)
