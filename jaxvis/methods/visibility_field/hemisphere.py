"""Cosine-weighted rays, the same about every point but for a turn (paper 001, section 4.2)."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, UInt8

from jaxvis.methods.traced import Components
from jaxvis.methods.visibility_field.cull import ACCEPT
from jaxvis.sampling.blue_noise import blue_noise
from jaxvis.sampling.hemisphere import sample_cosine
from jaxvis.sampling.sequences import hammersley
from jaxvis.sphere.angles import sine_cosine
from jaxvis.sphere.frames import frame
from jaxvis.sphere.harmonics import quadratic_form


class Shifts(NamedTuple):
    """What a key decides: how the turns of a frame's rays are moved, the same for all pixels.

    The rays' angles with the normal stay the midpoints of their strata: moved for all pixels at
    once they would change the brightness of whole pictures from key to key.
    """

    tile: Int[Array, "2"]
    """Rows and columns by which the tile of blue noise is moved."""
    turn: Float[Array, ""]
    """Added to every turn, in turns."""


@jax.jit
def shifts(key: jax.Array) -> Shifts:
    """Uniform shifts."""
    tile = jax.random.randint(jax.random.fold_in(key, 1), (2,), 0, 1 << 16)
    return Shifts(tile, jax.random.uniform(key))


@jax.jit
def turns(
    pixel: Int[Array, "points"], columns: Int[Array, ""], moved: Shifts
) -> Float[Array, "points"]:
    """The turn of each pixel's rays about the normal, in [0, 1): blue noise between pixels."""
    tile = jnp.asarray(blue_noise())
    size = tile.shape[0]
    row, column = pixel // columns, pixel % columns
    value = tile[(row + moved.tile[0]) % size, (column + moved.tile[1]) % size] + moved.turn
    return value - jnp.floor(value)


@partial(jax.jit, static_argnames="samples")
def local_directions(samples: int) -> Float[Array, "samples 3"]:
    """Cosine-weighted directions about +z, of Hammersley points."""
    return sample_cosine(hammersley(samples))


@jax.jit
def turned_frames(
    normal: Float[Array, "points 3"], turn: Float[Array, "points"]
) -> Float[Array, "points 3 3"]:
    """Rows: tangent, bitangent and normal, turned about the normal by ``turn`` turns."""
    tangent, bitangent = frame(normal)
    sine, cosine = sine_cosine(turn[:, None])
    return jnp.stack(
        [cosine * tangent + sine * bitangent, cosine * bitangent - sine * tangent, normal], axis=1
    )


@jax.jit
def world_directions(
    frames: Float[Array, "points 3 3"], local: Float[Array, "samples 3"]
) -> Components:
    """The same local directions in every point's frame."""
    x, y, z = local[:, 0], local[:, 1], local[:, 2]
    f = frames[..., None]
    axes = [f[:, 0, k] * x + f[:, 1, k] * y + f[:, 2, k] * z for k in range(3)]
    return axes[0], axes[1], axes[2]


PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2), (0, 3), (1, 3), (2, 3), (3, 3))
"""The different products of the components of (x, y, z, 1)."""


@jax.jit
def mean_radiance(
    coefficients: Float[Array, "9 3"],
    frames: Float[Array, "points 3 3"],
    local: Float[Array, "samples 3"],
    decision: UInt8[Array, "points samples"],
) -> Float[Array, "points 3"]:
    """Sum of the light over the accepted rays / number of rays; the light is nine harmonics.

    With cosine-weighted rays it is E / pi (eq. 9). Since the local directions are the same at all
    points, the sum over rays is one product of matrices: radiance is d^T M d with d = (x, y, z, 1),
    and its sum that of M with the second moments of the visible rays, turned with the frame.
    """
    extended = jnp.concatenate([local, jnp.ones((local.shape[0], 1))], axis=1)
    products = jnp.stack([extended[:, a] * extended[:, b] for a, b in PAIRS], axis=1)
    visible = (decision == ACCEPT).astype(jnp.float32)
    sums = jnp.dot(visible, products, precision="highest") / local.shape[0]
    moment = {pair: sums[:, k] for k, pair in enumerate(PAIRS)}
    axis = [[frames[:, k, a] for a in range(3)] for k in range(3)]
    # Written out by component: XLA's product of many small matrices is slow on a CPU.
    turned: dict[tuple[int, int], Any] = {(3, 3): moment[3, 3]}
    for a in range(3):
        turned[a, 3] = sum(axis[k][a] * moment[k, 3] for k in range(3))
        along = [sum(axis[l][a] * moment[min(k, l), max(k, l)] for l in range(3)) for k in range(3)]
        for b in range(a, 3):
            turned[a, b] = sum(axis[k][b] * along[k] for k in range(3))
    matrices = quadratic_form(coefficients)
    channels = [
        sum((1.0 if a == b else 2.0) * matrices[c, a, b] * turned[a, b] for a, b in PAIRS)
        for c in range(coefficients.shape[1])
    ]
    return jnp.stack(channels, axis=-1)
