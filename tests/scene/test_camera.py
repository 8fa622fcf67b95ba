"""The pinhole camera: which way is up, right, and through which pixel."""

import numpy as np
import pytest

from jaxvis.scene import Camera


def test_axes_are_right_up_forward():
    camera = Camera((0, 0, 5), (0, 0, 0))
    np.testing.assert_allclose(camera.axes(), [[1, 0, 0], [0, 1, 0], [0, 0, -1]], atol=1e-15)


def test_row_0_is_the_top_and_column_0_the_left():
    directions = Camera((0, 0, 5), (0, 0, 0)).directions(4, 2)
    assert directions.shape == (2, 4, 3)
    assert np.all(directions[0, :, 1] > 0.0)
    assert np.all(directions[1, :, 1] < 0.0)
    assert np.all(np.diff(directions[..., 0], axis=1) > 0.0)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0)


def test_the_field_of_view_is_vertical():
    directions = Camera((0, 0, 0), (0, 0, -1), field_of_view=np.pi / 2).directions(3, 1000)
    middle = directions[:, 1]
    slope = middle[:, 1] / -middle[:, 2]
    np.testing.assert_allclose(slope[[0, -1]], [0.999, -0.999])
    sideways = directions[500, :, 0] / -directions[500, :, 2]
    np.testing.assert_allclose(np.diff(sideways), 2.0 / 1000)


def test_some_rows_are_those_of_all():
    camera = Camera((1, 2, 3), (0, 0.5, 0))
    np.testing.assert_array_equal(
        camera.directions(5, 7, slice(2, 4)), camera.directions(5, 7)[2:4]
    )


def test_arrays_become_tuples_of_floats():
    camera = Camera(np.array([1, 2, 3]), [0, 0, 0], field_of_view=1)
    assert camera.eye == (1.0, 2.0, 3.0)
    assert hash(camera) == hash(Camera((1.0, 2.0, 3.0), (0.0, 0.0, 0.0), field_of_view=1.0))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"eye": (0, np.nan, 0)}, "camera eye must be three finite numbers"),
        ({"target": (0, 0)}, "camera target must be three finite numbers"),
        ({"target": (0, 0, 5)}, "eye and target coincide"),
        ({"up": (0, 0, 2)}, "parallel to up"),
        ({"field_of_view": 0.0}, "field_of_view must be in"),
        ({"field_of_view": np.pi}, "field_of_view must be in"),
    ],
)
def test_bad_cameras_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        Camera(**{"eye": (0, 0, 5), "target": (0, 0, 0), **changes})
