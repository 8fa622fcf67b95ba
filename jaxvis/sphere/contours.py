"""Integrals of lat-long maps over spherical polygons, by contour integration of summed-area tables.

With S(u, v) the sum from column 0 to u and from the north pole to row v, each edge a -> b of a
polygon lies between the two runs along the rows of its ends,

    E = S(u_b, v_a) - S(u_a, v_a),    F = S(u_b, v_b) - S(u_a, v_b),

and adds -((1 - beta) E + beta F) to the integral (paper 000, eqs. 10 and 12; the sign is that of
the Y-up panorama, whose columns run clockwise seen from outside). ``trapezoid`` takes beta = 1/2,
when the two lookups of an edge's own ends cancel round the polygon; ``vsat`` estimates beta from
where the light between the two runs lies (eq. 11).
"""

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxvis.sphere.angles import colatitude, turns
from jaxvis.sphere.polygons import Directions
from jaxvis.sphere.ranges import quotient, shrinking
from jaxvis.sphere.summed_area import SummedAreaTable

Lookup = Literal["nearest", "bilinear"]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ContourTable:
    """A summed-area table with half a turn more on either side: [height + 1, 2 width + 1].

    An edge that crosses the seam finds its lookups there, so that no edge needs to be split.
    """

    corners: Float[Array, "*lights corner_rows corner_columns channels"]

    @staticmethod
    def build(values: Float[Array, "height width channels"]) -> "ContourTable":
        """From each texel's integral (density times solid angle), an even number of columns.

        Differentiable with respect to the values.
        """
        corners = SummedAreaTable.build(values).corners
        half = values.shape[1] // 2
        turn = corners[:, -1:]
        left, right = corners[:, half:-1] - turn, corners[:, 1 : half + 1] + turn
        return ContourTable(jnp.concatenate([left, corners, right], axis=1))

    @property
    def height(self) -> int:
        """Rows of the map."""
        return self.corners.shape[0] - 1

    @property
    def width(self) -> int:
        """Columns of the map."""
        return (self.corners.shape[1] - 1) // 2

    @property
    def total(self) -> Float[Array, "channels"]:
        """The integral over the whole sphere."""
        return self.corners[-1, self.width + self.width // 2]


class Lookups(NamedTuple):
    """Rows of a table's flat corners, and weights: a polygon's integral is their weighted sum.

    ``south`` counts how often the polygon winds round the south pole: S starts at the other, so
    that each time adds the whole sphere.

    The columns walked alone do not tell: they are none for a polygon that winds round both poles,
    as the rounded horizon of every vertical wall may, and none for one that winds round neither.
    So the count is the one that brings the polygon's share of the map's area, which is between 0
    and 1/2 for whatever lies in a hemisphere, nearest to 1/4.
    """

    index: Int[Array, "points lookups"]
    weight: Float[Array, "points lookups"]
    south: Int[Array, "points"]


class Texels(NamedTuple):
    """Where directions lie in a table: corner (row, column) and fractions beyond it.

    The fractions are None where corners are rounded to the nearest.
    """

    row: Int[Array, "*points vectors"]
    column: Int[Array, "*points vectors"]
    down: Float[Array, "*points vectors"] | None
    across: Float[Array, "*points vectors"] | None


def integrate(table: ContourTable, lookups: Lookups) -> Float[Array, "points channels"]:
    """Integrals over polygons from their :func:`trapezoid` or :func:`vsat`.

    Rounding errors are about 1e-6 of the table's total (128 vectors), however small the polygon;
    padding adds up to 4e-7 of it for each repeated vector.
    """
    return _weighted(table, lookups, _rows(table, lookups))


def integrate_small(table: ContourTable, lookups: Lookups) -> Float[Array, "points channels"]:
    """:func:`integrate`, some eight times as precise for polygons of a few degrees and dearer.

    A polygon's weights add up to zero, so that one of its rows may be subtracted from all.
    """
    rows = _rows(table, lookups)
    return _weighted(table, lookups, rows - rows[:, :1])


def _rows(table: ContourTable, lookups: Lookups) -> Float[Array, "points lookups channels"]:
    channels = table.corners.shape[-1]
    flat = table.corners.reshape(-1, channels)
    rows = jnp.take(flat, lookups.index.reshape(-1), axis=0, mode="clip")
    return rows.reshape(*lookups.index.shape, channels)


def _weighted(
    table: ContourTable, lookups: Lookups, rows: Float[Array, "points lookups channels"]
) -> Float[Array, "points channels"]:
    # A batched product: a written-out sum would be computed once for each channel.
    total = jnp.einsum("pk,pkc->pc", lookups.weight, rows)
    return total + lookups.south[:, None] * table.total


def trapezoid(height: int, polygons: list[Directions], lookup: Lookup = "bilinear") -> Lookups:
    """Lookups of the rule with beta = 1/2; its error falls with the square of the edges' length.

    Args:
        height: of the table.
        polygons: sets of directions [points, vectors] of any length, to be taken in turn as
            :func:`jaxvis.sphere.polygons.subdivide` returns them.
        lookup: corners at the directions themselves, or at the nearest corner.
    """
    edges = _edges([_locate(height, directions, lookup) for directions in polygons])
    seams = [_seam(height, a, b) for a, b in edges]
    terms = []
    for (a, b), seam in zip(edges, seams, strict=True):
        terms += _corner(height, a, b, seam, -0.5) + _corner(height, b, a, -seam, 0.5)
    return _joined(terms, _south(height, edges, seams))


def vsat(
    luminous: ContourTable,
    polygons: list[Directions],
    sharpness: Float[Array, "..."] | float,
    lookup: Lookup = "bilinear",
) -> Lookups:
    """Lookups of paper 000's vsat (eqs. 9 to 12).

    beta = 1/2 + 1/2 tanh(sharpness x), with x the signed angle (radians) from the edge's great
    circle to the mean direction of the light between the edge's two runs.

    Args:
        luminous: luminance times direction, three channels, of the table's size.
        polygons: as for :func:`trapezoid`, but unit.
        sharpness: alpha' of eq. 11, in 1 / radians; one for all or [points or 1, vectors or 1].
        lookup: as for :func:`trapezoid`.
    """
    height = luminous.height
    texels = [_locate(height, directions, lookup) for directions in polygons]
    edges = _edges(texels)
    seams = [_seam(height, a, b) for a, b in edges]
    corners = []
    for (a, b), seam in zip(edges, seams, strict=True):
        corners += [(a, a, 0), (a, b, seam), (b, a, -seam)]
    lights = _at_corners(luminous, corners)
    own, ahead, back = lights[0::3], lights[1::3], lights[2::3]
    betas = []
    for (start, end), (a, b), e, f in zip(_edges(polygons), _edges(own), ahead, back, strict=True):
        # E - F, signed so that light on the left of the edge pulls beta up.
        between = Directions(*((e[i] - a[i]) - (b[i] - f[i]) for i in range(3)))
        betas.append(_beta(between, start, end, sharpness))
    # Every direction ends one edge and starts the next: its own lookup serves both.
    before = [jnp.roll(betas[-1], 1, axis=-1), *betas[:-1]]
    terms = []
    for (a, b), seam, beta, last in zip(edges, seams, betas, before, strict=True):
        terms += _corner(height, a, a, 0, 1.0 - beta - last)
        terms += _corner(height, a, b, seam, beta - 1.0) + _corner(height, b, a, -seam, beta)
    return _joined(terms, _south(height, edges, seams))


def _locate(height: int, directions: Directions, lookup: Lookup) -> Texels:
    """The corners of a table of ``height`` rows at, or next to, directions of any length."""
    x, y, z = directions
    u = turns(x, -z)
    across = jnp.where(u < 0.0, u + 1.0, u) * (2 * height)
    down = colatitude(x, y, z) * (2 * height)
    if lookup == "nearest":
        row, column = jnp.round(down).astype(jnp.int32), jnp.round(across).astype(jnp.int32)
        return Texels(row, column, None, None)
    row = jnp.clip(down.astype(jnp.int32), 0, height - 1)
    column = jnp.clip(across.astype(jnp.int32), 0, 2 * height - 1)
    return Texels(row, column, down - row, across - column)


def _edges(sets: list) -> list[tuple]:
    """(starts, ends) of the edges between sets that are taken in turn."""
    wrapped = jax.tree.map(lambda leaf: jnp.roll(leaf, -1, axis=-1), sets[0])
    return list(zip(sets, [*sets[1:], wrapped], strict=True))


def _seam(height: int, a: Texels, b: Texels) -> Int[Array, "points vectors"]:
    """Turns to add to the column of b, so that it lies within half a turn of a's: -1, 0 or 1."""
    ahead = b.column - a.column
    return (ahead < -height).astype(jnp.int32) - (ahead > height).astype(jnp.int32)


Term = tuple[Int[Array, "points vectors"], Float[Array, "points vectors"]]


def _corner(
    height: int,
    at_row: Texels,
    at_column: Texels,
    seam: Int[Array, "points vectors"] | int,
    factor: Float[Array, "points vectors"] | float,
) -> list[Term]:
    """Flat rows, with weights, of factor x S(column + seam, row)."""
    stride = 4 * height + 1
    first = at_row.row * stride + at_column.column + (2 * seam + 1) * height
    down, across = at_row.down, at_column.across
    if down is None or across is None:
        return [(first, jnp.broadcast_to(jnp.float32(factor), first.shape))]
    upper, lower = factor * (1.0 - down), factor * down
    return [
        (first, upper * (1.0 - across)),
        (first + 1, upper * across),
        (first + stride, lower * (1.0 - across)),
        (first + stride + 1, lower * across),
    ]


def _place(texels: Texels) -> tuple[Array, Array]:
    """Rows and columns, with the fractions where there are any."""
    if texels.down is None or texels.across is None:
        return texels.row, texels.column
    return texels.row + texels.down, texels.column + texels.across


def _south(
    height: int, edges: list[tuple[Texels, Texels]], seams: list[Int[Array, "points vectors"]]
) -> Int[Array, "points"]:
    """How often to add the whole map (see :class:`Lookups`)."""
    total = jnp.float32(0.0)
    for (a, b), seam in zip(edges, seams, strict=True):
        (row, column), (next_row, next_column) = _place(a), _place(b)
        columns = next_column - column + 2 * height * seam
        total = total + (row + next_row) * (columns * (0.5 / (2 * height * height)))
    # The contour integral of the map's area is -total, less by 1 each time.
    return jnp.round(jnp.sum(total, axis=-1) + 0.25).astype(jnp.int32)


def _joined(terms: list[Term], south: Int[Array, "points"]) -> Lookups:
    """All terms of sixteen vectors, then of the next sixteen.

    They are added in this order, and an edge's terms nearly cancel: with all first terms first,
    partial sums would grow to many times the result, and so would their rounding errors. Smaller
    blocks would be slower to put together.
    """
    points, vectors = terms[0][0].shape
    block = math.gcd(vectors, 16)

    def flat(arrays: list) -> jax.Array:
        blocks = [array.reshape(points, vectors // block, block) for array in arrays]
        return jnp.concatenate(blocks, axis=-1).reshape(points, len(terms) * vectors)

    index, weight = flat([term[0] for term in terms]), flat([term[1] for term in terms])
    return Lookups(index, weight, south)


def _at_corners(luminous: ContourTable, corners: list[tuple]) -> list[Directions]:
    """S of the luminous table at (row of, column of, seam) corners."""
    flat = luminous.corners.reshape(-1, 3)
    found = []
    for at_row, at_column, seam in corners:
        total = [jnp.float32(0.0)] * 3
        for index, weight in _corner(luminous.height, at_row, at_column, seam, 1.0):
            rows = jnp.take(flat, index.reshape(-1), axis=0, mode="clip").reshape(*index.shape, 3)
            total = [total[i] + weight * rows[..., i] for i in range(3)]
        found.append(Directions(*total))
    return found


def _beta(
    light: Directions,
    start: Directions,
    end: Directions,
    sharpness: Float[Array, "..."] | float,
) -> Float[Array, "points vectors"]:
    """Paper 000, eq. 11. Where there is no light or no edge, 1/2."""
    normal = Directions(
        start.y * end.z - start.z * end.y,
        start.z * end.x - start.x * end.z,
        start.x * end.y - start.y * end.x,
    )
    scale = shrinking(*light)
    light = Directions(light.x * scale, light.y * scale, light.z * scale)
    square = jnp.square(light.x) + jnp.square(light.y) + jnp.square(light.z)
    square *= jnp.square(normal.x) + jnp.square(normal.y) + jnp.square(normal.z)
    product = light.x * normal.x + light.y * normal.y + light.z * normal.z
    some = square > 1e-36  # gradients overflow below
    sine = jnp.where(some, quotient(product, jnp.sqrt(jnp.where(some, square, 1.0))), 0.0)
    # The polynomial arctangent is what XLA vectorises; arcsin is called one number at a time.
    # The root is kept from zero, where its gradient is infinite.
    angle = 2.0 * jnp.pi * turns(sine, jnp.sqrt(jnp.maximum(1.0 - sine * sine, 1e-12)))
    return 0.5 + 0.5 * jnp.tanh(sharpness * angle)
