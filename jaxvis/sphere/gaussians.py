"""Spherical Gaussians: lobes mu exp(lambda (p . w - 1)) about unit axes (paper 002, eq. 3).

1 - p . w is taken as half the squared chord \\|w - p\\|^2 / 2 throughout, so that in float32 lobes
keep their shape up to sharpness 1e4 and beyond, and do not feel that unit vectors are a little
longer or shorter than 1.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxvis.sphere.frames import dot
from jaxvis.sphere.ranges import quotient

_FLATTEST = 1e-4  # half-space constants are 0 / 0 at sharpness 0; shares differ by less than 1e-4


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SphericalGaussians:
    """Lobes mu exp(lambda (p . w - 1)): unit axis p, sharpness lambda >= 0, amplitude mu a channel.

    Arrays of lobes of any shape; a light made of several has them along its last axis.
    """

    axis: Float[Array, "*lobes 3"]
    sharpness: Float[Array, "*lobes"]
    amplitude: Float[Array, "*lobes channels"]

    def evaluate(self, directions: Float[Array, "*#lobes 3"]) -> Float[Array, "*lobes channels"]:
        """Each lobe's own value in unit ``directions`` that broadcast against the lobes."""
        exponent = -self.sharpness * _versine(self.axis, directions)
        return self.amplitude * jnp.exp(exponent)[..., None]

    def mixture(self, directions: Float[Array, "*points 3"]) -> Float[Array, "*points channels"]:
        """The sum of a list of lobes in each of the unit ``directions``."""
        if self.sharpness.ndim != 1:
            raise ValueError(
                f"a mixture is one list of lobes; these are {self.sharpness.shape}: use evaluate"
            )
        exponent = -self.sharpness * _versine(self.axis, directions[..., None, :])
        return jnp.exp(exponent) @ self.amplitude

    def integral(self) -> Float[Array, "*lobes channels"]:
        """Over the sphere: 2 pi mu / lambda (1 - exp(-2 lambda)), 4 pi mu for lambda = 0."""
        return self.amplitude * total(self.sharpness)[..., None]


@jax.jit
def total(sharpness: Float[Array, "*lobes"]) -> Float[Array, "*lobes"]:
    """Integral of a lobe of amplitude 1 over the sphere, in steradians."""
    x = 2.0 * sharpness
    flat = x < 0.25
    # The series is for the gradient, which cancels in the closed form.
    t = jnp.where(flat, x, 0.0)
    series = 1.0 - t * (1 / 2 - t * (1 / 6 - t * (1 / 24 - t * (1 / 120 - t * (1 / 720)))))
    safe = jnp.where(flat, 1.0, x)
    return 4.0 * jnp.pi * jnp.where(flat, series, -jnp.expm1(-safe) / safe)


def product(a: SphericalGaussians, b: SphericalGaussians) -> SphericalGaussians:
    """The lobes a(w) b(w), which are spherical Gaussians again; lobes and channels broadcast.

    With l = la + lb and q = (la pa + lb pb) / l: axis q / \\|q\\|, sharpness l \\|q\\|, amplitude
    ma mb exp(l (\\|q\\| - 1)). Equal lobes with opposite axes have a constant product, whose axis
    is then that of ``a``.
    """
    axis, sharpness, fall = _product_shape(a, b)
    amplitude = a.amplitude * b.amplitude * jnp.exp(fall)[..., None]
    return SphericalGaussians(axis, sharpness, amplitude)


def inner_product(a: SphericalGaussians, b: SphericalGaussians) -> Float[Array, "*lobes channels"]:
    """Integral of a(w) b(w) over the sphere, broadcasting like :func:`product`."""
    return product(a, b).integral()


def _product_shape(
    a: SphericalGaussians, b: SphericalGaussians
) -> tuple[Float[Array, "*lobes 3"], Float[Array, "*lobes"], Float[Array, "*lobes"]]:
    """Axis, sharpness and logarithm of the relative amplitude of a product."""
    first, second = a.sharpness, b.sharpness
    both = first + second
    share = quotient(second, both)
    # l (|q| - 1) = -la lb chord^2 / (l (|q| + 1)): nothing cancels between nearly equal axes.
    lost = 2.0 * share * _versine(a.axis, b.axis)
    length = jnp.sqrt(jnp.maximum(1.0 - (1.0 - share) * lost, 1e-12))
    fall = -first * lost / (length + 1.0)
    vector = (1.0 - share)[..., None] * a.axis + share[..., None] * b.axis
    square = dot(vector, vector)
    some = square > 1e-12
    unit = vector * (1.0 / jnp.sqrt(jnp.where(some, square, 1.0)))[..., None]
    return jnp.where(some[..., None], unit, a.axis), both * length, fall


