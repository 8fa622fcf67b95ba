"""Reflectance models as spherical Gaussians over light directions (paper 002, eq. 2).

The usual lobe is that of the half vector, warped: NDF lobes of sharpness 2 / a^2 become light lobes
of 2 / (4 a^2 v.h) about the mirror direction (:func:`warped_sharpness`). That is right for narrow
lobes only; of rough ones it keeps neither energy nor direction. :func:`specular_lobe` starts from
it and corrects axis, sharpness and energy by a table over roughness and the view's cosine, fitted
once by quadrature of the exact model.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxvis.cache import cached_arrays, content_hash
from jaxvis.reflectance.cook_torrance import grazing_reflectance
from jaxvis.reflectance.lambert import Lambert
from jaxvis.reflectance.mixed import Mixed
from jaxvis.reflectance.model import Reflectance, over_points
from jaxvis.reflectance.phong import Phong
from jaxvis.reflectance.values import MINIMUM_ROUGHNESS, MaterialValues
from jaxvis.sphere.frames import dot, normalize, reflect
from jaxvis.sphere.gaussians import SphericalGaussians, total

COSINE_SHARPNESS = 2.144
COSINE_AMPLITUDE = 1.177
"""The lobe nearest to a clamped cosine by least squares. Its integral is 8 % more than pi."""
COSINE_AMPLITUDE_OF_ENERGY = 1.08691
"""The amplitude that makes the integral pi."""

ROUGHNESSES = np.linspace(MINIMUM_ROUGHNESS, 1.0, 19)
COSINES = np.linspace(0.0, 1.0, 25)
"""Of the view with the normal. The table's first column stands at :data:`LOWEST_COSINE`."""
LOWEST_COSINE = 0.02

_SAMPLES = 32  # squared: directions that a lobe is fitted to
_FAINT = 0.02  # a specular colour with full reflection at grazing angles that is nearly black


def cosine_lobe(
    normal: Float[Array, "*points 3"], *, keep_energy: bool = True
) -> SphericalGaussians:
    """max(n.l, 0) as a lobe of one channel: of the same integral, pi, or else of least squares.

    Its root mean square error is 0.07, in the plane of the horizon 0.13.
    """
    points = normal.shape[:-1]
    amplitude = COSINE_AMPLITUDE_OF_ENERGY if keep_energy else COSINE_AMPLITUDE
    return SphericalGaussians(
        normal, jnp.full(points, COSINE_SHARPNESS), jnp.full((*points, 1), amplitude)
    )


def warped_sharpness(
    reflectance: Reflectance, material: MaterialValues, cos_view: Float[Array, "..."]
) -> Float[Array, "..."]:
    """Sharpness over light directions of a narrow lobe.

    Of Phong's, a + 1 (that of the same integral). Otherwise that of the half-vector lobe, 2 / a^2
    for microfacets of width a, as of Blinn's exponent, over the Jacobian 4 v.h of mirroring.
    """
    if isinstance(reflectance, Phong):
        return material.exponent + 1.0 + 0.0 * cos_view
    return 0.5 / (jnp.square(material.microfacet_width) * cos_view)


