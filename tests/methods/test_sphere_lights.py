"""Sphere lights in the methods that trace rays: closed forms, shadows, each other; who refuses."""

from dataclasses import replace
from functools import cache

import jax
import numpy as np
import pytest

from jaxvis.methods import MonteCarlo, Reference, create, names
from jaxvis.methods.base import LIGHT_LOCALLY
from jaxvis.reflectance import Lambert, Material
from jaxvis.scene import trace_surface
from tests.methods.known_scenes import (
    MATERIALS,
    SCENES,
    contrasted,
    ground_pixels,
    lamp_radiance,
    lamps,
    uniform_light,
)
from tests.methods.test_monte_carlo import renders, standard_errors_apart

PLANE, WALL, BOX, BALL = SCENES
WHITE = Material(base_colour=(1.0,) * 3)
STRATEGIES = ("uniform", "environment", "brdf", "mis")
# One of them is so near and wide that it fills a quarter of some points' skies.
TWO = (((0.4, 1.2, 0.3), 0.3, 5.0), ((-1.5, 0.9, -0.5), 0.8, 2.0))


def image_of(method, scene, environment, surface, seed=0):
    light = method.light(environment)
    return np.asarray(
        method.shade(method.precompute(scene), light, surface, key=jax.random.key(seed)), np.float64
    )


def world(surface):
    """Positions of the shaded points in the coordinates that lamps are given in."""
    return np.asarray(surface.position, np.float64)[np.asarray(surface.mask)] + np.asarray(
        surface.origin, np.float64
    )


@cache
def open_plane(height=0.0):
    """A plane at a height, lamps above it, and what they send."""
    scene = PLANE.with_material(WHITE, Lambert())
    raised = replace(scene, origin=scene.origin + [0.0, height, 7.0 * height])
    camera = replace(
        PLANE.camera,
        eye=tuple(np.add(PLANE.camera.eye, [0.0, height, 7.0 * height])),
        target=tuple(np.add(PLANE.camera.target, [0.0, height, 7.0 * height])),
    )
    environment = lamps(
        *(((x, y + height, z + 7.0 * height), r, radiance) for (x, y, z), r, radiance in TWO)
    )
    surface = trace_surface(raised, camera, PLANE.size)
    return raised, environment, surface, lamp_radiance(environment, world(surface))


@pytest.mark.parametrize("height", [0.0, 3.5], ids=["centred", "elsewhere"])
@pytest.mark.parametrize(
    ("method", "tolerance"),
    [(Reference(), 1e-3), (Reference(error=0.001), 5e-3)],
    ids=["every", "subset"],
)
def test_an_open_plane_has_the_irradiance_of_the_closed_form(method, tolerance, height):
    """E = pi L (r / d)^2 cos, exactly; in world coordinates, wherever the scene is."""
    scene, environment, surface, expected = open_plane(height)
    image = image_of(method, scene, environment, surface)[np.asarray(surface.mask)]
    assert len(image) > 100
    np.testing.assert_allclose(image, expected, rtol=tolerance)


@pytest.mark.parametrize("spp", [1, 3, 16])
@pytest.mark.parametrize("strategy", STRATEGIES)
def test_every_strategy_is_unbiased(strategy, spp):
    """Two lamps with one ray, three, or many: the mean is the closed form's."""
    scene, environment, surface, expected = open_plane()
    samples = renders(MonteCarlo(strategy, spp), scene, environment, surface, 24)
    apart = standard_errors_apart(samples, expected)
    assert np.all(np.abs(apart) < 4.0), f"{apart} standard errors"
    # A few per cent more would be seen.
    brighter = (1.0 + 0.2 / np.sqrt(spp)) * expected
    assert np.abs(standard_errors_apart(samples, brighter)).max() > 4.0
    noise = samples.std(axis=0, ddof=1).mean() / expected.mean()
    assert noise < 2.0 / np.sqrt(spp)


