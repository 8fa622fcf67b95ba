"""Sphere lights: what they subtend, as lobes, as parts of an environment, and bad ones."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.lighting import SphereLights, load_environment, uniform
from jaxvis.lighting.spheres import Cones

LIGHTS = SphereLights.of(
    [(0.0, 2.0, 0.0), (1.0, 0.0, -1.0)], [0.5, 0.01], [(1.0, 2.0, 3.0), (9.0, 8.0, 7.0)]
)


def cone(distance, radius):
    """The cone of a sphere on the x axis seen from the zero point."""
    return SphereLights.of([(distance, 0.0, 0.0)], [radius], [(1.0,) * 3]).cones(jnp.zeros(3))


@pytest.mark.parametrize("distance", [1.001, 1.5, 4.0, 100.0, 1e5])
def test_the_cone_of_a_unit_sphere(distance):
    found = cone(distance, 1.0)
    sine = 1.0 / float(np.float32(distance))
    # 1 - cos without cancellation, in double precision.
    expected = sine**2 / (1.0 + np.sqrt((1.0 - sine) * (1.0 + sine)))
    np.testing.assert_allclose(found.versine, expected, rtol=2e-5 if distance > 1.01 else 2e-3)
    np.testing.assert_allclose(found.axis[0], [1.0, 0.0, 0.0], atol=1e-7)
    np.testing.assert_allclose(found.distance, distance, rtol=1e-6)
    np.testing.assert_allclose(found.solid_angle, 2.0 * np.pi * found.versine, rtol=1e-6)


@pytest.mark.parametrize("distance", [0.0, 1e-20, 0.3, 1.0])
def test_from_inside_it_is_a_hemisphere(distance):
    found = cone(distance, 1.0)
    assert float(found.versine[0]) == pytest.approx(1.0, abs=1e-5)
    assert float(jnp.linalg.norm(found.axis)) == pytest.approx(1.0)
    assert np.all(np.asarray(found.entry(jnp.linspace(0.0, 1.0, 5))) == 0.0)


@pytest.mark.parametrize(("distance", "radius"), [(3.0, 1.0), (1.1, 1.0), (1e3, 0.01), (2.0, 1e-4)])
def test_rays_end_where_the_sphere_begins(distance, radius):
    """Against the quadratic equation in double precision."""
    found = cone(distance, radius)
    d, r = float(np.float32(distance)), float(np.float32(radius))
    apart = np.array([0.0, 0.3, 0.7, 0.97]) * np.asarray(found.versine, np.float64)
    half = np.sqrt(r * r - d * d * apart * (2.0 - apart))
    expected = d * (1.0 - apart) - half
    entry = np.asarray(found.entry(jnp.asarray(apart, jnp.float32)), np.float64)
    np.testing.assert_allclose(entry, expected, atol=3e-3 * r, rtol=3e-7)
    assert entry[0] == pytest.approx(d - r, rel=1e-6)
    assert np.all(np.diff(entry) >= 0.0)


def test_each_point_sees_each_light():
    points = jnp.asarray(np.random.default_rng(0).normal(size=(4, 5, 3)), jnp.float32)
    cones = LIGHTS.cones(points)
    assert cones.versine.shape == (4, 5, 2)
    towards = np.asarray(LIGHTS.position) - np.asarray(points)[..., None, :]
    expected = towards / np.linalg.norm(towards, axis=-1, keepdims=True)
    np.testing.assert_allclose(cones.axis, expected, atol=1e-6)
    chosen = LIGHTS.take(jnp.array([[1, 0, 1]]))
    assert chosen.position.shape == (1, 3, 3)
    one = Cones.of(chosen.position, chosen.radius, points[0, :1, None])
    np.testing.assert_allclose(one.versine[0], cones.versine[0, 0][np.array([1, 0, 1])])


def test_lobes_have_the_energy_and_the_mean_direction_of_the_cones():
    points = jnp.asarray([[0.0, 0.0, 0.0], [0.2, 1.2, 0.1], [0.0, 2.0, 0.1], [30.0, 0.0, 0.0]])
    lobes, cones = LIGHTS.gaussians(points), LIGHTS.cones(points)
    energy = cones.solid_angle[..., None] * LIGHTS.radiance
    np.testing.assert_allclose(lobes.integral(), energy, rtol=1e-5)
    # coth(lambda) - 1 / lambda against the mean cosine of a cone, 1 - versine / 2.
    sharpness = np.asarray(lobes.sharpness, np.float64)
    mean = 1.0 / np.tanh(sharpness) - 1.0 / sharpness
    narrow = sharpness > 8.0
    assert narrow.sum() >= 5
    np.testing.assert_allclose(mean[narrow], (1.0 - 0.5 * cones.versine)[narrow], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(lobes.axis, axis=-1), 1.0, atol=1e-6)


@pytest.mark.parametrize(
    "at", [(0.0, 2.0, 0.0), (0.0, 1.5, 0.0), (0.0, 1.7, 0.0), (3.0, -1.0, 0.0)]
)
def test_gradients_are_finite_everywhere(at):
    def value(lights, point):
        cones = lights.cones(point)
        return jnp.sum(cones.axis @ jnp.array([1.0, 2.0, 3.0]) * cones.solid_angle) + jnp.sum(
            lights.gaussians(point).evaluate(jnp.array([0.0, 1.0, 0.0]))
        )

    slopes = jax.grad(value, argnums=(0, 1))(LIGHTS, jnp.asarray(at, jnp.float32))
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(slopes))


def test_gradients_are_differences():
    def solid_angle(place):
        lights = SphereLights(place[None], jnp.array([0.4]), jnp.ones((1, 3)))
        return lights.cones(jnp.zeros(3)).solid_angle[0]

    place = jnp.array([0.5, 0.7, -0.2])
    gradient = np.asarray(jax.grad(solid_angle)(place))
    for axis, slope in zip(np.eye(3, dtype=np.float32), gradient, strict=True):
        ends = [float(solid_angle(place + sign * 1e-2 * axis)) for sign in (1, -1)]
        assert slope == pytest.approx((ends[0] - ends[1]) / 2e-2, rel=5e-3)


def test_other_coordinates():
    moved = LIGHTS.seen_from(jnp.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(moved.position[0], [-1.0, 0.0, -3.0])
    np.testing.assert_array_equal(moved.radius, LIGHTS.radius)
    environment = uniform(1.0)
    assert environment.seen_from(jnp.ones(3)) is environment
    placed = environment.with_spheres(LIGHTS).seen_from(jnp.ones(3))
    np.testing.assert_allclose(placed.spheres.position, LIGHTS.position - 1.0)


def test_environments_keep_them():
    environment = load_environment("windows:height=16").with_spheres(LIGHTS)
    assert environment.name == "windows:height=16"
    others = {
        "rotate": environment.rotate(1.0),
        "resize": environment.resize(4),
        "blur": environment.blur(20.0),
        "channels": environment.scale(jnp.array([1.0, 0.0, 2.0])),
        "scale": environment.scale(2.0),
    }
    for name, other in others.items():
        factor = {"scale": 2.0, "channels": jnp.array([1.0, 0.0, 2.0])}.get(name, 1.0)
        np.testing.assert_array_equal(other.spheres.position, LIGHTS.position)
        np.testing.assert_array_equal(other.spheres.radius, LIGHTS.radius)
        np.testing.assert_array_equal(other.spheres.radiance, factor * LIGHTS.radiance)
        assert not np.array_equal(other.radiance, environment.radiance)
        assert other.name == environment.name
    assert environment.with_spheres(None).spheres is None
    np.testing.assert_array_equal(
        environment.towards(jnp.array([0.0, 1.0, 0.0])),
        environment.with_spheres(None).towards(jnp.array([0.0, 1.0, 0.0])),
    )


def test_they_go_through_jit():
    environment = uniform(1.0).with_spheres(LIGHTS)
    doubled = jax.jit(lambda light: light.scale(2.0))(environment)
    np.testing.assert_allclose(doubled.spheres.radiance, 2.0 * LIGHTS.radiance)
    assert LIGHTS.count == 2


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"radius": [0.0, 1.0]}, "radius must be positive and finite, got 0.0 for light 0"),
        ({"radius": [1.0, -2.0]}, "radius must be positive and finite, got -2.0 for light 1"),
        ({"radius": [1.0, np.inf]}, "radius must be positive and finite, got inf"),
        ({"radius": 1.0}, "radius must be a list, a number for each light, got 1.0"),
        ({"radius": []}, "radius must be a list, a number for each light, got []"),
        ({"radius": [1.0]}, "position must have the shape [1, 3], three numbers for each radius"),
        ({"radius": ["wide", 1.0]}, "radius must be numbers, got ['wide', 1.0]"),
        ({"position": [(0, 0, np.nan), (0, 0, 0)]}, "position must be finite, got [ 0.  0. nan]"),
        ({"position": (0.0, 1.0, 2.0)}, "position must have the shape [2, 3]"),
        ({"position": [(0, 0), (1, 1)]}, "position must have the shape [2, 3]"),
        ({"radiance": [(1, 1, 1), (1, -1, 1)]}, "radiance must be finite and >= 0, got [ 1. -1."),
        ({"radiance": [(1, 1, 1), (1, np.nan, 1)]}, "radiance must be finite and >= 0"),
        ({"radiance": [1.0, 1.0]}, "radiance must have the shape [2, 3]"),
    ],
)
def test_bad_lights_are_refused_in_one_line(wrong, says):
    good = {"position": [(0, 0, 0), (1, 1, 1)], "radius": [1.0, 1.0], "radiance": [(1, 1, 1)] * 2}
    with pytest.raises(ValueError) as error:  # noqa: PT011 - the message is checked
        SphereLights.of(**(good | wrong))
    assert str(error.value).startswith(f"sphere lights: {says}")
    assert "\n" not in str(error.value)