def specular_lobe(
    reflectance: Reflectance,
    material: MaterialValues,
    normal: Float[Array, "*#points 3"],
    view: Float[Array, "*#points 3"],
) -> SphericalGaussians:
    """The specular part of BRDF x max(n.l, 0) as one lobe a point, over the light's directions.

    Its integral over the sphere is the specular energy that the exact model reflects, its axis and
    sharpness are those of least squares: errors of energy below 2 %. In shape an isotropic lobe
    cannot follow the streaks of grazing views: the error (relative, root mean square) is some 0.02
    to 0.3 at 0 degrees, 0.35 to 0.45 at 60 and 0.6 at 75 (experiments/spherical_gaussian_table.py).

    Black where the view is below the horizon, and for Lambert. Differentiable; the first call for a
    model fits its table, which is kept in the cache.
    """
    if isinstance(reflectance, Mixed):
        return _mixed_lobe(reflectance, material, normal, view)
    normal, view = over_points(material, normal, view)
    signed_cosine = dot(normal, view)
    cosine = jnp.clip(signed_cosine, LOWEST_COSINE, 1.0)
    mirror = reflect(view, normal)
    if isinstance(reflectance, Lambert):
        return SphericalGaussians(mirror, jnp.ones_like(cosine), jnp.zeros_like(view))
    bend, sharper, energy, grazing = _look_up(reflectance, material.roughness, cosine)
    sharpness = warped_sharpness(reflectance, material, cosine) * jnp.exp(sharper)
    # Towards the normal (positive) or the horizon, in their plane.
    upwards = normalize(normal - dot(normal, mirror)[..., None] * mirror)
    axis = jnp.cos(bend)[..., None] * mirror + jnp.sin(bend)[..., None] * upwards
    f0 = material.specular
    rise = grazing * grazing_reflectance(material)
    colour = f0 * energy[..., None] + (1.0 - f0) * rise[..., None]
    amplitude = jnp.where(signed_cosine > 0.0, 1.0 / total(sharpness), 0.0)
    return SphericalGaussians(normalize(axis), sharpness, colour * amplitude[..., None])


def _mixed_lobe(
    reflectance: Mixed,
    material: MaterialValues,
    normal: Float[Array, "*#points 3"],
    view: Float[Array, "*#points 3"],
) -> SphericalGaussians:
    chosen = specular_lobe(reflectance.models[0], material, normal, view)
    if material.model is None:
        return chosen
    number = jnp.minimum(material.model, len(reflectance.models) - 1)
    for k, model in enumerate(reflectance.models[1:], 1):
        other, here = specular_lobe(model, material, normal, view), number == k
        chosen = SphericalGaussians(
            jnp.where(here[..., None], other.axis, chosen.axis),
            jnp.where(here, other.sharpness, chosen.sharpness),
            jnp.where(here[..., None], other.amplitude, chosen.amplitude),
        )
    return chosen


def _look_up(
    reflectance: Reflectance, roughness: Float[Array, "..."], cosine: Float[Array, "..."]
) -> tuple[Float[Array, "..."], ...]:
    """The four columns of :func:`lobe_table`, bilinear."""
    table = jnp.asarray(lobe_table(reflectance).reshape(-1, 4))
    rows, columns = len(ROUGHNESSES), len(COSINES)
    first, last = ROUGHNESSES[0], ROUGHNESSES[-1]
    row = jnp.clip((roughness - first) * ((rows - 1) / (last - first)), 0.0, rows - 1.0)
    column = cosine * (columns - 1.0)
    i = jnp.clip(jnp.floor(row).astype(jnp.int32), 0, rows - 2)
    j = jnp.clip(jnp.floor(column).astype(jnp.int32), 0, columns - 2)
    down, across = (row - i)[..., None], (column - j)[..., None]
    place = i * columns + j
    top = (1.0 - across) * jnp.take(table, place, axis=0)
    top = top + across * jnp.take(table, place + 1, axis=0)
    bottom = (1.0 - across) * jnp.take(table, place + columns, axis=0)
    bottom = bottom + across * jnp.take(table, place + columns + 1, axis=0)
    values = (1.0 - down) * top + down * bottom
    return tuple(values[..., k] for k in range(4))


@functools.lru_cache(maxsize=16)
def lobe_table(reflectance: Reflectance) -> Float[np.ndarray, "roughnesses cosines 4"]:
    """For each roughness and cosine of the view, of a specular lobe of colour 1:

    the angle from the mirror direction towards the normal, the logarithm of sharpness over
    :func:`warped_sharpness`, the reflected energy, and that of Schlick's rise (1 - v.h)^5 alone.
    """
    key = content_hash("3", repr(reflectance), ROUGHNESSES, COSINES, _SAMPLES, LOWEST_COSINE)

    def build() -> dict[str, np.ndarray]:
        with jax.ensure_compile_time_eval():
            rows = [np.asarray(_fit_row(reflectance, np.float32(r))) for r in ROUGHNESSES]
        return {"table": np.stack(rows)}

    return cached_arrays("lobe-table", key, build)[0]["table"]


