"""Counts and bytes of the table of correspondence, and crops of the pictures."""

import numpy as np
import pytest

import jaxvis
from experiments.correspondence_table import sizes
from experiments.crops import smooth_parts, strongest_boundaries
from tests.methods.corresponding_polygons import SIDES, two_triangles


@pytest.mark.parametrize("separate", [False, True])
def test_sizes_count_triples_as_the_paper_does(separate):
    scene = jaxvis.load_scene("plane:cells=2")
    found = two_triangles(separate=separate)
    cost, count = sizes(scene, found, {"polygons": 1.0, "triples": 0.5})
    faces = 2 - separate
    assert cost["triangles"] == 2
    assert cost["triples MB (24 B each)"] == pytest.approx(24e-6 * SIDES * faces)
    assert cost["ms/triangle"] == pytest.approx(250.0)
    assert count["triples/triangle"] == count["evaluated"] == count["vectors/polygon"] == SIDES
    assert count["3 vectors / evaluated"] == pytest.approx(3.0)
    assert count["% of faces"] == 50.0 * separate


def test_crops_are_at_the_strongest_edges_inside():
    shown = np.full((60, 80, 3), 0.2, np.float32)
    shown[20:, :] += 0.1  # a weak edge all along a row
    shown[:, 50:] += 0.5  # a strong one along a column
    inside = np.zeros((60, 80), bool)
    inside[5:55, 5:75] = True
    crops = strongest_boundaries(shown, inside, 10, 2)
    for row, column in crops:
        assert column < 50 < column + 10
        assert 0 <= row <= 50
    assert abs(crops[0][0] - crops[1][0]) >= 10


def test_smooth_parts_leave_out_where_a_sphere_hides_the_plane():
    scene = jaxvis.load_scene("sphere-on-plane:clearance=1,rows=12,cells=4")
    surface = jaxvis.trace_surface(scene, jaxvis.default_camera(scene), (64, 48))
    smooth = smooth_parts(surface)
    on_sphere = np.asarray(surface.normal).reshape(48, 64, 3)[..., 1] < 0.9
    rim = (on_sphere[:, 1:] != on_sphere[:, :-1]) & np.asarray(surface.mask)[:, 1:]
    assert rim.sum() > 10
    assert not smooth[:, 1:][rim].any()
    assert smooth.sum() > 200
