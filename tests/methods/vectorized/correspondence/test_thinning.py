"""Which triples go first: those on great circles, then those that change least."""

import numpy as np

from jaxvis.methods.vectorized.correspondence.candidates import Layout
from jaxvis.methods.vectorized.correspondence.thinning import thin_faces


def square(between: int) -> np.ndarray:
    """Directions along the sides of a square cap, [4 (between + 1), 3]: its corners and others."""
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]], float) * 0.3
    place = np.arange(4 * (between + 1)) / (between + 1)
    side = place.astype(int)
    along = (place - side)[:, None]
    flat = (1 - along) * corners[side] + along * corners[(side + 1) % 4]
    return np.column_stack([flat, np.ones(len(flat))])


def thinned(outlines: list[np.ndarray], most: int) -> np.ndarray:
    count = len(outlines[0])
    directions = np.stack(outlines)[None].astype(np.float32)
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    layout = Layout(
        directions,
        np.zeros_like(directions),
        np.full((1, 3), count, np.int32),
        np.ones(1, np.float32),
    )
    triples = np.repeat(np.arange(count)[:, None], 3, axis=1)[None].astype(np.int16)
    kept = np.zeros((1, count), bool)
    thin_faces(np.arange(1), layout, triples, np.array([count], np.int32), most, kept)
    return np.flatnonzero(kept[0])


def test_corners_are_left():
    assert thinned([square(4)] * 3, 4).tolist() == [0, 5, 10, 15]


def test_a_bend_of_one_polygon_is_enough_to_stay():
    """Entity 7 lies off the side for the third corner alone."""
    bent = square(4)
    bent[7, :2] *= 1.2
    assert thinned([square(4), square(4), bent], 5).tolist() == [0, 5, 7, 10, 15]


def test_short_lists_stay_whole():
    assert len(thinned([square(4)] * 3, 20)) == 20
    assert len(thinned([square(4)] * 3, 50)) == 20
