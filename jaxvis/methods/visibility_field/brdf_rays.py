"""Rays drawn by the BRDF from the points of a square that all pixels share, turned for each."""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxvis.methods.traced import Components, ShadingPoints, components
from jaxvis.methods.visibility_field.hemisphere import turned_frames
from jaxvis.reflectance import CookTorrance, Reflectance
from jaxvis.sampling.sequences import hammersley, radical_inverse
from jaxvis.sphere.angles import sine_cosine
from jaxvis.sphere.components import join

UNRELATED = 1009.0
"""A multiple of a turn that has next to nothing to do with it."""

STEEPEST = 1e-6
"""Views at lower cosines count as having this one, as in jaxvis.sampling.microfacet."""


@partial(jax.jit, static_argnames=("samples", "reflectance"))
def brdf_directions(
    points: ShadingPoints,
    turn: Float[Array, "points"],
    *,
    samples: int,
    reflectance: Reflectance,
) -> Components:
    """Directions by the reflectance's own sampling of Hammersley points, turned for each pixel."""
    square, lobe = hammersley(samples), lobes(samples, turn)
    if isinstance(reflectance, CookTorrance) and reflectance.distribution == "ggx":
        return ggx_directions(points, turn, square, lobe, reflectance)
    angle = square[None, :, 1] + turn[:, None]
    angle = angle - jnp.floor(angle)
    uniforms = join(jnp.broadcast_to(square[None, :, 0], angle.shape), angle, lobe)
    return components(reflectance.sample(*points.per_sample(), uniforms))


def lobes(samples: int, turn: Float[Array, "points"]) -> Float[Array, "points samples"]:
    """Numbers in [0, 1) that choose a ray's lobe: another sequence than the square's, so that each
    lobe gets points from all of the square."""
    shuffled = (jnp.arange(samples) * 0x9E3779) & 0xFFFFFF
    number = radical_inverse(shuffled)[None, :] + UNRELATED * turn[:, None]
    return number - jnp.floor(number)


def ggx_directions(
    points: ShadingPoints,
    turn: Float[Array, "points"],
    square: Float[Array, "samples 2"],
    lobe: Float[Array, "points samples"],
    reflectance: CookTorrance,
) -> Components:
    """:meth:`CookTorrance.sample` for GGX, written out by component and four times as fast.

    In frames that are turned with the pixel, sines and cosines are those of the shared points.
    """
    first, (sine, cosine) = square[:, 0], sine_cosine(square[:, 1])
    frames = turned_frames(points.normal, turn)
    view = [jnp.sum(frames[:, k] * points.view, axis=-1)[:, None] for k in range(3)]
    width = points.material.microfacet_width[:, None]
    share = reflectance.specular_share(points.material, view[2][:, 0])[:, None]

    # Visible facets: Dupuy and Benyoub 2023, as in jaxvis.sampling.microfacet.
    x, y, z = width * view[0], width * view[1], jnp.maximum(view[2], STEEPEST)
    scale = 1.0 / jnp.sqrt(x * x + y * y + z * z)
    x, y, z = x * scale, y * scale, z * scale
    depth = first * (1.0 + z)
    radius = jnp.sqrt(depth * (2.0 - depth))
    facet = [
        width * (x + radius * cosine),
        width * (y + radius * sine),
        jnp.maximum(z + (1.0 - depth), 1e-7),
    ]
    square_length = facet[0] * facet[0] + facet[1] * facet[1] + facet[2] * facet[2]
    towards = view[0] * facet[0] + view[1] * facet[1] + view[2] * facet[2]
    double = 2.0 * towards / square_length

    ring = jnp.sqrt(first)
    diffuse = [ring * cosine, ring * sine, jnp.sqrt(1.0 - first)]
    local = [jnp.where(lobe < share, double * facet[k] - view[k], diffuse[k]) for k in range(3)]
    f = frames[..., None]
    axes = [f[:, 0, a] * local[0] + f[:, 1, a] * local[1] + f[:, 2, a] * local[2] for a in range(3)]
    return axes[0], axes[1], axes[2]
