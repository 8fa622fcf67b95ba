"""From light at sites to the image: light first, material last."""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxvis.methods.vectorized.light import PolygonLight
from jaxvis.methods.vectorized.nearest_lobe import specular_lobe
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


@partial(jax.jit, static_argnames="clipped")
def glossy_image(
    irradiance: Float[Array, "capacity 3"],
    seen: Float[Array, "capacity 3"],
    stencil: Stencil,
    surface: Surface,
    light: PolygonLight,
    *,
    clipped: bool,
) -> Float[Array, "height width 3"]:
    """The image of irradiance and of the lobes' light, of which a part is ``seen`` (eq. 14)."""
    both = jnp.concatenate([irradiance, seen], axis=-1)
    found = interpolate(both, stencil).reshape(*surface.mask.shape, 6)
    lobe = specular_lobe(surface.reflectance, surface.material, surface.normal, surface.view)
    diffuse = lobe.diffuse * (found[..., :3] / jnp.pi)
    diffuse = diffuse if clipped else clearance(surface)[..., None] * diffuse
    specular = lobe.scale * light.lobes.radiance(lobe.mirror, lobe.exponent)
    return surface.to_image(diffuse + found[..., 3:] * specular)
