"""Irradiance through visibility polygons (paper 000, eqs. 9 to 12)."""

from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from jaxvis.methods.vectorized.evaluation import References, Sites, sum_over_polygons
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

SHORTEST = 1e-6
"""Length below which edges count as this long when their sharpness is scaled."""


@dataclass(frozen=True)
class Quadrature:
    """How contours are integrated.

    ``split`` cuts every edge in ``pieces`` and applies the trapezoidal rule; ``vsat`` leaves edges
    whole and estimates where the light beside them lies.
    """

    integration: Literal["split", "vsat"] = "split"
    pieces: int = 1
    lookup: Lookup = "nearest"

    @property
    def lookups_per_vector(self) -> int:
        """Rows of a table that an edge needs."""
        corners = 1 if self.lookup == "nearest" else 4
        return corners * (3 if self.integration == "vsat" else 2 * self.pieces)


def is_traced(*trees: Any) -> bool:
    """Whether a leaf is followed by grad, vmap or jit."""
    return any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(trees))


def irradiance(
    visibility: VisibilityPolygons,
    light: PolygonLight,
    sites: Sites,
    quadrature: Quadrature,
    *tables: ContourTable,
    **options: int,
) -> Float[Array | np.ndarray, "sites channels"]:
    """Irradiance at each site from what its polygons see, three channels for each table.

    Args:
        visibility: the polygons.
        light: where sharpness comes from.
        sites: where.
        quadrature: how.
        tables: ``light.vector``, ``light.blurred`` or both: the same lookups serve all.
        options: ``lookups_per_chunk`` of :func:`sum_over_polygons`.
    """
    traced = is_traced(light, visibility.vectors)

    def integral(references: References, size: int) -> Float[Array, "references channels"]:
        lookups = irradiance_lookups(
            visibility.vectors, light, references, size=size, quadrature=quadrature
        )
        if traced:
            lookups = jax.lax.optimization_barrier(lookups)
        values = [projected(table, lookups, references.normal) for table in tables]
        return values[0] if len(values) == 1 else jnp.concatenate(values, axis=-1)

    return sum_over_polygons(
        integral,
        visibility,
        sites,
        channels=3 * len(tables),
        lookups_per_vector=quadrature.lookups_per_vector,
        traced=traced,
        **options,
    )


def outlines(
    vectors: Float[Array, "polygons 4 capacity"], references: References, size: int
) -> Directions:
    """The first ``size`` vectors of each polygon as seen from its site, above both planes.

    Not normalised. Paper 000, eq. 3.
    """
    rows = jax.vmap(lambda i: jax.lax.dynamic_slice_in_dim(vectors, i, 1)[0, :, :size])
    seen = seen_from(rows(jnp.asarray(references.polygon)), jnp.asarray(references.position))
    above = clamp_to_hemisphere(seen, jnp.asarray(references.plane))
    return clamp_to_hemisphere(above, jnp.asarray(references.normal))


@partial(jax.jit, static_argnames=("size", "quadrature"))
def irradiance_lookups(
    vectors: Float[Array, "polygons 4 capacity"],
    light: PolygonLight,
    references: References,
    *,
    size: int,
    quadrature: Quadrature,
) -> Lookups:
    """Where the tables are read, for the first ``size`` vectors of each polygon."""
    directions = outlines(vectors, references, size)
    if quadrature.integration == "vsat":
        directions = normalized(directions)
        sharpness = edge_sharpness(light, directions)
        return vsat(light.luminous, [directions], sharpness, quadrature.lookup)
    sets = [directions]
    if quadrature.pieces > 1:
        sets = subdivide(normalized(directions), quadrature.pieces)
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
