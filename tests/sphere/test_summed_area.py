"""Sums over boxes and polygons against plain sums over texels, in float64."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.sphere import SummedAreaTable, latlong

HEIGHT, WIDTH = 16, 32
OCTANT_TEXELS = [(r, c) for r in (5, 10) for c in (4, 12, 20, 28)]
POLE_TEXELS = [(0, 7), (15, 9)]
SEAM_TEXELS = [(7, 0), (8, 31)]
lookup = jax.jit(SummedAreaTable.lookup)
box = jax.jit(SummedAreaTable.box)
build = jax.jit(SummedAreaTable.build)


def as_jax(array):
    return jnp.asarray(array, jnp.float32)


def random_values(channels=3):
    values = np.random.default_rng(0).random((HEIGHT, WIDTH, channels)) ** 6
    return values * latlong.row_solid_angles(HEIGHT, WIDTH)[:, None, None]


def bright(row, column):
    values = np.zeros((HEIGHT, WIDTH, 1))
    values[row, column] = 1.0
    return build(as_jax(values))


def overlap(n, start, end):
    """The share of each of n unit intervals that [start, end] covers."""
    edges = np.clip(np.arange(n + 1.0), start, end)
    return np.diff(edges)


def test_corners_are_prefix_sums():
    values = random_values().astype(np.float32)
    table = build(as_jax(values))
    assert (table.height, table.width) == (HEIGHT, WIDTH)
    expected = np.pad(values.astype(np.float64).cumsum(0).cumsum(1), ((1, 0), (1, 0), (0, 0)))
    np.testing.assert_allclose(table.corners, expected, rtol=1.2e-7, atol=0)
    np.testing.assert_array_equal(table.total, table.corners[-1, -1])


def test_sums_are_exact_to_float32_where_plain_ones_are_not():
    """A bright texel first and a million dim ones after it."""
    values = np.full((512, 1024, 1), 1e-7, np.float32)
    values[0, 0] = 1.0
    exact = values.astype(np.float64).cumsum(0).cumsum(1)
    error = np.abs(np.asarray(build(as_jax(values)).corners[1:, 1:]) - exact).max()
    assert error < 1.2e-7 * exact[-1, -1]
    plain = values.cumsum(0, dtype=np.float32).cumsum(1, dtype=np.float32)
    assert np.abs(plain - exact).max() > 2e-6 * exact[-1, -1]


def test_boxes_are_sums_of_covered_texels():
    values = random_values()
    table = build(as_jax(values))
    rng = np.random.default_rng(1)
    u, v = np.sort(rng.random((2, 60)), axis=0), np.sort(rng.random((2, 60)) * HEIGHT, axis=0)
    got = box(table, as_jax(u[0]), as_jax(v[0]), as_jax(u[1]), as_jax(v[1]))
    for k in range(60):
        rows = overlap(HEIGHT, v[0, k], v[1, k])
        columns = overlap(WIDTH, u[0, k] * WIDTH, u[1, k] * WIDTH)
        expected = np.einsum("r,c,rcx->x", rows, columns, values)
        np.testing.assert_allclose(got[k], expected, atol=1e-6 * values.sum(axis=(0, 1)).max())


@pytest.mark.parametrize("texel", OCTANT_TEXELS + POLE_TEXELS + SEAM_TEXELS)
def test_one_bright_texel_is_where_the_map_says(texel):
    """A box around the direction of the texel's centre holds it, boxes beside it hold nothing."""
    table = bright(*texel)
    u, theta = latlong.coordinates(as_jax(latlong.texel_directions(HEIGHT, WIDTH)[texel]))
    v = theta * HEIGHT / np.pi
    du, dv = 0.5 / WIDTH + 1e-6, 0.5 + 1e-4
    whole = box(table, u - du, jnp.maximum(v - dv, 0.0), u + du, jnp.minimum(v + dv, HEIGHT))
    np.testing.assert_allclose(whole, 1.0, atol=1e-4)
    quarter = box(table, u, v, u + du, jnp.minimum(v + dv, HEIGHT))
    np.testing.assert_allclose(quarter, 0.25, atol=1e-3)
    for shift in (-2 * du, 2 * du):
        beside = box(table, u + shift - du, v - 0.4, u + shift + du, v + 0.4)
        np.testing.assert_allclose(beside, 0.0, atol=1e-3)
    for u0 in (-3.0, -0.7, 0.2, 5.4):  # any whole turn holds it once
        turn = box(table, u0, 0.0, u0 + 1.0, float(HEIGHT))
        np.testing.assert_allclose(turn, 1.0, atol=1e-6)


def test_u_is_unwrapped_over_the_seam():
    values = random_values()
    table = build(as_jax(values))
    rows = overlap(HEIGHT, 3.3, 9.1)
    columns = overlap(WIDTH, 0.9 * WIDTH, WIDTH) + overlap(WIDTH, 0.0, 0.25 * WIDTH)
    expected = np.einsum("r,c,rcx->x", rows, columns, values)
    scale = values.sum()
    for turn in (-2.0, 0.0, 3.0):
        got = box(table, as_jax(turn + 0.9), as_jax(3.3), as_jax(turn + 1.25), as_jax(9.1))
        np.testing.assert_allclose(got, expected, atol=2e-6 * scale)
    forwards = lookup(table, as_jax(1.0), as_jax(4.2))
    from_seam = lookup(table, as_jax(np.nextafter(np.float32(1), np.float32(0))), as_jax(4.2))
    np.testing.assert_allclose(forwards, from_seam, rtol=1e-5)
    np.testing.assert_array_equal(lookup(table, as_jax(0.0), as_jax(4.2)), 0.0)


