"""Light by spherical Gaussians through interpolated signed distances (paper 002, section 6).

The light is a list of lobes; what a pixel sees of each follows from the signed distance along the
lobe's axis. As the axes are the same for all pixels, distances are read once for every sample,
interpolated at the vertices, and again over the triangles: no map is read for a pixel.

A sphere light is a lobe whose axis and width depend on the place. Its distances are read along the
direction from each sample to the sphere's centre; cosines and the lobe are those of the pixel. Maps
do not say how far away an occluder is: what stands behind a sphere shadows it like what stands
before it.
"""

import functools
import math
import operator
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int

from jaxvis.chunks import map_on_host
from jaxvis.cores import core_count
from jaxvis.devices import dealer, device_count
from jaxvis.lighting import SphereLights
from jaxvis.methods.distance_field.fetch import signed_distances_at
from jaxvis.methods.distance_field.field import DistanceFields, corners_seen
from jaxvis.methods.distance_field.light import LobesAndSpheres
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

SPHERES_AT_ONCE = 16
"""The same of sphere lights, whose axes are held for all samples."""

PIXELS_AT_ONCE = 1 << 11
"""That meet these lobes at once: what is computed for them stays in the cache."""

VERTICES_AT_ONCE = 1 << 10
"""For which these lobes' distances are interpolated at once."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Fragments:
    """What shaded pixels see, as one list."""

    corners: Int[Array, "*pixels 3"]
    """Rows of the vertices in view."""
    barycentrics: Float[Array, "*pixels 3"]
    normal: Float[Array, "*pixels 3"]
    view: Float[Array, "*pixels 3"]
    position: Float[Array, "*pixels 3"]
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
    positions: Array


class Lobes(NamedTuple):
    """A block of lobes as some places see them."""

    axis: tuple[Array, Array, Array]
    """Components, [lobes] or [pixels, lobes], as is what follows."""
    sharpness: Float[Array, "*#pixels lobes"]
    constants: HalfSpace
    solid_angle: Float[Array, "*#pixels lobes"]
    energy: Float[Array, "lobes 3"]
    """Times the solid angle, the light of a lobe."""


T = TypeVar("T")
Towards = Callable[[Fragments], Lobes]


def view_of(fields: DistanceFields, surface: Surface) -> View:
    """The pixels of a surface and the vertices at their corners (host).

    Lists are as long as there are pixels in the image, and vertices in the field: no other view
    needs other programs. Blocks of padding alone are not evaluated.

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
    rows = _whole(len(fields.weights), VERTICES_AT_ONCE)
    count = _whole(surface.mask.size, PIXELS_AT_ONCE * _parts())

    def listed(values: np.ndarray) -> Array:
        return jax.device_put(_padded(values, count))  # jnp.asarray would compile for the shape

    def material(leaf: Array) -> Array:
        if isinstance(leaf, Tracer):  # differentiated, which the host cannot be
            pixels = leaf.reshape(-1, *leaf.shape[2:])[pixel]
            return jnp.pad(pixels, [(0, count - len(pixel)), *[(0, 0)] * (leaf.ndim - 2)])
        return listed(gather(leaf))

    fragments = Fragments(
        listed(row[corners]),
        listed(gather(surface.barycentrics)),
        listed(gather(surface.normal)),
        listed(gather(surface.view)),
        listed(gather(surface.position)),
        jax.tree.map(material, surface.material),
    )
    return View(
        jax.device_put(_padded(np.asarray(fields.near)[vertex], rows)),
        jax.device_put(_padded(weights, rows)),
        fragments,
        jax.device_put(np.pad(pixel, (0, count - len(pixel)), constant_values=surface.mask.size)),
    )


