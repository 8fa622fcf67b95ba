"""The one orientation, poles and seam included, against closed forms and against Mitsuba 3."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.sphere import latlong

direction = jax.jit(latlong.direction)
coordinates = jax.jit(latlong.coordinates)
texel = jax.jit(latlong.texel, static_argnums=(1, 2))
nearest = jax.jit(latlong.nearest)
bilinear = jax.jit(latlong.bilinear)


def spiral(count):
    """Unit vectors spread evenly over the sphere (float64)."""
    y = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    phi = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    r = np.sqrt(1.0 - y * y)
    return np.stack([r * np.cos(phi), y, r * np.sin(phi)], axis=-1)


def as_jax(array):
    return jnp.asarray(array, jnp.float32)


LANDMARKS = [
    ((0.0, 0.0, -1.0), 0.0, 0.5),
    ((1.0, 0.0, 0.0), 0.25, 0.5),
    ((0.0, 0.0, 1.0), 0.5, 0.5),
    ((-1.0, 0.0, 0.0), 0.75, 0.5),
    ((1.0, np.sqrt(2.0), -1.0), 0.125, 0.25),
    ((-1.0, -np.sqrt(2.0), 1.0), 0.625, 0.75),
]


@pytest.mark.parametrize(("vector", "u", "v"), LANDMARKS)
def test_landmarks(vector, u, v):
    got_u, theta = coordinates(as_jax([vector]))
    np.testing.assert_allclose([got_u[0], theta[0] / np.pi], [u, v], atol=3e-7)
    unit = np.array(vector) / np.linalg.norm(vector)
    there = direction(as_jax(u), as_jax(np.pi * v))
    np.testing.assert_allclose(there, unit, atol=5e-7)


def test_poles_are_in_the_first_and_last_row():
    for y, theta, row in ((1.0, 0.0, 0), (-1.0, np.pi, 7)):
        pole = as_jax([[0.0, y, 0.0], [1e-9, y, -1e-9]])
        np.testing.assert_allclose(coordinates(pole)[1], theta, atol=1e-6)
        np.testing.assert_array_equal(texel(pole, 8, 16)[0], row)


def test_both_sides_of_the_seam():
    for tiny in (1e-3, 1e-6, 1e-12, 1e-30):
        u, _ = coordinates(as_jax([[tiny, 0.3, -1.0], [-tiny, 0.3, -1.0]]))
        assert 0.0 <= u[0] < 1e-3
        assert 0.0 <= u[1] < 1.0
        column = np.asarray(texel(as_jax([[-tiny, 0.3, -1.0]]), 8, 16)[1])[0]
        # Closer to the seam than float32 can tell from it, either side will do.
        assert column == 15 or (tiny < 1e-6 and column == 0)


def test_coordinates_undo_direction_and_keep_small_angles_at_the_poles():
    u = np.linspace(0.01, 0.99, 7)[:, None] + np.zeros(12)
    theta = np.array([1e-6, 1e-4, 1e-3, 0.03, 0.5, 1.0, 1.6, 2.0, 2.6, 3.0, 3.1, 3.14]) + 0.0 * u
    got_u, got_theta = coordinates(direction(as_jax(u), as_jax(theta)))
    np.testing.assert_allclose(got_u, u, atol=1e-6)
    np.testing.assert_allclose(got_theta, theta, rtol=2e-6)


@pytest.mark.parametrize("height", [1, 2, 5, 16, 64])
def test_texel_centres_are_in_their_texels(height):
    centres = latlong.texel_directions(height, 2 * height)
    np.testing.assert_allclose(np.linalg.norm(centres, axis=-1), 1.0, atol=1e-15)
    row, column = texel(as_jax(centres), height, 2 * height)
    expected = np.meshgrid(np.arange(height), np.arange(2 * height), indexing="ij")
    np.testing.assert_array_equal(row, expected[0])
    np.testing.assert_array_equal(column, expected[1])


def test_solid_angles_are_exact():
    for height in (1, 3, 64):
        angles = latlong.row_solid_angles(height, 2 * height)
        assert abs(angles.sum() * 2 * height - 4.0 * np.pi) < 1e-12
    quarter = latlong.row_solid_angles(3, 6)[0]  # a cap of 60 degrees, in six slices
    assert abs(quarter - 2.0 * np.pi * (1.0 - 0.5) / 6.0) < 1e-14


def test_nearest_is_the_texel_that_holds_the_direction():
    values = np.random.default_rng(0).random((6, 12, 3)).astype(np.float32)
    points = spiral(500)
    row = np.floor(np.arccos(points[:, 1]) / np.pi * 6).astype(int)
    column = np.floor(np.mod(np.arctan2(points[:, 0], -points[:, 2]) / (2 * np.pi), 1) * 12)
    expected = values[row, column.astype(int)]
    np.testing.assert_array_equal(nearest(as_jax(values), as_jax(points)), expected)
    np.testing.assert_array_equal(nearest(as_jax(values[..., 0]), as_jax(points)), expected[:, 0])


def test_bilinear_is_the_value_at_centres_and_smooth_over_poles_and_seam():
    height = 16
    centres = latlong.texel_directions(height, 2 * height)
    values = as_jax(centres)  # the function whose value is the direction itself
    np.testing.assert_allclose(bilinear(values, as_jax(centres)), centres, atol=1e-5)
    poles = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [1e-3, 1.0, 1e-3], [1e-4, 0.2, -1.0]])
    points = np.concatenate([spiral(2000), poles / np.linalg.norm(poles, axis=1, keepdims=True)])
    error = np.abs(np.asarray(bilinear(values, as_jax(points))) - points).max()
    step = np.pi / height
    assert error < 0.3 * step**2  # second order everywhere; half a texel off would be 0.5 step
    constant = bilinear(jnp.full((4, 8), 2.5), as_jax(points))
    np.testing.assert_allclose(constant, 2.5, rtol=1e-6)


def test_mitsuba_sees_the_same_panorama():
    mi = pytest.importorskip("mitsuba", reason="mitsuba is not installed (extra 'peers')")
    mi.set_variant("scalar_rgb")
    # A smooth function of direction on Mitsuba's own grid: rows 0 and H-1 exactly on the poles.
    height = 64
    theta = np.pi * np.arange(height)[:, None] / (height - 1)
    u = (np.arange(2 * height)[None, :] + 0.5) / (2 * height)
    panorama = 0.5 + 0.4 * np.asarray(direction(as_jax(u + 0 * theta), as_jax(theta + 0 * u)))
    emitter = mi.load_dict(
        {"type": "envmap", "bitmap": mi.Bitmap(panorama.astype(np.float32)), "scale": 1.0}
    )
    for vector in spiral(24):
        interaction = mi.SurfaceInteraction3f()
        interaction.wi = -mi.Vector3f(*vector.tolist())
        seen = np.array(emitter.eval(interaction))
        np.testing.assert_allclose(seen, 0.5 + 0.4 * vector, atol=0.03)
