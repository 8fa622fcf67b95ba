"""Smooth random functions of space, for textures and folds (host)."""

import numpy as np
from jaxtyping import Float

_PERIOD = 32


def smoothstep(
    low: float, high: float, x: Float[np.ndarray, "*points"]
) -> Float[np.ndarray, "*points"]:
    """0 below ``low``, 1 above ``high``, with continuous slope between; falls if high < low."""
    t = np.clip((x - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def noise(
    points: Float[np.ndarray, "*points 3"], octaves: int = 1, seed: int = 0
) -> Float[np.ndarray, "*points"]:
    """Value noise in [0, 1], mean 1/2: random numbers at the integer lattice, smooth between.

    Each further octave has twice the frequency and half the weight (Perlin 1985, "An Image
    Synthesizer", with values for gradients). Repeats with period 32.
    """
    table = np.random.default_rng(seed).uniform(size=(_PERIOD,) * 3).astype(np.float32)
    total, weight = np.zeros(points.shape[:-1]), 0.0
    for octave in range(octaves):
        amount = 0.5**octave
        # A shift per octave, so that lattices do not share their points.
        total += amount * _lattice(points * 2.0**octave + 5.3 * octave, table)
        weight += amount
    return total / weight


def _lattice(
    points: Float[np.ndarray, "*points 3"], table: Float[np.ndarray, "n n n"]
) -> Float[np.ndarray, "*points"]:
    cell = np.floor(points)
    part = (points - cell).astype(np.float32)
    part = part * part * part * (part * (6.0 * part - 15.0) + 10.0)
    low = cell.astype(np.int32) % _PERIOD
    high = (low + 1) % _PERIOD
    value = np.zeros(points.shape[:-1], np.float32)
    for corner in range(8):
        side = [(corner >> axis) & 1 for axis in range(3)]
        at = [(high if s else low)[..., axis] for axis, s in enumerate(side)]
        share = [part[..., k] if s else 1.0 - part[..., k] for k, s in enumerate(side)]
        value += share[0] * share[1] * share[2] * table[tuple(at)]
    return value