@functools.partial(jax.jit, static_argnums=0)
def _fit_row(reflectance: Reflectance, roughness: Float[Array, ""]) -> Float[Array, "cosines 4"]:
    cosines = jnp.maximum(jnp.asarray(COSINES, jnp.float32), LOWEST_COSINE)
    return jax.lax.map(lambda cosine: _fit_lobe(reflectance, roughness, cosine), cosines)


def _fit_lobe(
    reflectance: Reflectance, roughness: Float[Array, ""], cosine: Float[Array, ""]
) -> Float[Array, "4"]:
    """One entry of :func:`lobe_table`: the best of many lobes, all with the energy of the model."""
    white, faint = (
        MaterialValues(jnp.zeros(3), jnp.full(3, specular), roughness) for specular in (1.0, _FAINT)
    )
    normal = jnp.array([0.0, 0.0, 1.0])
    sine = jnp.sqrt(1.0 - cosine * cosine)
    view = jnp.stack([sine, jnp.zeros(()), cosine])
    middle = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    grid = np.stack([*np.meshgrid(middle, middle), np.zeros((_SAMPLES, _SAMPLES))], axis=-1)
    # The specular lobe's own samples: value / density is nearly constant, however narrow it is.
    light = reflectance.sample(white, normal, view, jnp.asarray(grid.reshape(-1, 3), jnp.float32))
    value, density = reflectance.evaluate_and_pdf(white, normal, view, light)
    dim = reflectance.evaluate(faint, normal, view, light)[:, 0]
    measure = jnp.where(density > 0.0, 1.0 / jnp.where(density > 0.0, density, 1.0), 0.0)
    weight = value[:, 0] * measure / _SAMPLES**2
    energy = jnp.sum(weight)
    grazing = (jnp.sum(dim * measure) / _SAMPLES**2 - _FAINT * energy) / (1.0 - _FAINT)

    mirror = jnp.stack([-sine, jnp.zeros(()), cosine])
    upwards = jnp.stack([cosine, jnp.zeros(()), sine])  # the in-plane normal of ``mirror``
    mean = weight @ light
    bends = jnp.arctan2(dot(mean, upwards), dot(mean, mirror)) * jnp.linspace(0.0, 1.0, 5)
    axes = jnp.cos(bends)[:, None] * mirror + jnp.sin(bends)[:, None] * upwards
    factors = jnp.linspace(jnp.log(0.15), jnp.log(6.0), 40)
    sharpness = warped_sharpness(reflectance, white, cosine) * jnp.exp(factors)
    apart = light[:, None, :] - axes
    versine = 0.5 * jnp.sum(apart * apart, axis=-1)

    def error(one: Float[Array, ""]) -> Float[Array, "bends"]:
        """Squared distance to the model, less what is the same for all."""
        amplitude = energy / total(one)
        overlap = weight @ jnp.exp(-one * versine)
        return amplitude * (amplitude * total(2.0 * one) - 2.0 * overlap)

    errors = jax.lax.map(error, sharpness) / energy**2
    best = jnp.argmin(errors)
    level, place = best // errors.shape[1], best % errors.shape[1]
    # Between the steps of sharpness: the vertex of a parabola.
    inner = jnp.clip(level, 1, len(factors) - 2)
    below, here, above = (errors[inner + k, place] for k in (-1, 0, 1))
    curve = below - 2.0 * here + above
    step = jnp.where(curve > 0.0, 0.5 * (below - above) / jnp.where(curve > 0.0, curve, 1.0), 0.0)
    factor = factors[inner] + jnp.clip(step, -1.0, 1.0) * (factors[1] - factors[0])
    return jnp.stack([bends[place], factor, energy, jnp.maximum(grazing, 0.0)])
