"""Frames are orthonormal and right-handed everywhere; to_world and to_local undo each other."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxvis.sphere import frames

normalize = jax.jit(frames.normalize)
frame = jax.jit(frames.frame)
to_world = jax.jit(frames.to_world)
to_local = jax.jit(frames.to_local)
reflect = jax.jit(frames.reflect)


def directions(count=500):
    random = np.random.default_rng(1).normal(size=(count, 3))
    random /= np.linalg.norm(random, axis=1, keepdims=True)
    axes = np.concatenate([np.eye(3), -np.eye(3), [[0.0, 0.0, -0.0]]])[:6]
    almost_down = np.array([[1e-4, 0.0, -1.0], [0.0, -1e-7, -1.0], [1e-20, 0.0, -1.0]])
    equator = np.array([[0.6, 0.8, 0.0], [0.6, 0.8, -0.0], [0.6, 0.8, -1e-8]])
    return jnp.asarray(np.concatenate([random, axes, almost_down, equator]), jnp.float32)


def test_frames_on_the_host_are_those_of_the_array_code():
    normals = np.asarray(directions())
    tangent, bitangent = frame(jnp.asarray(normals))
    expected = np.stack([tangent, bitangent, normals], axis=1)
    found = frames.frames_on_host(normals)
    np.testing.assert_allclose(found, expected, atol=2e-6)


def test_dot_is_the_scalar_product():
    a = directions()
    b = jnp.roll(a, 1, axis=0)
    np.testing.assert_allclose(frames.dot(a, b), np.einsum("ni,ni->n", a, b), atol=1e-6)


def test_normalize_gives_unit_vectors_and_keeps_zero():
    vectors = directions() * jnp.linspace(1e-3, 1e3, len(directions()))[:, None]
    np.testing.assert_allclose(normalize(vectors), directions(), atol=3e-7)
    np.testing.assert_array_equal(normalize(jnp.zeros((2, 3))), np.zeros((2, 3)))


def test_the_gradient_of_normalize_is_right_and_zero_at_zero():
    jacobian = jax.jit(jax.jacfwd(normalize))
    np.testing.assert_array_equal(jacobian(jnp.zeros(3)), np.zeros((3, 3)))
    x = np.array([1.0, -2.0, 2.0])
    expected = (np.eye(3) - np.outer(x, x) / 9.0) / 3.0
    np.testing.assert_allclose(jacobian(jnp.asarray(x, jnp.float32)), expected, atol=1e-6)


def test_frame_is_orthonormal_and_right_handed():
    normal = np.asarray(directions(), np.float64)
    tangent, bitangent = (np.asarray(v, np.float64) for v in frame(directions()))
    for a, b in ((tangent, bitangent), (tangent, normal), (bitangent, normal)):
        np.testing.assert_allclose(np.sum(a * b, axis=1), 0.0, atol=5e-7)
    np.testing.assert_allclose(np.linalg.norm(tangent, axis=1), 1.0, atol=5e-7)
    np.testing.assert_allclose(np.cross(tangent, bitangent), normal, atol=1e-6)


def test_local_and_world_undo_each_other():
    normal = directions()
    vectors = jnp.roll(normal, 7, axis=0)
    there_and_back = to_world(to_local(vectors, normal), normal)
    np.testing.assert_allclose(there_and_back, vectors, atol=1e-6)
    up = jnp.broadcast_to(jnp.array([0.0, 0.0, 1.0]), normal.shape)
    np.testing.assert_array_equal(to_world(up, normal), normal)
    np.testing.assert_allclose(to_local(normal, normal), up, atol=1e-6)


def test_reflect_mirrors_about_the_normal():
    normal = directions()
    view = jnp.roll(normal, 3, axis=0)
    mirrored = reflect(view, normal)
    np.testing.assert_allclose(frames.dot(mirrored, normal), frames.dot(view, normal), atol=1e-6)
    np.testing.assert_allclose(reflect(mirrored, normal), view, atol=1e-6)
    half = np.asarray(mirrored + view) / 2.0
    np.testing.assert_allclose(np.cross(half, normal), 0.0, atol=1e-6)
