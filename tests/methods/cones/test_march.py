"""Cones through lightmaps: furnace, horizons against closed forms, gradients."""

import math
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.methods.cones.cones import cone_set, own_azimuth, upright_frame
from jaxvis.methods.cones.heights import Plan, stored_heights
from jaxvis.methods.cones.heights import mip_chain as plan_chain
from jaxvis.methods.cones.inject import colours_of, volume_of
from jaxvis.methods.cones.light import Sky
from jaxvis.methods.cones.march import Lightmaps, March, Points, cone_radiosity
from jaxvis.methods.cones.volume import Grid
from jaxvis.methods.cones.voxelize import projected_areas, voxelize
from jaxvis.sphere import latlong
from tests.methods.cones.made_scenes import ball, scene
from tests.methods.known_scenes import contrasted

APERTURE = math.pi / 3.0
NOTHING = Lightmaps(None, (), None, None, ())
UNIT_SKY = Sky.of(jnp.ones((16, 32, 3)))


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def points_at(positions, normals, away, first):
    count = len(positions)
    return Points(
        jnp.asarray(positions, jnp.float32),
        jnp.asarray(normals, jnp.float32),
        jnp.full(count, away, jnp.float32),
        jnp.full(count, first, jnp.float32),
        jnp.zeros(count),
    )


@pytest.mark.parametrize("count", [4, 6, 9])
def test_cones_cover_a_hemisphere_with_weights_of_pi(count):
    cones = cone_set(count)
    assert len(cones.axes) == count
    np.testing.assert_allclose(cones.weights.sum(), math.pi)
    np.testing.assert_allclose(np.linalg.norm(cones.axes, axis=-1), 1.0)
    assert (cones.axes[:, 2] >= 0.5 - 1e-9).all()
    # The mean direction, by weight, is the normal.
    np.testing.assert_allclose((cones.weights @ cones.axes)[:2], 0.0, atol=1e-12)


def test_less_than_four_cones_are_refused():
    with pytest.raises(ValueError, match="cones must be at least 4"):
        cone_set(3)


def test_frames_are_right_handed_and_do_not_jump():
    normals = unit(np.random.default_rng(0).normal(size=(500, 3)))
    normals = normals[normals[:, 1] > -0.95]
    tangent, bitangent = map(np.asarray, upright_frame(jnp.asarray(normals, jnp.float32)))
    frames = np.stack([tangent, bitangent, normals], axis=1)
    np.testing.assert_allclose(
        frames @ np.swapaxes(frames, 1, 2), [np.eye(3)] * len(frames), atol=1e-4
    )
    np.testing.assert_allclose(np.linalg.det(frames), 1.0, atol=1e-4)
    nearby = unit(normals + 1e-3)
    moved = np.asarray(upright_frame(jnp.asarray(nearby, jnp.float32))[0])
    assert np.abs(moved - tangent).max() < 0.1


def test_frames_turn_with_the_azimuth():
    normals = unit(np.random.default_rng(3).normal(size=(100, 3)))
    normals = np.concatenate([normals[normals[:, 1] > -0.95], [[0.0, 1.0, 0.0]]])
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    before = upright_frame(jnp.asarray(normals, jnp.float32), 0.3)
    # +x goes to -z: azimuths from +x towards +z become a quarter less.
    after = upright_frame(jnp.asarray(normals @ turn.T, jnp.float32), 0.3 - 0.5 * np.pi)
    for old, new in zip(before, after, strict=True):
        np.testing.assert_allclose(np.asarray(old) @ turn.T, new, atol=1e-5)
    fixed = upright_frame(jnp.asarray(normals @ turn.T, jnp.float32), 0.3)
    assert np.abs(np.asarray(before[0]) @ turn.T - np.asarray(fixed[0])).max() > 0.5


def test_the_azimuth_of_a_scene_turns_with_it():
    positions = np.random.default_rng(4).normal(size=(50, 3)).astype(np.float32)
    quarter = np.stack([positions[:, 2], positions[:, 1], -positions[:, 0]], axis=-1)
    change = own_azimuth(quarter) - own_azimuth(positions)
    np.testing.assert_allclose(np.cos(change + 0.5 * np.pi), 1.0, atol=1e-5)


@pytest.mark.parametrize("cones", [4, 6])
def test_without_geometry_a_unit_sky_gives_pi(cones):
    normals = unit(np.random.default_rng(1).normal(size=(200, 3)))
    found = cone_radiosity(
        NOTHING,
        UNIT_SKY,
        points_at(np.zeros((200, 3)), normals, 0.1, 0.1),
        APERTURE,
        March("cubes", cones, 4),
    )
    np.testing.assert_allclose(found, math.pi, rtol=1e-4)


