"""From light at sites to the image: light first, material last."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxvis.methods.vectorized.light import PolygonLight
from jaxvis.methods.vectorized.nearest_lobe import SpecularLobe, specular_lobe
from jaxvis.methods.vectorized.plan import Stencil
from jaxvis.scene import Surface
from jaxvis.sphere.frames import dot


def interpolate(
    values: Float[Array, "capacity channels"], stencil: Stencil
) -> Float[Array, "pixels channels"]:
    """Every pixel's value from the sites'."""
    ends = (jnp.take(values, stencil.ends[:, k], axis=0, mode="clip") for k in range(2))
    first, last = ends
    between = first + stencil.fraction[:, None] * (last - first)
    nodes = jnp.concatenate([values, between])
    found = jnp.take(nodes, stencil.nodes, axis=0, mode="clip")
    return jnp.einsum("pk,pkc->pc", stencil.weights, found)


def clearance(surface: Surface) -> Float[Array, "rows columns"]:
    """What a triangle's own plane leaves of a uniform sky's irradiance under the shading normal.

    (1 + cos) / 2 of the angle between them.
    """
    return 0.5 + 0.5 * dot(surface.normal, surface.geometric_normal)


@partial(jax.jit, static_argnames="clipped")
def diffuse_image(
    irradiance: Float[Array, "capacity 3"], stencil: Stencil, surface: Surface, *, clipped: bool
) -> Float[Array, "height width 3"]:
    """The image of the irradiance at the sites, reflected by Lambert's law."""
    found = interpolate(irradiance, stencil).reshape(*surface.mask.shape, 3)
    radiance = surface.material.base_colour * (found / jnp.pi)
    return surface.to_image(radiance if clipped else clearance(surface)[..., None] * radiance)


def glossy_image(
    irradiance: Float[Array | np.ndarray, "capacity 3"],
    seen: Float[Array, "capacity 3"],
    stencil: Stencil,
    surface: Surface,
    light: PolygonLight,
    *,
    clipped: bool,
) -> Float[Array, "height width 3"]:
    """The image of irradiance and of the lobes' light, of which a part is ``seen`` (eq. 14).

    Three jitted calls: in one, XLA would find the lobes again for every texel of their maps.
    """
    lobe = _lobes(surface)
    unoccluded = _unoccluded(light, lobe)
    return _reflected(irradiance, seen, stencil, surface, lobe, unoccluded, clipped=clipped)


@jax.jit
def _lobes(surface: Surface) -> SpecularLobe:
    return specular_lobe(surface.reflectance, surface.material, surface.normal, surface.view)


@jax.jit
def _unoccluded(light: PolygonLight, lobe: SpecularLobe) -> Float[Array, "rows columns 3"]:
    return light.lobes.radiance(lobe.mirror, lobe.exponent)


@partial(jax.jit, static_argnames="clipped")
def _reflected(
    irradiance: Float[Array, "capacity 3"],
    seen: Float[Array, "capacity 3"],
    stencil: Stencil,
    surface: Surface,
    lobe: SpecularLobe,
    unoccluded: Float[Array, "rows columns 3"],
    *,
    clipped: bool,
) -> Float[Array, "height width 3"]:
    both = jnp.concatenate([irradiance, seen], axis=-1)
    found = interpolate(both, stencil).reshape(*surface.mask.shape, 6)
    diffuse = lobe.diffuse * (found[..., :3] / jnp.pi)
    diffuse = diffuse if clipped else clearance(surface)[..., None] * diffuse
    return surface.to_image(diffuse + found[..., 3:] * (lobe.scale * unoccluded))
