"""Coarse floors under balls and cards, where visibility at the vertices says too little."""

import numpy as np

from jaxvis.reflectance import Material
from jaxvis.scene import Scene, build_scene
from jaxvis.scene.builtin.shapes import sphere

HALF = 4.0
RADIUS, CENTRE = 0.6, np.array([1.4, 1.0, 0.5])
FLOOR = np.array([[-HALF, 0, -HALF], [-HALF, 0, HALF], [HALF, 0, HALF], [HALF, 0, -HALF]])
FLOOR_TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])


def ball_over_floor(rows: int = 12, two_sided: bool = False, below: bool = False) -> Scene:
    """Two triangles, and a ball over one of them, or below."""
    ball = sphere(RADIUS, rows)
    centre = CENTRE * [1, -1 if below else 1, 1]
    triangles = np.concatenate([FLOOR_TRIANGLES, len(FLOOR) + ball.triangles])
    return build_scene(
        np.concatenate([FLOOR, ball.positions + centre]),
        triangles,
        materials=(Material(two_sided=two_sided), Material()),
        material_ids=(np.arange(len(triangles)) >= 2).astype(int),
    )


def beside_a_ball(places):
    """Part of the sky's irradiance that places [n, 3] of the floor keep (world coordinates)."""
    offset = CENTRE - places
    distance = np.linalg.norm(offset, axis=-1)
    return 1.0 - (RADIUS / distance) ** 2 * (offset[:, 1] / distance)


def random_barycentrics(count, seed=0):
    return np.random.default_rng(seed).dirichlet([1, 1, 1], count).astype(np.float32)