def test_without_geometry_any_sky_gives_its_irradiance():
    environment = contrasted(16)
    normals = unit(np.random.default_rng(1).normal(size=(200, 3)))
    found = cone_radiosity(
        NOTHING,
        Sky.of(environment.radiance),
        points_at(np.zeros((200, 3)), normals, 0.1, 0.1),
        APERTURE,
        March("cubes", 6, 4),
    )
    exact = latlong.bilinear(environment.irradiance_map(32), jnp.asarray(normals, jnp.float32))
    np.testing.assert_allclose(found, exact, rtol=2e-3)


SIDE = 128
TEXEL = 16.0 / SIDE


def field(height, colours=None):
    """A height field of 16 x 16 about the origin; heights from 0 to 4."""
    centre = (np.arange(SIDE) + 0.5) * TEXEL - 8.0
    x, z = np.meshgrid(centre, centre, indexing="ij")
    base = jnp.asarray((height(x, z) / 4.0).reshape(-1), jnp.float32)
    plan = Plan(np.float32([-8, 0, -8]), np.array(TEXEL, "f4"), np.array(4.0, "f4"), SIDE)
    lit = (
        () if colours is None else colours_of(jnp.asarray(colours(x, z).reshape(-1, 3), "f4"), SIDE)
    )
    return Lightmaps(None, (), plan, stored_heights(plan_chain(base, SIDE)), lit)


def over(maps, sky=UNIT_SKY, x=0.0, stepping="cubes"):
    """Irradiance of a point of the ground at (x, 0), as a share of pi."""
    points = points_at([[x, 0.0, 0.0]], [[0.0, 1.0, 0.0]], 0.25 * TEXEL, TEXEL)
    march = March(stepping, 6, 24 if stepping == "half" else 12)
    return np.asarray(cone_radiosity(maps, sky, points, APERTURE, march))[0, 0] / math.pi


def test_a_flat_field_hides_nothing():
    assert abs(over(field(lambda x, z: 0.0 * x)) - 1.0) < 1e-3


def free_share(distance, rise):
    """Cosine-weighted sky over a long wall: (1 + cos e) / 2, e its elevation."""
    return 0.5 * (1.0 + distance / math.hypot(distance, rise))


@pytest.mark.parametrize("slope", [0.25, 0.5, 1.0, 2.0])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_long_ramp_hides_the_view_factor_of_its_slope(slope, side):
    """From its foot on, a ramp is as high everywhere: horizons need no resolution."""
    maps = field(lambda x, z: np.minimum(slope * np.maximum(side * x, 0.0), 4.0))
    hidden, exact = 1.0 - over(maps), 1.0 - free_share(1.0, slope)
    np.testing.assert_allclose(hidden, exact, rtol=0.08)


@pytest.mark.parametrize("rise", [0.5, 1.0, 2.0, 4.0])
@pytest.mark.parametrize("distance", [1.0, 2.0])
def test_of_what_a_steep_wall_hides_a_quarter_is_found_at_least(rise, distance):
    """Cones look at heights that are averaged over their own width: of a step from 0 to 1 they see
    a ramp."""
    hidden = 1.0 - over(field(lambda x, z: rise * (x > distance)))
    assert 0.25 < hidden / (1.0 - free_share(distance, rise)) < 1.1


def test_a_valley_grows_darker_with_its_walls():
    found = [over(field(lambda x, z, r=rise: r * (abs(x) > 1.0))) for rise in (0, 0.5, 1, 2, 4)]
    assert abs(found[0] - 1.0) < 1e-3
    assert (np.diff(found) < -0.02).all()
    # cos e of walls on both sides: 0.243 at a rise of 4
    assert 0.2 < found[-1] < 0.5


def test_what_a_nearer_wall_hides_does_not_shine():
    """White beyond a wall: a wall in front that is as high, and black, leaves it no light; without
    the one in front it shines."""

    def colours(x, z):
        return np.repeat((x > 4.0)[..., None] * 1.0, 3, axis=-1)

    dark = Sky.of(jnp.zeros((16, 32, 3)))
    alone = over(field(lambda x, z: 3.0 * (x > 4.0), colours), dark)
    behind = over(field(lambda x, z: 3.0 * ((x > 4.0) | ((x > 1.5) & (x < 2.5))), colours), dark)
    assert alone > 0.02
    # Coarse levels of the map mix the two: a leak of a tenth.
    assert behind < 0.15 * alone, (alone, behind)


def made_volume(resolution=16):
    made = scene(ball(rows=12))
    grid = Grid.around(np.float64([-1, -1, -1]), np.float64([1, 1, 1]), resolution)
    patches = voxelize(made, np.ones(len(made.triangles), bool), grid)
    voxels, slot = np.unique(patches.voxel, return_inverse=True)
    fronts, backs = projected_areas(patches)

    def of(radiance):
        return volume_of(
            radiance,
            *map(jnp.asarray, (fronts, backs, patches.two_sided)),
            jnp.asarray(slot.astype(np.int32)),
            jnp.asarray(voxels.astype(np.int32)),
            resolution=resolution,
            count=len(voxels),
        )

    return grid, patches, of


