"""Layouts by shape, and crosses cut into faces."""

import numpy as np
import pytest

from jaxvis.errors import InvalidEnvironment
from jaxvis.lighting.layouts import LAYOUTS, choose_layout, layout_of, unfold
from jaxvis.lighting.projections import FACES, Angular, Cube


@pytest.mark.parametrize(("height", "width", "layout"), [
    (512, 1024, "latlong"), (1024, 768, "vertical-cross"), (768, 1024, "horizontal-cross"),
    (900, 900, "angular"), (64, 384, "faces"), (384, 64, "faces"), (4, 3, "vertical-cross"),
    (512, 1023, None), (1024, 512, None), (10, 7, None),
])  # fmt: skip
def test_layouts_are_told_by_shape(height, width, layout):
    assert layout_of(height, width) == layout


def labelled_face(number):
    """3 x 3 texels that tell the face and the place in it."""
    return np.repeat((10.0 * number + np.arange(9.0)).reshape(3, 3, 1), 3, axis=2)


def cross(places, rows, columns):
    picture = np.full((rows * 3, columns * 3, 3), np.nan)
    for number, (row, column) in enumerate(places):
        picture[3 * row : 3 * row + 3, 3 * column : 3 * column + 3] = labelled_face(number)
    return picture


EXPECTED = np.concatenate([labelled_face(n).reshape(-1, 3) for n in range(6)])


def test_the_horizontal_cross_has_nz_to_the_right_of_px():
    picture = cross([(1, 2), (1, 0), (0, 1), (2, 1), (1, 1), (1, 3)], 3, 4)
    values, projection = unfold([picture], "horizontal-cross")
    assert projection == Cube(3)
    np.testing.assert_array_equal(values, EXPECTED)


def test_the_vertical_cross_has_nz_below_head_down():
    picture = cross([(1, 2), (1, 0), (0, 1), (2, 1), (1, 1), (3, 1)], 4, 3)
    picture[9:12, 3:6] = labelled_face(FACES.index("nz"))[::-1, ::-1]
    values, projection = unfold([picture], "vertical-cross")
    assert projection == Cube(3)
    np.testing.assert_array_equal(values, EXPECTED)


def test_strips_and_lists_hold_the_faces_in_order():
    faces = [labelled_face(n) for n in range(6)]
    for pictures in (faces, [np.concatenate(faces, axis=0)], [np.concatenate(faces, axis=1)]):
        values, projection = unfold(pictures, "faces")
        assert projection == Cube(3)
        np.testing.assert_array_equal(values, EXPECTED)


def test_an_angular_map_is_one_face():
    picture = np.arange(48.0).reshape(4, 4, 3)
    values, projection = unfold([picture], "angular")
    assert projection == Angular(4)
    np.testing.assert_array_equal(values, picture.reshape(-1, 3))


def test_a_layout_that_does_not_fit_is_refused_by_file_name():
    picture = np.zeros((8, 6, 3))
    assert choose_layout([picture], "vertical-cross", "a.hdr") == "vertical-cross"
    with pytest.raises(InvalidEnvironment, match=r"a\.hdr: 6 x 8 cannot be latlong .*vertical"):
        choose_layout([picture], "latlong", "a.hdr")
    with pytest.raises(InvalidEnvironment, match=r"a\.hdr: 7 x 8 has the shape of no layout"):
        choose_layout([np.zeros((8, 7, 3))], "auto", "a.hdr")
    with pytest.raises(ValueError, match="no layout 'mirror-ball': use auto, latlong"):
        choose_layout([picture], "mirror-ball", "a.hdr")
    assert set(LAYOUTS) == {"latlong", "vertical-cross", "horizontal-cross", "faces", "angular"}
