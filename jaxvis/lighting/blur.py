"""Phong-kernel blur of lat-long maps."""

import math
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxvis.chunks import chunked_map
from jaxvis.lighting import resampling
from jaxvis.sphere import latlong

_NEGLIGIBLE = 1e-9  # of the kernel's peak: further away it is not evaluated
_ROWS = 4  # rows of the result computed at a time


def phong_blur(
    radiance: Float[Array, "rows columns channels"], exponent: float, height: int
) -> Float[Array, "height width channels"]:
    """Convolution with the normalised Phong lobe (a + 1) / (2 pi) max(r.l, 0)^a.

    A texel of the result (width = 2 ``height``) is the average over the lobe directions r in it.
    Along phi the convolution of the piecewise-constant map is exact, by Fourier series; along theta
    rows count as lines at their middle, after a coarse map has been divided to rows of a fraction
    of the lobe's width. A constant stays exactly constant.

    Args:
        radiance: lat-long map, columns = 2 rows.
        exponent: a >= 0, a plain number; 1 gives irradiance / pi.
        height: rows of the result.
    """
    if not (math.isfinite(exponent) and exponent >= 0.0):
        raise ValueError(f"exponent must be a finite number >= 0, got {exponent}")
    if height < 1:
        raise ValueError(f"height must be at least 1, got {height}")
    enough = max(64, math.ceil(16.0 * math.sqrt(exponent + 1.0)))
    rows = radiance.shape[0]
    split = -(-enough // rows)
    fine = radiance.repeat(split, axis=0).repeat(split, axis=1)
    lines = height * -(-enough // height)
    reach = math.pi / 2 if exponent == 0 else math.acos(_NEGLIGIBLE ** (1.0 / exponent))
    window = min(rows * split, 2 * math.ceil(reach * rows * split / math.pi) + 2)
    blurred = _convolve(fine, jnp.float32(exponent), window=window, height=lines, width=2 * height)
    return jnp.maximum(resampling.resize(blurred, height, 2 * height), 0.0)


@partial(jax.jit, static_argnames=("window", "height", "width"))
def _convolve(radiance, exponent, *, window: int, height: int, width: int):
    """Result rows at the middles of ``height`` rows, averaged over each of ``width`` columns."""
    rows, columns = radiance.shape[:2]
    modes = np.arange(columns // 2 + 1)
    # A column is a box, not a line: its spectrum is a sinc; so is that of the averages. The phases
    # put phi = 0 at the left edge of the first column.
    phase = np.exp(-1j * np.pi * modes / columns) * np.sinc(modes / columns)
    spectrum = jnp.fft.rfft(radiance, axis=1) * jnp.asarray(phase, jnp.complex64)[:, None]
    middle = (np.arange(width) + 0.5) / width
    wave = np.exp(2j * np.pi * np.outer(modes, middle)) * np.sinc(modes / width)[:, None]
    twice = np.where((modes == 0) | (2 * modes == columns), 1.0, 2.0)[:, None] / columns
    wave = jnp.asarray(wave * twice, jnp.complex64)
    solid_angles = jnp.asarray(latlong.row_solid_angles(rows, columns), jnp.float32)
    half_turns = jnp.sin(jnp.pi * jnp.arange(columns) / columns) ** 2

    def result_row(theta: Float[Array, ""]) -> Float[Array, "width channels"]:
        first = jnp.clip(jnp.floor(theta * (rows / jnp.pi) - 0.5 * window + 0.5), 0, rows - window)
        first = first.astype(jnp.int32)
        others = (jnp.pi / rows) * (first + jnp.arange(window) + 0.5)
        # 1 - cos of the angle between two directions, without cancellation at small angles.
        versine = 2.0 * (
            jnp.sin(0.5 * (theta - others))[:, None] ** 2
            + (jnp.sin(theta) * jnp.sin(others))[:, None] * half_turns
        )
        front = versine < 1.0
        logarithm = jnp.log1p(-jnp.where(front, versine, 0.0))
        lobe = jnp.where(front, jnp.exp(exponent * logarithm), 0.0)
        weights = jax.lax.dynamic_slice_in_dim(solid_angles, first, window)[:, None]
        kernel = jnp.fft.rfft(lobe * weights, axis=1).real
        light = jax.lax.dynamic_slice_in_dim(spectrum, first, window)
        total = jnp.einsum("rm,rmc->mc", kernel, light) / kernel[:, 0].sum()
        return jnp.einsum("mc,mw->wc", total, wave).real

    theta = jnp.asarray(np.pi * (np.arange(height) + 0.5) / height, jnp.float32)
    return chunked_map(jax.vmap(result_row), theta, _ROWS)
