"""Pearson's chi-squared test of samplers, and the bins it needs."""

import numpy as np
from scipy.stats import chi2

SIGNIFICANCE = 1e-5
"""Of one test: a hundred of them raise a false alarm once in a thousand choices of seeds."""


def p_value(observed, expected, fewest=8.0):
    """Probability of counts at least as far from ``expected`` by chance.

    Bins that expect fewer than ``fewest`` are pooled; counts where nothing is expected give 0.
    """
    observed, expected = np.ravel(observed).astype(float), np.ravel(expected).astype(float)
    assert abs(observed.sum() - expected.sum()) < 1e-3 * expected.sum()
    if np.any(observed[expected == 0.0] > 0.0):
        return 0.0
    order = np.argsort(expected)
    observed, expected = observed[order], expected[order]
    small = np.searchsorted(expected, fewest)
    if small:
        observed = np.append(observed[small:], observed[:small].sum())
        expected = np.append(expected[small:], expected[:small].sum())
    used = expected > 0.0
    if np.count_nonzero(used) == 1:
        return 1.0
    statistic = np.sum((observed[used] - expected[used]) ** 2 / expected[used])
    return float(chi2.sf(statistic, np.count_nonzero(used) - 1))


def zone_counts(directions, cosine_edges, slices):
    """Counts over zones of z (edges ascending) and equal slices of phi about +z."""
    d = np.asarray(directions, np.float64).reshape(-1, 3)
    phi = np.mod(np.arctan2(d[:, 1], d[:, 0]) / (2.0 * np.pi), 1.0)
    return np.histogram2d(d[:, 2], phi, bins=[cosine_edges, np.linspace(0.0, 1.0, slices + 1)])[0]


def zone_probabilities(pdf, cosine_edges, slices):
    """The integral of ``pdf(directions [..., 3])`` over the same bins, by quadrature.

    Nodes crowd towards each zone's upper edge, where lobes about +z are steepest.
    """
    nodes, weights = _unit_interval(32)
    low, high = cosine_edges[:-1, None], cosine_edges[1:, None]
    z = (high - (high - low) * nodes**4)[:, :, None, None]
    measure = (high - low) * weights * 4.0 * nodes**3
    nodes, weights = _unit_interval(6)
    phi = 2.0 * np.pi * (np.arange(slices)[:, None] + nodes) / slices
    r = np.sqrt(1.0 - z * z)
    directions = np.stack([r * np.cos(phi), r * np.sin(phi), z + 0.0 * phi], axis=-1)
    values = np.asarray(pdf(directions.astype(np.float32)), np.float64)
    return np.einsum("zisj,zi,j->zs", values, measure, weights * 2.0 * np.pi / slices)


def _unit_interval(order):
    nodes, weights = np.polynomial.legendre.leggauss(order)
    return 0.5 * (nodes + 1.0), 0.5 * weights
