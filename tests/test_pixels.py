"""Pixels as stored, of files written byte by byte."""

import numpy as np
import pytest

from jaxvis.pixels import read_stored


@pytest.mark.parametrize("height", [1, 3, 300])  # OpenImageIO turns tall images over by itself
def test_rows_of_pfm_come_top_first(tmp_path, height):
    values = np.arange(2 * height, dtype="<f4").reshape(height, 2, 1)
    path = tmp_path / "grey.PFM"
    path.write_bytes(f"Pf\n2 {height}\n-1.0\n".encode() + values[::-1].tobytes())
    stored = read_stored(path)
    np.testing.assert_array_equal(stored.pixels, values)
    assert stored.picture == (2, height)
    assert stored.orientation == 1
    assert stored.channels == ("Y",)


def test_refusals_are_one_line_with_the_path(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"gone\.exr: no such file"):
        read_stored(tmp_path / "gone.exr")
    (tmp_path / "text.exr").write_text("hello")
    with pytest.raises(ValueError, match=r"text\.exr: cannot be read \(.+\)") as caught:
        read_stored(tmp_path / "text.exr")
    assert "\n" not in str(caught.value)
    (tmp_path / "cut.pfm").write_bytes(b"PF\n4 4\n-1.0\n" + bytes(50))
    with pytest.raises(ValueError, match=r"cut\.pfm: truncated or damaged"):
        read_stored(tmp_path / "cut.pfm")
