"""Visibility maps as spherical harmonics, by which samples are compared (paper 002, eq. 7)."""

import functools

import numpy as np
from jaxtyping import Bool, Float, Float32

from jaxvis.sphere import harmonics
from jaxvis.sphere.hemisphere_grid import texel_directions, texel_solid_angles

BANDS = 4
"""16 coefficients, as in the paper."""

COARSE = 32
"""Texels along each side of the maps that are projected; finer ones are averaged."""

FEWEST = 0.05
"""Errors are relative to the coefficients, of which a map counts as having this share at least."""


def map_coefficients(
    maps: Bool[np.ndarray, "samples n n"], frames: Float[np.ndarray, "samples 3 3"]
) -> Float32[np.ndarray, "samples 16"]:
    """Coefficients of the maps as functions of world directions, 0 below the horizon."""
    return _to_world(_local(maps), frames)


def _local(maps: Bool[np.ndarray, "samples n n"]) -> Float32[np.ndarray, "samples 16"]:
    count, size = maps.shape[0], maps.shape[-1]
    ratio = max(size // COARSE, 1)
    if size % ratio:
        ratio = 1
    side = size // ratio
    # Bytes add up eight at a time; a row of at most 8 x 255 texels fits into 16 bits.
    rows = np.add.reduce(maps.reshape(count, size, side, ratio).view(np.uint8), axis=-1)
    share = np.add.reduce(rows.reshape(count, side, ratio, side), axis=2, dtype=np.uint16)
    flat = share.reshape(count, side * side).astype(np.float32)
    return flat @ (_table(side) / ratio**2)


@functools.lru_cache(maxsize=8)
def _table(side: int) -> Float32[np.ndarray, "texels 16"]:
    """The basis at the texels' centres times their solid angles, in the local frame."""
    x, y, z = np.moveaxis(texel_directions(side).astype(np.float64), -1, 0)
    basis = np.stack(harmonics.basis(x, y, z, BANDS), axis=-1)
    return (
        (basis * texel_solid_angles(side)[:, None, None]).reshape(-1, BANDS**2).astype(np.float32)
    )


def _to_world(
    local: Float32[np.ndarray, "samples 16"], frames: Float[np.ndarray, "samples 3 3"]
) -> Float32[np.ndarray, "samples 16"]:
    """Turns coefficients: projects the local function's values in a few directions, turned.

    In NumPy: the number of samples changes from frame to frame, and JAX would compile for each.
    """
    directions, measure = _few()
    values = local @ _basis(directions).T
    turned = _basis(np.einsum("ka,sac->skc", directions, frames))
    return np.einsum("skb,sk->sb", turned, values * measure).astype(np.float32)


def _basis(directions: Float[np.ndarray, "*points 3"]) -> Float[np.ndarray, "*points 16"]:
    x, y, z = np.moveaxis(directions, -1, 0)
    return np.stack(harmonics.basis(x, y, z, BANDS), axis=-1)


@functools.lru_cache(maxsize=1)
def _few() -> tuple[Float32[np.ndarray, "directions 3"], Float32[np.ndarray, "directions"]]:
    """Directions and weights whose sums are integrals, exact for products of two of the basis."""
    heights, weights = np.polynomial.legendre.leggauss(BANDS)
    around = 2 * BANDS
    phi = 2.0 * np.pi * np.arange(around) / around
    ring = np.sqrt(1.0 - heights**2)[:, None]
    directions = np.stack(
        [
            ring * np.cos(phi),
            ring * np.sin(phi),
            np.broadcast_to(heights[:, None], (BANDS, around)),
        ],
        axis=-1,
    )
    spread = np.repeat(weights, around) * 2.0 * np.pi / around
    return directions.reshape(-1, 3).astype(np.float32), spread.astype(np.float32)


def visibility_error(
    a: Float[np.ndarray, "*#samples 16"], b: Float[np.ndarray, "*#samples 16"]
) -> Float[np.ndarray, "*samples"]:
    """e_v: sum of the coefficients' absolute differences (eq. 7)."""
    return np.abs(a - b).sum(axis=-1)


def magnitude(coefficients: Float[np.ndarray, "samples 16"]) -> Float[np.ndarray, "samples"]:
    """What errors are relative to: the sum of absolute coefficients.

    The paper divides by e_v(x, x), which is 0. Maps that are (nearly) all occluded count as having
    a twentieth of an open map's.
    """
    return np.maximum(np.abs(coefficients).sum(axis=-1), FEWEST * _open())


@functools.lru_cache(maxsize=1)
def _open() -> float:
    return float(np.abs(_local(np.ones((1, COARSE, COARSE), bool))).sum())
