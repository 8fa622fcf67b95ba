"""HybridCones and VoxelCones as wholes: furnace, leaks, what they agree on, and bad input."""

import math
import re
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.lighting import Environment, uniform
from jaxvis.methods.cones import march
from jaxvis.methods.cones import method as module
from jaxvis.methods.cones.method import HybridCones, VoxelCones
from jaxvis.scene import Camera, trace_surface
from tests.methods.cones.made_scenes import ball, box, flat_ground, heights, paint, scene
from tests.methods.known_scenes import contrasted, lamps, uniform_light

SIZE = (24, 16)
SMALL = {"voxels": 16, "texels": 64}
GROUND = scene(flat_ground(4.0, 4), materials=(paint(0.8, 0.6, 0.4),))
BALL = scene(ball(rows=16), materials=(paint(0.8, 0.6, 0.4),))
MIXED = scene(flat_ground(4.0, 4), box((-0.5, 0.0, -0.6), (0.5, 0.8, 0.4)))
ABOVE = Camera((1.5, 2.5, 2.5), (0.0, 0.0, 0.0))


@pytest.fixture(autouse=True)
def one_block_size(monkeypatch):
    """Images of any coverage share their compiled programs."""
    monkeypatch.setattr(module, "POINTS_AT_ONCE", 128)


def picture(method, made, environment, camera=ABOVE, size=SIZE):
    surface = trace_surface(made, camera, size)
    found = method.shade(method.precompute(made), method.light(environment), surface)
    return np.asarray(found), np.asarray(surface.mask)


def difference(image, other, mask):
    """Root mean square, as a share of the mean."""
    return float(np.sqrt(np.mean((image - other)[mask] ** 2)) / np.mean(other[mask]))


@pytest.mark.parametrize("stepping", ["cubes", "half"])
def test_a_plane_under_a_unit_sky_is_its_albedo(stepping):
    image, mask = picture(HybridCones(stepping=stepping, **SMALL), GROUND, uniform(1.0))
    assert mask.sum() > 200
    np.testing.assert_allclose(image[mask], [[0.8, 0.6, 0.4]] * mask.sum(), rtol=1e-4)
    assert not image[~mask].any()


def test_in_voxels_a_plane_keeps_nearly_its_albedo():
    """Backs do not count, so a plane does not hide the sky from cones that leave it."""
    image, mask = picture(VoxelCones(voxels=16), GROUND, uniform(1.0))
    np.testing.assert_allclose(image[mask], [[0.8, 0.6, 0.4]] * mask.sum(), rtol=0.02)


def test_a_scene_without_height_fields_is_the_same_from_both():
    voxel, mask = picture(VoxelCones(voxels=16), BALL, contrasted())
    same, _ = picture(HybridCones(voxels=16, texels=64, stepping="half"), BALL, contrasted())
    np.testing.assert_array_equal(same, voxel)
    # Steps of another length differ little, where a coarse ball does not hide its own sky.
    voxel, cubes = (
        picture(HybridCones(voxels=16, texels=64, offset=1.0, stepping=by), BALL, contrasted())[0]
        for by in ("half", "cubes")
    )
    assert 0.0 < difference(cubes, voxel, mask) < 0.05
    assert voxel[mask].std() > 0.05


def test_with_a_height_field_they_differ():
    voxel, mask = picture(VoxelCones(voxels=16), MIXED, contrasted())
    hybrid, _ = picture(HybridCones(**SMALL), MIXED, contrasted())
    assert difference(hybrid, voxel, mask) > 0.01


def turned(points):
    """A quarter turn about +Y, as Environment.rotate(pi / 2): +z to +x."""
    points = np.asarray(points, float)
    return np.stack([points[..., 2], points[..., 1], -points[..., 0]], axis=-1)


