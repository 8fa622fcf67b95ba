"""Equal rows and shared edges."""

import numpy as np
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from jaxvis.scene.weld import edge_sides, equal_rows


@settings(max_examples=30, deadline=None, derandomize=True)
@given(arrays(np.int64, st.tuples(st.integers(1, 40), st.just(3)), elements=st.integers(-2, 2)))
def test_equal_rows_against_a_dictionary(table):
    first, ids = equal_rows(*table.T)
    numbers: dict = {}
    expected = [numbers.setdefault(tuple(row), len(numbers)) for row in table.tolist()]
    np.testing.assert_array_equal(ids, expected)
    np.testing.assert_array_equal(table[first][ids], table)


def test_zeros_of_both_signs_are_equal():
    first, ids = equal_rows(np.array([0.0, -0.0, 1.0]), np.array([-0.0, 0.0, 0.0]))
    np.testing.assert_array_equal(ids, [0, 0, 1])
    np.testing.assert_array_equal(first, [0, 2])


def test_edges_of_a_closed_mesh_have_two_sides():
    box = trimesh.creation.box()
    sides = edge_sides(np.asarray(box.faces))
    np.testing.assert_array_equal(sides.count, np.full(18, 2))
    faces = np.asarray(box.faces).reshape(-1)
    following = np.where(sides.side % 3 == 2, sides.side - 2, sides.side + 1)
    ends = np.sort(np.stack([faces[sides.side], faces[following]], axis=-1), axis=-1)
    np.testing.assert_array_equal(ends[::2], ends[1::2])


def test_border_and_crowded_edges_are_counted():
    fan = np.array([[0, 1, 2], [0, 1, 3], [1, 0, 4]])
    assert sorted(edge_sides(fan).count) == [1] * 6 + [3]
