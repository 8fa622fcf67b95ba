"""Slow, readable distance transforms in float64, right and wrong, and maps to try them on.

A grid is (theta of the rows, phi of the columns, whether phi goes round). Seeds are bool
[rows, columns]; results are angles [rows, columns], pi everywhere where there is no seed.
"""

import jax.numpy as jnp
import numpy as np

from jaxvis.scene import RayTracer, Scene
from jaxvis.scene.rays import offset_origins
from jaxvis.sphere.frames import to_world
from jaxvis.sphere.hemisphere_grid import texel_directions

Grid = tuple[np.ndarray, np.ndarray, bool]


def hemisphere(size: int) -> Grid:
    angle = np.pi * (np.arange(size) + 0.5) / size
    return angle, angle, False


def sphere(height: int, width: int) -> Grid:
    theta = np.pi * (np.arange(height) + 0.5) / height
    return theta, 2.0 * np.pi * (np.arange(width) + 0.5) / width, True


def grid_points(grid: Grid) -> np.ndarray:
    """Unit vectors [rows, columns, 3]; which way they are turned does not matter to distances."""
    theta, phi = np.meshgrid(grid[0], grid[1], indexing="ij")
    return np.stack(
        [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1
    )


def angle_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Precise at 0 and at pi alike."""
    return 2.0 * np.arctan2(np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1))


def brute_force(seeds: np.ndarray, grid: Grid) -> np.ndarray:
    """Every texel against every seed."""
    points = grid_points(grid)
    places = points[seeds]
    nearest = np.full(seeds.shape, np.pi)
    if len(places):
        for i, row in enumerate(points):
            # The nearest by the dot product may lose to rounding, by less than 1e-7 rad.
            chosen = places[np.argmax(row @ places.T, axis=1)]
            nearest[i] = angle_between(row, chosen)
    return nearest


def signed(visible: np.ndarray, grid: Grid, transform=brute_force) -> np.ndarray:
    """Paper 002, eq. 4, from a transform of one sign."""
    return np.where(visible, transform(~visible, grid), -transform(visible, grid))


def separating_colatitude(theta_s, phi_s, theta_g, phi_g, phi) -> float:
    """Theta of Algorithm 1: the point of the meridian ``phi`` as far from s as from g.

    In (0, pi) where theta_s < theta_g; s is the nearer of the two above it, g below it.
    """
    return np.arctan2(
        np.cos(theta_s) - np.cos(theta_g),
        np.sin(theta_g) * np.cos(phi_g - phi) - np.sin(theta_s) * np.cos(phi_s - phi),
    )


def scan(seeds: np.ndarray, grid: Grid) -> np.ndarray:
    """Paper 002's Algorithm 1, its misprints mended: two scans along rows, two along meridians."""
    theta, phi, wraps = grid
    points = grid_points(grid)
    rows, columns = seeds.shape
    winner = np.full((rows, columns), -1)  # the column of the row's nearest seed

    def apart(i, a, b):
        return angle_between(points[i, a], points[i, b])

    for i in range(rows):
        # On a ring each scan goes round twice: the first time finds what lies across the seam.
        turns = 2 if wraps else 1
        for order in (range(columns), range(columns - 1, -1, -1)):
            last = -1
            for j in [*order] * turns:
                if seeds[i, j]:
                    last = j
                if last >= 0 and (
                    winner[i, j] < 0 or apart(i, last, j) < apart(i, winner[i, j], j)
                ):
                    winner[i, j] = last

    distance = np.full((rows, columns), np.pi)
    for j in range(columns):
        stack = []  # (row, colatitude from which that row's candidate is the nearest)
        for i in range(rows):
            if winner[i, j] < 0:
                continue
            begin = -1.0
            while stack:
                top, top_begin = stack[-1]
                begin = separating_colatitude(
                    theta[top], phi[winner[top, j]], theta[i], phi[winner[i, j]], phi[j]
                )
                if begin > top_begin:
                    break
                stack.pop()
                begin = -1.0
            if begin < np.pi:
                stack.append((i, begin))
        for i in range(rows - 1, -1, -1):
            if not stack:
                break
            while len(stack) > 1 and theta[i] < stack[-1][1]:
                stack.pop()
            top = stack[-1][0]
            distance[i, j] = angle_between(points[i, j], points[top, winner[top, j]])
    return distance


def meridians_first(seeds: np.ndarray, grid: Grid) -> np.ndarray:
    """The other order, which is wrong: the meridian's nearest seed need not win elsewhere."""
    points = grid_points(grid)
    rows, columns = seeds.shape
    distance = np.full(seeds.shape, np.pi)
    for j in range(columns):
        places = np.flatnonzero(seeds[:, j])
        if len(places):
            for i in range(rows):
                seed = points[places[np.argmin(np.abs(places - i))], j]
                distance[i] = np.minimum(distance[i], angle_between(points[i], seed))
    return distance


def smooth_maps(count: int, size: int, seed: int = 0, height: int | None = None) -> np.ndarray:
    """Maps of a few large blobs, about half of it visible: [count, height or size, size]."""
    random = np.random.default_rng(seed)
    height = size if height is None else height
    y, x = np.mgrid[0:height, 0:size] / size
    total = np.zeros((count, height, size))
    for _ in range(12):
        kx, ky, shift = random.normal(size=(3, count, 1, 1)) * [[[[6.0]]], [[[6.0]]], [[[9.0]]]]
        total += np.cos(kx * x + ky * y + shift)
    return total > 0.0


def traced_maps(scene: Scene, count: int, size: int) -> np.ndarray:
    """What vertices of a scene see, in their own frames: bool [count, size, size]."""
    tracer = RayTracer(scene.positions, scene.triangles)
    # In the order of their heights, lest they all lie on one part.
    order = np.argsort(scene.positions[:, 1], kind="stable")
    chosen = order[np.linspace(0, len(order) - 1, count).astype(int)]
    local = texel_directions(size).reshape(-1, 3)
    normals = scene.normals[chosen]
    directions = np.asarray(to_world(jnp.asarray(local)[None], jnp.asarray(normals)[:, None]))
    origins = offset_origins(scene.positions[chosen], normals)
    occluded = tracer.occluded(np.repeat(origins, len(local), axis=0), directions.reshape(-1, 3))
    return ~occluded.reshape(count, size, size)
