"""Sphere lights through distance fields: closed forms, shadows and their limit, gradients."""

from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.image import psnr
from jaxvis.lighting import SphereLights
from jaxvis.methods import Reference
from jaxvis.methods.distance_field import AdaptiveVisibility, DistanceField, ShadowMaps
from jaxvis.methods.distance_field.shade import SPHERES_AT_ONCE, radiance_of, shade_view, view_of
from jaxvis.reflectance import Lambert, Material
from jaxvis.scene import load_scene, trace_surface
from tests.methods.known_scenes import (
    MATERIALS,
    SCENES,
    contrasted,
    ground_pixels,
    lamp_radiance,
    lamps,
)

PLANE, WALL, BOX, BALL = SCENES
pytestmark = pytest.mark.usefixtures("own_caches")

EVERY = DistanceField(resolution=64, lights=8, fill="adaptive")
PLACED = AdaptiveVisibility(resolution=64, lights=8, budget=0.3)
DRAWN = ShadowMaps(resolution=64, lights=8, budget=0.3)
METHODS = {"distance-field": EVERY, "adaptive": PLACED, "shadow-map": DRAWN}


@cache
def fields_of(name, known):
    return METHODS[name].precompute(known.load(), progress=False)


def image_of(name, known, environment, surface):
    method = METHODS[name]
    image = method.shade(fields_of(name, known), method.light(environment), surface)
    return np.asarray(image, np.float64)


def world(surface):
    mask = np.asarray(surface.mask)
    return np.asarray(surface.position, np.float64)[mask] + np.asarray(surface.origin, np.float64)


def exact(known, environment, surface):
    method = Reference()
    return np.asarray(
        method.shade(method.precompute(known.load()), method.light(environment), surface),
        np.float64,
    )


@pytest.mark.parametrize("name", METHODS)
def test_an_open_plane_has_the_irradiance_of_the_closed_form(name):
    environment = lamps(((0.4, 1.2, 0.3), 0.3, 5.0), ((-1.5, 0.9, -0.5), 0.5, 2.0))
    surface = PLANE.surface(Material(base_colour=(1.0,) * 3), Lambert())
    image = image_of(name, PLANE, environment, surface)[np.asarray(surface.mask)]
    expected = lamp_radiance(environment, world(surface))
    # Where all of a lamp is well above the horizon; low ones leave the clamped cosine's mean.
    np.testing.assert_allclose(image, expected, rtol=0.03)
    assert np.ptp(expected[:, 0]) > 0.1
    assert image.mean() == pytest.approx(expected.mean(), rel=0.01)


@pytest.mark.parametrize("name", METHODS)
def test_a_box_before_a_lamp_shadows(name):
    # The box is [-1, 1] x [0, 2] x [-1, 1]; the lamp lies beyond it, and its scene off centre.
    environment = lamps(((2.5, 0.6, 0.0), 0.1, 50.0))
    surfaces = ground_pixels(BOX, [(-1.5, 0.0), (-2.25, 0.0), (2.25, 2.25), (3.0, -2.25)])
    unshadowed = [lamp_radiance(environment, world(s))[0] for s in surfaces]
    images = [image_of(name, BOX, environment, s)[0, 0] for s in surfaces]
    for image, light in zip(images[:2], unshadowed[:2], strict=True):
        assert np.all(image < 1e-3 * light)
    for image, light in zip(images[2:], unshadowed[2:], strict=True):
        np.testing.assert_allclose(image, light, rtol=0.03)
    assert np.asarray(surfaces[0].origin).any()


def test_what_lies_behind_a_lamp_shadows_too():
    """The documented limit: maps have no depth. The reference tells before from behind."""
    environment = lamps(((2.75, 0.5, 0.0), 0.1, 50.0))
    (surface,) = ground_pixels(BOX, [(3.75, 0.0)])  # sees the box beyond the lamp
    lit = lamp_radiance(environment, world(surface))[0]
    np.testing.assert_allclose(exact(BOX, environment, surface)[0, 0], lit, rtol=5e-3)
    assert np.all(image_of("distance-field", BOX, environment, surface)[0, 0] < 0.05 * lit)


@pytest.mark.parametrize("material", ["diffuse", "phong", "ggx"])
@pytest.mark.parametrize("name", METHODS)
def test_images_are_near_the_reference(name, material):
    environment = lamps(((2.0, 2.5, 1.0), 0.2, 100.0))
    surface = BALL.surface(*MATERIALS[material])
    wanted = exact(BALL, environment, surface)
    image = image_of(name, BALL, environment, surface)
    mask = np.asarray(surface.mask)
    found = psnr(image, wanted, mask)
    assert found > 28.0  # shadow edges in images of 14 rows
    # A lamp elsewhere, or its shadow left out, is another picture.
    elsewhere = image_of(name, BALL, lamps(((2.0, 2.5, 0.0), 0.2, 100.0)), surface)
    assert psnr(elsewhere, wanted, mask) < found - 6.0
    fields = fields_of(name, BALL)
    open_sky = replace(fields, signed_distance=np.full_like(fields.signed_distance, np.pi))
    method = METHODS[name]
    unshadowed = np.asarray(method.shade(open_sky, method.light(environment), surface))
    assert psnr(unshadowed, wanted, mask) < found - 6.0


