"""Shapes turned on a lathe or carried around a rectangle, that scenes are made of (host)."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Float64

from jaxvis.scene.builtin.mesh import Mesh, grid, join, rectangle, unit


def profile_normals(
    profile: Float64[np.ndarray, "rows 2"],
) -> Float64[np.ndarray, "rows 2"]:
    """Unit normals of a smooth profile (radius or offset, height): outwards where it rises."""
    tangent = np.gradient(profile, axis=0)
    return unit(np.stack([tangent[:, 1], -tangent[:, 0]], axis=-1))


def lathe(
    profile: Float64[np.ndarray, "rows 2"],
    around: int,
    normals: Float64[np.ndarray, "rows 2"] | None = None,
) -> Mesh:
    """A surface of revolution about +Y.

    Args:
        profile: (radius, height); the front is on its right-hand side, outside where it rises.
        around: segments of the full turn.
        normals: (radial, vertical) unit normals along the profile; smooth ones if None.
    """
    normals = profile_normals(profile) if normals is None else normals
    angle = 2.0 * np.pi * (np.arange(around + 1) % around) / around
    turn = np.stack([np.cos(angle), np.ones_like(angle), np.sin(angle)], axis=-1)
    return grid(profile[:, None, [0, 1, 0]] * turn, normals[:, None, [0, 1, 0]] * turn)


def rectangle_sweep(
    half_x: float,
    half_z: float,
    profile: Sequence[tuple[float, float]],
    spacing: float,
) -> Mesh:
    """A profile carried around a rectangle about the Y axis, mitred at the corners; flat faces.

    With a closed profile it is a ring of walls or slabs; with offsets down to the rectangle's half
    width, a box.

    Args:
        half_x, half_z: half the edges of the rectangle that offset 0 stands for.
        profile: (outward offset, height) corners; the front is outside where the profile rises.
        spacing: largest edge of the quads along a face.
    """
    widest = max(offset for offset, _ in profile)
    meshes = []
    for (offset, low), (next_offset, high) in pairwise(profile):
        length = float(np.hypot(next_offset - offset, high - low))
        t = np.linspace(0.0, 1.0, cell_count(length, spacing) + 1)[:, None]
        reach = offset + t * (next_offset - offset)
        height = low + t * (high - low)
        normal = np.array([high - low, offset - next_offset]) / length
        for quarter, (front, side) in enumerate(((half_z, half_x), (half_x, half_z)) * 2):
            cells = cell_count(2.0 * (side + widest), spacing)
            along = np.linspace(-1.0, 1.0, cells + 1)
            points = np.stack(
                [
                    along * (side + reach),
                    np.broadcast_to(height, (len(t), cells + 1)),
                    np.broadcast_to(front + reach, (len(t), cells + 1)),
                ],
                axis=-1,
            )
            face = grid(points, np.broadcast_to([0.0, normal[1], normal[0]], points.shape))
            meshes.append(face.moved((0.0, 0.0, 0.0), quarter))
    return join(meshes)


def cell_count(length: float, spacing: float) -> int:
    """Cells that divide a length into steps of at most the spacing."""
    return max(1, int(np.ceil(length / spacing - 1e-9)))


def box(size: tuple[float, float, float], spacing: float) -> Mesh:
    """A closed box, facing outwards, centred on the Y axis and standing on y = 0."""
    x, y, z = size
    inward = -0.5 * min(x, z)
    corners = ((inward, 0.0), (0.0, 0.0), (0.0, y), (inward, y))
    return rectangle_sweep(0.5 * x, 0.5 * z, corners, spacing)


def ground(size: float, cells: int) -> Mesh:
    """A square of the plane y = 0 about the origin, facing up."""
    return rectangle(
        (-0.5 * size, 0.0, -0.5 * size), (0.0, 0.0, size), (size, 0.0, 0.0), (cells, cells)
    )


def sphere(radius: float, rows: int) -> Mesh:
    """A sphere about the origin with ``rows`` bands of latitude and twice as many of longitude."""
    polar = np.linspace(-0.5 * np.pi, 0.5 * np.pi, rows + 1)
    normals = np.stack([np.cos(polar), np.sin(polar)], axis=-1)
    normals[[0, -1], 0] = 0.0  # cos(pi / 2) is not quite zero in floating point
    return lathe(radius * normals, 2 * rows, normals)


def torus(ring_radius: float, tube_radius: float, around: int, tube: int) -> Mesh:
    """A torus about the Y axis: ``around`` segments of the ring, ``tube`` of the tube."""
    angle = 2.0 * np.pi * (np.arange(tube + 1) % tube) / tube
    normals = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return lathe(tube_radius * normals + [ring_radius, 0.0], around, normals)
