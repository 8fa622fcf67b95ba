"""The Phong lobe nearest to each reflectance model's specular lobe.

Prefiltered maps and Cap kernels know radially symmetric lobes about one direction without the
factor n.l (paper 000, eq. 13). Phong's lobe as in the paper is one; the others are approximated by
one that reflects exactly as much of a uniform sky.
"""

from functools import lru_cache, partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxvis.reflectance import CookTorrance, Lambert, MaterialValues, Mixed, Phong, Reflectance
from jaxvis.reflectance.cook_torrance import (
    FAINTEST_SPECULAR,
    grazing_reflectance,
    schlick_weight,
    smoothness,
)
from jaxvis.reflectance.model import GlossyReflectance
from jaxvis.reflectance.values import MINIMUM_ROUGHNESS
from jaxvis.sampling.sequences import hammersley
from jaxvis.sphere.frames import dot, normalize, reflect

_COSINES, _ROUGHNESSES = 33, 37  # nodes of the tables
_SAMPLES = 512  # of a lobe, for its table
_ITERATIONS = 12
_LOWEST = 1e-3  # cosine that stands for 0 in the tables


class SpecularLobe(NamedTuple):
    """radiance = diffuse E / pi + scale x the light's mean over a Phong lobe about ``mirror``.

    Both kinds of light count what arrives from above the horizon only. ``diffuse`` holds the base
    colour.
    """

    exponent: Float[Array, "*points"]
    scale: Float[Array, "*points 3"]
    mirror: Float[Array, "*points 3"]
    diffuse: Float[Array, "*points 3"]


def specular_lobe(
    reflectance: Reflectance,
    material: MaterialValues,
    normal: Float[Array, "*points 3"],
    view: Float[Array, "*points 3"],
) -> SpecularLobe:
    """What a model reflects towards ``view``, as Lambert's base and one Phong lobe.

    ``Phong(foreshortened=False)`` is exact. The other lobes are not quite symmetric, nor about the
    mirror direction; their factor n.l alone tilts them. Direction and exponent come from a fit:
    close for ``Phong()``, the less so the more grazing and the more mirror-like for ``BlinnPhong``
    and ``CookTorrance``, whose lobes are then narrow across the plane of incidence and, for GGX,
    have long tails. Directional albedos are exact. The base of ``CookTorrance`` reflects what it
    does under a uniform sky.

    Raises:
        ValueError: an unknown kind of reflectance.
    """
    if isinstance(reflectance, Mixed):
        lobe = specular_lobe(reflectance.models[0], material, normal, view)
        for model, here in reflectance.later_models(material):
            other = specular_lobe(model, material, normal, view)
            chosen = [here, here[..., None], here[..., None], here[..., None]]
            lobe = SpecularLobe(*map(jnp.where, chosen, other, lobe))
        return lobe
    cosine = dot(normal, view)
    up = (cosine > 0.0)[..., None]
    mirror = reflect(view, normal)
    if isinstance(reflectance, Lambert):
        none = jnp.zeros_like(material.specular)
        return SpecularLobe(
            material.exponent, none, mirror, jnp.where(up, material.base_colour, 0.0)
        )
    if not isinstance(reflectance, GlossyReflectance):
        raise ValueError(f"no Phong lobe is known for {type(reflectance).__name__}")
    diffuse = jnp.where(up, material.base_colour, 0.0)
    cosine = jnp.clip(cosine, 0.0, 1.0)
    if isinstance(reflectance, Phong) and not reflectance.foreshortened:
        scale = jnp.where(up, material.specular, 0.0)
        return SpecularLobe(material.exponent, scale, mirror, diffuse)
    grazing = grazing_reflectance(material)
    if isinstance(reflectance, CookTorrance):
        coat = grazing * smoothness(material.microfacet_width)
        rest = (1.0 - material.specular) * (1.0 - coat * schlick_weight(cosine))[..., None]
        diffuse = diffuse * rest
    fit = _look_up(_fitted_table(reflectance), cosine, material)
    f0 = material.specular
    scale = f0 * fit[..., 2:3] + (1.0 - f0) * grazing[..., None] * fit[..., 3:4]
    mirror = normalize(mirror + fit[..., 1:2] * normal)
    return SpecularLobe(jnp.exp(fit[..., 0]), jnp.where(up, scale, 0.0), mirror, diffuse)


Table = Float[np.ndarray, "cosines roughnesses values"]


def _look_up(
    table: Table, cosine: Float[Array, "*points"], material: MaterialValues
) -> Float[Array, "*points values"]:
    """Bilinear in the cosine and the roughness, both within the table."""
    rough = jnp.clip(material.roughness, MINIMUM_ROUGHNESS, 1.0) - MINIMUM_ROUGHNESS
    x = cosine * (_COSINES - 1)
    y = rough * ((_ROUGHNESSES - 1) / (1.0 - MINIMUM_ROUGHNESS))
    i = jnp.clip(x.astype(jnp.int32), 0, _COSINES - 2)
    j = jnp.clip(y.astype(jnp.int32), 0, _ROUGHNESSES - 2)
    x, y = (x - i)[..., None], (y - j)[..., None]
    flat = jnp.asarray(table.reshape(-1, table.shape[-1]), jnp.float32)
    first = i * _ROUGHNESSES + j
    lower = (1.0 - y) * flat[first] + y * flat[first + 1]
    upper = (1.0 - y) * flat[first + _ROUGHNESSES] + y * flat[first + _ROUGHNESSES + 1]
    return (1.0 - x) * lower + x * upper