def test_lamps_and_the_environment_add_up():
    surface, method = BOX.surface(*MATERIALS["ggx"]), EVERY
    fields, lit = fields_of("distance-field", BOX), lamps(((2.5, 1.5, 2.0), 0.4, 10.0))
    environments = contrasted(), lit, contrasted().with_spheres(lit.spheres)
    images = [np.asarray(method.shade(fields, method.light(e), surface)) for e in environments]
    np.testing.assert_allclose(images[0] + images[1], images[2], rtol=1e-4, atol=1e-5)
    assert images[1].max() > 0.05
    light = method.light(environments[2])
    assert method.evaluations(fields, light, surface) == 9 * int(np.sum(surface.mask))


def test_more_lamps_than_a_block_holds():
    count = SPHERES_AT_ONCE + 3
    rng = np.random.default_rng(1)
    places = rng.uniform([-3.0, 2.2, -3.0], [3.0, 4.0, 3.0], (count, 3))
    surface = BOX.surface(*MATERIALS["phong"])
    one_by_one = sum(
        image_of("distance-field", BOX, lamps((tuple(place.tolist()), 0.2, 1.0)), surface)
        for place in places
    )
    together = lamps(*((tuple(place.tolist()), 0.2, 1.0) for place in places))
    image = image_of("distance-field", BOX, together, surface)
    np.testing.assert_allclose(image, one_by_one, rtol=1e-4, atol=1e-5)


def test_surfaces_inside_a_lamp_and_lamps_below_the_ground_are_finite():
    surface = BOX.surface(*MATERIALS["ggx"])
    for lights in (((1.5, 0.0, 1.5), 0.5, 2.0), ((0.0, -1.0, 0.0), 0.5, 2.0)):
        assert np.all(np.isfinite(image_of("distance-field", BOX, lamps(lights), surface)))
    under = lamps(((0.0, -1.0, 0.0), 0.2, 2.0))
    image = image_of("distance-field", PLANE, under, PLANE.surface(*MATERIALS["diffuse"]))
    assert np.abs(image).max() < 1e-3


@pytest.mark.parametrize("material", ["diffuse", "ggx"])
def test_gradients_through_lamps_are_differences(material):
    known = replace(BOX, size=(8, 6))
    fields, surface = fields_of("distance-field", BOX), known.surface(*MATERIALS[material])
    view = view_of(fields, surface)
    light = EVERY.light(lamps(((2.0, 2.5, 1.5), 0.3, 20.0), ((-1.0, 3.0, 1.0), 0.2, 30.0)))

    @jax.jit
    @jax.value_and_grad
    def total(spheres):
        return shade_view(fields, replace(light, spheres=spheres), view, surface).sum()

    spheres = light.spheres
    _, gradient = total(spheres)
    for name, step in (("radiance", 1.0), ("radius", 0.01), ("position", 5e-3)):
        leaf, slopes = getattr(spheres, name), getattr(gradient, name)
        assert np.all(np.isfinite(slopes))
        assert float(jnp.abs(slopes).min()) > 0.0
        for seed in range(3):
            towards = np.random.default_rng(seed).normal(size=leaf.shape).astype(np.float32)
            ends = [
                float(total(replace(spheres, **{name: leaf + sign * step * towards}))[0])
                for sign in (1.0, -1.0)
            ]
            measured = (ends[0] - ends[1]) / (2.0 * step)
            scale = float(jnp.abs(slopes * towards).sum())
            # Bilinear distances have kinks, over which a difference in the position steps.
            slack = 0.05 if name == "position" else 0.02
            assert float((slopes * towards).sum()) == pytest.approx(measured, abs=slack * scale)


def test_lamps_that_move_compile_nothing_anew():
    surface = BOX.surface(*MATERIALS["diffuse"])
    fields = fields_of("distance-field", BOX)
    before = None
    for step in range(3):
        light = EVERY.light(lamps(((2.0 + 0.1 * step, 2.5, 1.0), 0.2, 10.0 + step)))
        jax.block_until_ready(EVERY.shade(fields, light, surface))
        before = radiance_of._cache_size() if before is None else before
    assert radiance_of._cache_size() == before


def test_the_hat_under_a_lamp():
    """The picture of an animated scene, in the dark but for one lamp close by."""
    scene = load_scene("hat")
    surface = trace_surface(scene, scene.camera, (48, 36))
    environment = (
        contrasted()
        .scale(0.0)
        .with_spheres(SphereLights.of([(0.4, 1.2, 0.3)], [0.05], [(40.0, 36.0, 30.0)]))
    )
    truth = Reference(error=0.01)
    wanted = np.asarray(truth.shade(truth.precompute(scene), truth.light(environment), surface))
    method = AdaptiveVisibility(resolution=64, lights=8)
    fields = method.precompute_for(scene, surface, progress=False)
    image = np.asarray(method.shade(fields, method.light(environment), surface))
    mask = np.asarray(surface.coverage) > 0.0
    found = psnr(image, wanted, mask)
    assert found > 33.0  # 43.5 at 320 x 240 with maps of 128 texels
    # The shadow on its other side is another picture.
    mirrored = environment.with_spheres(
        SphereLights.of([(-0.4, 1.2, 0.3)], [0.05], [(40.0, 36.0, 30.0)])
    )
    other = np.asarray(method.shade(fields, method.light(mirrored), surface))
    assert psnr(other, wanted, mask) < found - 10.0
