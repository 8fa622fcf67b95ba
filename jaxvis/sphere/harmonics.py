"""Real orthonormal spherical harmonics, index l (l + 1) + m, without the Condon-Shortley sign.

Polynomials of the vector's own components with z as the axis, the usual form in graphics: band 1
is 0.488603 (y, z, x). That the world's up is +y changes nothing: it is only a basis.
"""

import functools

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxvis.sphere.components import join

COSINE_BANDS = (np.pi, 2.0 * np.pi / 3.0, np.pi / 4.0)
"""What a clamped cosine does to bands 0, 1 and 2 (Ramamoorthi and Hanrahan 2001, eq. 8)."""


def basis(x, y, z, bands: int) -> list:
    """The ``bands``^2 functions of unit vectors' components: JAX or NumPy arrays, or numbers.

    Normalised recurrences (in the form of Sloan 2013, "Efficient Spherical Harmonic
    Evaluation"): (x + i y)^m times a polynomial of z. Good to rounding up to 64 bands in float32.
    """
    if bands < 1:
        raise ValueError(f"bands must be at least 1, got {bands}")
    functions: list = [None] * (bands * bands)
    cosine, sine = 1.0 + 0.0 * x, 0.0 * x
    diagonal = np.sqrt(1.0 / (4.0 * np.pi))
    for m in range(bands):
        if m > 0:
            cosine, sine = x * cosine - y * sine, x * sine + y * cosine
            diagonal *= np.sqrt((2.0 * m + 1.0) / (2.0 * m))
        scale = float(diagonal * (1.0 if m == 0 else np.sqrt(2.0)))
        before, current = None, scale
        for l in range(m, bands):
            functions[l * (l + 1) + m] = current * cosine
            if m > 0:
                functions[l * (l + 1) - m] = current * sine
            n = l + 1.0
            grow = float(np.sqrt((4.0 * n * n - 1.0) / (n * n - m * m)))
            following = grow * z * current
            if before is not None:
                drop = (n - 1.0) ** 2
                following = following - grow * before * float(
                    np.sqrt((drop - m * m) / (4.0 * drop - 1.0))
                )
            before, current = current, following
    return functions


def evaluate(directions: Float[Array, "*points 3"], bands: int) -> Float[Array, "*points basis"]:
    """All functions of the first ``bands`` bands at unit directions: [..., bands^2]."""
    functions = basis(directions[..., 0], directions[..., 1], directions[..., 2], bands)
    levels = [join(*functions[l * l : (l + 1) ** 2]) for l in range(bands)]
    return jnp.concatenate(levels, axis=-1)


def reconstruct(
    coefficients: Float[Array, "basis channels"], directions: Float[Array, "*points 3"]
) -> Float[Array, "*points channels"]:
    """The function with these coefficients at unit directions; it may be negative."""
    bands = round(coefficients.shape[0] ** 0.5)
    if bands * bands != coefficients.shape[0]:
        raise ValueError(f"{coefficients.shape[0]} coefficients are not a whole number of bands")
    functions = basis(directions[..., 0], directions[..., 1], directions[..., 2], bands)
    total = functions[0][..., None] * coefficients[0]
    for function, row in zip(functions[1:], coefficients[1:], strict=True):
        total = total + function[..., None] * row
    return total


def irradiance(
    coefficients: Float[Array, "9 channels"], normals: Float[Array, "*points 3"]
) -> Float[Array, "*points channels"]:
    """Unoccluded irradiance at unit normals from radiance's first 9 coefficients, with its pi.

    Ramamoorthi and Hanrahan 2001, "An Efficient Representation for Irradiance Environment Maps".
    Not clamped: strongly directional light can make it slightly negative.
    """
    weights = np.repeat(np.array(COSINE_BANDS, np.float32), (1, 3, 5))
    return reconstruct(coefficients * weights[:, None], normals)


def quadratic_form(
    coefficients: Float[Array, "9 channels"],
) -> Float[Array, "channels 4 4"]:
    """Symmetric matrices M with d^T M d = :func:`reconstruct` for d = (x, y, z, 1), |x y z| = 1.

    The form of Ramamoorthi and Hanrahan 2001, eq. 12, for radiance instead of irradiance. Sums of
    the function over directions follow from sums of d d^T: for rays that are turned with a frame,
    from those of their local directions.
    """
    c = [coefficients[k] for k in range(9)]
    constant, linear = np.sqrt(1.0 / (4.0 * np.pi)), 0.5 * np.sqrt(3.0 / (4.0 * np.pi))
    product = 0.5 * np.sqrt(15.0 / (4.0 * np.pi))
    axis, across = np.sqrt(5.0 / (16.0 * np.pi)), np.sqrt(15.0 / (16.0 * np.pi))
    xy, yz, xz = product * c[4], product * c[5], product * c[7]
    x, y, z = linear * c[3], linear * c[1], linear * c[2]
    rows = [
        [across * c[8], xy, xz, x],
        [xy, -across * c[8], yz, y],
        [xz, yz, 3.0 * axis * c[6], z],
        [x, y, z, constant * c[0] - axis * c[6]],
    ]
    return jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)


def project(
    radiance: Float[Array, "height width channels"], bands: int
) -> Float[Array, "basis channels"]:
    """Coefficients of a lat-long map that is constant in each texel, to rounding.

    The integral over u within a row is exact (each function is a trigonometric polynomial there),
    that over theta is Gauss-Legendre quadrature beyond float32's precision.
    """
    height, width = radiance.shape[:2]
    columns, rows = _projection_tables(height, width, bands)
    waves = jnp.einsum("rcx,kc->rkx", radiance, jnp.asarray(columns))
    return jnp.einsum("brk,rkx->bx", jnp.asarray(rows), waves)


@functools.lru_cache(maxsize=8)
def _projection_tables(height: int, width: int, bands: int) -> tuple[np.ndarray, np.ndarray]:
    """(integrals of the waves over each column [waves, width],
    integral over each row of every function's amount of each wave [bands^2, height, waves]).
    """
    frequencies = np.arange(1, bands)
    edges = 2.0 * np.pi * np.arange(width + 1) / width
    angles = frequencies[:, None] * edges
    cosines = np.diff(np.sin(angles), axis=1) / frequencies[:, None]
    sines = -np.diff(np.cos(angles), axis=1) / frequencies[:, None]
    columns = np.concatenate([np.full((1, width), 2.0 * np.pi / width), cosines, sines])

    nodes, weights = np.polynomial.legendre.leggauss(int(0.5 * np.pi * bands / height) + 8)
    theta = (np.pi / height) * (np.arange(height)[:, None] + 0.5 * (nodes + 1.0))
    measure = (0.5 * np.pi / height) * weights * np.sin(theta)
    phi = 2.0 * np.pi * np.arange(2 * bands) / (2 * bands)
    sin_theta, cos_theta = np.sin(theta)[..., None], np.cos(theta)[..., None]
    x, y, z = sin_theta * np.sin(phi), cos_theta + 0.0 * phi, -sin_theta * np.cos(phi)
    angles = frequencies[:, None] * phi
    amounts = np.concatenate([np.full((1, phi.size), 0.5), np.cos(angles), np.sin(angles)])
    analysis = (measure[..., None] * np.ones(phi.size)) / bands
    rows = np.stack(
        [
            np.einsum("rqp,kp->rk", function * analysis, amounts)
            for function in basis(x, y, z, bands)
        ]
    )
    return columns.astype(np.float32), rows.astype(np.float32)
