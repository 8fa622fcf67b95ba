"""Height fields from .npz files."""

import numpy as np
import pytest

from jaxvis.errors import InvalidScene
from jaxvis.scene import load_scene


def save(path, **arrays):
    np.savez(path, **arrays)
    return path


def test_rows_run_south_columns_east_and_heights_up(tmp_path):
    heights = np.array([[0, 0, 0], [0, 7, 0], [0, 0, 0], [0, 0, 3]], np.int16)
    scene = load_scene(save(tmp_path / "hill.npz", z=heights, dx=30.0))
    points = scene.positions + scene.origin
    assert len(scene.positions) == 12
    assert len(scene.triangles) == 12
    np.testing.assert_allclose(scene.bounds, [[0, 0, 0], [60, 7, 90]], atol=1e-5)
    np.testing.assert_allclose(points[points[:, 1].argmax()], [30, 7, 30], atol=1e-5)
    np.testing.assert_allclose(points[np.abs(points[:, 1] - 3).argmin()], [60, 3, 90], atol=1e-5)
    assert scene.geometric_normals[:, 1].min() > 0.5
    assert scene.name == "hill"


def test_normals_are_those_of_the_slope(tmp_path):
    row, column = np.mgrid[0:5, 0:6]
    scene = load_scene(save(tmp_path / "slope.npz", z=2.0 * column - row, dx=2.0))
    expected = np.array([-1.0, 1.0, 0.5]) / 1.5
    np.testing.assert_allclose(scene.normals, np.broadcast_to(expected, (30, 3)), atol=1e-6)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"height": np.zeros((3, 3)), "dx": 1.0}, "needs the arrays z and dx"),
        ({"z": np.zeros(9), "dx": 1.0}, r"z must be \[rows, columns\], got \[9\]"),
        ({"z": np.zeros((1, 9)), "dx": 1.0}, r"z must be \[rows, columns\]"),
        ({"z": np.zeros((3, 3)), "dx": 0.0}, "dx must be a positive length"),
        ({"z": np.full((3, 3), np.nan), "dx": 1.0}, "9 of 9 vertices are NaN"),
        ({"z": np.array([["a"] * 3] * 3), "dx": 1.0}, "damaged or not"),
    ],
)
def test_bad_height_fields(tmp_path, arrays, message):
    path = save(tmp_path / "bad.npz", **arrays)
    with pytest.raises(InvalidScene, match=message) as caught:
        load_scene(path)
    assert str(caught.value).startswith(f"{path}: ")


def test_damaged_file(tmp_path):
    path = save(tmp_path / "cut.npz", z=np.zeros((9, 9)), dx=1.0)
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(InvalidScene, match="damaged or not a NumPy"):
        load_scene(path)
