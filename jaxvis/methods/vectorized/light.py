"""What vectorized visibility stores of an environment: tables for contour integrals, and lobes."""

from dataclasses import dataclass, field
from functools import partial
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxvis.lighting import Environment, resampling
from jaxvis.methods.vectorized.lobes import PhongLobes
from jaxvis.sphere import latlong
from jaxvis.sphere.contours import ContourTable, Lookup

PAPER_SHARPNESS = 5.8
"""alpha' of paper 000 (after eq. 11), per radian."""
SCALED_SHARPNESS = 5.0
"""alpha' times the length of the edge: what fits polygons of any number of vectors."""
ROWS = 512
"""Rows of the tables: 15 channels of 512 x 1024 texels and their margins are 63 MB."""
BLUR_EXPONENT = 256.0
"""Of the Phong kernel that blurs the environment to L' (paper 000, III-C)."""

_BLUR_ROWS = 128  # where the blurred map is computed: 2.5 to the lobe's standard deviation
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)

Sharpness = float | Literal["paper", "scaled"]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class PolygonLight:
    """Summed-area tables of an environment L, all of one size, and its Phong lobes.

    Attributes:
        vector: direction x radiance; channel 3 axis + colour (paper 000's rho, eq. 9).
        scalar: radiance.
        luminous: luminance x direction, from which ``vsat`` finds beta (eq. 11).
        blurred: as ``vector``, of L' (III-C). The same lookups serve all four tables.
        lobes: the unoccluded environment seen through Phong lobes (eq. 14).
        sharpness: alpha' of eq. 11 in 1 / radians; if ``scaled``, times the length of the edge.
    """

    vector: ContourTable
    scalar: ContourTable
    luminous: ContourTable
    blurred: ContourTable
    lobes: PhongLobes
    sharpness: Float[Array, ""]
    scaled: bool = field(default=False, metadata={"static": True})


def polygon_light(
    environment: Environment,
    *,
    lookup: Lookup = "nearest",
    sharpness: Sharpness = "scaled",
    rows: int = ROWS,
) -> PolygonLight:
    """Tables and lobes of an environment; differentiable in its radiance.

    Maps of more than ``rows`` rows are averaged down to ``rows``; for ``nearest`` lookups, which
    are as fine as the table, coarser ones are repeated until they have as many.

    Args:
        environment: one light.
        lookup: what the tables will be read by.
        sharpness: alpha' in 1 / radians, ``"paper"`` (5.8) or ``"scaled"`` (5 / edge length).
        rows: of the tables.

    Raises:
        ValueError: a sharpness that is negative, not finite or of an unknown name; rows below 1.
    """
    if rows < 1:
        raise ValueError(f"rows must be at least 1, got {rows}")
    value, scaled = _sharpness(sharpness)
    tables = _tables(environment.radiance, repeated=lookup == "nearest", rows=rows)
    lobes = PhongLobes.build(environment.radiance)
    return PolygonLight(*tables, lobes, jnp.float32(value), scaled)


def _sharpness(sharpness: Sharpness) -> tuple[float, bool]:
    if sharpness == "paper":
        return PAPER_SHARPNESS, False
    if sharpness == "scaled":
        return SCALED_SHARPNESS, True
    if isinstance(sharpness, str) or not (np.isfinite(sharpness) and sharpness >= 0.0):
        raise ValueError(
            f"sharpness must be a finite number >= 0, 'paper' or 'scaled', got {sharpness!r}"
        )
    return float(sharpness), False


def _tables(
    radiance: Float[Array, "height width 3"], *, repeated: bool, rows: int
) -> tuple[ContourTable, ContourTable, ContourTable, ContourTable]:
    """The tables vector, scalar, luminous and blurred."""
    if radiance.shape[0] > rows:
        radiance = resampling.resize(radiance, rows, 2 * rows)
    height = radiance.shape[0]
    times = -(-rows // height) if repeated else 1
    # The lobe is wide: its map may be as coarse as it is, and is repeated to the tables' rows.
    coarse = height * times // max(1, height * times // _BLUR_ROWS)
    coarse = next(k for k in range(coarse, 0, -1) if height * times % k == 0)
    small = radiance if height <= coarse else resampling.resize(radiance, coarse, 2 * coarse)
    blurred = Environment(small).blur(BLUR_EXPONENT, coarse).radiance
    return _summed(radiance, blurred, times=times)


@partial(jax.jit, static_argnames="times")
def _summed(radiance, blurred, *, times: int):
    height = radiance.shape[0] * times
    radiance = _repeat(radiance, height)
    vector = ContourTable.build(_directed(radiance))
    solid_angles = jnp.asarray(latlong.row_solid_angles(height, 2 * height), jnp.float32)
    scalar = ContourTable.build(radiance * solid_angles[:, None, None])
    axes = vector.corners.reshape(*vector.corners.shape[:2], 3, 3)
    luminous = ContourTable(axes @ _LUMINANCE)
    return vector, scalar, luminous, ContourTable.build(_directed(_repeat(blurred, height)))


def _repeat(values: Float[Array, "rows columns 3"], height: int) -> Float[Array, "height width 3"]:
    times = height // values.shape[0]
    return values.repeat(times, axis=0).repeat(times, axis=1)


def _directed(radiance: Float[Array, "height width 3"]) -> Float[Array, "height width 9"]:
    """Each texel's integral of direction x radiance, channel 3 axis + colour."""
    moments = jnp.asarray(texel_moments(*radiance.shape[:2]), jnp.float32)
    return (moments[..., :, None] * radiance[..., None, :]).reshape(*radiance.shape[:2], 9)


def texel_moments(height: int, width: int) -> Float[np.ndarray, "height width 3"]:
    """The integral of the direction over each texel (float64, host), exactly.

    Shorter than the texel's solid angle: with them the irradiance of a uniform sky is exact.
    """
    theta = np.pi * np.arange(height + 1) / height
    phi = 2.0 * np.pi * np.arange(width + 1) / width
    sine_squared = np.diff(0.5 * theta - 0.25 * np.sin(2.0 * theta))[:, None]
    sine_cosine = np.diff(0.5 * np.sin(theta) ** 2)[:, None]
    x = sine_squared * -np.diff(np.cos(phi))
    z = sine_squared * -np.diff(np.sin(phi))
    return np.stack([x, np.broadcast_to(sine_cosine * (2.0 * np.pi / width), x.shape), z], axis=-1)
