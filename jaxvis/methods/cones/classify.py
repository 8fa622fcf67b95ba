"""Which meshes of a scene are height fields, and go to the 2D lightmap (paper 003, eq. 5; host).

A mesh is a set of triangles connected through equal positions. It is compared with the height
field that its topmost points make; what stands far from that (undersides, walls, whatever lies
beneath) is lost in a map of heights, and makes it a mesh for the 3D lightmap.
"""

import numpy as np
import scipy
from jaxtyping import Bool, Float64, Int32, Integer

from jaxvis.methods.cones.height_field import (
    Layout,
    Tops,
    bound,
    distances,
    height_field_distance,
    lay_out,
    resolutions,
    sample_surface,
)
from jaxvis.scene.scene import Scene
from jaxvis.scene.weld import equal_rows

__all__ = ["height_field_distance", "height_field_meshes", "mesh_ids"]

THRESHOLD = 1e-3
"""Mean distance (of the bounding box's diagonal) below which a mesh is a height field (paper)."""

PLAN = 1024
"""Cells along the scene's longer side of the plan in which height fields must not overlap."""

OVERLAP = 0.01
"""Part of a height field's cells that may lie over or under an earlier one: rounding at borders."""


def mesh_ids(scene: Scene) -> Int32[np.ndarray, "triangles"]:
    """The number of the mesh that each triangle belongs to, in the order of first triangles.

    Two triangles are of one mesh where corners have equal positions, whatever their normals.
    """
    _, place = equal_rows(*scene.positions.T)
    return _components(place[scene.triangles])


def height_field_meshes(
    scene: Scene, threshold: float = THRESHOLD
) -> Bool[np.ndarray, "triangles"]:
    """Which triangles one map of heights can stand for, all together.

    Those of meshes whose :func:`height_field_distance` is below the threshold and whose topmost
    surface shows its front (or is two-sided). Where several lie above each other, the one that
    covers most of the plan stays: the ground, not the roof. A mesh too small to be met by the plan
    goes to 3D too, where a mean over its surface finds it.

    Raises:
        ValueError: the threshold is not positive.
    """
    if not threshold > 0.0:
        raise ValueError(f"threshold must be positive, got {threshold}")
    ids = mesh_ids(scene)
    laid = lay_out(scene.positions, scene.triangles, ids)
    tops = Tops.above(laid, sample_surface(laid))
    fit = _faces_up(tops, scene, laid)
    # A point's own column bounds its distance, which is all that most height fields need.
    unclear = fit & ~(bound(laid, tops) < threshold)
    fit &= distances(laid, tops, resolutions(ids), unclear) < threshold
    fit &= _alone(laid, fit)
    return fit[ids]


def _faces_up(tops: Tops, scene: Scene, laid: Layout) -> Bool[np.ndarray, "meshes"]:
    """Whether most of what lies topmost shows a side that is rendered."""
    two_sided = np.array([m.two_sided for m in scene.materials])[scene.material_ids]
    shown = two_sided | (scene.geometric_normals[:, 1] > 0.0)
    mesh, hit = tops.points.mesh, tops.triangle >= 0
    share = np.where(shown[tops.triangle], 1.0, -1.0)
    return np.bincount(mesh[hit], share[hit], minlength=len(laid.low)) > 0.0


def _alone(laid: Layout, fit: Bool[np.ndarray, "meshes"]) -> Bool[np.ndarray, "meshes"]:
    """Of meshes that fit, those that no larger one lies over or under."""
    meshes = np.flatnonzero(fit)
    alone = np.zeros(len(fit), bool)
    if not len(meshes):
        return alone
    low, high = laid.came.min(axis=0), (laid.came + laid.extent * laid.size[:, None]).max(axis=0)
    width = float(max(high[0] - low[0], high[2] - low[2])) / PLAN
    footprint = _footprints(laid)[meshes]
    occupied = np.zeros((PLAN, PLAN), bool)
    for mesh in meshes[np.argsort(-footprint, kind="stable")].tolist():
        covered = _covered(laid, mesh, low, width)
        if covered is None:
            continue
        part, cells = covered
        before = occupied[part]
        if np.count_nonzero(before & cells) <= OVERLAP * np.count_nonzero(cells):
            alone[mesh] = True
            before |= cells
    return alone


def _footprints(laid: Layout) -> Float64[np.ndarray, "meshes"]:
    """Areas seen from above; twice that for what is closed."""
    a, b, c = (laid.corners[:, k, ::2] for k in range(3))
    first, second = b - a, c - a
    area = 0.5 * np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    return np.bincount(laid.ids, area) * laid.size**2


def _covered(
    laid: Layout, mesh: int, low: Float64[np.ndarray, "3"], width: float
) -> tuple[tuple[slice, slice], Bool[np.ndarray, "rows columns"]] | None:
    """The part of the plan about a mesh, and its cells whose centres are over or under the mesh.

    None without any.
    """
    ends = laid.came[mesh], laid.came[mesh] + laid.extent[mesh] * laid.size[mesh]
    first, last = (np.rint((end - low) / width).astype(int) for end in ends)
    # Cells whose centres lie between the ends.
    rows, columns = slice(first[2], min(last[2], PLAN)), slice(first[0], min(last[0], PLAN))
    row, column = np.mgrid[rows, columns] + 0.5
    if not row.size:
        return None
    scale = 1.0 / laid.size[mesh]
    x = laid.low[mesh, 0] + (low[0] + width * column - laid.came[mesh, 0]) * scale
    z = laid.low[mesh, 2] + (low[2] + width * row - laid.came[mesh, 2]) * scale
    _, triangle = laid.heights(x.reshape(-1), z.reshape(-1))
    cells = (triangle >= 0).reshape(row.shape)
    return ((rows, columns), cells) if cells.any() else None


def _components(places: Integer[np.ndarray, "triangles 3"]) -> Int32[np.ndarray, "triangles"]:
    """Connected components of triangles given by position numbers, by first triangle."""
    count = int(places.max()) + 1
    start, end = np.repeat(places[:, 0], 2), places[:, 1:].reshape(-1)
    graph = scipy.sparse.coo_matrix((np.ones(len(start), bool), (start, end)), shape=(count, count))
    _, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
    _, ids = equal_rows(label[places[:, 0]])
    return ids.astype(np.int32)
