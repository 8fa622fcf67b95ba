"""The test itself accepts what is right and refuses what is not."""

import numpy as np

from .chi_square import SIGNIFICANCE, p_value, zone_counts, zone_probabilities


def test_p_values_of_right_counts_are_uniform():
    rng = np.random.default_rng(0)
    probabilities = rng.random(40)
    probabilities /= probabilities.sum()
    values = [
        p_value(rng.multinomial(5000, probabilities), 5000 * probabilities) for _ in range(400)
    ]
    assert abs(np.mean(values) - 0.5) < 0.06
    assert 0.05 < np.mean(np.array(values) < 0.1) < 0.16


def test_wrong_counts_are_refused():
    probabilities = np.full(20, 0.05)
    counts = 100_000 * probabilities
    tilted = counts * (1.0 + 0.05 * np.linspace(-1.0, 1.0, 20))
    assert p_value(tilted, counts) < SIGNIFICANCE
    impossible = np.array([0.0, 1.0, 0.0, 50.0]), np.array([0.0, 0.0, 1.0, 50.0])
    assert p_value(*impossible) == 0.0


def test_bins_of_the_sphere_hold_their_solid_angle():
    edges = np.array([-1.0, -0.3, 0.2, 1.0])
    areas = zone_probabilities(lambda d: np.ones(d.shape[:-1]), edges, 5)
    np.testing.assert_allclose(areas, np.diff(edges)[:, None] * 2.0 * np.pi / 5 * np.ones(5))
    counts = zone_counts([[0.6, 0.1, 0.79], [-0.6, -0.1, -0.79]], edges, 4)
    assert counts[2, 0] == 1
    assert counts[0, 2] == 1
    assert counts.sum() == 2