@pytest.mark.parametrize("material", MATERIALS)
def test_the_mean_of_many_rays_is_the_reference(material):
    """Glossy models, occluders, a bright environment and two lamps at once."""
    scene, surface = BALL.load(), BALL.surface(*MATERIALS[material])
    both = contrasted().with_spheres(
        lamps(((2.0, 2.5, 1.0), 0.3, 60.0), ((-1.0, 3.0, 1.0), 0.6, 20.0)).spheres
    )
    truth = image_of(Reference(subdivision=12), scene, both, surface)[np.asarray(surface.mask)]
    samples = renders(MonteCarlo("mis", 32), scene, both, surface)
    assert np.all(np.abs(standard_errors_apart(samples, truth)) < 4.0)
    dark = image_of(Reference(subdivision=12), scene, contrasted(), surface)
    assert truth.mean() > 1.3 * dark[np.asarray(surface.mask)].mean()


@pytest.mark.parametrize("method", [Reference(), MonteCarlo("mis", 8)], ids=["reference", "mc"])
def test_lamps_add_to_the_environment(method):
    """The environment's rays are the same with and without lamps."""
    scene, surface = BOX.load(), BOX.surface(*MATERIALS["ggx"])
    lit = lamps(((2.5, 1.5, 2.0), 0.4, 10.0))
    map_alone = image_of(method, scene, contrasted(), surface)
    lamp_alone = image_of(method, scene, lit, surface)
    both = image_of(method, scene, contrasted().with_spheres(lit.spheres), surface)
    np.testing.assert_allclose(both, map_alone + lamp_alone, rtol=1e-5, atol=1e-6)
    assert lamp_alone.max() > 0.05


TRACED = [Reference(), Reference(error=0.05), *(MonteCarlo(s, 4) for s in STRATEGIES)]


@pytest.mark.parametrize("method", TRACED, ids=lambda m: getattr(m, "strategy", str(m)))
def test_a_box_before_a_lamp_shadows_and_one_behind_it_does_not(method):
    # The box is [-1, 1] x [0, 2] x [-1, 1].
    environment = lamps(((2.75, 0.5, 0.0), 0.1, 50.0))
    behind, before = ground_pixels(BOX, [(-2.0, 0.0), (3.75, 0.0)])
    assert np.all(image_of(method, BOX.load(), environment, behind) == 0.0)
    seen = image_of(method, BOX.load(), environment, before)[0, 0]
    expected = lamp_radiance(environment, world(before))[0]
    np.testing.assert_allclose(seen, expected, rtol=0.2 if method.stochastic else 5e-3)
    # Towards the lamp and on, rays do meet the box: without a limit they would be blocked.
    away = np.array([[2.75, 0.5, 0.0]]) - [3.75, 0.0, 0.0]
    start = np.asarray(before.position)[0, :1] + np.float32([[0.0, 1e-3, 0.0]])
    assert BOX.load().tracer.occluded(start, away)[0]


def test_a_lamp_that_a_box_surrounds_lights_nothing_outside():
    environment = lamps(((0.0, 1.0, 0.0), 0.3, 50.0))
    (outside,) = ground_pixels(BOX, [(2.0, 0.0)])
    assert np.all(image_of(Reference(), BOX.load(), environment, outside) == 0.0)


def test_half_of_a_lamp_behind_an_edge_is_half_the_light():
    # From the ground at x = -3, the roof's edge (1, 2) hides what lies below a slope of 1/2 beyond
    # it; seen at (-1, 2) first. A lamp centred on that line is cut in half.
    point, edge = np.array([-3.0, 0.0]), np.array([-1.0, 2.0])
    centre = point + 3.0 * (edge - point)
    environment = lamps(((centre[0], centre[1], 0.0), 0.05, 50.0))
    (surface,) = ground_pixels(BOX, [(-3.0, 0.0)])
    seen = image_of(Reference(), BOX.load(), environment, surface)[0, 0]
    np.testing.assert_allclose(seen, 0.5 * lamp_radiance(environment, world(surface))[0], rtol=0.02)


