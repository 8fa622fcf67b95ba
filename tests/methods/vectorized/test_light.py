"""The tables of an environment against closed forms and plain sums."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.lighting import uniform, windows
from jaxvis.methods.vectorized import light as module
from jaxvis.methods.vectorized.light import polygon_light, texel_moments
from jaxvis.sphere import latlong
from jaxvis.sphere.contours import integrate, trapezoid
from jaxvis.sphere.polygons import clamp_to_hemisphere
from tests.sphere.contour_oracle import circle, directions_of, unit

LUMINANCE = [0.2126, 0.7152, 0.0722]


@pytest.fixture(scope="module")
def church():
    return polygon_light(windows(height=64), lookup="bilinear")


def tables(radiance, rows=512, repeated=True):
    return module._tables(jnp.asarray(radiance, jnp.float32), repeated=repeated, rows=rows)


def sky_tables(height):
    """Those of a uniform sky, the blurred one left sharp."""
    sky = jnp.ones((height, 2 * height, 3))
    return module._summed(sky, sky, times=1)


def test_moments_are_integrals_of_the_direction():
    height, fine = 5, 40
    inside = latlong.texel_directions(height * fine, 2 * height * fine)
    inside *= latlong.row_solid_angles(height * fine, 2 * height * fine)[:, None, None]
    expected = inside.reshape(height, fine, 2 * height, fine, 3).sum(axis=(1, 3))
    np.testing.assert_allclose(texel_moments(height, 2 * height), expected, atol=1e-4)
    np.testing.assert_allclose(texel_moments(7, 14).sum(axis=(0, 1)), 0.0, atol=1e-14)


def test_the_irradiance_of_a_uniform_sky_is_pi():
    """Also of a map with hardly any texels; what error is left is the trapezoidal rule's."""
    vector, scalar, *_ = sky_tables(40)
    normals = unit([[0.3, 0.8, -0.5], [0, 1, 0], [0.9, -0.2, 0.4], [0.1, 0.05, -1]])
    hemispheres = directions_of(*(circle(n, np.pi / 2, 512) for n in normals))
    lookups = trapezoid(40, [hemispheres])
    moment = np.asarray(integrate(vector, lookups)).reshape(-1, 3, 3)
    np.testing.assert_allclose(np.einsum("na,nac->nc", normals, moment), np.pi, rtol=2e-3)
    np.testing.assert_allclose(integrate(scalar, lookups), 2.0 * np.pi, rtol=2e-3)


@pytest.mark.parametrize("height", [2, 40])
def test_the_irradiance_of_level_ground_is_exact(height):
    """The horizon is a row of corners, so that nothing but the texels' moments counts."""
    vector, scalar, *_ = sky_tables(height)
    rim = directions_of(circle([0, 1, 0], np.pi / 2, 512))
    moment = np.asarray(integrate(vector, trapezoid(height, [rim])))[0].reshape(3, 3)
    np.testing.assert_allclose(moment, [[0.0] * 3, [np.pi] * 3, [0.0] * 3], atol=1e-5)
    np.testing.assert_allclose(vector.total, 0.0, atol=1e-5)
    np.testing.assert_allclose(scalar.total, 4.0 * np.pi, rtol=1e-6)


def test_tables_hold_the_sums_of_the_map(church):
    radiance = np.asarray(windows(height=64).radiance, np.float64)
    weight = latlong.row_solid_angles(64, 128)[:, None, None]
    np.testing.assert_allclose(church.scalar.total, (radiance * weight).sum((0, 1)), rtol=1e-6)
    moments = np.einsum("hwa,hwc->ac", texel_moments(64, 128), radiance)
    scale = np.abs(moments).max()
    total = np.asarray(church.vector.total).reshape(3, 3)
    np.testing.assert_allclose(total, moments, atol=1e-6 * scale)
    np.testing.assert_allclose(church.luminous.total, moments @ LUMINANCE, atol=1e-6 * scale)


def test_all_tables_have_one_size_and_nearest_ones_at_least_512_rows(church):
    fine = tables(windows(height=64).radiance)
    assert {table.height for table in fine} == {512}
    # Repeating a map changes none of its integrals: the fine table has the coarse one's corners.
    for coarse, table in zip((church.vector, church.scalar), fine[:2], strict=True):
        assert coarse.height == 64
        scale = np.abs(np.asarray(coarse.corners)).max()
        np.testing.assert_allclose(table.corners[::8, ::8], coarse.corners, atol=1e-6 * scale)


def test_larger_maps_are_averaged(church):
    averaged = tables(windows(height=64).radiance, rows=40)
    assert {table.height for table in averaged} == {40}
    np.testing.assert_allclose(averaged[1].total, church.scalar.total, rtol=1e-5)


def test_the_blurred_table_is_that_of_the_blurred_map(church):
    blurred = np.asarray(windows(height=64).blur(256.0).radiance, np.float64)
    expected = np.einsum("hwa,hwc->ac", texel_moments(64, 128), blurred).ravel()
    scale = np.abs(np.asarray(church.blurred.corners)).max()
    np.testing.assert_allclose(church.blurred.total, expected, atol=1e-4 * scale)
    apart = np.abs(np.asarray(church.blurred.corners - church.vector.corners)).max()
    assert apart > 1e-3 * scale


@pytest.mark.parametrize(("given", "value", "scaled"), [
    ("paper", 5.8, False), ("scaled", 5.0, True), (12.0, 12.0, False), (0.0, 0.0, False),
])  # fmt: skip
def test_sharpness_by_name_and_by_number(given, value, scaled):
    number, times_length = module._sharpness(given)
    assert number == value
    assert times_length is scaled


def test_sharpness_is_a_leaf(church):
    other = dataclasses.replace(church, sharpness=jnp.float32(9.0))
    assert jax.tree.structure(other) == jax.tree.structure(church)
    assert float(church.sharpness) == 5.0
    assert church.scaled


@pytest.mark.parametrize("sharpness", [-1.0, np.nan, np.inf])
def test_refuses_a_sharpness_that_is_none(sharpness):
    with pytest.raises(ValueError, match="sharpness must be"):
        polygon_light(uniform(height=4), sharpness=sharpness)


def test_refuses_tables_without_rows():
    with pytest.raises(ValueError, match="rows must be"):
        polygon_light(uniform(height=4), rows=0)


def test_has_gradients_in_the_radiance():
    """With lobes too, but those are test_lobes' and test_blur's."""
    radiance = jnp.asarray(np.random.default_rng(1).random((16, 32, 3)), jnp.float32)
    normal = jnp.asarray(unit([[0.2, 0.9, 0.3]]), jnp.float32)
    polygon = clamp_to_hemisphere(directions_of(circle([0.5, 0.5, 0.1], 0.9, 64)), normal)

    @jax.jit
    def value(radiance):
        integrals = [
            jnp.sum(integrate(table, trapezoid(table.height, [polygon])))
            for table in tables(radiance, repeated=False)
        ]
        return sum(integrals)

    total, gradient = jax.jit(jax.value_and_grad(value))(radiance)
    np.testing.assert_allclose((gradient * radiance).sum(), total, rtol=1e-4)  # it is linear
    texel, step = (5, 9, 1), 0.25
    rise = value(radiance.at[texel].add(step)) - value(radiance.at[texel].add(-step))
    np.testing.assert_allclose(gradient[texel], rise / (2.0 * step), rtol=0.02, atol=1e-4)
