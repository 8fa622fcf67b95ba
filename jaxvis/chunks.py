"""Functions of many points: in fixed-size chunks, which bounds memory, or on the host."""

from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

T = TypeVar("T")


def chunked_map(
    function: Callable[[Any], Any], points: Any, chunk: int, *, remat: bool = True
) -> Any:
    """Applies ``function`` to ``chunk`` points at a time and joins the results.

    Args:
        function: maps a pytree whose leaves are ``[chunk, ...]`` to one whose leaves are
            ``[chunk, ...]``; each point's result must not depend on the other points.
        points: pytree whose leaves are ``[points, ...]``; the last chunk is padded by
            repeating the last point and the padding's results are dropped.
        chunk: points per call, at least 1: memory is that of one call.
        remat: recompute inside each chunk when differentiating, so that gradients are bounded too.

    Returns:
        A pytree whose leaves are ``[points, ...]``.
    """
    if chunk < 1:
        raise ValueError(f"chunk must be at least 1, got {chunk}")
    count = jax.tree.leaves(points)[0].shape[0]
    body = jax.checkpoint(function) if remat else function  # pyright: ignore
    if count <= chunk:
        return body(points)
    blocks = -(-count // chunk)
    padded = jax.tree.map(lambda leaf: _pad_to(leaf, blocks * chunk), points)
    split = jax.tree.map(lambda leaf: leaf.reshape(blocks, chunk, *leaf.shape[1:]), padded)
    mapped = jax.lax.map(body, split)
    return jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:])[:count], mapped)


def _pad_to(leaf: jax.Array, count: int) -> jax.Array:
    missing = count - leaf.shape[0]
    return jnp.concatenate([leaf, jnp.repeat(leaf[-1:], missing, axis=0)]) if missing else leaf


def block_of(tree: T, start: int, count: int) -> T:
    """``count`` rows from ``start`` on, the last one repeated where there are no more (host)."""

    def rows(leaf: np.ndarray) -> np.ndarray:
        part = leaf[start : start + count]
        missing = count - len(part)
        return np.concatenate([part, part[-1:].repeat(missing, axis=0)]) if missing else part

    return map_on_host(rows, tree)


def map_on_host(function: Callable[[np.ndarray], np.ndarray], tree: T) -> T:
    """Every leaf through a NumPy function, and all of them to the device together.

    For rows whose number changes from frame to frame: compiled code would be compiled for each.
    """
    leaves, structure = jax.tree.flatten(tree)
    return structure.unflatten(jax.device_put([function(np.asarray(leaf)) for leaf in leaves]))
