"""Direct light on lightmaps: closed forms on a plane, shadows, and sides."""

import math

import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.lighting import uniform
from jaxvis.methods.cones.inject import (
    colours_of,
    irradiance,
    irradiance_of_patches,
    irradiance_of_texels,
    lit,
    volume_of,
)
from jaxvis.methods.cones.light import ConeLight, Sky, cone_light
from tests.methods.cones.made_scenes import box, flat_ground, scene

GROUND = scene(flat_ground(8.0))
UP = np.float32([0.0, 1.0, 0.0])


def places(count=100, width=3.0, height=1e-3):
    at = np.random.default_rng(0).uniform(-width, width, (count, 3)).astype(np.float32)
    at[:, 1] = height
    return at, np.tile(UP, (count, 1))


def suns(directions, flux):
    directions = np.asarray(directions, float)
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    nothing = jnp.zeros((0, 3))
    return ConeLight(
        Sky.of(jnp.zeros((4, 8, 3))),
        jnp.asarray(directions, jnp.float32),
        jnp.asarray(flux, jnp.float32),
        nothing,
        nothing,
    )


def test_a_free_plane_under_suns_receives_flux_times_cosine():
    along = np.array([[0.3, 1.0, 0.2], [-2.0, 1.0, 0.5]])
    flux = np.array([[3.0, 2.0, 1.0], [0.5, 0.5, 4.0]])
    found = irradiance_of_patches(GROUND.tracer, *places(), suns(along, flux))
    cosine = along[:, 1] / np.linalg.norm(along, axis=-1)
    np.testing.assert_allclose(found, np.tile(cosine @ flux, (100, 1)), rtol=1e-5)


def test_the_shadow_of_a_box_is_black_and_ends_at_its_edges():
    made = scene(flat_ground(8.0), box((-0.5, 1.0, -0.5), (0.5, 2.0, 0.5)))
    at, up = places(500, height=0.0)
    at[:, 1] = made.positions[:, 1].min() + 1e-3
    slope = np.array([1.0, 2.0, 0.0])  # light from +x: the shadow moves to -x by half the height
    found = np.asarray(irradiance_of_patches(made.tracer, at, up, suns([slope], [[1.0] * 3])))
    shadow = (np.abs(at[:, 2]) < 0.5) & (at[:, 0] > -0.5 - 1.0) & (at[:, 0] < 0.5 - 0.5)
    edge = (np.abs(np.abs(at[:, 2]) - 0.5) < 0.01) | (np.abs(at[:, 0] + 0.75) > 0.74) & (
        np.abs(at[:, 0] + 0.75) < 0.76
    )
    assert shadow[~edge].sum() > 10
    assert (found[shadow & ~edge] == 0.0).all()
    np.testing.assert_allclose(found[~shadow & ~edge], 2.0 / math.sqrt(5.0), rtol=1e-5)


def test_backs_receive_nothing_and_cost_no_rays():
    at, up = places()
    before = GROUND.tracer.rays_traced
    seen = lit(GROUND.tracer, at, -up, np.float32([[0.0, 1.0, 0.0], [0.6, 0.8, 0.0]]))
    assert not seen.any()
    assert GROUND.tracer.rays_traced == before
    light = suns([[0.0, 1.0, 0.0]], [[1.0] * 3])
    assert not np.asarray(irradiance_of_patches(GROUND.tracer, at, -up, light)).any()
    # Were they said to be lit, the cosine would still be none.
    shone = jnp.ones((100, 1), bool)
    assert not np.asarray(
        irradiance(jnp.asarray(-up), shone, light.sun_directions, light.sun_flux)
    ).any()


@pytest.mark.parametrize(("directions", "tolerance"), [(64, 0.025), (512, 0.006)])
def test_a_uniform_sky_gives_nearly_pi_on_a_free_plane(directions, tolerance):
    light = cone_light(uniform(1.0), 2, directions)
    found = irradiance_of_patches(GROUND.tracer, *places(4), light)
    np.testing.assert_allclose(found, math.pi, rtol=tolerance)


def test_texels_are_as_patches_and_coarser_skies_nearly():
    made = scene(flat_ground(8.0), box((-0.5, 0.2, -0.5), (0.5, 2.0, 0.5)))
    n = 32
    line = (np.arange(n) + 0.5) * 8.0 / n - 4.0
    at = np.zeros((n, n, 3), np.float32)
    at[..., 0], at[..., 2] = line[:, None], line
    at[..., 1] = made.positions[:, 1].min() + 1e-3
    at = at.reshape(-1, 3)
    up = np.tile(UP, (len(at), 1))
    light = cone_light(uniform(1.0), 0, 64)
    exact = np.asarray(irradiance_of_patches(made.tracer, at, up, light))
    each = irradiance_of_texels(made.tracer, at, up, light, n, 1)
    np.testing.assert_allclose(each, exact, rtol=1e-6)
    before = made.tracer.rays_traced
    fourth = np.asarray(irradiance_of_texels(made.tracer, at, up, light, n, 4))
    assert made.tracer.rays_traced - before < 64 * (n // 4) ** 2
    far = np.linalg.norm(at[:, [0, 2]], axis=-1) > 2.5
    np.testing.assert_allclose(fourth[far], exact[far], rtol=0.06)


def one_patch(radiance, two_sided=False, cover=0.5):
    """A patch that faces up, in voxel (1, 0, 1) of 2 x 2 x 2; down is way 3."""
    fronts = np.zeros((1, 6), np.float32)
    backs = np.zeros((1, 6), np.float32)
    fronts[0, 3], backs[0, 2] = cover, cover
    chain = volume_of(
        jnp.asarray([radiance], jnp.float32),
        jnp.asarray(fronts),
        jnp.asarray(backs),
        jnp.asarray([two_sided]),
        jnp.zeros(1, jnp.int32),
        jnp.asarray([5], jnp.int32),
        resolution=2,
        count=1,
    )
    return [np.asarray(channel, np.float64).reshape(6, -1) for channel in chain]


def test_a_voxel_is_as_opaque_as_it_is_covered_and_colours_are_premultiplied():
    red, green, blue, opacity = one_patch((4.0, 2.0, 1.0))
    assert opacity[3, 5] == 0.5
    assert (red[3, 5], green[3, 5], blue[3, 5]) == (2.0, 1.0, 0.5)
    assert opacity[:, :8].sum() == 0.5  # neither backs nor other voxels
    full = one_patch((4.0, 2.0, 1.0), cover=2.0)
    assert full[3][3, 5] == 1.0
    assert full[0][3, 5] == 4.0


def test_backs_of_two_sided_patches_send_as_much():
    red, _, _, opacity = one_patch((4.0, 2.0, 1.0), two_sided=True)
    assert opacity[2, 5] == opacity[3, 5] == 0.5
    assert red[2, 5] == red[3, 5] == 2.0


def test_colours_of_height_fields_are_means():
    radiance = np.random.default_rng(0).uniform(0.0, 5.0, (64, 3)).astype(np.float32)
    found = colours_of(jnp.asarray(radiance), 8)
    for channel, values in zip(found, radiance.T, strict=True):
        np.testing.assert_allclose(channel[:64], values, rtol=1e-3)
        np.testing.assert_allclose(channel[-1], values.mean(), rtol=2e-3)
