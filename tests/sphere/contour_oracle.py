"""Slow, readable integrals over spherical polygons in float64, and polygons to try them on.

Polygons are unit directions [vectors, 3], counter-clockwise about their region seen from outside.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxvis.sphere.latlong import row_solid_angles
from jaxvis.sphere.polygons import Directions

Points = Float[np.ndarray, "vectors 3"]

HEIGHT, WIDTH = 16, 32
"""Texels of the maps that tests share."""


def unit(vectors):
    """Each row (or the one vector) by its length."""
    vectors = np.asarray(vectors, np.float64)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def directions_of(*polygons: Points) -> Directions:
    """Float32 Directions [polygons, vectors]; all of the same number of vectors."""
    parts = jnp.asarray(np.stack(polygons), jnp.float32)
    return Directions(parts[..., 0], parts[..., 1], parts[..., 2])


def points_of(directions: Directions) -> np.ndarray:
    """The reverse: float64 [polygons, vectors, 3]."""
    return np.stack([np.asarray(axis, np.float64) for axis in directions], axis=-1)


def about(centre, angle, radius) -> Points:
    """Directions at ``radius`` (radians) from ``centre``, at an azimuth that runs anticlockwise."""
    centre = unit(centre)
    tangent = unit(np.cross(centre, [0.31, 0.52, 0.79]))
    bitangent = np.cross(centre, tangent)  # (tangent, bitangent, centre) is right-handed
    angle, radius = np.broadcast_arrays(angle, radius)
    ring = np.cos(angle)[:, None] * tangent + np.sin(angle)[:, None] * bitangent
    return np.cos(radius)[:, None] * centre + np.sin(radius)[:, None] * ring


def circle(centre, radius: float, count: int = 256) -> Points:
    """A regular polygon inscribed in the spherical circle."""
    return about(centre, 2.0 * np.pi * (np.arange(count) + 0.37) / count, radius)


def star(rng, centre, count: int, least: float = 0.3, most: float = 1.4) -> Points:
    """A polygon that winds once round ``centre``, at random distances from it."""
    angle = 2.0 * np.pi * (np.arange(count) + rng.random(count) * 0.8) / count
    waves = np.sin(np.outer(angle, np.arange(1, 6)) + 2.0 * np.pi * rng.random(5)) @ rng.random(5)
    waves = (waves - waves.min()) / np.ptp(waves)
    return about(centre, angle, least + (most - least) * waves)


def arcs(points: Points, pieces: int) -> Points:
    """Each great-circle edge in ``pieces`` equally long pieces."""
    a, b = points[:, None], np.roll(points, -1, axis=0)[:, None]
    t = (np.arange(pieces) / pieces)[None, :, None]
    angle = 2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(b - a, axis=-1, keepdims=True), 0.0, 1.0))
    sine = np.where(angle > 0.0, np.sin(angle), 1.0)
    between = (np.sin((1.0 - t) * angle) * a + np.sin(t * angle) * b) / sine
    return np.where(angle > 0.0, between, a).reshape(-1, 3)


def winding(points: Points, directions: Float[np.ndarray, "n 3"]) -> np.ndarray:
    """How often the polygon winds round each direction, less how often round the opposite one."""
    tangent = unit(np.cross(directions, np.eye(3)[np.argmin(np.abs(directions), axis=-1)]))
    bitangent = np.cross(directions, tangent)
    azimuth = np.arctan2(bitangent @ points.T, tangent @ points.T)
    steps = np.mod(np.roll(azimuth, -1, axis=-1) - azimuth + np.pi, 2.0 * np.pi) - np.pi
    return np.rint(steps.sum(axis=-1) / (2.0 * np.pi)).astype(int)


def coordinates(points: Points) -> tuple[np.ndarray, np.ndarray]:
    """(u in turns, v from 0 at the north pole to 1) of unit directions, in float64."""
    x, y, z = points.T
    u = np.mod(np.arctan2(x, -z) / (2.0 * np.pi), 1.0)
    return u, np.arctan2(np.hypot(x, z), y) / np.pi


def raster_integral(values, points: Points, axis, samples: int = 4) -> np.ndarray:
    """Sum over samples x samples points in each texel that the polygon winds round.

    The polygon must lie in the hemisphere of ``axis``.
    """
    height, width = values.shape[:2]
    v = (np.arange(height * samples) + 0.5)[:, None] / (height * samples) * np.pi
    u = (np.arange(width * samples) + 0.5)[None, :] / (width * samples) * 2.0 * np.pi
    grid = np.stack(
        np.broadcast_arrays(np.sin(v) * np.sin(u), np.cos(v), -np.sin(v) * np.cos(u)), axis=-1
    )
    fine = np.repeat(np.repeat(values, samples, axis=0), samples, axis=1) / samples**2
    inside = grid @ np.asarray(axis) > 0.0
    return winding(points, grid[inside]) @ fine[inside]


def contour_integral(values, points: Points, step: float = 0.25) -> np.ndarray:
    """The integral [channels] of texel values over a polygon of great-circle edges.

    The trapezoidal rule on edges in pieces of at most ``step`` texels' height.
    """
    height, width, channels = values.shape
    areas = np.broadcast_to(row_solid_angles(height, width)[:, None, None], (height, width, 1))
    values = np.concatenate([values, areas], axis=-1)
    table = np.zeros((height + 1, width + 1, channels + 1))
    table[1:, 1:] = values.cumsum(axis=0).cumsum(axis=1)

    longest = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1).max()
    pieces = max(1, int(np.ceil(longest * height / np.pi / step)))
    u, v = coordinates(arcs(points, pieces))
    next_v = np.roll(v, -1)
    next_u = u + np.mod(np.roll(u, -1) - u + 0.5, 1.0) - 0.5  # within half a turn of u

    def prefix(u, v):
        """The sum from the north pole to v and from column 0 to u, any real number of turns."""
        turn = np.floor(u)
        x, y = (u - turn) * width, v * height
        column = np.minimum(x.astype(int), width - 1)
        row = np.minimum(y.astype(int), height - 1)
        fx, fy = (x - column)[:, None], (y - row)[:, None]
        upper = (1.0 - fx) * table[row, column] + fx * table[row, column + 1]
        lower = (1.0 - fx) * table[row + 1, column] + fx * table[row + 1, column + 1]
        whole = (1.0 - fy) * table[row, width] + fy * table[row + 1, width]
        return (1.0 - fy) * upper + fy * lower + turn[:, None] * whole

    run_at_start = prefix(next_u, v) - prefix(u, v)
    run_at_end = prefix(next_u, next_v) - prefix(u, next_v)
    total = -0.5 * (run_at_start + run_at_end).sum(axis=0)  # columns run clockwise from outside
    # Prefix sums start at the north pole, so that the whole sphere is missing each time that the
    # polygon winds round the south pole; no polygon of the tests has more than 3 pi or less than
    # -pi steradians.
    south = round((np.pi - total[-1]) / (4.0 * np.pi))
    return (total + south * table[height, width])[:channels]


def as_jax(array):
    return jnp.asarray(array, jnp.float32)


def solid_angles(height):
    return row_solid_angles(height, 2 * height)[:, None, None]


def random_values(channels=3, height=HEIGHT, power=6):
    values = np.random.default_rng(0).random((height, 2 * height, channels)) ** power
    return values * solid_angles(height)