def _whole(count: int, block: int) -> int:
    """``count`` in whole blocks, one at least."""
    return max(1, -(-count // block)) * block


def padded_length(count: int) -> int:
    """At least ``count``, by at most an eighth more: one of eight lengths for every doubling."""
    grain = 1 << max(count.bit_length() - 4, 0)
    return max(-(-count // grain), 1) * grain


def _padded(rows: np.ndarray, count: int) -> np.ndarray:
    missing = count - len(rows)
    return np.concatenate([rows, np.zeros((missing, *rows.shape[1:]), rows.dtype)])


def shade_view(
    fields: DistanceFields, light: SphericalGaussians, view: View, surface: Surface
) -> Float[Array, "height width 3"]:
    """The image; spheres light it where ``light`` is a :class:`LobesAndSpheres` that has some."""
    count = padded_length(len(fields.frames))
    places = np.asarray(fields.positions)[np.asarray(fields.samples)]
    leaves = fields.signed_distance, fields.frames, places
    samples = Samples(*(jnp.asarray(_rows(leaf, count)) for leaf in leaves))
    lobes = SphericalGaussians(light.axis, light.sharpness, light.amplitude)
    spheres = light.spheres if isinstance(light, LobesAndSpheres) else None
    if spheres is not None:
        spheres = spheres.seen_from(surface.origin)
    shade = functools.partial(
        radiance_of, samples, view.near, view.weights, reflectance=surface.reflectance
    )
    lights = lobes, spheres
    radiance = _in_threads(lambda part: shade(part, *lights), view.fragments, (lights, samples))
    flat = jnp.zeros((surface.mask.size, 3), jnp.float32)
    flat = flat.at[view.pixel].set(radiance, mode="drop")
    return surface.to_image(flat.reshape(*surface.mask.shape, 3))


def _parts() -> int:
    """Into which an image's blocks are dealt: of each device, or of each core."""
    return device_count() or (core_count() if jax.default_backend() == "cpu" else 1)


def _in_threads(
    shade: Callable[[Fragments], Array], fragments: Fragments, others: object
) -> Float[Array, "pixels 3"]:
    """The fragments in parts: XLA runs a loop over blocks on one core.

    In one piece where JAX transforms the function, whose traces belong to a thread.
    """
    parts = _parts()
    traced = any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((fragments, others)))
    if parts < 2 or traced:
        return shade(fragments)
    deal = dealer()

    def dealt(leaf: np.ndarray, part: int) -> np.ndarray:
        # Block by block in turn, since padding is at the end.
        blocks = leaf.reshape(-1, PIXELS_AT_ONCE, *leaf.shape[1:])
        return blocks[part::parts].reshape(-1, *leaf.shape[1:])

    def shade_part(part: int) -> np.ndarray:
        with deal(part):
            return np.asarray(shade(map_on_host(functools.partial(dealt, part=part), fragments)))

    with ThreadPoolExecutor(parts, thread_name_prefix="jaxvis-shading") as pool:
        found = list(pool.map(shade_part, range(parts)))
    blocks = [piece.reshape(-1, PIXELS_AT_ONCE, 3) for piece in found]
    return jax.device_put(np.stack(blocks, axis=1).reshape(-1, 3))


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
    spheres: SphereLights | None = None,
    *,
    reflectance: Reflectance,
) -> Float[Array, "pixels 3"]:
    """Radiance that each fragment sends to the viewer; spheres are in its coordinates."""
    chunked = _blocks(fragments, min(PIXELS_AT_ONCE, len(fragments.normal)))
    rows = _blocks((near, weights), min(VERTICES_AT_ONCE, len(near)))

    def light_of(axes: Float[Array, "*samples lobes 3"], towards: Towards) -> Terms:
        """Of a block of lobes, along these axes from the samples."""
        at_samples = signed_distances_at(samples.signed_distance, samples.frames, axes)

        def at_some(some: tuple[Array, Array]) -> Array:
            near, weights = some
            return _added(
                weights[:, k : k + 1] * jnp.take(at_samples, near[:, k], axis=0, mode="clip")
                for k in range(near.shape[1])
            )

        at_vertices = _where_used(at_some, rows, rows[1]).reshape(-1, at_samples.shape[1])

        def terms(part: Fragments) -> Terms:
            return _light_terms(part, at_vertices, towards(part), reflectance)

        return _where_used(terms, chunked, chunked.normal)

    # Gradients compute each block of lobes anew, and in it each block of pixels: what they keep is
    # no more than one of each needs.
    @jax.checkpoint
    def from_lobes(block: SphericalGaussians) -> Terms:
        return light_of(block.axis, _from_infinity(block))

    @jax.checkpoint
    def from_spheres(block: SphereLights) -> Terms:
        return light_of(block.cones(samples.positions).axis, functools.partial(_at_places, block))

    def add_block(total: Terms, block: SphericalGaussians) -> tuple[Terms, None]:
        return _plus(total, from_lobes(block)), None

    def add_spheres(total: Terms, block: SphereLights) -> tuple[Terms, None]:
        return _plus(total, from_spheres(block)), None

    shape = chunked.normal.shape
    # Lambert has one term alone.
    total = Terms(*(jnp.zeros(shape if used else shape[:1]) for used in _used(reflectance)))
    total, _ = jax.lax.scan(add_block, total, _in_blocks(lobes, LOBES_AT_ONCE))
    if spheres is not None:
        total, _ = jax.lax.scan(add_spheres, total, _in_blocks(spheres, SPHERES_AT_ONCE))
    flat = [t.reshape(-1, 3) if t.ndim == 3 else jnp.zeros((1, 3)) for t in total]
    colours = reflectance.colours(fragments.material)
    return _added(colour * light for colour, light in zip(colours, flat, strict=True))


def _blocks(tree: T, size: int) -> T:
    """Every leaf's rows in blocks of ``size``."""
    return jax.tree.map(lambda leaf: leaf.reshape(-1, size, *leaf.shape[1:]), tree)


def _where_used(
    function: Callable[[T], Any], blocks: T, marks: Float[Array, "blocks *rest"]
) -> Any:
    """The function of every block, or zeros where the block's marks are 0: it is padding."""
    used = jnp.any(marks != 0.0, axis=tuple(range(1, marks.ndim)))
    like = jax.eval_shape(function, jax.tree.map(lambda leaf: leaf[0], blocks))

    def nothing(block: T) -> Any:
        return jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), like)

    @jax.checkpoint  # around the condition, which else keeps what the function closes over
    def either(one: tuple[Array, T]) -> Any:
        return jax.lax.cond(one[0], function, nothing, one[1])

    return jax.lax.map(either, (used, blocks))


