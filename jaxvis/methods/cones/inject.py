"""Direct light on the surfaces of lightmaps, with ray-traced shadows (paper 003, section V-B)."""

from concurrent.futures import ThreadPoolExecutor
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxvis.methods.cones.heights import mip_chain as plan_chain
from jaxvis.methods.cones.light import ConeLight
from jaxvis.methods.cones.volume import FACES, Channels
from jaxvis.methods.cones.volume import mip_chain as volume_chain
from jaxvis.scene import RayTracer

AT_ONCE = 1 << 14
"""Points whose shadow rays are traced together."""


def constant(directions: Float[Array, "directions 3"]) -> Float[np.ndarray, "directions 3"]:
    """On the host: for gradients, what rays see does not depend on where they go (DESIGN §1)."""
    return np.asarray(jax.lax.stop_gradient(directions))


def lit(
    tracer: RayTracer,
    origins: Float[np.ndarray, "points 3"],
    normals: Float[np.ndarray, "points 3"],
    directions: Float[np.ndarray, "directions 3"],
) -> Bool[np.ndarray, "points directions"]:
    """Which directional lights shine on which points; only those above the plane are traced."""
    result = np.zeros((len(origins), len(directions)), bool)
    along = np.asarray(directions, np.float32)
    starts = np.ascontiguousarray(origins, np.float32)

    def part(rows: slice) -> None:
        above = normals[rows] @ along.T > 0.0
        rays = tuple(np.ascontiguousarray(np.broadcast_to(a, above.shape)) for a in along.T)
        result[rows] = tracer.visible(starts[rows], rays, above)

    if len(directions):
        with ThreadPoolExecutor(tracer.threads, thread_name_prefix="jaxvis-shadows") as pool:
            rows = [slice(a, a + AT_ONCE) for a in range(0, len(origins), AT_ONCE)]
            list(pool.map(part, rows))
    return result


@jax.jit
def irradiance(
    normals: Float[Array, "points 3"],
    shone_on: Bool[Array, "points directions"],
    directions: Float[Array, "directions 3"],
    flux: Float[Array, "directions 3"],
) -> Float[Array, "points 3"]:
    """Sum of flux x cosine of the lights that shine on each point."""
    total = jnp.zeros((len(normals), 3))

    def one(total: Array, light: tuple[Array, Array, Array]) -> tuple[Array, None]:
        seen, along, sent = light
        cosine = jnp.maximum(
            normals[:, 0] * along[0] + normals[:, 1] * along[1] + normals[:, 2] * along[2], 0.0
        )
        return total + jnp.where(seen, cosine, 0.0)[:, None] * sent, None

    total, _ = jax.lax.scan(one, total, (shone_on.T, directions, flux))
    return total


def irradiance_of_patches(
    tracer: RayTracer,
    origins: Float[np.ndarray, "points 3"],
    normals: Float[np.ndarray, "points 3"],
    light: ConeLight,
) -> Float[Array, "points 3"]:
    """From the suns and the sky."""
    upright = jnp.asarray(normals)
    total = jnp.zeros((len(normals), 3))
    for along, flux in ((light.sun_directions, light.sun_flux), (light.directions, light.flux)):
        seen = lit(tracer, origins, normals, constant(along))
        total = total + irradiance(upright, jnp.asarray(seen), along, flux)
    return total


def irradiance_of_texels(
    tracer: RayTracer,
    origins: Float[np.ndarray, "texels 3"],
    normals: Float[np.ndarray, "texels 3"],
    light: ConeLight,
    resolution: int,
    stride: int,
) -> Float[Array, "texels 3"]:
    """From the suns at every texel; from the sky, which is smooth, at every ``stride``-th along
    each side, and linearly between."""
    seen = lit(tracer, origins, normals, constant(light.sun_directions))
    sharp = irradiance(
        jnp.asarray(normals), jnp.asarray(seen), light.sun_directions, light.sun_flux
    )
    stride = min(stride, resolution)
    grid = np.arange(resolution * resolution).reshape(resolution, resolution)
    coarse = grid[stride // 2 :: stride, stride // 2 :: stride]
    chosen = coarse.reshape(-1)
    seen = lit(tracer, origins[chosen], normals[chosen], constant(light.directions))
    smooth = irradiance(
        jnp.asarray(normals[chosen]), jnp.asarray(seen), light.directions, light.flux
    )
    return sharp + _enlarged(smooth, coarse.shape[0], resolution)


@partial(jax.jit, static_argnums=(1, 2))
def _enlarged(values: Float[Array, "few 3"], few: int, many: int) -> Float[Array, "many 3"]:
    image = values.reshape(few, few, 3)
    return jax.image.resize(image, (many, many, 3), "linear").reshape(-1, 3)


@partial(jax.jit, static_argnames=("resolution", "count"))
def volume_of(
    radiance: Float[Array, "patches channels"],
    fronts: Float[Array, "patches 6"],
    backs: Float[Array, "patches 6"],
    two_sided: Bool[Array, "patches"],
    slot: Int[Array, "patches"],
    voxels: Int[Array, "occupied"],
    *,
    resolution: int,
    count: int,
) -> Channels:
    """The mip chain of patches' radiance (none: opacity alone).

    A voxel is as opaque as its fronts cover one of its sides, seen along each way. Backs of
    one-sided faces do not count: rays meet none but those of open meshes from behind, while cones,
    which are wide, would meet those of the surface that they leave.

    Args:
        radiance: exitant.
        fronts, backs: projected areas, see :func:`projected_areas`.
        two_sided: patches whose backs send as much.
        slot: the occupied voxel of each patch.
        voxels: x-major numbers of these.
        resolution: voxels a side.
        count: how many are occupied.
    """

    def summed(values: Array) -> Array:
        return jax.ops.segment_sum(values, slot, count)

    shown = fronts + jnp.where(two_sided[:, None], backs, 0.0)
    cover = summed(shown)
    opacity, full = jnp.minimum(cover, 1.0), jnp.maximum(cover, 1.0)
    channels = [summed(shown * radiance[:, c : c + 1]) / full for c in range(radiance.shape[1])]
    base = tuple(
        jnp.zeros((FACES, resolution**3), jnp.float16)
        .at[:, voxels]
        .set(values.T.astype(jnp.float16))
        for values in (*channels, opacity)
    )
    return volume_chain(base, resolution)


@partial(jax.jit, static_argnames="resolution")
def colours_of(radiance: Float[Array, "texels 3"], resolution: int) -> tuple[Array, Array, Array]:
    """The mip chains of a height field's exitant radiance, as float16."""
    red, green, blue = (
        plan_chain(radiance[:, c], resolution).astype(jnp.float16) for c in range(3)
    )
    return red, green, blue
