"""Reading signed distances along any direction (array code)."""

import jax.numpy as jnp
from jaxtyping import Array, Float, Float16

from jaxvis.sphere.hemisphere_grid import distance_at


def signed_distances_at(
    signed_distance: Float16[Array, "samples n n"],
    frames: Float[Array, "samples 3 3"],
    directions: Float[Array, "*samples directions 3"],
) -> Float[Array, "samples directions"]:
    """Every sample's distance along each of some unit world directions, radians; directions are
    the same for all samples, or [samples, directions, 3].

    Below a sample's horizon they go on (:func:`jaxvis.sphere.hemisphere_grid.distance_at`), so that
    what other samples see above theirs can be interpolated.
    """
    count = signed_distance.shape[0]
    x, y, z = (
        frames[:, row, 0:1] * directions[..., 0]
        + frames[:, row, 1:2] * directions[..., 1]
        + frames[:, row, 2:3] * directions[..., 2]
        for row in range(3)
    )
    return distance_at(signed_distance, jnp.arange(count)[:, None], x, y, z)