@pytest.mark.parametrize(("cones", "bounces", "bound"), [(5, 0, 2e-3), (6, 0, 2e-3), (6, 1, 5e-3)])
def test_a_quarter_turn_hardly_moves_the_image(cones, bounces, bound):
    """A ring of four cones turns into itself; one of five turns with the scene."""
    line = np.linspace(-2.0, 2.0, 17)
    hills = heights(lambda x, z: 0.15 * np.sin(2 * x) * np.cos(3 * z), line, line)
    meshes = [hills, box((-0.5, -0.1, -0.6), (0.5, 0.8, 0.4))]
    method = HybridCones(cones=cones, bounces=bounces, **SMALL)
    environment = contrasted(16)
    camera = Camera(turned(ABOVE.eye), turned(ABOVE.target))
    before, mask = picture(method, scene(*meshes), environment)
    after, other = picture(
        method,
        scene(*((turned(points), faces) for points, faces in meshes)),
        environment.rotate(0.5 * math.pi),
        camera,
    )
    both = mask & other
    assert both.sum() > 0.98 * mask.sum()
    assert difference(after, before, both) < bound
    # A turn of the scene without its light is no small thing.
    wrong, _ = picture(
        method,
        scene(*((turned(points), faces) for points, faces in meshes)),
        environment,
        camera,
    )
    assert difference(wrong, before, both) > 0.06


INSIDE = Camera((0.9, 0.2, 0.9), (-1.0, -0.3, -1.0), field_of_view=1.2)
ROOM = scene(box((-1.1, -1.1, -1.1), (1.1, 1.1, 1.1)), box((-1, -1, -1), (1, 1, 1), inward=True))


@pytest.mark.parametrize(("kind", "voxels", "bound"), [("hybrid", 32, 0.4), ("voxel", 32, 0.18)])
def test_little_light_leaks_into_a_closed_room(kind, voxels, bound):
    """Walls of one voxel and a half and a unit sky outside: white surfaces should be black."""
    method = (
        HybridCones(voxels=voxels, texels=64) if kind == "hybrid" else VoxelCones(voxels=voxels)
    )
    image, mask = picture(method, ROOM, uniform(1.0), INSIDE)
    assert mask.all()
    leak = float(image.mean()) / 0.8
    assert leak < bound, leak


def test_light_of_a_sun_does_not_leak():
    """Shadows are traced from every pixel; of the sun's glow in the sky nothing is left."""
    radiance = np.zeros((64, 128, 3), np.float32)
    radiance[6, 20] = 1000.0
    environment = Environment(jnp.asarray(radiance), "one texel")
    method = HybridCones(voxels=32, texels=64)
    image, mask = picture(method, ROOM, environment, INSIDE)
    assert len(method.light(environment).sun_flux) == 1
    assert image[mask].max() < 1e-6
    outside, lit = picture(HybridCones(**SMALL), GROUND, environment)
    assert outside[lit].min() > 0.05


def test_bounces_add_light_and_none_in_the_dark():
    dim, mask = picture(HybridCones(**SMALL), MIXED, uniform(1.0))
    lit, _ = picture(HybridCones(bounces=1, **SMALL), MIXED, uniform(1.0))
    assert (lit[mask] >= dim[mask] - 1e-5).all()
    assert 0.0 < (lit - dim)[mask].mean() < 0.3
    dark, _ = picture(HybridCones(bounces=1, **SMALL), MIXED, uniform(0.0))
    assert not dark.any()


def test_images_do_not_depend_on_blocks(monkeypatch):
    method = HybridCones(**SMALL)
    whole, _ = picture(method, MIXED, contrasted())
    monkeypatch.setattr(module, "POINTS_AT_ONCE", 32)
    parts, _ = picture(method, MIXED, contrasted())
    np.testing.assert_allclose(parts, whole, rtol=2e-5, atol=1e-6)