def _versine(
    a: Float[Array, "*#points 3"], b: Float[Array, "*#points 3"]
) -> Float[Array, "*points"]:
    """1 - cos of the angle between unit vectors."""
    x, y, z = a[..., 0] - b[..., 0], a[..., 1] - b[..., 1], a[..., 2] - b[..., 2]
    return 0.5 * (x * x + y * y + z * z)


class HalfSpace(NamedTuple):
    """What :func:`share_of` needs of each lobe, computed once."""

    steepness: Float[Array, "*lobes"]
    height: Float[Array, "*lobes"]
    """Half the difference between the shares at distances +pi / 2 and -pi / 2, over erf(k')."""
    rest: Float[Array, "*lobes"]
    """Share of a lobe that lies more than pi / 2 from its axis."""


def half_space_constants(sharpness: Float[Array, "*lobes"]) -> HalfSpace:
    """The constants of each lobe's visible share, for :func:`share_of`."""
    sharpness = jnp.maximum(sharpness, _FLATTEST)
    steepness = jnp.sqrt(0.5 * sharpness)
    steepness = steepness / jnp.sqrt(1.0 + 1.0 / (sharpness * (0.153 + 0.165 * sharpness)))
    far = jnp.exp(-sharpness)
    half = 0.5 * -jnp.expm1(-sharpness) / (1.0 + far)
    return HalfSpace(steepness, half / error_function(steepness), far / (1.0 + far))


def share_of(
    signed_distance: Float[Array, "*#lobes"], constants: HalfSpace
) -> Float[Array, "*lobes"]:
    """:func:`visible_share` from the lobes' constants: some twenty operations a lobe and point."""
    quarter = 0.5 * jnp.pi
    near = jnp.clip(signed_distance, -quarter, quarter)
    share = 0.5 + constants.height * error_function(constants.steepness * _sine(near))
    # What lies beyond a quarter turn from the axis: all of it when nothing is occluded.
    # Distances are below -pi where an axis is below the horizon of a map that is all occluded.
    beyond = jnp.clip((signed_distance - near) * (1.0 / quarter), -1.0, 1.0)
    eased = beyond * (2.0 - jnp.abs(beyond))
    return jnp.clip(share + constants.rest * eased, 0.0, 1.0)


def visible_share(
    signed_distance: Float[Array, "*#lobes"], sharpness: Float[Array, "*#lobes"]
) -> Float[Array, "*lobes"]:
    """Share, in [0, 1], of a lobe that is visible at a signed distance from its axis to occluders.

    The visible region is replaced by the half-space whose great circle is at that distance
    (radians, positive where the axis is visible; paper 002, eq. 4). The closed form is
    1/2 + (e - 1/2) erf(k' sin D) / erf(k'), e = 1 / (1 + exp(-lambda)); it is within 0.005 of the
    integral at all sharpnesses. At distances of more than pi / 2, which no half-space has, the
    share goes on to 1 at +pi (nothing is occluded) and to 0 at -pi. Differentiable in both.
    """
    return share_of(signed_distance, half_space_constants(sharpness))


def half_space(
    signed_distance: Float[Array, "*#lobes"], sharpness: Float[Array, "*#lobes"]
) -> Float[Array, "*lobes"]:
    """f_h: integral of a lobe of amplitude 1 over its visible half-space, in steradians.

    f_h(D) + f_h(-D) is the lobe's :func:`total`.
    """
    return total(sharpness) * visible_share(signed_distance, sharpness)


def error_function(x: Float[Array, "*points"]) -> Float[Array, "*points"]:
    """erf to an absolute 5e-4, odd and smooth (Abramowitz and Stegun 7.1.27)."""
    # Not jnp.abs and jnp.sign, whose gradients at 0 are 0.
    size = jnp.where(x < 0.0, -x, x)
    size = jnp.minimum(size, 16.0)  # 1 in float32 long before, and the powers of more overflow
    base = 1.0 + size * (0.278393 + size * (0.230389 + size * (0.000972 + size * 0.078108)))
    square = base * base
    value = 1.0 - 1.0 / (square * square)
    return jnp.where(x < 0.0, -value, value)


def _sine(angle: Float[Array, "*points"]) -> Float[Array, "*points"]:
    """sin of angles in [-pi / 2, pi / 2], to 1e-6."""
    s = angle * angle
    return angle * (0.9999966 + s * (-0.16664824 + s * (0.00830629 + s * -0.00018363)))
