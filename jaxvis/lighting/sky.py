"""The clear sky of Preetham, Shirley and Smits 1999, "A Practical Analytic Model for Daylight"."""

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxvis.lighting import resampling
from jaxvis.lighting.environment import Environment
from jaxvis.sphere import latlong

SUN_RADIUS = 0.004652
"""Mean angular radius of the sun (radians)."""

_XYZ_TO_RGB = np.array(
    [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]]
)
_PER_SIDE = 2  # samples along each side of a texel
_SUN_SAMPLES = 4096

# Perez coefficients A ... E for luminance Y and chromaticities x, y, as slope and offset in the
# turbidity (their appendix A.2), and the zenith's chromaticities (its last equations).
_PEREZ = {
    "Y": ((0.1787, -1.4630), (-0.3554, 0.4275), (-0.0227, 5.3251), (0.1206, -2.5771),
          (-0.0670, 0.3703)),
    "x": ((-0.0193, -0.2592), (-0.0665, 0.0008), (-0.0004, 0.2125), (-0.0641, -0.8989),
          (-0.0033, 0.0452)),
    "y": ((-0.0167, -0.2608), (-0.0950, 0.0092), (-0.0079, 0.2102), (-0.0441, -1.6537),
          (-0.0109, 0.0529)),
}  # fmt: skip
_ZENITH = {
    "x": ((0.00166, -0.00375, 0.00209, 0.0), (-0.02903, 0.06377, -0.03202, 0.00394),
          (0.11693, -0.21196, 0.06052, 0.25886)),
    "y": ((0.00275, -0.00610, 0.00317, 0.0), (-0.04214, 0.08970, -0.04153, 0.00516),
          (0.15346, -0.26756, 0.06670, 0.26688)),
}  # fmt: skip


def sky(
    turbidity: float = 3.0,
    elevation: float = 0.8,
    azimuth: float = 2.2,
    ground: float | tuple[float, float, float] = 0.2,
    sun_radius: float = SUN_RADIUS,
    height: int = 256,
) -> Environment:
    """Clear sky with the sun's disc, above a matt ground that the two of them light.

    Radiance is in units of 1000 cd/m² (of the equal-energy white): the sky is of the order of 5,
    the sun's disc of 10^6, white paper in the sun about 30. Texels are averages, so that the sun's
    irradiance does not depend on ``height``. The sun is a black body of 5778 K seen through the
    paper's Rayleigh and aerosol transmittances (its appendix A.1, without the few percent that
    ozone, water vapour and mixed gases take).

    Args:
        turbidity: haziness, 2 (very clear) to 10 (haze).
        elevation: of the sun above the horizon, 0 to pi/2 radians.
        azimuth: of the sun, radians from -Z towards +X (2 pi u of the lat-long map).
        ground: albedo of the ground, one or three numbers in [0, 1].
        sun_radius: angular radius of the disc (radians); a larger disc has the same irradiance.
        height: rows of the map.

    Raises:
        ValueError: a parameter out of its range.
    """
    _check(turbidity, elevation, azimuth, ground, sun_radius, height)
    fine = latlong.texel_directions(_PER_SIDE * height, 2 * _PER_SIDE * height)
    to_sun = np.asarray(
        [
            math.cos(elevation) * math.sin(azimuth),
            math.sin(elevation),
            -math.cos(elevation) * math.cos(azimuth),
        ]
    )
    above = fine[..., 1] > 0.0
    light = np.where(above[..., None], _sky_rgb(fine, to_sun, turbidity), 0.0)
    averages = resampling.resize(jnp.asarray(light, jnp.float32), height, 2 * height)
    radiance = np.asarray(averages, np.float64) + _sun_map(to_sun, turbidity, sun_radius, height)

    cosine = np.maximum(latlong.texel_directions(height, 2 * height)[..., 1], 0.0)
    solid_angles = latlong.row_solid_angles(height, 2 * height)[:, None]
    irradiance = np.einsum("hw,hwc->c", cosine * solid_angles, radiance)
    share = np.asarray(
        resampling.resize(jnp.asarray(~above, jnp.float32)[..., None], height, 2 * height)
    )
    radiance += share * (np.asarray(ground) * irradiance / np.pi)
    return Environment(jnp.asarray(radiance, jnp.float32), "sky")


def _check(turbidity, elevation, azimuth, ground, sun_radius, height) -> None:
    if not 2.0 <= turbidity <= 10.0:
        raise ValueError(f"turbidity must be in [2, 10], got {turbidity}")
    if not 0.0 <= elevation <= math.pi / 2:
        raise ValueError(f"elevation must be in [0, pi/2] radians, got {elevation}")
    if not math.isfinite(azimuth):
        raise ValueError(f"azimuth must be a finite number of radians, got {azimuth}")
    if np.shape(ground) not in ((), (3,)) or not np.all(
        (np.asarray(ground) >= 0.0) & (np.asarray(ground) <= 1.0)
    ):
        raise ValueError(f"ground must be one or three albedos in [0, 1], got {ground}")
    if not 1e-4 <= sun_radius <= 0.2:
        raise ValueError(f"sun_radius must be in [0.0001, 0.2] radians, got {sun_radius}")
    if height < 2:
        raise ValueError(f"height must be at least 2, got {height}")


