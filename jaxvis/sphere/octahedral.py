"""The octahedral map: the sphere folded out onto the square [-1, 1]^2.

Cigolle et al. 2014, "A Survey of Efficient Representations for Independent Unit Vectors". The
folding axis is the vector's own z: (0, 0, 1) is the centre and (0, 0, -1) all four corners. Maps
are indexed [i, j], i along the first map coordinate (x) and j along the second (y).
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Shaped

from jaxvis.sphere.components import join
from jaxvis.sphere.ranges import quotient


def _fold(
    p: Float[Array, "*points"], q: Float[Array, "*points"]
) -> tuple[Float[Array, "*points"], Float[Array, "*points"]]:
    """Mirrors a point at its quadrant's diagonal \\|p\\| + \\|q\\| = 1; zero counts as positive."""
    return (
        (1.0 - jnp.abs(q)) * jnp.where(p >= 0.0, 1.0, -1.0),
        (1.0 - jnp.abs(p)) * jnp.where(q >= 0.0, 1.0, -1.0),
    )


def encode(directions: Float[Array, "*points 3"]) -> Float[Array, "*points 2"]:
    """Map coordinates in [-1, 1]^2 of directions of any length but zero."""
    return join(*_unfolded(directions[..., 0], directions[..., 1], directions[..., 2]))


def _unfolded(
    x: Float[Array, "*points"], y: Float[Array, "*points"], z: Float[Array, "*points"]
) -> tuple[Float[Array, "*points"], Float[Array, "*points"]]:
    length = jnp.abs(x) + jnp.abs(y) + jnp.abs(z)
    p, q = quotient(x, length), quotient(y, length)
    folded_p, folded_q = _fold(p, q)
    below = z < 0.0
    return jnp.where(below, folded_p, p), jnp.where(below, folded_q, q)


def decode(coordinates: Float[Array, "*points 2"]) -> Float[Array, "*points 3"]:
    """Unit directions of map coordinates in [-1, 1]^2."""
    x, y, z = _on_octahedron(coordinates)
    scale = 1.0 / jnp.sqrt(x * x + y * y + z * z)
    return join(x * scale, y * scale, z * scale)


def jacobian(coordinates: Float[Array, "*points 2"]) -> Float[Array, "*points"]:
    """Solid angle (sr) per unit of map area: 1 / r^3 for a point of the octahedron at distance r.

    From 1 at its vertices to 3 sqrt(3) at the centres of its faces.
    """
    x, y, z = _on_octahedron(coordinates)
    square = x * x + y * y + z * z
    return 1.0 / (square * jnp.sqrt(square))


def _on_octahedron(
    coordinates: Float[Array, "*points 2"],
) -> tuple[Float[Array, "*points"], Float[Array, "*points"], Float[Array, "*points"]]:
    """The point of \\|x\\| + \\|y\\| + \\|z\\| = 1 that unfolds to each map point."""
    p, q = coordinates[..., 0], coordinates[..., 1]
    z = 1.0 - jnp.abs(p) - jnp.abs(q)
    folded_p, folded_q = _fold(p, q)
    below = z < 0.0
    return jnp.where(below, folded_p, p), jnp.where(below, folded_q, q), z


def texel(
    directions: Float[Array, "*points 3"], size: int
) -> tuple[Int[Array, "*points"], Int[Array, "*points"]]:
    """(i, j) of the texel of a ``size`` x ``size`` map that holds each direction."""
    return texel_of_components(directions[..., 0], directions[..., 1], directions[..., 2], size)


def texel_of_components(
    x: Float[Array, "*points"], y: Float[Array, "*points"], z: Float[Array, "*points"], size: int
) -> tuple[Int[Array, "*points"], Int[Array, "*points"]]:
    """:func:`texel` of directions whose components are three arrays."""
    cells = [
        jnp.floor((side + 1.0) * (0.5 * size)).astype(jnp.int32) for side in _unfolded(x, y, z)
    ]
    i, j = (jnp.clip(cell, 0, size - 1) for cell in cells)
    return i, j


def texel_directions(size: int) -> Float[np.ndarray, "size size 3"]:
    """Unit directions (float64, host) of the texel centres, indexed [i, j]."""
    centres = (2.0 * np.arange(size) + 1.0) / size - 1.0
    return _host_decode(*np.meshgrid(centres, centres, indexing="ij"))


def texel_solid_angles(size: int) -> Float[np.ndarray, "size size"]:
    """Exact solid angles (sr, float64, host) of the texels; they add up to 4 pi."""
    # A grid of even size has no texel across an edge of the octahedron except along the diagonals
    # |p| + |q| = 1, which pass through texel corners: halved texels are spherical triangles.
    fine = 2 * size
    lines = np.linspace(-1.0, 1.0, fine + 1)
    corners = _host_decode(*np.meshgrid(lines, lines, indexing="ij"))
    a, b, c, d = corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:]
    low = np.arange(fine) < size
    parallel = (low[:, None] == low[None, :])[..., None]  # the diagonal runs from b to d here
    first = _triangle_solid_angle(a, b, np.where(parallel, d, c))
    second = _triangle_solid_angle(c, d, np.where(parallel, b, a))
    return (first + second).reshape(size, 2, size, 2).sum(axis=(1, 3))


def _host_decode(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    z = 1.0 - np.abs(p) - np.abs(q)
    below = z < 0.0
    x = np.where(below, (1.0 - np.abs(q)) * np.where(p >= 0.0, 1.0, -1.0), p)
    y = np.where(below, (1.0 - np.abs(p)) * np.where(q >= 0.0, 1.0, -1.0), q)
    points = np.stack([x, y, z], axis=-1)
    return points / np.linalg.norm(points, axis=-1, keepdims=True)


def _triangle_solid_angle(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Van Oosterom and Strackee 1983, for unit vectors in any order."""
    volume = np.abs(np.sum(a * np.cross(b, c), axis=-1))
    denominator = 1.0 + np.sum(a * b + b * c + c * a, axis=-1)
    return 2.0 * np.arctan2(volume, denominator)


def pad_indices(
    size: int, border: int = 1
) -> tuple[Int[np.ndarray, "n n"], Int[np.ndarray, "n n"]]:
    """(i, j) (host) of the texel that continues the map at each index of a padded one.

    Across an edge of the square the map continues mirrored about the edge's middle:
    (-1, t) is the same direction as (-1, -t), and so for the other three edges.
    """
    if not 0 <= border <= size:
        raise ValueError(f"border must be from 0 to the map's size {size}, got {border}")
    line = np.arange(-border, size + border)
    i, j = np.meshgrid(line, line, indexing="ij")
    i, j = _across(i, j, size)
    j, i = _across(j, i, size)
    return i, j


def _across(i: np.ndarray, j: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    outside = (i < 0) | (i >= size)
    i = np.where(i < 0, -1 - i, np.where(i >= size, 2 * size - 1 - i, i))
    return i, np.where(outside, size - 1 - j, j)


def pad(
    maps: Shaped[Array | np.ndarray, "*maps size size"], border: int = 1
) -> Shaped[Array | np.ndarray, "*maps padded padded"]:
    """Maps (last two axes) continued by ``border`` texels on every side, whatever their type.

    The maximum over 3 x 3 texels of a map padded by 1 is its dilation on the sphere.
    """
    i, j = pad_indices(maps.shape[-1], border)
    return maps[..., i, j]
