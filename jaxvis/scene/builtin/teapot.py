"""The Utah teapot on a plane."""

import numpy as np
from jaxtyping import Float64

from jaxvis.reflectance import BlinnPhong, Material
from jaxvis.scene.build import build_scene
from jaxvis.scene.builtin.mesh import Mesh, fan, grid, join, unit, weld
from jaxvis.scene.builtin.parameters import Number, length, whole
from jaxvis.scene.builtin.shapes import ground
from jaxvis.scene.builtin.teapot_patches import HANDLE, SPOUT, tube_patches, turned_patches
from jaxvis.scene.camera import Camera
from jaxvis.scene.scene import Scene

CLEARANCE = 0.002
"""Gap between the teapot's lowest point and the plane: nothing touches, and nobody can see it."""

PORCELAIN = Material(
    base_colour=(0.78, 0.75, 0.68), specular=(0.1, 0.1, 0.1), roughness=0.35, name="porcelain"
)
TABLE = Material(base_colour=(0.50, 0.36, 0.25), name="table")


def teapot(subdivisions: Number = 8, plane_cells: Number = 64, plane_size: Number = 16.0) -> Scene:
    """The Utah teapot, standing on the middle of a square plane; about 2,000 vertices.

    The teapot is 6.5 long (spout towards +x), 4 wide and 3.15 high, the published size, with
    analytic normals. Three closed surfaces make it: the body with its lid, which a narrow floor
    joins across the gap around it; the handle; and the spout, filled with tea to just below its
    lip. The published patches are open there, and would show their backs.

    Args:
        subdivisions: quads along each edge of a patch (half as many across the rim and the bottom),
            2 to 64. Below 6 the coarse triangles at the spout's lip lose their smooth normals.
        plane_cells: quads along each edge of the plane, 1 to 512.
        plane_size: edge of the plane, more than the teapot's 6.6, at most 1000.
    """
    steps = whole("subdivisions", subdivisions, 2, 64)
    cells = whole("plane_cells", plane_cells, 1, 512)
    size = length("plane_size", plane_size, low=6.6, high=1000.0)
    pot = teapot_mesh(steps).moved((0.0, CLEARANCE, 0.0))
    plane = ground(size, cells)
    mesh = weld(join([pot, plane]))
    ids = np.repeat([0, 1], [len(pot.triangles), len(plane.triangles)])
    return build_scene(
        mesh.positions,
        mesh.triangles,
        normals=mesh.normals[mesh.triangles],
        materials=(PORCELAIN, TABLE),
        material_ids=ids,
        reflectance=BlinnPhong(),
        camera=Camera(eye=(2.0, 5.2, 10.6), target=(0.32, 1.2, 0.0), field_of_view=0.6),
        name="teapot",
    )


def teapot_mesh(subdivisions: int) -> Mesh:
    """The teapot alone, y up, its lowest point at the origin: three closed surfaces."""
    newell = join([_body(subdivisions), *_handle(subdivisions), *_spout(subdivisions)])
    return weld(Mesh(_y_up(newell.positions), _y_up(newell.normals), newell.triangles))


def evaluate_patch(
    control: Float64[np.ndarray, "4 4 3"],
    u: Float64[np.ndarray, "rows"],
    v: Float64[np.ndarray, "columns"],
) -> tuple[Float64[np.ndarray, "rows columns 3"], Float64[np.ndarray, "rows columns 3"]]:
    """Points of a bicubic Bézier patch, and the unit normals dS/dv x dS/du (zero at a pole).

    Args:
        control: control points; ``u`` runs down the first axis, ``v`` along the second.
        u, v: parameters in [0, 1].
    """
    points = _bernstein(u) @ np.moveaxis(control, -1, 0) @ _bernstein(v).T
    along_u = _bernstein_slope(u) @ np.moveaxis(control, -1, 0) @ _bernstein(v).T
    along_v = _bernstein(u) @ np.moveaxis(control, -1, 0) @ _bernstein_slope(v).T
    normals = np.cross(np.moveaxis(along_v, 0, -1), np.moveaxis(along_u, 0, -1))
    return np.moveaxis(points, 0, -1), unit(normals)