def _sky_rgb(
    directions: Float[np.ndarray, "*points 3"], to_sun: Float[np.ndarray, "3"], turbidity: float
) -> Float[np.ndarray, "*points 3"]:
    """Sky radiance (1000 cd/m²); below the horizon, that of the horizon."""
    cosine = np.maximum(directions[..., 1], 1e-3)
    angle = np.arccos(np.clip(directions @ to_sun, -1.0, 1.0))
    zenith_angle = math.acos(min(1.0, to_sun[1]))
    powers = np.array([zenith_angle**3, zenith_angle**2, zenith_angle, 1.0])
    chi = (4.0 / 9.0 - turbidity / 120.0) * (math.pi - 2.0 * zenith_angle)
    zenith = {
        "Y": (4.0453 * turbidity - 4.9710) * math.tan(chi) - 0.2155 * turbidity + 2.4192,
        **{
            axis: np.array([turbidity**2, turbidity, 1.0]) @ np.array(_ZENITH[axis]) @ powers
            for axis in "xy"
        },
    }

    def perez(axis, cosine, angle):
        a, b, c, d, e = (slope * turbidity + offset for slope, offset in _PEREZ[axis])
        gradation = 1.0 + a * np.exp(b / cosine)
        return gradation * (1.0 + c * np.exp(d * angle) + e * np.cos(angle) ** 2)

    luminance, x, y = (
        zenith[axis] * perez(axis, cosine, angle) / perez(axis, 1.0, zenith_angle)
        for axis in ("Y", "x", "y")
    )
    xyz = np.stack([x / y * luminance, luminance, (1.0 - x - y) / y * luminance], axis=-1)
    return np.maximum(xyz @ _XYZ_TO_RGB.T, 0.0)


def _sun_map(
    to_sun: Float[np.ndarray, "3"], turbidity: float, radius: float, height: int
) -> Float[np.ndarray, "height width 3"]:
    """Radiance of the disc, averaged over texels; what is below the horizon is hidden."""
    # A spiral of points of equal solid angle fills the disc.
    index = np.arange(_SUN_SAMPLES) + 0.5
    cosine = 1.0 - (1.0 - math.cos(radius)) * index / _SUN_SAMPLES
    sine = np.sqrt(1.0 - cosine * cosine)
    turn = index * math.pi * (3.0 - math.sqrt(5.0))
    helper = np.array([1.0, 0.0, 0.0]) if abs(to_sun[0]) < 0.5 else np.array([0.0, 1.0, 0.0])
    across = np.cross(helper, to_sun)
    across /= np.linalg.norm(across)
    points = (
        (sine * np.cos(turn))[:, None] * across
        + (sine * np.sin(turn))[:, None] * np.cross(to_sun, across)
        + cosine[:, None] * to_sun
    )
    points = points[points[:, 1] > 0.0]
    x, y, z = points.T
    theta, u = np.arctan2(np.hypot(x, z), y), np.arctan2(x, -z) / (2.0 * np.pi) % 1.0
    row = np.minimum((theta * height / np.pi).astype(int), height - 1)
    column = np.minimum((u * 2 * height).astype(int), 2 * height - 1)
    count = np.bincount(row * 2 * height + column, minlength=2 * height * height)
    true_solid_angle = 2.0 * math.pi * (1.0 - math.cos(SUN_RADIUS))
    share = count.reshape(height, 2 * height) * (true_solid_angle / _SUN_SAMPLES)
    share = share / latlong.row_solid_angles(height, 2 * height)[:, None]
    return share[..., None] * _sun_rgb(to_sun[1], turbidity)


def _sun_rgb(sine: float, turbidity: float) -> Float[np.ndarray, "3"]:
    """Radiance of the sun's disc (1000 cd/m²) at the elevation of this sine."""
    wavelength = np.arange(0.380, 0.781, 0.005)  # micrometres
    elevation = math.degrees(math.asin(min(1.0, sine)))
    air_mass = 1.0 / (sine + 0.15 * (elevation + 3.885) ** -1.253)
    rayleigh = np.exp(-0.008735 * wavelength**-4.08 * air_mass)
    aerosol = np.exp(-(0.04608 * turbidity - 0.04586) * wavelength**-1.3 * air_mass)
    metres = wavelength * 1e-6
    planck = 1.191043e-16 / metres**5 / np.expm1(1.438777e-2 / (metres * 5778.0))
    spectrum = planck * rayleigh * aerosol  # W / (m² sr m)
    xyz = 683.0 * (_matching_functions(wavelength * 1e3) @ spectrum) * 5e-9
    return np.maximum(_XYZ_TO_RGB @ xyz, 0.0) / 1000.0


def _matching_functions(
    wavelength: Float[np.ndarray, "wavelengths"],
) -> Float[np.ndarray, "3 wavelengths"]:
    """CIE 1931 observer (nm), as fitted by Wyman, Sloan and Shirley 2013, table 1."""

    def lobe(peak, left, right):
        width = np.where(wavelength < peak, left, right)
        return np.exp(-0.5 * ((wavelength - peak) / width) ** 2)

    x = 1.056 * lobe(599.8, 37.9, 31.0) + 0.362 * lobe(442.0, 16.0, 26.7)
    x = x - 0.065 * lobe(501.1, 20.4, 26.2)
    y = 0.821 * lobe(568.8, 46.9, 40.5) + 0.286 * lobe(530.9, 16.3, 31.1)
    z = 1.217 * lobe(437.0, 11.8, 36.0) + 0.681 * lobe(459.0, 26.0, 13.8)
    return np.stack([x, y, z])