GRID, PATCHES, VOLUME_OF = made_volume()


@pytest.mark.parametrize("stepping", ["cubes", "half"])
def test_a_sphere_above_hides_and_sends_its_view_factor(stepping):
    """A white sphere of radius 1 at a distance of 2: (1 / 2)^2 of the cosine-weighted hemisphere.
    Its light in the dark and what it hides of a unit sky add up to what they should."""
    volume = VOLUME_OF(jnp.ones((len(PATCHES.area), 3)))
    maps = Lightmaps(GRID, volume, None, None, ())
    voxel = float(GRID.voxel)
    points = points_at([[0.0, -2.0, 0.0]], [[0.0, 1.0, 0.0]], 0.0, voxel)
    march = March(stepping, 6, 14 if stepping == "half" else 9)
    dark = Sky.of(jnp.zeros((16, 32, 3)))
    sent = np.asarray(cone_radiosity(maps, dark, points, APERTURE, march))[0, 0] / math.pi
    left = np.asarray(cone_radiosity(maps, UNIT_SKY, points, APERTURE, march))[0, 0] / math.pi
    np.testing.assert_allclose(left, 1.0, atol=0.02)  # as bright as what it hides
    assert 0.12 < sent < 0.38, sent
    below = points_at([[0.0, -2.0, 0.0]], [[0.0, -1.0, 0.0]], 0.0, voxel)
    away = np.asarray(cone_radiosity(maps, dark, below, APERTURE, march))
    assert np.abs(away).max() < 0.01 * sent


def gather_sum(maps, sky, aperture):
    """Mean irradiance of points about a sphere over a hilly field."""
    rng = np.random.default_rng(4)
    positions = rng.uniform(-1.8, 1.8, (40, 3))
    normals = unit(rng.normal(size=(40, 3)) + [0.0, 1.0, 0.0])
    points = points_at(positions, normals, 0.2, 0.2)
    return jnp.mean(cone_radiosity(maps, sky, points, aperture, MARCH))


MARCH = March("cubes", 4, 5)
SLOPE = field(lambda x, z: 0.05 * (x + 8.0))
"""Linear in x: read the same at any level, which is a whole number and would make jumps."""
MIXED = replace(SLOPE, grid=GRID, plan=replace(SLOPE.plan, low=np.float32([-8, -2.2, -8])))
SMOOTH = Sky.of(contrasted(8).radiance)
FALLEN = np.random.default_rng(0).uniform(0.2, 2.0, (len(PATCHES.area), 3)).astype(np.float32)
ALBEDO = np.random.default_rng(1).uniform(0.2, 0.8, FALLEN.shape).astype(np.float32)


def value(albedo, albedo_2d, light, aperture):
    """Mean irradiance of points about a sphere over a slope: volume, map and sky are lit in
    proportion."""
    solid = VOLUME_OF(albedo * FALLEN * light)
    maps = replace(MIXED, volume=solid, colours=colours_of(albedo_2d * light, SIDE))
    lit = jax.tree.map(lambda leaf: leaf * light, SMOOTH)
    rng = np.random.default_rng(4)
    positions, normals = rng.uniform(-1.8, 1.8, (24, 3)), unit(rng.normal(size=(24, 3)) + [0, 1, 0])
    points = points_at(positions, normals, 0.2, 0.2)
    return jnp.mean(cone_radiosity(maps, lit, points, aperture, MARCH))


def test_gradients_are_finite_differences():
    """By the albedo of voxels and of the height field, by light, and by the cones' aperture.

    All but the aperture are linear: differences are exact but for the tables' float16. By the
    aperture, whole levels of the height field jump here and there.
    """
    along = np.linspace(0.2, 0.8, SIDE, dtype=np.float32)
    albedo_2d = np.repeat(np.repeat(along, SIDE)[:, None], 3, axis=1)
    start = [jnp.asarray(v) for v in (ALBEDO, albedo_2d, np.float32(1.0), np.float32(0.9))]
    value_and_slopes = jax.jit(jax.value_and_grad(value, argnums=(0, 1, 2, 3)))
    at_start, slopes = value_and_slopes(*start)
    steps = [0.25 * v for v in start[:3]] + [jnp.float32(0.005)]
    for which, (slope, step) in enumerate(zip(slopes, steps, strict=True)):
        up, down = (
            value_and_slopes(*start[:which], start[which] + sign * step, *start[which + 1 :])[0]
            for sign in (1.0, -1.0)
        )
        difference = 0.5 * float(up - down)
        found = float(jnp.vdot(slope, step))
        assert abs(difference) > 2e-4, which
        np.testing.assert_allclose(found, difference, rtol=0.1 if which == 3 else 0.01)
    np.testing.assert_allclose(slopes[2], at_start, rtol=1e-3)