def _nodes() -> tuple[Float[np.ndarray, "cosines 1"], Float[np.ndarray, "1 roughnesses"]]:
    cosine = np.maximum(np.linspace(0.0, 1.0, _COSINES), _LOWEST)[:, None]
    return cosine, np.linspace(MINIMUM_ROUGHNESS, 1.0, _ROUGHNESSES)[None, :]


def share_above_horizon(
    cosine: Float[np.ndarray, "*lobes"], exponent: Float[np.ndarray, "*lobes"], steps: int = 256
) -> Float[np.ndarray, "*lobes"]:
    """The part of normalised Phong lobes that lies above the horizon. Host, float64.

    Exact round the lobe's axis, the midpoint rule of ``steps`` quantiles along it.

    Args:
        cosine: between the lobe's axis and the normal, > 0.
        exponent: a >= 0.
        steps: of the rule.
    """
    logarithm = np.log((np.arange(steps) + 0.5) / steps) / (exponent[..., None] + 1.0)
    along, across = np.exp(logarithm), np.sqrt(-np.expm1(2.0 * logarithm))
    sine = np.sqrt(np.maximum(1.0 - cosine * cosine, 0.0))
    ratio = along * cosine[..., None] / np.maximum(across * sine[..., None], 1e-30)
    return np.mean(np.arccos(-np.clip(ratio, -1.0, 1.0)), axis=-1) / np.pi


@lru_cache(maxsize=8)
def _fitted_table(reflectance: GlossyReflectance) -> Table:
    """log exponent, tilt, and scales of F0 and of the Fresnel rise 1 - F0, of the nearest lobe.

    The lobe points along the mirror direction plus tilt times the normal. It is the fixed point of
    weighting the model's lobe by it: the product has the mean direction and the mean 1 - cos that
    the square of the lobe would have. That finds Phong lobes exactly, and of others the core.
    """
    cosine, roughness = np.broadcast_arrays(*_nodes())
    cosine, roughness = cosine.ravel(), roughness.ravel()
    sine = np.sqrt(1.0 - cosine * cosine)
    views = np.stack([sine, np.zeros_like(sine), cosine], axis=-1)
    with jax.ensure_compile_time_eval():
        samples = _samples(
            reflectance, jnp.asarray(views, jnp.float32), jnp.asarray(roughness, jnp.float32)
        )
    light, full, faint = (np.asarray(values, np.float64) for values in samples)
    albedo = full.mean(axis=-1)
    rise = (faint.mean(axis=-1) - FAINTEST_SPECULAR * albedo) / (1.0 - FAINTEST_SPECULAR)
    axis = np.stack([-sine, np.zeros_like(sine), cosine], axis=-1)
    exponent = 0.5 / roughness**4
    for _ in range(_ITERATIONS):
        apart = 0.5 * np.sum((light - axis[:, None]) ** 2, axis=-1)  # 1 - cos
        inside = np.log1p(-np.minimum(apart, 1.0 - 1e-12))
        weight = full * np.exp(exponent[:, None] * inside)
        weight /= weight.sum(axis=-1, keepdims=True)
        exponent = 1.0 / np.sum(weight * apart, axis=-1) - 2.0 - exponent
        exponent = np.clip(exponent, 0.0, 4.0 / MINIMUM_ROUGHNESS**4)
        axis = np.einsum("ns,nsc->nc", weight, light)
        axis[:, 1] = 0.0  # lobes are symmetric about the plane of incidence
        axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    share = share_above_horizon(np.maximum(axis[:, 2], 1e-6), exponent)
    tilt = np.where(sine > 1e-3, sine * axis[:, 2] / np.maximum(-axis[:, 0], 1e-3) - cosine, 0.0)
    table = [np.log(np.maximum(exponent, 1e-3)), tilt, albedo / share, rise / share]
    return np.stack(table, axis=-1).reshape(_COSINES, _ROUGHNESSES, 4)


@partial(jax.jit, static_argnames="reflectance")
def _samples(
    reflectance: GlossyReflectance,
    views: Float[Array, "nodes 3"],
    roughness: Float[Array, "nodes"],
) -> tuple[
    Float[Array, "nodes samples 3"],
    Float[Array, "nodes samples"],
    Float[Array, "nodes samples"],
]:
    """Samples of the specular lobe in the local frame, and value / density of each for specular
    colour 1 and for :data:`FAINTEST_SPECULAR`, without a base.
    """
    shape = (len(views), _SAMPLES)
    uniforms = jnp.broadcast_to(hammersley(_SAMPLES), (*shape, 2))
    view = jnp.broadcast_to(views[:, None], (*shape, 3))
    normal = jnp.asarray([0.0, 0.0, 1.0])
    rough = jnp.broadcast_to(roughness[:, None], shape)
    black = jnp.zeros((*shape, 3))
    light = reflectance.sample_specular(MaterialValues(black, black + 1.0, rough), view, uniforms)
    weights = []
    for specular in (1.0, FAINTEST_SPECULAR):
        material = MaterialValues(black, black + specular, rough)
        value, density = reflectance.evaluate_and_pdf(material, normal, view, light)
        weight = jnp.where(density > 0.0, value[..., 0] / jnp.where(density > 0.0, density, 1.0), 0)
        weights.append(weight)
    return light, *weights
