"""Octahedral map: the test vectors of the specification, areas, and what lies across each edge."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxvis.sphere import octahedral

encode = jax.jit(octahedral.encode)
decode = jax.jit(octahedral.decode)
jacobian = jax.jit(octahedral.jacobian)
texel = jax.jit(octahedral.texel, static_argnames="size")

VECTORS = [
    ((0, 0, 1), (0.0, 0.0), (9, 9)),
    ((0, 0, -1), (1.0, 1.0), (17, 17)),
    ((1, 2, 3), (1 / 6, 1 / 3), (10, 12)),
    ((1, -2, -3), (2 / 3, -5 / 6), (15, 1)),
    ((-1, -2, -0.5), (-3 / 7, -5 / 7), (5, 2)),
]


@pytest.mark.parametrize(("vector", "point", "cell"), VECTORS)
def test_vectors_of_the_specification(vector, point, cell):
    direction = jnp.array([vector], jnp.float32)
    np.testing.assert_allclose(encode(direction)[0], point, atol=1e-6)
    i, j = texel(direction, size=18)
    assert (int(i[0]), int(j[0])) == cell
    unit = np.array(vector) / np.linalg.norm(vector)
    np.testing.assert_allclose(decode(jnp.array([point])), [unit], atol=1e-6)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.tuples(*[st.floats(-1.0, 1.0, width=32)] * 3).filter(lambda v: sum(map(abs, v)) > 1e-3))
def test_decode_undoes_encode(vector):
    direction = np.float32(vector)
    point = encode(jnp.asarray(direction))
    assert np.all(np.abs(point) <= 1.0 + 1e-6)
    unit = direction / np.linalg.norm(direction)
    np.testing.assert_allclose(decode(point), unit, atol=1e-6)


@pytest.mark.parametrize("size", [1, 2, 5, 18])
def test_texel_centres_are_in_their_texels(size):
    centres = octahedral.texel_directions(size)
    i, j = texel(jnp.asarray(centres, jnp.float32), size=size)
    expected = np.meshgrid(np.arange(size), np.arange(size), indexing="ij")
    if size % 2:  # the centre of an odd map's corner texel is on no edge, its middle is +z
        np.testing.assert_allclose(centres[size // 2, size // 2], [0, 0, 1], atol=1e-15)
    np.testing.assert_array_equal(i, expected[0])
    np.testing.assert_array_equal(j, expected[1])


@pytest.mark.parametrize("size", [1, 7, 18, 255])
def test_texels_of_directions_given_by_component(size):
    """The same as of vectors, whatever their length, and on the axes and the map's edges."""
    rng = np.random.default_rng(size)
    vectors = np.concatenate([rng.normal(size=(500, 3)), np.eye(3), -np.eye(3), [[1, -1, 0]]])
    vectors = jnp.asarray(vectors * rng.uniform(0.1, 10.0, (len(vectors), 1)), jnp.float32)
    x, y, z = vectors.reshape(-1, 3).T
    found = octahedral.texel_of_components(x, y, z, size)
    for one, other in zip(found, octahedral.texel(vectors, size), strict=True):
        assert one.dtype == jnp.int32
        assert one.min() >= 0
        assert one.max() < size
        np.testing.assert_array_equal(one, other)
    blocks = [jnp.reshape(axis[:500], (20, 25)) for axis in (x, y, z)]
    i, j = octahedral.texel_of_components(*blocks, size)
    np.testing.assert_array_equal(i.reshape(-1), found[0][:500])
    np.testing.assert_array_equal(j.reshape(-1), found[1][:500])


def test_jacobian_is_the_area_that_decode_stretches_to():
    points = jnp.asarray(np.random.default_rng(0).uniform(-1.0, 1.0, (300, 2)), jnp.float32)
    tangents = np.asarray(jax.jit(jax.vmap(jax.jacfwd(decode)))(points), np.float64)
    area = np.linalg.norm(np.cross(tangents[..., 0], tangents[..., 1]), axis=-1)
    np.testing.assert_allclose(jacobian(points), area, rtol=2e-5)
    extremes = jnp.array([[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [1 / 3, 1 / 3], [-2 / 3, 2 / 3]])
    expected = [1.0, 1.0, 1.0, np.sqrt(27.0), np.sqrt(27.0)]
    np.testing.assert_allclose(jacobian(extremes), expected, rtol=1e-5)


@pytest.mark.parametrize("size", [1, 2, 5, 18])
def test_solid_angles_are_exact(size):
    exact = octahedral.texel_solid_angles(size)
    assert abs(exact.sum() - 4.0 * np.pi) < 1e-12
    fine = 720 // size
    line = (2.0 * np.arange(size * fine) + 1.0) / (size * fine) - 1.0
    grid = jnp.asarray(np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1), jnp.float32)
    density = np.asarray(jacobian(grid), np.float64).reshape(size, fine, size, fine)
    quadrature = density.sum(axis=(1, 3)) * (2.0 / (size * fine)) ** 2
    np.testing.assert_allclose(exact, quadrature, rtol=2e-4)
    if size == 18:
        assert abs(exact.min() - 0.0155) < 1e-4
        assert abs(exact.max() - 0.0613) < 1e-4


