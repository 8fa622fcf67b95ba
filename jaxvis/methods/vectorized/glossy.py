"""The share of a specular lobe's light that polygons let through, at sites (paper 000, eq. 15)."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import Partial
from jaxtyping import Array, Float, Int

from jaxvis.methods.vectorized.correspondence.interpolated import polygons_of, sum_over_outlines
from jaxvis.methods.vectorized.correspondence.triples import CorrespondingPolygons
from jaxvis.methods.vectorized.evaluation import (
    Integral,
    References,
    Sites,
    fenced,
    integrals,
)
from jaxvis.methods.vectorized.irradiance import (
    Quadrature,
    Source,
    contour_lookups,
    is_traced,
    outlines,
)
from jaxvis.methods.vectorized.light import PolygonLight
from jaxvis.methods.vectorized.nearest_lobe import specular_lobe
from jaxvis.methods.vectorized.plan import Plan, Stencil, needed_sites, padded, room
from jaxvis.methods.vectorized.polygons import VisibilityPolygons
from jaxvis.methods.vectorized.specular import (
    CIRCLE_VECTORS,
    Cap,
    cap_integral,
    circle_lookups,
    parts_in_cap,
    phong_cap,
    visible_ratio,
)
from jaxvis.reflectance import MaterialValues, Reflectance
from jaxvis.sphere.contours import Lookups, integrate_small
from jaxvis.sphere.frames import dot, normalize
from jaxvis.sphere.polygons import Directions, normalized

GRAZING = 1e-3
"""Cosine at which a site's normal still faces the viewer."""


def lobe_visibility(
    visibility: VisibilityPolygons | CorrespondingPolygons,
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
    polygons = polygons_of(visibility)
    traced = is_traced(light, polygons.vectors, axis)
    extra = jax.tree.map(lambda leaf: leaf if traced else np.asarray(leaf), (axis, cap))
    rule = replace(quadrature, integration="split")

    def of_outlines(source: Source) -> Integral:
        return Partial(_of_outlines, light, source, rule=rule, traced=traced)

    waiting = integrals(
        Partial(_of_circles, light, rule=rule, traced=traced),
        lambda rows: _lobes_at(sites, extra, rows),
        np.zeros(len(needed), np.int32),
        np.array([CIRCLE_VECTORS]),
        np.array([CIRCLE_VECTORS]),
        channels=3,
        lookups_per_vector=replace(rule, pieces=1).lookups_per_vector,
        traced=traced,
    )
    visible = sum_over_outlines(
        of_outlines,
        visibility,
        sites,
        channels=3,
        lookups_per_vector=rule.lookups_per_vector,
        extra=extra,
        traced=traced,
    )
    place = np.full(plan.capacity, count, np.int32)
    place[needed] = np.arange(len(needed), dtype=np.int32)
    return _ratio(padded(visible, count), padded(waiting(), count), light, place)


def _of_outlines(
    light: PolygonLight,
    source: Source,
    references: References,
    size: int,
    *,
    rule: Quadrature,
    traced: bool,
) -> Float[Array, "references 3"]:
    lookups = outline_lookups(source, light, references, size=size, rule=rule, traced=traced)
    return _integral(light, lookups, references)


def _of_circles(
    light: PolygonLight, references: References, size: int, *, rule: Quadrature, traced: bool
) -> Float[Array, "references 3"]:
    of_lobes = partial(whole_lookups, rule=rule)
    if traced:
        return _integral(light, fenced(of_lobes, references, light, references), references)
    return _integral(light, of_lobes(light, references), references)


def _integral(
    light: PolygonLight, lookups: Lookups, references: References
) -> Float[Array, "references 3"]:
    vector, scalar = _integrate(light.vector, lookups), _integrate(light.scalar, lookups)
    return _cap(vector, scalar, *references.extra)


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


def outline_lookups(
    source: Source,
    light: PolygonLight,
    references: References,
    *,
    size: int,
    rule: Quadrature,
    traced: bool,
) -> Lookups:
    """Where the tables are read for the parts of outlines inside their sites' lobes.

    Two jitted calls: in one, XLA would make the outlines again for every lookup.
    """
    inside = partial(outlines_in_lobes, size=size, rule=rule)
    lookups = partial(contour_lookups, quadrature=rule)
    if traced:
        return fenced(lookups, references, light, fenced(inside, references, source, references))
    return lookups(light, inside(source, references))


@partial(jax.jit, static_argnames=("size", "rule"))
def outlines_in_lobes(
    source: Source, references: References, *, size: int, rule: Quadrature
) -> list[Directions]:
    """The parts of outlines inside their sites' lobes, as sets to be taken in turn."""
    axis, cap = references.extra
    directions = normalized(outlines(source, references, size, rule.interpolation))
    return parts_in_cap(directions, axis, cap.rim, rule.pieces)


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


def _lobes_at(
    sites: Sites, lobes: tuple[Array | np.ndarray, Cap], rows: Int[np.ndarray, "rows"]
) -> References:
    """Some sites' lobes, whatever the polygons."""
    position, normal, plane = (field.take(rows, axis=0) for field in sites[:3])
    some = jax.tree.map(lambda leaf: leaf.take(rows, axis=0), lobes)
    return References(np.zeros(len(rows), np.int32), position, normal, plane, some)