def cap_polygon(centre, half_angle, count=256):
    """A circle about ``centre``, counter-clockwise seen from outside (float64)."""
    centre = np.asarray(centre, np.float64) / np.linalg.norm(centre)
    t = np.cross(centre, np.roll(centre, 1) + [0.1, 0.2, 0.3])
    t /= np.linalg.norm(t)
    b = np.cross(centre, t)  # (t, b, centre) is right-handed
    a = 2.0 * np.pi * (np.arange(count) + 0.37) / count
    ring = np.cos(a)[:, None] * t + np.sin(a)[:, None] * b
    return np.cos(half_angle) * centre + np.sin(half_angle) * ring


def polygon_integral(table, points):
    """The rule in the class's documentation."""
    u, theta = (np.asarray(c, np.float64) for c in latlong.coordinates(as_jax(points)))
    v = theta * table.height / np.pi
    steps = np.mod(np.roll(u, -1) - u + 0.5, 1.0) - 0.5
    u = u[0] + np.concatenate([[0.0], np.cumsum(steps)])
    v = np.append(v, v[0])
    turns = np.round(u[-1] - u[0])

    def s(u, v):
        return np.asarray(lookup(table, as_jax(u), as_jax(v)), np.float64)

    contour = 0.5 * np.sum(s(u[1:], v[:-1]) - s(u[:-1], v[1:]), axis=0)
    contour += 0.5 * (s(u[-1:], v[:1]) - s(u[:1], v[:1]))[0]
    return max(turns, 0.0) * np.asarray(table.total, np.float64) - contour


CENTRES = [
    *(latlong.texel_directions(HEIGHT, WIDTH)[t] for t in OCTANT_TEXELS + SEAM_TEXELS),
    *([0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.2, 1.0, 0.1], [-0.1, -1.0, 0.3]),
]


@pytest.mark.parametrize("centre", CENTRES, ids=[str(k) for k in range(len(CENTRES))])
def test_polygons_under_uniform_light(centre):
    """A cap of half angle 0.7: integral 2 pi (1 - cos 0.7), n . integral of l = pi sin^2 0.7."""
    height = 128
    l = latlong.texel_directions(height, 2 * height)
    angles = latlong.row_solid_angles(height, 2 * height)[:, None, None]
    table = build(as_jax(np.concatenate([np.ones_like(l[..., :1]), l], axis=-1) * angles))
    centre = np.asarray(centre, np.float64) / np.linalg.norm(centre)
    points = cap_polygon(centre, 0.7)
    integral = polygon_integral(table, points)
    assert abs(integral[0] - 1.477540) < 0.003 * 1.477540
    assert abs(integral[1:] @ centre - 1.303813) < 0.003 * 1.303813
    backwards = polygon_integral(table, points[::-1])
    assert abs(backwards[0] - 1.477540) > 1.0  # the sense of the walk matters


@pytest.mark.parametrize("texel", OCTANT_TEXELS + POLE_TEXELS + SEAM_TEXELS)
def test_polygons_hold_one_bright_texel_or_do_not(texel):
    table = bright(*texel)
    centre = latlong.texel_directions(HEIGHT, WIDTH)[texel]
    around = polygon_integral(table, cap_polygon(centre, 0.5))
    np.testing.assert_allclose(around, 1.0, atol=1e-3)
    elsewhere = polygon_integral(table, cap_polygon(-centre, 0.5))
    np.testing.assert_allclose(elsewhere, 0.0, atol=1e-3)


def test_gradients_with_respect_to_the_light_and_the_place():
    values = as_jax(random_values(1))

    def integral(values, u, v):
        return SummedAreaTable.build(values).lookup(u, v)[0]

    u, v = jnp.float32(0.43), jnp.float32(9.6)
    in_light, in_u, in_v = jax.jit(jax.grad(integral, argnums=(0, 1, 2)))(values, u, v)
    rows, columns = overlap(HEIGHT, 0.0, 9.6), overlap(WIDTH, 0.0, 0.43 * WIDTH)
    np.testing.assert_allclose(in_light[..., 0], np.outer(rows, columns), atol=1e-5)
    values = np.asarray(values, np.float64)[..., 0]
    column, row = int(0.43 * WIDTH), 9
    np.testing.assert_allclose(in_u, WIDTH * (rows @ values[:, column]), rtol=1e-3)
    np.testing.assert_allclose(in_v, values[row] @ columns, rtol=1e-3)


def test_tables_of_several_lights_can_be_mapped_over():
    values = as_jax(np.stack([random_values(), 2.0 * random_values()]))
    tables = jax.jit(jax.vmap(SummedAreaTable.build))(values)
    u, v = jnp.float32(0.3), jnp.float32(5.5)
    both = jax.jit(jax.vmap(SummedAreaTable.lookup, in_axes=(0, None, None)))(tables, u, v)
    np.testing.assert_allclose(both[1], 2.0 * both[0], rtol=1e-6)
    np.testing.assert_allclose(both[0], lookup(build(values[0]), u, v), rtol=1e-6)