def test_map_edges_are_the_same_directions_mirrored():
    t = jnp.linspace(-1.0, 1.0, 21)
    one = jnp.ones_like(t)
    for a, b in (
        ((-one, t), (-one, -t)),
        ((one, t), (one, -t)),
        ((t, one), (-t, one)),
        ((t, -one), (-t, -one)),
    ):
        left, right = (decode(jnp.stack(p, axis=-1)) for p in (a, b))
        np.testing.assert_allclose(left, right, atol=1e-6)


def test_padding_follows_the_rule_of_the_specification():
    n = 6
    index = np.arange(n * n).reshape(n, n)
    padded = octahedral.pad(index)
    assert padded.shape == (n + 2, n + 2)
    np.testing.assert_array_equal(padded[1:-1, 1:-1], index)
    for k in range(n):
        assert padded[0, k + 1] == index[0, n - 1 - k]
        assert padded[n + 1, k + 1] == index[n - 1, n - 1 - k]
        assert padded[k + 1, 0] == index[n - 1 - k, 0]
        assert padded[k + 1, n + 1] == index[n - 1 - k, n - 1]
    corners = [padded[0, 0], padded[0, -1], padded[-1, 0], padded[-1, -1]]
    assert corners == [index[-1, -1], index[-1, 0], index[0, -1], index[0, 0]]


@pytest.mark.parametrize("border", [1, 3])
def test_padding_continues_the_sphere(border):
    """Stepping over an edge goes no further on the sphere than stepping inside the map."""
    n = 12
    centres = octahedral.texel_directions(n)
    padded = centres[octahedral.pad_indices(n, border)]

    def longest_step(grid):
        along = np.linalg.norm(np.diff(grid, axis=0), axis=-1).max()
        return max(along, np.linalg.norm(np.diff(grid, axis=1), axis=-1).max())

    assert longest_step(padded) <= longest_step(centres) + 1e-12
    wrapped = np.pad(centres, ((border, border), (border, border), (0, 0)), mode="wrap")
    assert longest_step(wrapped) > 1.5 * longest_step(centres)  # a torus is not a sphere


def test_dilation_covers_every_neighbour_on_the_sphere():
    """Padding then a 3 x 3 maximum marks all texels that touch a marked one; cutting does not."""
    n = 10
    rng = np.random.default_rng(3)
    line = np.linspace(-1.0, 1.0, n + 1)
    corners = decode(
        jnp.asarray(np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1), jnp.float32)
    )
    corners = np.round(np.asarray(corners), 4) + 0.0

    def vertices(i, j):
        return {tuple(corners[i + a, j + b]) for a in (0, 1) for b in (0, 1)}

    def dilate(padded):
        return np.max([padded[a : a + n, b : b + n] for a in range(3) for b in range(3)], axis=0)

    cells = [(0, 0), (0, 4), (9, 7), (3, 9), (5, 5), *map(tuple, rng.integers(0, n, (5, 2)))]
    cut_misses = 0
    for cell in cells:
        mask = np.zeros((n, n), bool)
        mask[cell] = True
        touching = np.array(
            [[bool(vertices(*cell) & vertices(i, j)) for j in range(n)] for i in range(n)]
        )
        np.testing.assert_array_equal(dilate(octahedral.pad(mask)), touching)
        cut_misses += int(np.sum(touching & ~dilate(np.pad(mask, 1))))
    assert cut_misses > 0


def test_padding_takes_batches_and_both_kinds_of_array():
    masks = np.random.default_rng(0).random((3, 4, 8, 8)) > 0.5
    on_host, on_device = octahedral.pad(masks, 2), octahedral.pad(jnp.asarray(masks), 2)
    assert isinstance(on_host, np.ndarray)
    assert on_host.dtype == bool
    np.testing.assert_array_equal(on_host, on_device)
    np.testing.assert_array_equal(on_host[2, 1], octahedral.pad(masks[2, 1], 2))
    with pytest.raises(ValueError, match="border"):
        octahedral.pad(masks, 9)
