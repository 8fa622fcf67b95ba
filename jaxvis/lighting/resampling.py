"""Lat-long maps turned about the vertical and resized, exactly: piecewise-constant in and out."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

Pieces = tuple[Int[np.ndarray, "pieces"], Int[np.ndarray, "pieces"], Float[np.ndarray, "pieces"]]


def rotate(
    radiance: Float[Array, "height width channels"], yaw: float | Float[Array, ""]
) -> Float[Array, "height width channels"]:
    """The map turned by ``yaw`` radians about +Y, counter-clockwise seen from above (+Z to +X).

    By whole texels it is a roll; otherwise each texel receives the average of what came to lie
    over it, which keeps all energy and moves its centroid exactly.
    """
    width = radiance.shape[1]
    if isinstance(yaw, (int, float)):
        turned = -yaw * width / (2.0 * np.pi)
        if abs(turned - round(turned)) < 1e-6:
            turned = round(turned)
        whole = int(np.floor(turned))
        part = float(turned - whole)
    else:
        turned = -jnp.asarray(yaw) * (width / (2.0 * jnp.pi))
        whole = jnp.floor(turned).astype(jnp.int32)
        part = turned - jax.lax.stop_gradient(jnp.floor(turned))
    # jnp.roll would be compiled for each number of texels.
    rolled = jnp.take(radiance, (np.arange(width) - whole) % width, axis=1, mode="clip")
    return (1.0 - part) * rolled + part * jnp.roll(rolled, 1, axis=1)


def resize(
    radiance: Float[Array, "rows columns channels"], height: int, width: int
) -> Float[Array, "height width channels"]:
    """Average radiance over the texels of a ``height`` x ``width`` map: energy is kept exactly."""
    rows, columns = radiance.shape[:2]
    if height != rows:
        pieces = box_overlap(_cosines(rows), _cosines(height))
        radiance = _gather(radiance, *pieces, count=height)
    if width != columns:
        pieces = box_overlap(np.linspace(0.0, 1.0, columns + 1), np.linspace(0.0, 1.0, width + 1))
        turned = _gather(radiance.transpose(1, 0, 2), *pieces, count=width)
        radiance = turned.transpose(1, 0, 2)
    return radiance


def box_overlap(
    source: Float[np.ndarray, "source_edges"], target: Float[np.ndarray, "target_edges"]
) -> Pieces:
    """How the cells of one interval's partition average into those of another (host, float64).

    Returns (source cell, target cell, share of the target cell), a row for each overlap, sorted.
    """
    edges = np.union1d(source, target)
    middle = 0.5 * (edges[:-1] + edges[1:])
    cells = [np.clip(np.searchsorted(e, middle) - 1, 0, len(e) - 2) for e in (source, target)]
    length = np.diff(edges)
    covered = np.bincount(cells[1], length, len(target) - 1)
    return cells[0], cells[1], length / covered[cells[1]]


def _cosines(height: int) -> Float[np.ndarray, "edges"]:
    edges = -np.cos(np.pi * np.arange(height + 1) / height)
    edges[0], edges[-1] = -1.0, 1.0
    return edges


@partial(jax.jit, static_argnames="count")
def _gather(values, source, target, share, *, count: int):
    weight = jnp.asarray(share, values.dtype)[:, None, None]
    return jax.ops.segment_sum(
        values[source] * weight, target, num_segments=count, indices_are_sorted=True
    )
