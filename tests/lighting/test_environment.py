"""Environments turned, resized, scaled and blurred."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.lighting import Environment, load_environment, uniform
from jaxvis.sphere import latlong


def noise(height=8, seed=0):
    values = np.random.default_rng(seed).random((height, 2 * height, 3))
    return Environment(jnp.asarray(values, jnp.float32), "noise")


def energy(environment):
    weights = latlong.row_solid_angles(environment.height, environment.width)
    return np.einsum("h,hwc->c", weights, np.asarray(environment.radiance, np.float64))


def about_y(yaw):
    """The right-handed rotation about +Y."""
    cosine, sine = np.cos(yaw), np.sin(yaw)
    return np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])


@pytest.mark.parametrize("turns", [0.25, 0.5, 0.125, -0.25, 3.0])
def test_turning_is_counter_clockwise_seen_from_above(turns):
    environment, yaw = noise(), 2.0 * np.pi * turns
    directions = latlong.texel_directions(8, 16).astype(np.float32)
    turned = (directions @ about_y(yaw).T).astype(np.float32)
    np.testing.assert_array_equal(
        environment.rotate(yaw).towards(turned), environment.towards(directions)
    )


def test_a_quarter_turn_brings_the_front_to_plus_x():
    sun = Environment(jnp.zeros((8, 16, 3)).at[3:5, 7:9].set(1.0))
    x, z = jnp.asarray([1.0, 0.0, 0.0]), jnp.asarray([0.0, 0.0, 1.0])
    assert sun.towards(z)[0] == 1.0
    assert sun.rotate(np.pi / 2).towards(x)[0] == 1.0
    assert sun.rotate(np.pi / 2).towards(z)[0] == 0.0


def test_turning_through_all_angles_keeps_energy():
    environment = noise()
    for yaw in (0.1, 1.0, 2.5, -7.0):
        np.testing.assert_allclose(energy(environment.rotate(yaw)), energy(environment), rtol=1e-5)


def test_scaling_by_a_number_or_by_channel():
    environment = noise()
    np.testing.assert_allclose(environment.scale(3.0).radiance, 3.0 * environment.radiance)
    tinted = environment.scale(jnp.asarray([1.0, 0.5, 0.0])).radiance
    np.testing.assert_allclose(tinted[..., 1], 0.5 * environment.radiance[..., 1])
    assert not tinted[..., 2].any()


def test_resizing_keeps_name_shape_and_energy():
    small = noise().resize(5)
    assert (small.height, small.width, small.name) == (5, 10, "noise")
    np.testing.assert_allclose(energy(small), energy(noise()), rtol=1e-5)
    with pytest.raises(ValueError, match="height"):
        noise().resize(0)


def test_blurring_keeps_energy_and_flattens():
    environment = noise()
    blurred = environment.blur(20.0)
    assert blurred.height == environment.height
    assert environment.blur(20.0, height=5).height == 5
    np.testing.assert_allclose(energy(blurred), energy(environment), rtol=1e-3)
    assert blurred.radiance.std() < 0.5 * environment.radiance.std()
    for height in (0, -3):
        with pytest.raises(ValueError, match="height"):
            environment.blur(20.0, height=height)


def test_irradiance_of_uniform_light_is_pi():
    np.testing.assert_allclose(uniform(2.0).irradiance_map(16), 2.0 * np.pi, rtol=1e-5)


def test_irradiance_of_a_sky_over_a_black_floor():
    """pi (1 + cos theta) / 2 at a normal that leans by theta."""
    dome = Environment(jnp.zeros((16, 32, 3)).at[:8].set(1.0))
    irradiance = dome.irradiance_map()
    assert irradiance.shape == (64, 128, 3)
    theta = np.linspace(0.1, 3.0, 9)
    normals = np.stack([np.sin(theta), np.cos(theta), 0.0 * theta], axis=-1).astype(np.float32)
    np.testing.assert_allclose(
        latlong.bilinear(irradiance, jnp.asarray(normals))[:, 0],
        np.pi * (1.0 + np.cos(theta)) / 2.0,
        atol=0.01,
    )


def test_irradiance_of_one_sun_is_its_cosine():
    sun = Environment(jnp.zeros((64, 128, 3)).at[20, 40].set(1e4))
    direction = latlong.texel_directions(64, 128)[20, 40]
    power = 1e4 * latlong.row_solid_angles(64, 128)[20]
    cosine = latlong.texel_directions(32, 64) @ direction
    expected = power * np.maximum(cosine, 0.0)
    np.testing.assert_allclose(sun.irradiance_map(32)[..., 1], expected, atol=0.015 * power)


def test_is_a_pytree():
    environment = noise()
    doubled = jax.jit(lambda e: e.scale(2.0).rotate(0.3))(environment)
    np.testing.assert_allclose(
        doubled.radiance, environment.scale(2.0).rotate(0.3).radiance, rtol=1e-5
    )
    assert doubled.name == "noise"
    both = jax.tree.map(lambda *r: jnp.stack(r), environment, environment.scale(2.0))
    up = jnp.asarray([0.0, 1.0, 0.0])
    seen = jax.vmap(lambda e: e.towards(up))(both)
    np.testing.assert_allclose(seen[1], 2.0 * seen[0])


def test_loaded_environments_turn_too():
    one = load_environment("windows:height=16").rotate(np.pi)
    np.testing.assert_allclose(
        energy(one), energy(load_environment("windows:height=16")), rtol=1e-5
    )
