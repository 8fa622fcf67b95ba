"""The share of a specular lobe's light that polygons let through, at sites (paper 000, eq. 15)."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxvis.methods.vectorized.evaluation import References, Sites, sum_over_polygons
from jaxvis.methods.vectorized.irradiance import Quadrature, is_traced, outlines
from jaxvis.methods.vectorized.light import PolygonLight
from jaxvis.methods.vectorized.nearest_lobe import specular_lobe
from jaxvis.methods.vectorized.plan import Plan, Stencil, needed_sites, padded, room
from jaxvis.methods.vectorized.polygons import VisibilityPolygons
from jaxvis.methods.vectorized.specular import (
    CIRCLE_VECTORS,
    Cap,
    cap_integral,
    cap_lookups,
    circle_lookups,
    phong_cap,
    visible_ratio,
)
from jaxvis.reflectance import MaterialValues, Reflectance
from jaxvis.sphere.contours import Lookups, integrate_small
from jaxvis.sphere.frames import dot, normalize
from jaxvis.sphere.polygons import normalized

GRAZING = 1e-3
"""Cosine at which a site's normal still faces the viewer."""


def lobe_visibility(
    visibility: VisibilityPolygons,
    light: PolygonLight,
    plan: Plan,
    roughness: Float[Array, "pixels"],
    eye: Float[Array, "3"],
    reflectance: Reflectance,
    quadrature: Quadrature,
) -> Float[Array, "capacity 3"]:
    """gamma of eq. 15 in [0, 1], for each colour, at the plan's sites; 1 where no pixel needs it.

    A site's lobe has the mean roughness of the pixels around it. Contours are integrated by the
    trapezoidal rule.
    """
    needed = needed_sites(plan)
    sites = plan.sites.take(needed)
    count = room(len(needed))
    means = mean_roughness(roughness, plan.stencil, capacity=plan.capacity)
    axis, cap = site_lobes(
        padded(sites.position, count),
        padded(sites.normal, count),
        means.take(padded(needed, count)),
        eye,
        reflectance=reflectance,
    )
    traced = is_traced(light, visibility.vectors, axis)
    extra = jax.tree.map(lambda leaf: leaf if traced else np.asarray(leaf), (axis, cap))
    rule = Quadrature("split", quadrature.pieces, quadrature.lookup)

    def of_polygon(references: References, size: int) -> Float[Array, "references 3"]:
        lookups = polygon_lookups(visibility.vectors, light, references, size=size, rule=rule)
        return integral(lookups, references)

    def of_circle(references: References, size: int) -> Float[Array, "references 3"]:
        return integral(whole_lookups(light, references, rule=rule), references)

    def integral(lookups: Lookups, references: References) -> Float[Array, "references 3"]:
        if traced:
            lookups = jax.lax.optimization_barrier(lookups)
        vector, scalar = _integrate(light.vector, lookups), _integrate(light.scalar, lookups)
        return _cap(vector, scalar, *references.extra)

    options = {"channels": 3, "extra": extra, "traced": traced}
    visible = sum_over_polygons(
        of_polygon,
        visibility,
        sites,
        lookups_per_vector=rule.lookups_per_vector,
        **options,
    )
    whole = sum_over_polygons(
        of_circle,
        visibility,
        _alone(sites),
        lookups_per_vector=2 * CIRCLE_VECTORS,
        **options,
    )
    place = np.full(plan.capacity, count, np.int32)
    place[needed] = np.arange(len(needed), dtype=np.int32)
    return _ratio(padded(visible, count), padded(whole, count), light, place)


@partial(jax.jit, static_argnames="capacity")
def mean_roughness(
    roughness: Float[Array, "pixels"], stencil: Stencil, *, capacity: int
) -> Float[Array, "capacity"]:
    """Of the pixels that use each site; 1 where none does."""
    ends, used = stencil.ends, stencil.weights > 0.0
    both = jnp.where(used, 1.0, 0.0), jnp.where(used, roughness[:, None], 0.0)
    rows = jnp.stack([part.reshape(-1) for part in both], axis=-1)
    sums = jax.ops.segment_sum(rows, stencil.nodes.reshape(-1), capacity + len(ends))
    between = sums[capacity:]
    sums = sums[:capacity].at[ends[:, 0]].add(between).at[ends[:, 1]].add(between)
    return jnp.where(sums[:, 0] > 0.0, sums[:, 1] / jnp.maximum(sums[:, 0], 1.0), 1.0)


@partial(jax.jit, static_argnames="reflectance")
def site_lobes(
    position: Float[Array, "sites 3"],
    normal: Float[Array, "sites 3"],
    roughness: Float[Array, "sites"],
    eye: Float[Array, "3"],
    *,
    reflectance: Reflectance,
) -> tuple[Float[Array, "sites 3"], Cap]:
    """Axis and Cap kernel of each site's lobe towards the eye.

    Normals that face away, as at the far corners of triangles on a silhouette, have the view turned
    until they face it barely.
    """
    view = normalize(eye - position)
    lacking = jnp.maximum(GRAZING - dot(normal, view), 0.0)[:, None]
    view = normalize(view + lacking * normal)
    black = jnp.zeros_like(position)
    lobe = specular_lobe(reflectance, MaterialValues(black, black, roughness), normal, view)
    return lobe.mirror, phong_cap(lobe.exponent)


@partial(jax.jit, static_argnames=("size", "rule"))
def polygon_lookups(
    vectors: Float[Array, "polygons 4 capacity"],
    light: PolygonLight,
    references: References,
    *,
    size: int,
    rule: Quadrature,
) -> Lookups:
    """Where the tables are read for the parts of polygons inside their sites' lobes."""
    axis, cap = references.extra
    directions = normalized(outlines(vectors, references, size))
    return cap_lookups(light.scalar.height, directions, axis, cap.rim, rule.pieces, rule.lookup)


@partial(jax.jit, static_argnames="rule")
def whole_lookups(light: PolygonLight, references: References, *, rule: Quadrature) -> Lookups:
    """The same for whole lobes."""
    axis, cap = references.extra
    return circle_lookups(light.scalar.height, axis, cap.rim, rule.lookup)


_integrate = jax.jit(integrate_small)


@jax.jit
def _cap(
    vector: Float[Array, "references 9"],
    scalar: Float[Array, "references 3"],
    axis: Float[Array, "references 3"],
    cap: Cap,
) -> Float[Array, "references 3"]:
    return cap_integral(vector, scalar, axis, cap.base)


@jax.jit
def _ratio(
    visible: Float[Array, "needed 3"],
    whole: Float[Array, "needed 3"],
    light: PolygonLight,
    place: Int[Array, "capacity"],
) -> Float[Array, "capacity 3"]:
    """gamma where it was computed, 1 elsewhere."""
    ratio = visible_ratio(visible, whole, light)
    return jnp.concatenate([ratio, jnp.ones((1, 3))]).take(place, axis=0)


def _alone(sites: Sites) -> Sites:
    """Each site once."""
    polygon, weight = np.full_like(sites.polygon, -1), np.zeros_like(sites.weight)
    polygon[:, 0], weight[:, 0] = 0, 1.0
    return sites._replace(polygon=polygon, weight=weight)
