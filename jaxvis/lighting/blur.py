"""Phong-kernel blur of lat-long maps: averages over texels, or values at points."""

import math
from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Complex, Float

from jaxvis.chunks import chunked_map
from jaxvis.lighting import resampling
from jaxvis.sphere import latlong
from jaxvis.sphere.angles import sine_cosine

_NEGLIGIBLE = 1e-9  # of the kernel's peak: further away it is not evaluated
_HIGHEST = 5.3  # modes to sqrt(a + 1): exp(-5.3^2 / 2) is below 1e-6
_ROWS = 4  # rows of the result, and as many across the equator, computed at a time


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
    _check(exponent, height)
    enough = max(64, math.ceil(16.0 * math.sqrt(exponent + 1.0)))
    split = -(-enough // radiance.shape[0])
    lines = height * -(-enough // height)
    modes = radiance.shape[0] * split
    blurred = _convolve(
        radiance,
        jnp.float32(exponent),
        split=split,
        window=_window(radiance.shape[0] * split, exponent),
        modes=modes,
        height=lines,
        width=2 * height,
        averaged=True,
    )
    return jnp.maximum(resampling.resize(blurred, height, 2 * height), 0.0)


def phong_lobes(
    radiance: Float[Array, "rows columns channels"], exponents: Sequence[float], height: int
) -> Float[Array, "exponents height width channels"]:
    """The integrals of :func:`phong_blur` for lobes about the texels' centres, not averaged.

    Quicker: the map is divided, and Fourier modes are kept, only as finely as the sharpest of the
    lobes needs. Between points that are much closer than a lobe's width, 1 / sqrt(a + 1) radians,
    interpolate bilinearly. One compiled program serves all ``exponents``.
    """
    for exponent in exponents:
        _check(exponent, height)
    rows, frequency = radiance.shape[0], math.sqrt(max(exponents) + 1.0)
    split = -(-math.ceil(8.0 * frequency) // rows)
    return _convolve_with_each(
        radiance,
        jnp.asarray(exponents, jnp.float32),
        split=split,
        window=_window(rows * split, min(exponents)),
        modes=16 + math.ceil(_HIGHEST * frequency),
        height=height,
    )


@partial(jax.jit, static_argnames=("split", "window", "modes", "height"))
def _convolve_with_each(radiance, exponents, *, split: int, window: int, modes: int, height: int):
    def convolved(exponent):
        image = _convolve(
            radiance,
            exponent,
            split=split,
            window=window,
            modes=modes,
            height=height,
            width=2 * height,
            averaged=False,
        )
        return jnp.maximum(image, 0.0)

    return jax.lax.map(convolved, exponents)


def _check(exponent: float, height: int) -> None:
    if not (math.isfinite(exponent) and exponent >= 0.0):
        raise ValueError(f"exponent must be a finite number >= 0, got {exponent}")
    if height < 1:
        raise ValueError(f"height must be at least 1, got {height}")


def _window(rows: int, exponent: float) -> int:
    """How many rows the kernel reaches."""
    reach = math.pi / 2 if exponent == 0 else math.acos(_NEGLIGIBLE ** (1.0 / exponent))
    return min(rows, 2 * math.ceil(reach * rows / math.pi) + 2)


@partial(jax.jit, static_argnames=("split", "window", "modes", "height", "width", "averaged"))
def _convolve(
    radiance,
    exponent,
    *,
    split: int,
    window: int,
    modes: int,
    height: int,
    width: int,
    averaged: bool,
):
    """Result rows at the middles of ``height`` rows, at, or averaged over, ``width`` columns."""
    rows, columns = radiance.shape[0] * split, radiance.shape[1]
    spectrum = _spectrum(radiance, modes).repeat(split, axis=0)
    # The mirror image of a northern row's kernel is that of the southern row across the equator.
    both = jnp.concatenate([spectrum, spectrum[::-1]], axis=-1)
    solid_angles = jnp.asarray(latlong.row_solid_angles(rows, columns), jnp.float32)
    samples = int(scipy.fft.next_fast_len(modes) or modes)  # of half a turn: kernels are even
    half_turns = np.sin(0.5 * np.pi * np.arange(samples + 1) / samples) ** 2
    half_turns = jnp.asarray(half_turns, jnp.float32)

    def two_rows(theta: Float[Array, ""]) -> Complex[Array, "modes twice_channels"]:
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
        kernel = jnp.fft.irfft(lobe * weights, 2 * samples)[:, :modes]
        light = jax.lax.dynamic_slice_in_dim(both, first, window)
        return jnp.einsum("rm,rmc->mc", kernel, light) / kernel[:, 0].sum()

    northern = np.pi * (np.arange((height + 1) // 2) + 0.5) / height
    total = chunked_map(jax.vmap(two_rows), jnp.asarray(northern, jnp.float32), _ROWS)
    channels = radiance.shape[2]
    southern = total[: height // 2, :, channels:][::-1]
    total = jnp.concatenate([total[..., :channels], southern])
    cosine, sine = _waves(modes, width, averaged)
    real = jnp.einsum("hmc,mw->hwc", total.real, cosine)
    return real - jnp.einsum("hmc,mw->hwc", total.imag, sine)


def _spectrum(
    radiance: Float[Array, "rows columns channels"], modes: int
) -> Complex[Array, "rows modes channels"]:
    """Fourier coefficients along phi, starting at the left edge of the first column.

    A column is a box, not a line, of which the spectrum is a sinc: any number of modes exists.
    """
    columns = radiance.shape[1]
    mode = np.arange(modes)
    box = np.exp(-1j * np.pi * mode / columns) * np.sinc(mode / columns) / columns
    lines = jnp.fft.fft(radiance, axis=1)[:, mode % columns]
    return lines * jnp.asarray(box, jnp.complex64)[:, None]


def _waves(
    modes: int, width: int, averaged: bool
) -> tuple[Float[Array, "modes width"], Float[Array, "modes width"]]:
    """(cos, sin) of the modes at the middles of columns, or averaged over them."""
    mode = jnp.arange(modes)[:, None]
    # In whole 1 / (2 width) turns, which are exact.
    place = (mode * (2 * jnp.arange(width) + 1)) % (2 * width)
    sine, cosine = sine_cosine(place * jnp.float32(0.5 / width))
    factor = np.where(np.arange(modes) == 0, 1.0, 2.0)
    if averaged:
        factor = factor * np.sinc(np.arange(modes) / width)
    factor = jnp.asarray(factor[:, None], jnp.float32)
    return factor * cosine, factor * sine
