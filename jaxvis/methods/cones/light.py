"""An environment as cones see it: small bright sources apart, the rest averaged over cones."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float64

from jaxvis.lighting import Environment
from jaxvis.lighting.blur import phong_blur
from jaxvis.lighting.partition import partition
from jaxvis.sphere import latlong

EXPONENT = 6.0
"""Of the Phong lobe over which the sky is averaged: six of them, weighted as cones are, add up to
the cosine to 26 % (root mean square over the hemisphere; 5 is the least), and to pi exactly."""

ROWS = 32
"""Of the averaged sky."""

SUN_CELLS = 512
"""Cells among which suns are looked for."""

SUN_SIZE = 4e-3
"""Largest solid angle of a sun's cell (steradians): four degrees across."""

SUN_APART = 0.05
"""Radians within which small cells are parts of one sun."""

PART_SHARE = 1e-3
"""Least share of all flux that makes a small cell a part of a sun."""

SUN_SHARE = 0.05
"""Least share of all flux that makes a small source a sun."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Sky:
    """An environment averaged over cones, its halves above and below the horizon apart: a height
    field hides a cone's lower part first, and with it the light from below."""

    upper: Float[Array, "rows columns 3"]
    """Averages over a cone about each direction of radiance from above, and black below."""
    lower: Float[Array, "rows columns 3"]
    """The other way round."""
    from_above: Float[Array, "rows columns 3"]
    """Irradiance over the normal of a free surface, from above the horizon."""
    from_below: Float[Array, "rows columns 3"]
    """The same from below."""

    @staticmethod
    def of(radiance: Float[Array, "height width 3"]) -> "Sky":
        height = radiance.shape[0]
        under = jnp.arange(height)[:, None, None] >= height // 2
        above, under = jnp.where(under, 0.0, radiance), jnp.where(under, radiance, 0.0)
        upper, lower = (phong_blur(part, EXPONENT, ROWS) for part in (above, under))
        from_above, from_below = (np.pi * phong_blur(part, 1.0, ROWS) for part in (above, under))
        return Sky(upper, lower, from_above, from_below)

    def over(
        self, axis: Float[Array, "points 3"]
    ) -> tuple[Float[Array, "points 3"], Float[Array, "points 3"]]:
        """Radiance from above and from below the horizon in the cones about these axes."""
        return latlong.bilinear(self.upper, axis), latlong.bilinear(self.lower, axis)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ConeLight:
    """Directional lights and a smooth sky. Flux is radiance x solid angle."""

    sky: Sky
    """Without the suns."""
    sun_directions: Float[Array, "suns 3"]
    sun_flux: Float[Array, "suns 3"]
    directions: Float[Array, "directions 3"]
    """For the light that surfaces send on: the sky as some directional lights."""
    flux: Float[Array, "directions 3"]


def cone_light(environment: Environment, suns: int, directions: int) -> ConeLight:
    """Splits an environment (host).

    Args:
        environment: one light.
        suns: the most sources that are taken apart, brightest first.
        directions: lights that stand for the rest of the sky.
    """
    radiance = np.asarray(environment.radiance, np.float64)
    solid = latlong.row_solid_angles(*radiance.shape[:2])[:, None]
    found, kept = _suns(radiance, solid, suns)
    along, flux = _cells(kept, solid, directions)
    sky = Sky.of(jnp.asarray(kept, jnp.float32))
    single = jnp.float32
    return ConeLight(
        sky,
        jnp.asarray(found[:, :3], single).reshape(-1, 3),
        jnp.asarray(found[:, 3:], single).reshape(-1, 3),
        jnp.asarray(along, single),
        jnp.asarray(flux, single),
    )


def _suns(
    radiance: Float64[np.ndarray, "height width 3"],
    solid: Float64[np.ndarray, "height 1"],
    count: int,
) -> tuple[Float64[np.ndarray, "suns 6"], Float64[np.ndarray, "height width 3"]]:
    """(direction and flux of each, the map without them)."""
    kept = radiance.copy()
    energy = radiance.mean(axis=-1) * solid
    whole = energy.sum()
    if not count or not whole > 0.0:
        return np.zeros((0, 6)), kept
    small = []
    for cell in partition(energy, SUN_CELLS).tolist():
        top, bottom, left, right = cell
        size = float(solid[top:bottom].sum()) * (right - left)
        if size <= SUN_SIZE:
            small.append((float(energy[top:bottom, left:right].sum()), cell))
    suns: list[tuple[np.ndarray, np.ndarray, list[list[int]]]] = []
    for share, cell in sorted(small, reverse=True):
        if share < PART_SHARE * whole:
            break
        along, flux = _summed(radiance, solid, *cell)
        for k, (other, sent, cells) in enumerate(suns):
            # A disc that a cell's edge divides is one sun.
            if float(other @ along) > np.cos(SUN_APART):
                mean = other * sent.mean() + along * flux.mean()
                suns[k] = mean / np.linalg.norm(mean), sent + flux, [*cells, cell]
                break
        else:
            if share >= SUN_SHARE * whole and len(suns) < count:
                suns.append((along, flux, [cell]))
    for _, _, cells in suns:
        for top, bottom, left, right in cells:
            # What is behind a sun is as bright as what is around it, about.
            around = radiance[max(top - 2, 0) : bottom + 2, max(left - 2, 0) : right + 2]
            kept[top:bottom, left:right] = np.median(around, axis=(0, 1))
    rows = [np.concatenate([along, flux]) for along, flux, _ in suns]
    return np.array(rows).reshape(-1, 6), kept


def _cells(
    radiance: Float64[np.ndarray, "height width 3"],
    solid: Float64[np.ndarray, "height 1"],
    count: int,
) -> tuple[Float64[np.ndarray, "cells 3"], Float64[np.ndarray, "cells 3"]]:
    """Directions and flux of the cells of an adaptive partition."""
    cells = partition(radiance.mean(axis=-1) * solid, count)
    parts = [_summed(radiance, solid, *cell) for cell in cells.tolist()]
    return np.array([along for along, _ in parts]), np.array([flux for _, flux in parts])


def _summed(
    radiance: Float64[np.ndarray, "height width 3"],
    solid: Float64[np.ndarray, "height 1"],
    top: int,
    bottom: int,
    left: int,
    right: int,
) -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]:
    """Mean direction, by energy, and flux of a cell."""
    height, width = radiance.shape[:2]
    flux = radiance[top:bottom, left:right] * solid[top:bottom, :, None]
    phi = 2.0 * np.pi * (np.arange(left, right) + 0.5) / width
    theta = np.pi * (np.arange(top, bottom) + 0.5) / height
    energy = flux.mean(axis=-1) + 1e-30 * solid[top:bottom]
    sine = np.sin(theta)[:, None]
    along = np.array(
        [
            (energy * sine * np.sin(phi)).sum(),
            (energy * np.cos(theta)[:, None]).sum(),
            -(energy * sine * np.cos(phi)).sum(),
        ]
    )
    return along / np.linalg.norm(along), flux.sum(axis=(0, 1))