def _bernstein(t: Float64[np.ndarray, "points"]) -> Float64[np.ndarray, "points 4"]:
    s = 1.0 - t
    return np.stack([s**3, 3.0 * s**2 * t, 3.0 * s * t**2, t**3], axis=-1)


def _bernstein_slope(t: Float64[np.ndarray, "points"]) -> Float64[np.ndarray, "points 4"]:
    s = 1.0 - t
    return np.stack(
        [-3.0 * s**2, 3.0 * s * (s - 2.0 * t), 3.0 * t * (2.0 * s - t), 3.0 * t**2], axis=-1
    )


def _body(steps: int) -> Mesh:
    """Knob, lid, floor of the gap, rim, body and bottom: closed, in Newell's coordinates."""
    coarse = (steps + 1) // 2
    v = np.linspace(0.0, 1.0, steps + 1)
    meshes = []
    for profile, rows in zip(
        turned_patches(), (steps, steps, coarse, steps, steps, coarse), strict=True
    ):
        for control in profile:
            points, normals = evaluate_patch(control, np.linspace(0.0, 1.0, rows + 1), v)
            # At a pole all directions around are one, and the tangent plane is level.
            pole = np.linalg.norm(points[..., :2], axis=-1, keepdims=True) == 0.0
            level = np.array([0.0, 0.0, 1.0]) * np.where(points[..., 2:] > 1.0, 1.0, -1.0)
            meshes.append(grid(points, np.where(pole, level, normals)))
    _, lid, rim = turned_patches()[:3]
    for lid_control, rim_control in zip(lid, rim, strict=True):
        inner, _ = evaluate_patch(lid_control, np.ones(1), v)
        outer, _ = evaluate_patch(rim_control, np.zeros(1), v)
        points = np.concatenate([inner, outer])
        meshes.append(grid(points, np.broadcast_to([0.0, 0.0, 1.0], points.shape)))
    return join(meshes)


def _handle(steps: int) -> list[Mesh]:
    rings, meshes = _tube(tube_patches(HANDLE), steps)
    top, bottom = rings
    # Both ends lie inside the body, each in the plane of its ring.
    return [*meshes, _cap(top, np.array([1.0, 0.0, 0.0])), _cap(bottom, np.array([1.0, 0.0, 0.0]))]


def _spout(steps: int) -> list[Mesh]:
    (base, lip), meshes = _tube(tube_patches(SPOUT), steps)
    return [*meshes, _cap(base, np.array([-1.0, 0.0, 0.0])), _cap(lip, np.array([0.0, 0.0, 1.0]))]


def _tube(
    patches: Float64[np.ndarray, "lengths sides 4 4 3"], steps: int
) -> tuple[tuple[Float64[np.ndarray, "columns 3"], Float64[np.ndarray, "columns 3"]], list[Mesh]]:
    """The grids of a tube, and the closed rings of points at its two ends."""
    t = np.linspace(0.0, 1.0, steps + 1)
    sides = [[evaluate_patch(control, t, t) for control in pair] for pair in patches]
    meshes = [grid(points, normals) for pair in sides for points, normals in pair]
    first, last = (
        np.concatenate([sides[end][0][0][end], sides[end][1][0][end][1:]]) for end in (0, -1)
    )
    return (first, last), meshes


def _cap(ring: Float64[np.ndarray, "columns 3"], side: Float64[np.ndarray, "3"]) -> Mesh:
    """The flat inside of a ring, facing the given side."""
    centre = ring[:-1].mean(axis=0)
    normal = np.cross(ring[: len(ring) // 2] - centre, ring[1 : len(ring) // 2 + 1] - centre).sum(0)
    return fan(centre, ring, normal * np.sign(normal @ side))


def _y_up(vectors: Float64[np.ndarray, "vertices 3"]) -> Float64[np.ndarray, "vertices 3"]:
    x, y, z = vectors.T
    return np.stack([x, z, -y], axis=-1)
