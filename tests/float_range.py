"""Numbers from all of float32's range, and a check that values and gradients stay finite there.

``JAXVIS_EXAMPLES=500 pytest tests/sphere/test_float_range.py`` runs many more examples.
"""

import functools
import os
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from jaxtyping import Float32

ROWS = 64
"""Points of one example: programs are compiled once, for this many."""

SMALLEST = float(np.finfo(np.float32).tiny)
"""The smallest normal number; XLA takes smaller ones for 0 on the CPU."""

LARGEST = float(np.finfo(np.float32).max)

RANDOM = st.integers(0, 2**32 - 1).map(np.random.default_rng)
"""What an example is drawn with: thousands of numbers would be more than hypothesis holds."""

whole_range = settings(
    max_examples=int(os.environ.get("JAXVIS_EXAMPLES", "10")),
    deadline=None,
    derandomize=True,
    phases=[Phase.generate],  # seeds do not shrink
    suppress_health_check=[HealthCheck.too_slow],  # the first example compiles
)


def magnitudes(
    random: np.random.Generator, *shape: int, least: float = SMALLEST, most: float = LARGEST
) -> Float32[np.ndarray, "..."]:
    """Numbers >= 0: 0, subnormal, the ends of the range, 1, or of any size from least to most."""
    ends = np.array([0.0, 1e-45, 1e-40, least, most, 1.0])
    chosen = ends[random.integers(len(ends), size=shape)]
    any_size = np.exp(random.uniform(np.log(least), np.log(most), shape))
    alike = np.exp(random.uniform(np.log(least), np.log(most))) * random.uniform(0.5, 1.0, shape)
    kind = random.integers(4, size=shape)
    drawn = np.select([kind == 0, kind == 1, kind == 2], [chosen, any_size, alike], 1.0)
    drawn = np.where(kind == 3, random.uniform(0.0, min(1.0, most), shape), drawn)
    return np.minimum(drawn, most).astype(np.float32)


def numbers(
    random: np.random.Generator, *shape: int, least: float = SMALLEST, most: float = LARGEST
) -> Float32[np.ndarray, "..."]:
    """:func:`magnitudes` of either sign."""
    sign = random.choice(np.array([-1.0, 1.0], np.float32), shape)
    return sign * magnitudes(random, *shape, least=least, most=most)


def vectors(
    random: np.random.Generator, *shape: int, least: float = SMALLEST, most: float = LARGEST
) -> Float32[np.ndarray, "*shape 3"]:
    """Vectors of any length: the zero vector, or with components from least to most, or 0."""
    drawn = numbers(random, *shape, 3, least=least, most=most).astype(np.float64)
    small = np.max(np.abs(drawn), axis=-1, keepdims=True) < least
    drawn = np.where(small, np.where(random.random((*shape, 1)) < 0.5, 0.0, least), drawn)
    # Every other one has components of one size, and so an ordinary direction.
    length = np.exp(random.uniform(np.log(least), np.log(most), (*shape, 1)))
    ordinary = length * directions(random, *shape)
    ordinary = np.where(length < 2.0 * least, 0.0, ordinary)
    drawn = np.where(random.random((*shape, 1)) < 0.5, drawn, ordinary)
    drawn = np.where((np.abs(drawn) < least) & (least > SMALLEST), 0.0, drawn)
    return drawn.astype(np.float32)


def directions(
    random: np.random.Generator, *shape: int, least: float = SMALLEST
) -> Float32[np.ndarray, "*shape 3"]:
    """Unit vectors: along an axis, with other components from ``least``, or just anywhere."""
    drawn = random.normal(size=(*shape, 3))
    tiny = numbers(random, *shape, 3, least=least, most=1.0) * (random.random((*shape, 3)) < 0.7)
    axis = np.eye(3)[random.integers(3, size=shape)] * random.choice([-1.0, 1.0], (*shape, 1))
    near = np.where(np.abs(axis) > 0.0, axis, tiny * 10.0 ** -random.integers(0, 4, (*shape, 1)))
    drawn = np.where(random.random((*shape, 1)) < 0.6, near, drawn)
    return (drawn / np.linalg.norm(drawn, axis=-1, keepdims=True)).astype(np.float32)


def related(
    random: np.random.Generator, to: Float32[np.ndarray, "*shape 3"]
) -> Float32[np.ndarray, "*shape 3"]:
    """Unit vectors, each of them equal, opposite, at right angles, or next to one given, or any."""
    anywhere = directions(random, *to.shape[:-1])
    across = np.cross(to.astype(np.float64), anywhere)
    length = np.linalg.norm(across, axis=-1, keepdims=True)
    across = np.where(length > 1e-6, across / np.maximum(length, 1e-6), anywhere)
    step = magnitudes(random, *to.shape[:-1], 1, most=1e-2)
    beside = to + step * across
    beside /= np.linalg.norm(beside, axis=-1, keepdims=True)
    kind = random.integers(6, size=(*to.shape[:-1], 1))
    drawn = np.select([kind == k for k in range(5)], [to, -to, across, beside, -beside], anywhere)
    return drawn.astype(np.float32)


def is_float(argument: object) -> bool:
    """Whether all the arrays of an argument are of real numbers."""
    leaves = jax.tree.leaves(argument)
    return bool(leaves) and all(
        jnp.issubdtype(jnp.result_type(leaf), jnp.inexact) for leaf in leaves
    )


@functools.partial(jax.jit, static_argnums=0)
def values_and_gradients(function: Callable, *arguments):
    """What a function returns, and the gradient of its weighted sum by its float arguments."""
    by = tuple(k for k, argument in enumerate(arguments) if is_float(argument))

    def total(*arguments):
        values = function(*arguments)
        leaves = [leaf for leaf in jax.tree.leaves(values) if is_float(leaf)]
        # Not all alike: gradients would cancel.
        weights = (jnp.cos(1.0 + jnp.arange(leaf.size)).reshape(leaf.shape) for leaf in leaves)
        return sum(jnp.sum(w * leaf) for w, leaf in zip(weights, leaves, strict=True)), values

    gradients, values = jax.grad(total, argnums=by, has_aux=True)(*arguments)
    return values, gradients


def require_finite(function: Callable, *arguments):
    """The values of a function, which are finite as are their gradients by all float arguments.

    The function is a module's own, so that it is compiled once.
    """
    values, gradients = values_and_gradients(function, *arguments)
    for what, found in (("value", values), ("gradient", gradients)):
        for path, leaf in jax.tree_util.tree_leaves_with_path(found):
            wrong = np.argwhere(~np.isfinite(np.asarray(leaf)))
            if len(wrong):
                row = wrong[0][0] if wrong.shape[1] else 0
                lines = [f"{what}{jax.tree_util.keystr(path)} of {function} in {len(wrong)} places"]
                for place, argument in jax.tree_util.tree_leaves_with_path(arguments):
                    shown = argument[row] if np.ndim(argument) and row < len(argument) else argument
                    lines.append(
                        f"argument{jax.tree_util.keystr(place)} {np.asarray(shown)!r:.300}"
                    )
                raise AssertionError("\n".join(lines) + f"\nfound: {np.asarray(leaf)[row]!r:.300}")
    return values