def _plus(one: Terms, other: Terms) -> Terms:
    return Terms(*(a + b for a, b in zip(one, other, strict=True)))


def _from_infinity(block: SphericalGaussians) -> Towards:
    """Lobes that are the same everywhere."""
    x, y, z = (block.axis[:, k] for k in range(3))
    constants = half_space_constants(block.sharpness)
    lobes = Lobes((x, y, z), block.sharpness, constants, jnp.ones(()), block.integral())
    return lambda part: lobes


def _at_places(block: SphereLights, part: Fragments) -> Lobes:
    """Spheres as lobes, as each pixel sees them."""
    cones = block.cones(part.position)
    constants = half_space_constants(cones.sharpness)
    axis = cones.x, cones.y, cones.z
    return Lobes(axis, cones.sharpness, constants, cones.solid_angle, block.radiance)


def _added(terms: Iterable[Array]) -> Array:
    return functools.reduce(operator.add, terms)


def _used(reflectance: Reflectance) -> tuple[bool, bool, bool]:
    diffuse = isinstance(reflectance, Lambert)
    return True, not diffuse, not diffuse


def _light_terms(
    part: Fragments,
    at_vertices: Float[Array, "in_view lobes"],
    lobes: Lobes,
    reflectance: Reflectance,
) -> Terms:
    """Light of a block of lobes, [pixels, 3] for each term of the reflectance."""
    b = part.barycentrics
    at_corners = (jnp.take(at_vertices, part.corners[:, k], axis=0, mode="clip") for k in range(3))
    distance = _added(b[:, k : k + 1] * rows for k, rows in enumerate(at_corners))
    visible = share_of(distance, lobes.constants) * lobes.solid_angle
    towards = _dots(part.normal, lobes.axis)
    cos_light = _mean_cosine(towards, lobes.sharpness)
    if isinstance(reflectance, Lambert):
        unused = jnp.zeros(())
        return Terms((visible * cos_light * (1.0 / jnp.pi)) @ lobes.energy, unused, unused)
    cos_view = dot(part.normal, part.view)[:, None]
    cosines = Cosines.of(cos_view, towards, _dots(part.view, lobes.axis))
    cosines = cosines._replace(light=cos_light)
    terms = reflectance.terms(_widened(part.material, lobes.sharpness, cosines), cosines)
    return Terms(*((visible * term) @ lobes.energy for term in terms))


def _mean_cosine(
    cosine: Float[Array, "pixels lobes"], sharpness: Float[Array, "*#pixels lobes"]
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
    material: MaterialValues, sharpness: Float[Array, "*#pixels lobes"], cosines: Cosines
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
    points: Float[Array, "pixels 3"], axes: tuple[Array, Array, Array]
) -> Float[Array, "pixels lobes"]:
    return _added(points[:, k : k + 1] * component for k, component in enumerate(axes))


Lights = TypeVar("Lights", SphericalGaussians, SphereLights)


def _in_blocks(lights: Lights, most: int) -> Lights:
    """[blocks, lights of a block, ...] of at most so many; black ones fill the last."""
    # Axis or position, sharpness or radius, amplitude or radiance.
    leaves, structure = jax.tree.flatten(lights)
    count = leaves[0].shape[0]
    size = min(most, count)

    def blocks(leaf: Array, black: float | tuple[float, ...]) -> Array:
        filling = jnp.broadcast_to(jnp.asarray(black), (-count % size, *leaf.shape[1:]))
        return jnp.concatenate([leaf, filling]).reshape(-1, size, *leaf.shape[1:])

    fillings = (0.0, 1.0, 0.0), 1.0, 0.0
    return structure.unflatten([blocks(*pair) for pair in zip(leaves, fillings, strict=True)])
