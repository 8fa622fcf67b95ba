"""A correspondence made by hand, whose outlines have closed forms."""

import jax.numpy as jnp
import numpy as np

from jaxvis.methods.vectorized import VisibilityPolygons
from tests.methods.vectorized.correspondence.staircases import joined

SIDES = 8
ANGLE = np.radians(60.0)
"""Every corner sees the inside of this regular polygon on a cone about +Z, at infinity."""


def two_triangles(*, shift: int = 0, fold: float = 0.0, separate: bool = False):
    """Triangles (0, 1, 2) and (1, 0, 3), front up, that share the edge from 0 to 1.

    Args:
        shift: entities by which corner 1 is ahead of the others in the second triangle's list.
        fold: z of corner 3.
        separate: whether the second triangle has no triples.
    """
    turn = 2.0 * np.pi * np.arange(SIDES) / SIDES
    ring = np.stack([np.sin(ANGLE) * np.cos(turn), np.sin(ANGLE) * np.sin(turn)])
    ring = np.stack([*ring, np.full(SIDES, np.cos(ANGLE)), np.zeros(SIDES)])
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, -1, fold]], np.float32)
    polygons = VisibilityPolygons(
        vectors=jnp.asarray(np.tile(ring, (4, 1, 1)), jnp.float32),
        counts=jnp.full(4, SIDES, jnp.int32),
        positions=jnp.asarray(positions),
        normals=jnp.tile(jnp.array([0.0, 0.0, 1.0]), (4, 1)),
        triangles=jnp.array([[0, 1, 2], [1, 0, 3]], jnp.int32),
        backs=jnp.zeros((0, 3), jnp.int32),
        buried=jnp.zeros(4, bool),
    )
    own = np.repeat(np.arange(SIDES)[:, None], 3, axis=1)
    other = (own + [shift, 0, 0]) % SIDES
    lists = [own, own[:0] if separate else other]
    return joined(polygons, lists, separate=np.array([False, separate]))
