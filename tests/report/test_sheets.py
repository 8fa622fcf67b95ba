"""Titles over pictures."""

import numpy as np
import pytest

from jaxvis.report.sheets import CELL, LETTERS, Tile, folded, sheet_of

LONG = "visibility-field:lighting=environment,samples=300000"


@pytest.mark.parametrize(
    ("title", "lines"),
    [
        ("mc-mis\n25.8 dB, 169 ms", ["mc-mis", "25.8 dB, 169 ms"]),
        (LONG, ["visibility-field:lighting=environment,", "samples=300000"]),
        (f"{LONG}\n1 dB", ["visibility-field:lighting=environment,", "samples=300000", "1 dB"]),
        ("x" * (LETTERS + 9), ["x" * (LETTERS + 9)]),
        (
            "a picture under " * 4,
            ["a picture under a picture under a picture", "under a picture under"],
        ),
        ("", [""]),
    ],
)
def test_long_titles_are_folded(title, lines):
    assert folded(title).split("\n") == lines


def test_titles_stay_within_their_pictures():
    tiles = [Tile(f"{LONG}\n25.78 dB, 302 ms", np.zeros((60, 80, 3)), np.zeros((60, 80, 4)))] * 4
    figure = sheet_of(tiles, 4)
    figure.draw_without_rendering()
    for axis in figure.axes[:4]:
        box = axis.title.get_window_extent()
        assert box.width <= 1.02 * CELL * figure.dpi
        assert box.y1 <= figure.bbox.y1
