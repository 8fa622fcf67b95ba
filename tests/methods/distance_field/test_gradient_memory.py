"""Gradients keep what one block of pixels and lobes needs, however many there are."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxvis.methods.distance_field.shade import (
    LOBES_AT_ONCE,
    PIXELS_AT_ONCE,
    VERTICES_AT_ONCE,
    Fragments,
    Samples,
    radiance_of,
)
from jaxvis.reflectance import Lambert, MaterialValues
from jaxvis.sphere.gaussians import SphericalGaussians

VERTICES = 16 * VERTICES_AT_ONCE


def zeros(*shape, dtype=np.float32):
    return jnp.zeros(shape, dtype)


def held(blocks: int, lobes: int) -> int:
    """Bytes beside arguments and results, by XLA's own account; nothing is computed."""
    pixels = blocks * PIXELS_AT_ONCE
    vectors = (zeros(pixels, 3) for _ in range(4))
    material = MaterialValues(zeros(pixels, 3), zeros(pixels, 3), zeros(pixels))
    fragments = Fragments(zeros(pixels, 3, dtype=np.int32), *vectors, material)
    samples = Samples(zeros(64, 16, 16, dtype=np.float16), zeros(64, 3, 3), zeros(64, 3))
    near, weights = zeros(VERTICES, 4, dtype=np.int32), zeros(VERTICES, 4)
    light = SphericalGaussians(zeros(lobes, 3), zeros(lobes), zeros(lobes, 3))

    leaves, structure = jax.tree.flatten((samples, near, weights, fragments, light))

    def mean(amplitude, *others):
        given = structure.unflatten((*others, amplitude))
        return jnp.mean(radiance_of(*given, reflectance=Lambert()))

    program = jax.jit(jax.grad(mean)).lower(leaves[-1], *leaves[:-1])
    return program.compile().memory_analysis().temp_size_in_bytes


def test_memory_of_gradients_does_not_grow_with_blocks_of_pixels_or_lobes():
    base = held(4, LOBES_AT_ONCE)
    of_vertices = 4 * VERTICES * LOBES_AT_ONCE  # what one block of lobes has for all pixels
    assert base > of_vertices
    assert held(8, LOBES_AT_ONCE) - base < 4 * PIXELS_AT_ONCE * 400
    assert held(4, 4 * LOBES_AT_ONCE) - base < of_vertices