@pytest.mark.parametrize("bounces", [0, 1])
def test_gradients_in_light_and_material(bounces):
    """Images are linear in the light, and without bounces in the colour: so gradients times
    values are the image."""
    method = HybridCones(bounces=bounces, **SMALL)
    surface = trace_surface(MIXED, ABOVE, SIZE)
    radiance = np.full((64, 128, 3), 0.2, np.float32)
    radiance[6, 20] = 1000.0
    environment = Environment(jnp.asarray(radiance), "one texel")
    visibility, light = method.precompute(MIXED), method.light(environment)
    assert len(light.sun_flux)
    names = ("sky", "sun_flux", "flux")

    def mean(parts, colour):
        material = replace(surface.material, base_colour=colour)
        seen = replace(surface, material=material)
        lit = replace(light, **dict(zip(names, parts, strict=True)))
        return jnp.mean(method.shade(visibility, lit, seen))

    parts = tuple(getattr(light, name) for name in names)
    colour = surface.material.base_colour
    value, gradients = jax.value_and_grad(mean, argnums=(0, 1))(parts, colour)
    np.testing.assert_allclose(value, mean(parts, colour), rtol=1e-5)
    for gradient, at in zip(gradients, (parts, colour), strict=True):
        leaves = zip(jax.tree.leaves(gradient), jax.tree.leaves(at), strict=True)
        np.testing.assert_allclose(sum(jnp.sum(g * x) for g, x in leaves), value, rtol=1e-4)
    sky, flux, rest = (sum(jnp.sum(g) for g in jax.tree.leaves(part)) for part in gradients[0])
    assert min(sky, flux) > 0.0
    assert bool(rest > 0.0) == bool(bounces)


def test_another_light_compiles_nothing_anew(monkeypatch):
    traced = []
    original = march._one_cone
    monkeypatch.setattr(march, "_one_cone", lambda *a: traced.append(1) or original(*a))
    method = HybridCones(cones=7, **SMALL)
    surface = trace_surface(MIXED, ABOVE, SIZE)
    visibility = method.precompute(MIXED)
    first = method.shade(visibility, method.light(uniform_light(1.0, 8)), surface)
    assert traced
    traced.clear()
    second = method.shade(visibility, method.light(uniform_light(2.0, 8)), surface)
    assert not traced
    np.testing.assert_allclose(second, 2.0 * first, rtol=1e-5)


def test_a_view_of_nothing_is_black():
    method = HybridCones(**SMALL)
    away = Camera((0.0, 1.0, 0.0), (0.0, 2.0, 0.1))
    image, mask = picture(method, MIXED, uniform(1.0), away)
    assert not mask.any()
    assert not image.any()


BAD = {
    "voxels must be a power of two of at least 4, got 48": {"voxels": 48},
    "voxels must be a power of two of at least 4, got 2": {"voxels": 2},
    "texels must be a power of two of at least 4, or 0 for voxels alone, got 3": {"texels": 3},
    "voxels may be 512 and texels 8192 at most": {"voxels": 1024},
    "cones must be at least 4": {"cones": 3},
    "aperture must be from 0.05 to 2 radians": {"aperture": math.nan},
    "bounces must be 0 or 1, got 2": {"bounces": 2},
    "suns must be at least 0": {"suns": -1},
    "directions must be at least 8, got 4": {"directions": 4},
    "threshold must be positive, got 0.0": {"threshold": 0.0},
    "offset must be above 0 and at most 4 voxels, got 0.0": {"offset": 0.0},
}


@pytest.mark.parametrize("message", BAD)
@pytest.mark.parametrize("kind", [HybridCones, VoxelCones])
def test_parameters_out_of_range_are_refused_in_one_line(kind, message):
    with pytest.raises(ValueError, match=re.escape(message)) as caught:
        kind(**BAD[message])
    assert "\n" not in str(caught.value)


def test_sphere_lights_are_refused():
    with pytest.raises(ValueError, match="HybridCones has no local lights"):
        HybridCones().light(lamps(((0.0, 2.0, 0.0), 0.1, 1.0)))
