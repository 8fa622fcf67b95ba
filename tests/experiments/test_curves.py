"""Quality over time, with values worked out by hand."""

import math

import pytest

from experiments.curves import Curve, Found, Frame, front, margin, speedup

# Monte Carlo as it should be: four times the time gives 6 dB.
MC = Curve("mc", tuple(Frame(f"{n} spp", 0.01 * n, 6 * k) for k, n in enumerate((1, 4, 16, 64))))


def test_decibels_are_linear_over_the_logarithm_of_time():
    assert MC.decibels_at(0.04).value == pytest.approx(6.0)
    assert MC.decibels_at(0.08).value == pytest.approx(9.0)
    assert MC.seconds_at(9.0).value == pytest.approx(0.08)
    assert MC.decibels_at(0.08).bound == ""


@pytest.mark.parametrize("seconds", [0.011, 0.03, 0.2, 0.6])
def test_the_two_ways_are_inverse(seconds):
    assert MC.seconds_at(MC.decibels_at(seconds).value).value == pytest.approx(seconds)


def test_beyond_what_was_measured_the_nearest_frame_stands_and_says_so():
    assert MC.decibels_at(0.001) == Found(0.0, "slower")
    assert MC.decibels_at(10.0) == Found(18.0, "more")
    assert MC.seconds_at(-3.0) == Found(0.01, "slower")
    assert MC.seconds_at(30.0) == Found(0.64, "more")


def test_a_frame_that_is_dearer_and_no_better_does_not_count():
    odd = Curve("odd", (Frame("a", 1.0, 30.0), Frame("b", 2.0, 28.0), Frame("c", 4.0, 36.0)))
    assert [frame.setting for frame in odd.front] == ["a", "c"]
    assert odd.decibels_at(2.0).value == pytest.approx(33.0)
    assert odd.seconds_at(30.0) == Found(1.0)
    # Never reached: the longest frame stands, though another has more decibels.
    worse = Curve("worse", (Frame("a", 1.0, 30.0), Frame("b", 2.0, 28.0)))
    assert worse.seconds_at(31.0) == Found(2.0, "more")


def test_equal_frames_count_once():
    assert front([Frame("a", 1.0, 30.0), Frame("b", 1.0, 31.0), Frame("c", 1.0, 31.0)]) == (
        Frame("b", 1.0, 31.0),
    )


def test_margin_and_speedup():
    ours = Frame("zeta 2", 0.08, 15.0)
    assert margin(ours, MC).value == pytest.approx(6.0)
    assert speedup(ours, MC).value == pytest.approx(4.0)
    best = Frame("zeta 4", 0.08, 40.0)
    assert speedup(best, MC) == Found(8.0, "more")
    quick = Frame("vertex", 0.001, 20.0)
    assert margin(quick, MC) == Found(20.0, "slower")
    assert math.isclose(speedup(quick, MC).value, 640.0)  # 18 dB are the most: at least so long
