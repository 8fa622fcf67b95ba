"""Light by spherical Gaussians through interpolated signed distances (paper 002, section 6).

The light is a list of lobes; what a pixel sees of each follows from the signed distance along the
lobe's axis. As the axes are the same for all pixels, distances are read once for every sample,
interpolated at the vertices, and again over the triangles: no map is read for a pixel.
"""

import functools
import math
import operator
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int

from jaxvis.cores import core_count
from jaxvis.methods.distance_field.fetch import signed_distances_at
from jaxvis.methods.distance_field.field import DistanceFields, corners_seen
from jaxvis.reflectance import Lambert, MaterialValues, Reflectance
from jaxvis.reflectance.model import Cosines, Terms
from jaxvis.scene import Surface
from jaxvis.sphere.frames import dot
from jaxvis.sphere.gaussians import (
    HalfSpace,
    SphericalGaussians,
    error_function,
    half_space_constants,
    share_of,
)

LOBES_AT_ONCE = 64
"""Whose distances are held for all vertices: rows long enough to be read fast."""

PIXELS_AT_ONCE = 1 << 11
"""That meet these lobes at once: what is computed for them stays in the cache."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Fragments:
    """What shaded pixels see, as one list."""

    corners: Int[Array, "*pixels 3"]
    """Rows of the vertices in view."""
    barycentrics: Float[Array, "*pixels 3"]
    normal: Float[Array, "*pixels 3"]
    view: Float[Array, "*pixels 3"]
    material: MaterialValues


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class View:
    """What a surface shows of a field: the vertices in view, and the pixels in terms of them."""

    near: Int[Array, "in_view near"]
    weights: Float[Array, "in_view near"]
    fragments: Fragments
    pixel: Int[Array, "pixels"]
    """The index of each fragment in the flat image; beyond it for those that are padding."""


class Samples(NamedTuple):
    """What distances are read from."""

    signed_distance: Array
    frames: Array


def view_of(fields: DistanceFields, surface: Surface) -> View:
    """The pixels of a surface and the vertices at their corners (host).

    Lists are padded to few different lengths, so that the frames of an animation share programs.

    Raises:
        ValueError: pixels see what has no samples; says what to do.
    """
    pixel = np.flatnonzero(np.asarray(surface.mask).reshape(-1)).astype(np.int32)

    def gather(leaf: Array) -> np.ndarray:
        flat = np.asarray(leaf).reshape(-1, *leaf.shape[2:])
        return flat.take(pixel, axis=0)

    corners = corners_seen(fields, gather(surface.triangle), gather(surface.geometric_normal))
    shown = np.zeros(len(fields.positions), bool)
    shown[corners.reshape(-1)] = True
    vertex = np.flatnonzero(shown)
    row = np.cumsum(shown, dtype=np.int32) - 1
    weights = np.asarray(fields.weights)[vertex]
    if len(weights) and not np.any(weights, axis=1).all():
        raise ValueError(
            "the surface shows vertices that were not sampled: precompute for this surface, "
            "or without one for all views"
        )
    rows = padded_length(len(vertex))
    count = padded_length(len(pixel), PIXELS_AT_ONCE * core_count())

    def listed(values: np.ndarray) -> Array:
        return jnp.asarray(_padded(values, count))

    fragments = Fragments(
        listed(row[corners]),
        listed(gather(surface.barycentrics)),
        listed(gather(surface.normal)),
        listed(gather(surface.view)),
        jax.tree.map(lambda leaf: listed(gather(leaf)), surface.material),
    )
    return View(
        jnp.asarray(_padded(np.asarray(fields.near)[vertex], rows)),
        jnp.asarray(_padded(weights, rows)),
        fragments,
        jnp.asarray(np.pad(pixel, (0, count - len(pixel)), constant_values=surface.mask.size)),
    )


def padded_length(count: int, step: int = 1) -> int:
    """At least ``count``, by at most an eighth more: one of eight lengths for every doubling, in
    whole ``step``s."""
    units = max(-(-count // step), 1)
    grain = max(1 << max(units.bit_length() - 4, 0), 1)
    return -(-units // grain) * grain * step


def _padded(rows: np.ndarray, count: int) -> np.ndarray:
    missing = count - len(rows)
    return np.concatenate([rows, np.zeros((missing, *rows.shape[1:]), rows.dtype)])


def shade_view(
    fields: DistanceFields, lobes: SphericalGaussians, view: View, surface: Surface
) -> Float[Array, "height width 3"]:
    """The image."""
    count = padded_length(len(fields.frames))
    samples = Samples(
        jnp.asarray(_rows(fields.signed_distance, count)), jnp.asarray(_rows(fields.frames, count))
    )
    shade = functools.partial(
        radiance_of, samples, view.near, view.weights, reflectance=surface.reflectance
    )
    radiance = _in_threads(lambda part: shade(part, lobes), view.fragments, (lobes, samples))
    flat = jnp.zeros((surface.mask.size, 3), jnp.float32)
    flat = flat.at[view.pixel].set(radiance, mode="drop")
    return surface.to_image(flat.reshape(*surface.mask.shape, 3))


def _in_threads(
    shade: Callable[[Fragments], Array], fragments: Fragments, others: object
) -> Float[Array, "pixels 3"]:
    """The fragments in one part a core: XLA runs a loop over chunks on one.

    In one piece where JAX transforms the function, whose traces belong to a thread, and on a GPU.
    """
    parts = len(fragments.corners) // PIXELS_AT_ONCE
    parts = math.gcd(parts, core_count())
    traced = any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((fragments, others)))
    if parts < 2 or traced or jax.default_backend() != "cpu":
        return shade(fragments)
    size = len(fragments.corners) // parts
    pieces = [
        jax.tree.map(lambda leaf, k=k: leaf[k * size : (k + 1) * size], fragments)
        for k in range(parts)
    ]
    with ThreadPoolExecutor(parts, thread_name_prefix="jaxvis-shading") as pool:
        return jnp.concatenate(list(pool.map(shade, pieces)))


def _rows(leaf: Array | np.ndarray, count: int) -> Array | np.ndarray:
    if leaf.shape[0] == count:
        return leaf
    module = np if isinstance(leaf, np.ndarray) else jnp
    missing = module.zeros((count - leaf.shape[0], *leaf.shape[1:]), leaf.dtype)
    return module.concatenate([leaf, missing])


@functools.partial(jax.jit, static_argnames="reflectance")
def radiance_of(
    samples: Samples,
    near: Int[Array, "in_view near"],
    weights: Float[Array, "in_view near"],
    fragments: Fragments,
    lobes: SphericalGaussians,
    *,
    reflectance: Reflectance,
) -> Float[Array, "pixels 3"]:
    """Radiance that each fragment sends to the viewer."""
    blocks = _in_blocks(lobes)
    chunked = jax.tree.map(
        lambda leaf: leaf.reshape(-1, min(PIXELS_AT_ONCE, len(leaf)), *leaf.shape[1:]), fragments
    )

    def add_block(total: Terms, block: SphericalGaussians) -> tuple[Terms, None]:
        at_samples = signed_distances_at(samples.signed_distance, samples.frames, block.axis)
        at_vertices = _added(
            weights[:, k : k + 1] * jnp.take(at_samples, near[:, k], axis=0, mode="clip")
            for k in range(near.shape[1])
        )
        constants = half_space_constants(block.sharpness)
        seen = jax.lax.map(
            jax.checkpoint(
                lambda part: _light_terms(part, at_vertices, block, constants, reflectance)
            ),
            chunked,
        )
        return Terms(*(t + s for t, s in zip(total, seen, strict=True))), None

    shape = chunked.normal.shape
    # Lambert has one term alone.
    dark = Terms(*(jnp.zeros(shape if used else shape[:1]) for used in _used(reflectance)))
    total, _ = jax.lax.scan(add_block, dark, blocks)
    flat = [t.reshape(-1, 3) if t.ndim == 3 else jnp.zeros((1, 3)) for t in total]
    colours = reflectance.colours(fragments.material)
    return _added(colour * light for colour, light in zip(colours, flat, strict=True))


def _added(terms: Iterable[Array]) -> Array:
    return functools.reduce(operator.add, terms)


def _used(reflectance: Reflectance) -> tuple[bool, bool, bool]:
    diffuse = isinstance(reflectance, Lambert)
    return True, not diffuse, not diffuse


def _light_terms(
    part: Fragments,
    at_vertices: Float[Array, "in_view lobes"],
    block: SphericalGaussians,
    constants: HalfSpace,
    reflectance: Reflectance,
) -> Terms:
    """Light of a block of lobes, [pixels, 3] for each term of the reflectance."""
    b = part.barycentrics
    at_corners = (jnp.take(at_vertices, part.corners[:, k], axis=0, mode="clip") for k in range(3))
    distance = _added(b[:, k : k + 1] * rows for k, rows in enumerate(at_corners))
    energy = block.integral()
    visible = share_of(distance, constants)
    towards = _dots(part.normal, block.axis)
    cos_light = _mean_cosine(towards, block.sharpness)
    if isinstance(reflectance, Lambert):
        unused = jnp.zeros(())
        return Terms((visible * cos_light * (1.0 / jnp.pi)) @ energy, unused, unused)
    cos_view = dot(part.normal, part.view)[:, None]
    cosines = Cosines.of(cos_view, towards, _dots(part.view, block.axis))
    cosines = cosines._replace(light=cos_light)
    terms = reflectance.terms(_widened(part.material, block.sharpness, cosines), cosines)
    return Terms(*((visible * term) @ energy for term in terms))


def _mean_cosine(
    cosine: Float[Array, "pixels lobes"], sharpness: Float[Array, "lobes"]
) -> Float[Array, "pixels lobes"]:
    """The clamped cosine's mean over lobes, whose cosines are taken for normally distributed.

    Their mean is (coth(l) - 1/l) n.p, their variance some (1 - (n.p)^2) / l; of a normal
    distribution with mean m and deviation s, max(x, 0) has the mean m Phi(m/s) + s phi(m/s).
    """
    inverse = 1.0 / jnp.maximum(sharpness, 1.0)
    mean = cosine * (1.0 - inverse)
    deviation = jnp.sqrt(jnp.maximum(1.0 - cosine * cosine, 1e-4) * inverse)
    x = mean / deviation
    above = 0.5 + 0.5 * error_function(math.sqrt(0.5) * x)
    density = jnp.exp(-0.5 * x * x) * (1.0 / math.sqrt(2.0 * math.pi))
    return jnp.maximum(mean * above + deviation * density, 0.0)


def _widened(
    material: MaterialValues, sharpness: Float[Array, "lobes"], cosines: Cosines
) -> MaterialValues:
    """Materials as they reflect lobes instead of points: facets spread by the light's own width.

    A facet lobe of exponent s is s / (4 v.h) sharp in light directions; variances, inverses of
    sharpness, add up. With a^2 = 2 / (s + 2) for facets of width a (DESIGN section 3), the light's
    1 / lambda is worth 1 / (2 v.h lambda) of a^2.
    """
    square = jnp.square(material.microfacet_width)[:, None]
    square = square + 0.5 / (jnp.maximum(cosines.facing, 0.1) * sharpness)
    roughness = jnp.sqrt(jnp.sqrt(jnp.minimum(square, 1.0)))
    colour = (*roughness.shape, 3)
    return MaterialValues(
        jnp.broadcast_to(material.base_colour[:, None], colour),
        jnp.broadcast_to(material.specular[:, None], colour),
        roughness,
        None
        if material.model is None
        else jnp.broadcast_to(material.model[:, None], roughness.shape),
    )


def _dots(
    points: Float[Array, "pixels 3"], axes: Float[Array, "lobes 3"]
) -> Float[Array, "pixels lobes"]:
    return points[:, 0:1] * axes[:, 0] + points[:, 1:2] * axes[:, 1] + points[:, 2:3] * axes[:, 2]


def _in_blocks(lobes: SphericalGaussians) -> SphericalGaussians:
    """[blocks, lobes of a block, ...]; black lobes fill the last."""
    count = lobes.sharpness.shape[0]
    size = min(LOBES_AT_ONCE, count)
    missing = -count % size
    dark = SphericalGaussians(
        jnp.tile(jnp.array([[0.0, 1.0, 0.0]]), (missing, 1)),
        jnp.ones(missing),
        jnp.zeros((missing, 3)),
    )
    padded = jax.tree.map(lambda leaf, rest: jnp.concatenate([leaf, rest]), lobes, dark)
    return jax.tree.map(lambda leaf: leaf.reshape(-1, size, *leaf.shape[1:]), padded)
