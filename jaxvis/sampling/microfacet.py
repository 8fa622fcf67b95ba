"""Microfacet distributions, GGX (Trowbridge-Reitz) and Beckmann: D, Smith masking, sampling.

Walter et al. 2007, "Microfacet Models for Refraction through Rough Surfaces"; Heitz 2014,
"Understanding the Masking-Shadowing Function". ``width`` is a = roughness^2 > 0, isotropic;
local frame, the surface's normal along +z; cosines are with that normal.
"""

from typing import Literal

import jax.numpy as jnp
from jax.scipy.special import erfc
from jaxtyping import Array, Float

from jaxvis.sphere.angles import sine_cosine
from jaxvis.sphere.components import join
from jaxvis.sphere.frames import dot

Model = Literal["ggx", "beckmann"]
Width = Float[Array, "..."] | float

_HORIZON = (
    1e-6  # cosines up to this count as below the horizon: their squares are still normal numbers
)


def distribution(
    cosine: Float[Array, "*#points"], width: Width, model: Model = "ggx"
) -> Float[Array, "..."]:
    """D: facet area per unit of surface area and steradian, at normals of this cosine.

    The integral of D cos over the hemisphere is 1; D is 0 for facets that face down.
    """
    above = cosine > _HORIZON
    square = jnp.square(jnp.where(above, cosine, 1.0))
    area = width * width
    if _checked(model) == "ggx":
        value = area / (jnp.pi * jnp.square((1.0 - square) + area * square))
    else:
        # Where these bounds act, the exponential is 0; they keep its gradient from being NaN.
        tangent_square = (1.0 - square) / jnp.maximum(area * square, 1e-12)
        quartic = jnp.maximum(square * square, 1e-6)
        value = jnp.exp(-tangent_square) / (jnp.pi * area * quartic)
    return jnp.where(above, value, 0.0)


def _masking_root(cosine: Float[Array, "*#points"], width: Width) -> Float[Array, "..."]:
    """GGX: cos (1 + 2 Lambda) = sqrt(a^2 + (1 - a^2) cos^2), finite at grazing angles."""
    square = cosine * cosine
    return jnp.sqrt(width * width * (1.0 - square) + square)


def _beckmann_lambda(cosine: Float[Array, "*#points"], width: Width) -> Float[Array, "..."]:
    """Smith's Lambda for Beckmann's distribution (Heitz 2014, eq. 64), for cosines above 0."""
    sine_square = jnp.maximum(1.0 - cosine * cosine, 1e-12)
    slope = jnp.minimum(cosine / (width * jnp.sqrt(sine_square)), 9.0)
    return 0.5 * (jnp.exp(-slope * slope) / (slope * jnp.sqrt(jnp.pi)) - erfc(slope))


def masking(
    cosine: Float[Array, "*#points"], width: Width, model: Model = "ggx"
) -> Float[Array, "..."]:
    """Smith's G1 = 1 / (1 + Lambda) for a direction of this cosine; 0 below the horizon."""
    above = cosine > _HORIZON
    safe = jnp.where(above, cosine, 1.0)
    if _checked(model) == "ggx":
        value = 2.0 * safe / (safe + _masking_root(safe, width))
    else:
        value = 1.0 / (1.0 + _beckmann_lambda(safe, width))
    return jnp.where(above, value, 0.0)


def masking_shadowing(
    cosine_light: Float[Array, "*#points"],
    cosine_view: Float[Array, "*#points"],
    width: Width,
    model: Model = "ggx",
) -> Float[Array, "..."]:
    """Smith's height-correlated G2 = 1 / (1 + Lambda(light) + Lambda(view)) (Heitz 2014, eq. 99).

    0 where either direction is below the horizon.
    """
    above = (cosine_light > _HORIZON) & (cosine_view > _HORIZON)
    light = jnp.where(above, cosine_light, 1.0)
    view = jnp.where(above, cosine_view, 1.0)
    if _checked(model) == "ggx":
        crossed = light * _masking_root(view, width) + view * _masking_root(light, width)
        value = 2.0 * light * view / crossed
    else:
        value = 1.0 / (1.0 + _beckmann_lambda(light, width) + _beckmann_lambda(view, width))
    return jnp.where(above, value, 0.0)


def sample_normal(
    uniforms: Float[Array, "*#points 2"], width: Width, model: Model = "ggx"
) -> Float[Array, "..."]:
    """Unit facet normals of density D cos per steradian (Walter et al. 2007, eqs. 28 and 35)."""
    u = uniforms[..., 0]
    sine, cosine = sine_cosine(uniforms[..., 1])
    # tan^2 theta = numerator / denominator
    if _checked(model) == "ggx":
        numerator, denominator = width * width * u, 1.0 - u
    else:
        numerator, denominator = -width * width * jnp.log1p(-u), jnp.ones_like(u)
    scale = 1.0 / (numerator + denominator)
    radius = jnp.sqrt(jnp.maximum(numerator * scale, 1e-30))  # no infinite gradient at u = 0
    return join(radius * cosine, radius * sine, jnp.sqrt(denominator * scale))


def pdf_normal(
    cosine: Float[Array, "*#points"], width: Width, model: Model = "ggx"
) -> Float[Array, "..."]:
    """Density per steradian of :func:`sample_normal` at facet normals of this cosine.

    The mirror direction about the facet has this density divided by 4 (view . facet normal).
    """
    return distribution(cosine, width, model) * jnp.maximum(cosine, 0.0)


def sample_visible_normal(
    uniforms: Float[Array, "*#points 2"], view: Float[Array, "*#points 3"], width: Width
) -> Float[Array, "..."]:
    """GGX facet normals in proportion to the area seen from ``view`` (local, unit, z >= 0).

    Dupuy and Benyoub 2023, "Sampling Visible GGX Normals with Spherical Caps".
    """
    x, y, z = width * view[..., 0], width * view[..., 1], jnp.maximum(view[..., 2], _HORIZON)
    scale = 1.0 / jnp.sqrt(x * x + y * y + z * z)
    x, y, z = x * scale, y * scale, z * scale
    # A uniform point of the cap of heights -z to 1; depth is measured down from its top.
    depth = uniforms[..., 0] * (1.0 + z)
    sine, cosine = sine_cosine(uniforms[..., 1])
    radius = jnp.sqrt(jnp.maximum(depth * (2.0 - depth), 1e-30))  # no infinite gradient at u = 0
    x, y = width * (x + radius * cosine), width * (y + radius * sine)
    # At the cap's rim height and view cancel; the facet then stands upright.
    z = jnp.maximum(z + (1.0 - depth), 1e-7)
    scale = 1.0 / jnp.sqrt(x * x + y * y + z * z)
    return join(x * scale, y * scale, z * scale)


def pdf_visible_normal(
    normal: Float[Array, "*#points 3"], view: Float[Array, "*#points 3"], width: Width
) -> Float[Array, "..."]:
    """Density per steradian of :func:`sample_visible_normal`: G1 D (view . normal) / view_z.

    The mirror direction about the facet has this density divided by 4 (view . normal).
    """
    cosine = jnp.maximum(view[..., 2], _HORIZON)
    towards = jnp.maximum(dot(view, normal), 0.0)
    visible = 2.0 / (cosine + _masking_root(cosine, width))  # G1 / view_z
    return visible * distribution(normal[..., 2], width) * towards


def _checked(model: Model) -> Model:
    if model not in ("ggx", "beckmann"):
        raise ValueError(f"unknown microfacet distribution {model!r}; use 'ggx' or 'beckmann'")
    return model
