"""Maps that are hard to sample, and bins finer than their texels."""

from itertools import pairwise

import numpy as np

from jaxvis.sphere import latlong


def _dim(height, *texels):
    values = np.full((height, 2 * height), 0.05)
    for row, column in texels:
        values[row, column] = 60.0
    return values


def _only(height, *texels):
    return np.where(_dim(height, *texels) > 1.0, 1.0, 0.0)


MAPS = {
    "random": np.random.default_rng(0).random((6, 12)) ** 4,
    "odd height": np.random.default_rng(1).random((5, 10)),
    "poles": _dim(6, (0, 3), (5, 7)),
    "seam": _dim(6, (2, 0), (3, 11)),
    "only the north pole's row": _only(64, *((0, c) for c in range(128))),
    "only one texel at the south pole": _only(64, (63, 127)),
    "black rows": np.where(np.arange(6) % 2, 1.0, 0.0)[:, None] * np.ones(12),
    "one texel": np.ones((1, 2)),
    "black": np.zeros((6, 12)),
}


def fine_counts(directions, height, width, pieces):
    """Counts over bins of equal solid angle, ``pieces`` x ``pieces`` to a texel (float64).

    Heights are measured from the nearer pole, where float32 directions resolve them.
    """
    x, y, z = np.asarray(directions, np.float64).reshape(-1, 3).T
    level = x * x + z * z
    from_pole = level / (2.0 * (1.0 + np.abs(y)))  # sin^2 of half the angle
    edges = np.cos(np.pi * np.arange(height + 1) / height)
    edges = np.concatenate([np.linspace(a, b, pieces + 1)[:-1] for a, b in pairwise(edges)])
    theta = np.arccos(np.append(edges, -1.0))
    north, south = np.sin(theta / 2) ** 2, np.cos(theta / 2) ** 2
    row = np.where(
        y > 0.0,
        np.searchsorted(north, from_pole, side="right") - 1,
        len(south) - 1 - np.searchsorted(south[::-1], from_pole, side="left"),
    )
    u = np.mod(np.arctan2(x, -z) / (2 * np.pi), 1.0)
    column = np.minimum((u * width * pieces).astype(int), width * pieces - 1)
    counts = np.zeros((height * pieces, width * pieces))
    np.add.at(counts, (np.clip(row, 0, height * pieces - 1), column), 1)
    return counts


def fine_probabilities(values, pieces):
    """The probability of each of those bins."""
    values = values if values.any() else np.ones_like(values)
    weights = values * latlong.row_solid_angles(*values.shape)[:, None]
    return np.kron(weights / weights.sum(), np.full((pieces, pieces), 1.0 / pieces**2))
