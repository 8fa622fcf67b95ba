"""Error maps and the plot."""

import numpy as np
import pytest

from jaxvis.compare import Comparison
from jaxvis.report import beside_errors, figures


def test_error_map_uses_one_fixed_logarithmic_scale():
    error = np.array([[0.0, 1.0 / 255.0, 255.0**-0.5, 1.0, 5.0]])
    colours = figures.error_map(error, np.array([[True, True, True, True, False]]))
    assert np.array_equal(colours[0, 0], colours[0, 1])
    assert np.array_equal(colours[0, 3, :3], colours[0, 4, :3])
    brightness = colours[0, 1:4, :3].sum(axis=-1)
    assert np.all(np.diff(brightness) > 0.5)
    assert colours[0, :, 3].tolist() == [1, 1, 1, 1, 0]
    assert figures.scale_position(255.0**-0.5) == pytest.approx(0.5)


def test_plot_shows_curves_and_leaves_out_what_has_no_psnr(comparison, nasty):
    figure = figures.psnr_over_time(comparison)
    lines = [line for line in figure.axes[0].lines if line.get_marker() not in ("None", None)]
    assert [line.get_xydata().tolist() for line in lines] == [[[0.005, 12.0], [0.02, 18.0]]]
    assert figure.axes[0].get_xscale() == "log"
    names = [text.get_text() for text in figure.axes[0].texts]
    assert names == [nasty]


def test_plot_without_any_point_says_so(comparison):
    empty = Comparison(
        {**comparison, "results": comparison["results"][:1]},
        comparison.images,
        comparison.coverage,
        comparison.background,
    )
    figure = figures.psnr_over_time(empty)
    assert "no method has a finite PSNR" in figure.axes[0].texts[0].get_text()


def test_names_at_the_edge_do_not_overlap(comparison):
    row = comparison["results"][1]
    rows = [
        {**row, "label": f"m{i}", "curve": [{"frame_s": 0.1, "psnr_db": 30 + 1e-3 * i}]}
        for i in range(12)
    ]
    crowded = Comparison(
        {**comparison, "results": rows}, {}, comparison.coverage, comparison.background
    )
    texts = figures.psnr_over_time(crowded).axes[0].texts
    heights = sorted(text.get_position()[1] for text in texts)
    assert len(heights) == 12
    assert np.diff(heights).min() > 0.05
    assert heights[-1] <= 1.0 + 1e-9


def test_images_stand_beside_their_errors():
    reference = np.ones((4, 6, 3), np.float32)
    covered = np.ones((4, 6), bool)
    covered[0, 0] = False
    images = {"the same": reference, "darker": 0.5 * reference}
    figure = beside_errors(images, reference, covered, brightness=0.25)
    above, below = figure.axes[:3], figure.axes[3:6]
    titles = [axis.get_title() for axis in above]
    assert titles[0] == "reference"
    assert titles[1] == "the same\ninf dB"
    # One exposure shows the reference as 1 and the other as sRGB's 0.5.
    assert titles[2] == f"darker\n{-20.0 * np.log10(1.0 - 0.7353569):.1f} dB"
    shown = above[0].images[0].get_array()
    np.testing.assert_allclose(shown[0, 0], 1.0)  # outside it is white
    np.testing.assert_allclose(shown[2, 2], 0.5370987, atol=1e-6)  # sRGB of a quarter
    assert not below[0].images
    same, darker = (axis.images[0].get_array() for axis in below[1:])
    assert same[0, 0, 3] == 0.0
    assert (darker[2, 2, :3] > same[2, 2, :3]).all()
