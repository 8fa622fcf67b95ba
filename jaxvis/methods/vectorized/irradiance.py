"""Irradiance through visibility polygons (paper 000, eqs. 9 to 12)."""

from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.tree_util import Partial
from jaxtyping import Array, Float

from jaxvis.methods.vectorized.correspondence.interpolated import (
    Interpolation,
    TripleLists,
    interpolated,
    polygons_of,
    sum_over_outlines,
)
from jaxvis.methods.vectorized.correspondence.triples import CorrespondingPolygons
from jaxvis.methods.vectorized.evaluation import Integral, References, Sites, fenced
from jaxvis.methods.vectorized.light import PolygonLight
from jaxvis.methods.vectorized.polygons import VisibilityPolygons
from jaxvis.sphere.contours import ContourTable, Lookup, Lookups, integrate, trapezoid, vsat
from jaxvis.sphere.polygons import (
    Directions,
    clamp_to_hemisphere,
    following,
    normalized,
    seen_from,
    subdivide,
)

Source = Float[Array, "polygons 4 capacity"] | TripleLists
"""What outlines are made from: polygons, each seen by itself, or corresponding ones."""

SHORTEST = 1e-6
"""Length below which edges count as this long when their sharpness is scaled."""


@dataclass(frozen=True)
class Quadrature:
    """How contours are integrated.

    ``split`` cuts every edge in ``pieces`` and applies the trapezoidal rule; ``vsat`` leaves edges
    whole and estimates where the light beside them lies. ``interpolation`` says what is
    interpolated where polygons correspond.
    """

    integration: Literal["split", "vsat"] = "split"
    pieces: int = 1
    lookup: Lookup = "nearest"
    interpolation: Interpolation = "position"

    @property
    def lookups_per_vector(self) -> int:
        """Rows of a table that an edge needs."""
        corners = 1 if self.lookup == "nearest" else 4
        return corners * (3 if self.integration == "vsat" else 2 * self.pieces)


def is_traced(*trees: Any) -> bool:
    """Whether a leaf is followed by grad, vmap or jit."""
    return any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(trees))


def irradiance(
    visibility: VisibilityPolygons | CorrespondingPolygons,
    light: PolygonLight,
    sites: Sites,
    quadrature: Quadrature,
    *tables: ContourTable,
    **options: int,
) -> Float[Array | np.ndarray, "sites channels"]:
    """Irradiance at each site from what its polygons see, three channels for each table.

    Args:
        visibility: the polygons, and perhaps their correspondence.
        light: where sharpness comes from.
        sites: where.
        quadrature: how.
        tables: ``light.vector``, ``light.blurred`` or both: the same lookups serve all.
        options: ``lookups_per_chunk`` of :func:`sum_over_polygons`.
    """
    traced = is_traced(light, polygons_of(visibility).vectors)

    def integral(source: Source) -> Integral:
        return Partial(_of_outlines, source, light, tables, quadrature=quadrature, traced=traced)

    return sum_over_outlines(
        integral,
        visibility,
        sites,
        channels=3 * len(tables),
        lookups_per_vector=quadrature.lookups_per_vector,
        traced=traced,
        **options,
    )


def _of_outlines(
    source: Source,
    light: PolygonLight,
    tables: tuple[ContourTable, ...],
    references: References,
    size: int,
    *,
    quadrature: Quadrature,
    traced: bool,
) -> Float[Array, "references channels"]:
    lookups = irradiance_lookups(
        source, light, references, size=size, quadrature=quadrature, traced=traced
    )
    values = [projected(table, lookups, references.normal) for table in tables]
    return values[0] if len(values) == 1 else jnp.concatenate(values, axis=-1)


def outlines(
    source: Source, references: References, size: int, interpolation: Interpolation = "position"
) -> Directions:
    """The first ``size`` vectors of each outline as seen from its site, above both planes.

    Not normalised. Paper 000, eqs. 3 and 21.
    """
    if isinstance(source, TripleLists):
        seen = interpolated(source, references, size, interpolation)
    else:
        rows = jax.vmap(lambda i: jax.lax.dynamic_slice_in_dim(source, i, 1)[0, :, :size])
        seen = seen_from(rows(jnp.asarray(references.polygon)), jnp.asarray(references.position))
    above = clamp_to_hemisphere(seen, jnp.asarray(references.plane))
    return clamp_to_hemisphere(above, jnp.asarray(references.normal))


def irradiance_lookups(
    source: Source,
    light: PolygonLight,
    references: References,
    *,
    size: int,
    quadrature: Quadrature,
    traced: bool = False,
) -> Lookups:
    """Where the tables are read, for the first ``size`` vectors of each outline.

    Two jitted calls: in one, XLA would make the outlines again for every lookup.
    """
    pieces = partial(outline_pieces, size=size, quadrature=quadrature)
    lookups = partial(contour_lookups, quadrature=quadrature)
    if traced:
        sets = fenced(pieces, references, source, references)
        return fenced(lookups, references, light, sets)
    return lookups(light, pieces(source, references))


@partial(jax.jit, static_argnames=("size", "quadrature"))
def outline_pieces(
    source: Source, references: References, *, size: int, quadrature: Quadrature
) -> list[Directions]:
    """Outlines with their edges cut, as sets of directions to be taken in turn."""
    directions = outlines(source, references, size, quadrature.interpolation)
    if quadrature.integration == "vsat":
        return [normalized(directions)]
    if quadrature.pieces == 1:
        return [directions]
    return subdivide(normalized(directions), quadrature.pieces)


@partial(jax.jit, static_argnames="quadrature")
def contour_lookups(
    light: PolygonLight, sets: list[Directions], *, quadrature: Quadrature
) -> Lookups:
    """Where the tables are read along outlines."""
    if quadrature.integration == "vsat":
        return vsat(light.luminous, sets, edge_sharpness(light, sets[0]), quadrature.lookup)
    return trapezoid(light.vector.height, sets, quadrature.lookup)


def edge_sharpness(
    light: PolygonLight, directions: Directions
) -> Float[Array, "#references #vectors"]:
    """alpha' of every edge, in 1 / radians."""
    if not light.scaled:
        return jnp.broadcast_to(light.sharpness, (1, 1))
    ends = following(directions)
    square = sum((b - a) ** 2 for a, b in zip(directions, ends, strict=True))
    return light.sharpness / jnp.sqrt(jnp.maximum(square, SHORTEST**2))


@jax.jit
def projected(
    table: ContourTable, lookups: Lookups, normal: Float[Array, "references 3"]
) -> Float[Array, "references 3"]:
    """The cosine-weighted integral from a table of direction x radiance."""
    integrals = integrate(table, lookups).reshape(-1, 3, 3)
    return jnp.einsum("pac,pa->pc", integrals, normal)