def test_a_surface_inside_a_lamp_has_finite_light():
    environment = lamps(((0.0, 0.1, 0.0), 0.5, 2.0))
    scene, surface = PLANE.with_material(WHITE, Lambert()), PLANE.surface(WHITE, Lambert())
    inside = np.linalg.norm(world(surface) - [0.0, 0.1, 0.0], axis=-1) < 0.45
    assert inside.any()
    for method in (Reference(), MonteCarlo("mis", 64)):
        image = image_of(method, scene, environment, surface)[np.asarray(surface.mask)]
        assert np.all(np.isfinite(image))
        # Never more than the whole upper hemisphere gives.
        assert np.all(image[inside][:, 0] > 0.2)
        assert image[:, 0].max() < (2.001 if method == Reference() else 2.6)


def test_the_stated_error_counts_lamps():
    scene, surface = BOX.load(), BOX.surface(*MATERIALS["diffuse"])
    # A wide lamp low behind the box: all penumbra.
    environment = lamps(((-2.5, 2.5, -1.0), 1.5, 3.0))
    mask = np.asarray(surface.mask)
    solutions = {}
    for error in (0.02, 0.002):
        method = Reference(error=error)
        visibility = method.precompute(scene)
        solutions[error] = method.solve(visibility, method.light(environment), surface)
        assert 0.0 < solutions[error].error <= error
    coarse, fine = solutions[0.02], solutions[0.002]
    assert fine.directions > coarse.directions
    assert coarse.directions % (3 * 4 * 64) == 0  # environment, BRDF and lamp; scramblings; points
    difference = np.asarray(coarse.image - fine.image)[mask]
    relative = np.sqrt(np.mean(difference**2)) / np.asarray(fine.image)[mask].mean()
    assert 0.2 * coarse.error < relative < 2.5 * coarse.error + 0.002
    every = Reference()
    whole = every.solve(every.precompute(scene), every.light(environment), surface)
    assert 0.0 < whole.error < 0.005
    assert whole.directions == 4 * 8 + 4096  # all texels are black, and counted with
    plain = every.solve(every.precompute(scene), every.light(uniform_light()), surface)
    assert plain.error == 0.0


def test_evaluations_count_lamps():
    scene, surface = PLANE.load(), PLANE.surface(WHITE, Lambert())
    environment, pixels = lamps(*TWO), int(surface.mask.sum())
    for method, each in ((MonteCarlo("mis", 6), 12), (Reference(), 4 * 8 + 2 * 4096)):
        visibility = method.precompute(scene)
        count = method.evaluations(visibility, method.light(environment), surface)
        assert count == each * pixels


def test_many_lamps_share_few_rays():
    rng = np.random.default_rng(0)
    places = rng.uniform([-2.0, 0.5, -2.0], [2.0, 2.0, 2.0], (40, 3))
    environment = lamps(*((tuple(place.tolist()), 0.2, 1.0) for place in places))
    scene, surface = PLANE.with_material(WHITE, Lambert()), PLANE.surface(WHITE, Lambert())
    expected = lamp_radiance(environment, world(surface))
    before = scene.tracer.rays_traced
    samples = renders(MonteCarlo("brdf", 8), scene, environment, surface, 32)
    assert scene.tracer.rays_traced - before <= 32 * 8 * len(expected)
    assert np.all(np.abs(standard_errors_apart(samples, expected)) < 4.0)


def knows(name):
    return any(name == known or name.startswith(known.removesuffix("*")) for known in LIGHT_LOCALLY)


@pytest.mark.parametrize("name", names())
def test_methods_know_lamps_or_name_those_that_do(name):
    method, environment = create(name), lamps(*TWO)
    if knows(name):
        method.light(environment)
        return
    with pytest.raises(ValueError, match="has no local lights") as error:
        method.light(environment)
    assert str(error.value).endswith("use reference, mc-*, distance-field, adaptive or shadow-map")
    assert "\n" not in str(error.value)


def test_some_know_lamps_and_some_do_not():
    assert {"reference", "mc-mis", "adaptive"} <= set(filter(knows, names()))
    assert not any(map(knows, ("vectorized", "correspondence", "visibility-field", "unculled")))
