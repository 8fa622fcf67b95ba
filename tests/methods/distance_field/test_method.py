"""The three methods: known answers, the reference, parameters, caches, views, gradients."""

from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.cache import cache_folder
from jaxvis.image.metrics import psnr
from jaxvis.methods import Reference, create, names
from jaxvis.methods.distance_field import AdaptiveVisibility, DistanceField, ShadowMaps
from jaxvis.methods.distance_field.shade import shade_view, view_of
from jaxvis.scene import Camera, trace_surface
from jaxvis.sphere.gaussians import SphericalGaussians
from tests.methods.known_scenes import MATERIALS, SCENES, KnownScene, contrasted, uniform_light

PLANE, WALL, BOX, BALL = SCENES
pytestmark = pytest.mark.usefixtures("own_caches", "optimised")

EVERY = DistanceField(resolution=32, lights=256, fill="adaptive")
PLACED = AdaptiveVisibility(resolution=32, lights=256, budget=0.3)
DRAWN = ShadowMaps(resolution=32, lights=256, budget=0.3)
METHODS = {"distance-field": EVERY, "adaptive": PLACED, "shadow-map": DRAWN}


@cache
def fields_of(name, known):
    return METHODS[name].precompute(known.load(), progress=False)


@cache
def surface_of(known, material="diffuse"):
    return known.surface(*MATERIALS[material])


@cache
def light_of(name):
    # Lobes are no narrower than texels: 32 rows, for a uniform light that is one.
    return EVERY.light(uniform_light(height=32) if name == "uniform" else contrasted(32))


@cache
def exact(known, material="diffuse", light="contrasted"):
    method = Reference(subdivision=4)
    environment = uniform_light(height=32) if light == "uniform" else contrasted(32)
    surface = surface_of(known, material)
    return np.asarray(
        method.shade(method.precompute(known.load()), method.light(environment), surface)
    )


def image_of(name, known, material="diffuse", light="contrasted", method=None):
    method = method or METHODS[name]
    image = method.shade(fields_of(name, known), light_of(light), surface_of(known, material))
    return np.asarray(image)


def relative(image, wanted, surface):
    covered = np.asarray(surface.mask)
    return np.sqrt(np.mean((image - wanted)[covered] ** 2)) / wanted[covered].mean()


@pytest.mark.parametrize("name", METHODS)
def test_an_open_plane_under_a_uniform_sky_is_its_albedo(name):
    image, surface = image_of(name, PLANE, light="uniform"), surface_of(PLANE)
    inside = np.asarray(surface.coverage) == 1.0
    assert inside.any()
    expected = np.broadcast_to([0.8, 0.6, 0.4], (inside.sum(), 3))
    np.testing.assert_allclose(image[inside], expected, rtol=5e-3)
    assert np.all(image[np.asarray(surface.coverage) == 0.0] == 0.0)


def at_ground(known, points):
    """One pixel each that sees a point of the ground and nothing else: from above, from so near."""
    return [
        trace_surface(
            known.load(),
            Camera((x, 0.3, z), (x, 0.0, z), up=(0.0, 0.0, -1.0), field_of_view=0.01),
            (1, 1),
        )
        for x, z in points
    ]


def shares(name, scene_name, points):
    """E / pi L at the points."""
    known = next(k for k in SCENES if k.name == scene_name)
    light, fields = light_of("uniform"), fields_of(name, known)
    images = [METHODS[name].shade(fields, light, s) for s in at_ground(known, points)]
    return np.array([float(image[0, 0, 0]) / 0.8 for image in images])


def rectangle(distance, height, half_width):
    """Form factor of a wall before whose middle a point of the ground lies (scene `wall`)."""
    away = np.hypot(distance, height)
    taken = np.arctan(half_width / distance) - distance / away * np.arctan(half_width / away)
    return taken / np.pi


@pytest.mark.parametrize("name", METHODS)
def test_half_of_the_sky_at_the_foot_of_a_wall(name):
    found = shares(name, "wall", [(1e-3, 0.0), (1e-3, 1.0)])
    np.testing.assert_allclose(found, 0.5, atol=0.02)


@pytest.mark.parametrize("name", METHODS)
def test_the_ground_before_a_wall_and_a_box(name):
    # At vertices of the ground, where there is a sample at each: 16 cells over 16 and over 12.
    for scene, step, height, half, start in (
        ("wall", 1.0, 4.0, 4.0, 0.0),
        ("box-on-plane", 0.75, 2.0, 1.0, 1.0),
    ):
        at = step * np.arange(2, 6)
        found = shares(name, scene, [(x, 0.0) for x in at])
        expected = 1.0 - rectangle(at - start, height, half)
        # The others have no sample at every one of them.
        np.testing.assert_allclose(found, expected, atol=0.02 if name == "distance-field" else 0.04)
        assert np.ptp(expected) > 0.1


def test_under_a_floating_sphere_and_beside_it():
    at = 0.75 * np.arange(2, 6)
    found = shares("distance-field", "sphere-on-plane", [(x, 0.0) for x in at])
    square = at**2 + 1.0
    np.testing.assert_allclose(found, 1.0 - 1.0 / square**1.5, atol=0.02)


@pytest.mark.parametrize("known", [BOX, BALL], ids=lambda k: k.name)
@pytest.mark.parametrize("material", ["diffuse", "phong", "ggx"])
def test_images_are_near_the_reference(known, material):
    surface = surface_of(known, material)
    wanted = exact(known, material)
    error = relative(image_of("distance-field", known, material), wanted, surface)
    # Without occlusion it is not.
    fields = fields_of("distance-field", known)
    everywhere = replace(fields, signed_distance=np.full_like(fields.signed_distance, np.pi))
    unshadowed = np.asarray(EVERY.shade(everywhere, light_of("contrasted"), surface))
    assert relative(unshadowed, wanted, surface) > 2.5 * error


@pytest.mark.parametrize("known", [BOX, BALL], ids=lambda k: k.name)
@pytest.mark.parametrize("light", ["uniform", "contrasted"])
def test_placed_and_drawn_samples_come_near_all_vertices(known, light):
    mask = surface_of(known).mask
    every = image_of("distance-field", known, light=light)
    for name in ("adaptive", "shadow-map"):
        found = fields_of(name, known)
        assert len(found.samples) <= 0.3 * len(found.positions) + 1
        assert psnr(image_of(name, known, light=light), every, mask) > 25.0
    assert np.asarray(exact(known, light=light)).max() > 0.0


def test_shadow_maps_trace_no_rays():
    scene = replace(BOX.load())
    before = scene.tracer.rays_traced
    fields = replace(DRAWN, resolution=16).precompute(scene, progress=False)
    assert fields.rays_traced == 0
    # Those that ask whether vertices are buried, 64 for each that may become a sample.
    assert scene.tracer.rays_traced - before <= 64 * len(fields.positions)
    rays = replace(PLACED, resolution=16).precompute(scene, progress=False).rays_traced
    assert rays >= 16 * 16 * 16


def test_the_image_is_linear_in_the_light():
    fields, surface = fields_of("distance-field", BOX), surface_of(BOX)
    one, two = light_of("contrasted"), light_of("uniform")
    both = jax.tree.map(lambda a, b: jnp.concatenate([a, b]), one, two)
    view = view_of(fields, surface)
    images = [np.asarray(shade_view(fields, light, view, surface)) for light in (one, two, both)]
    np.testing.assert_allclose(images[0] + images[1], images[2], rtol=1e-4, atol=1e-5)
    brighter = replace(one, amplitude=3.0 * one.amplitude)
    np.testing.assert_allclose(
        shade_view(fields, brighter, view, surface), 3.0 * images[0], rtol=1e-4, atol=1e-5
    )
    channels = replace(one, amplitude=one.amplitude * jnp.array([0.0, 1.0, 0.0]))
    other = np.asarray(shade_view(fields, channels, view, surface))
    assert np.abs(other[..., [0, 2]]).max() == 0.0
    np.testing.assert_allclose(other[..., 1], images[0][..., 1], rtol=1e-5, atol=1e-6)


def test_many_lights_at_once():
    fields, surface = fields_of("distance-field", BOX), surface_of(BOX)
    view = view_of(fields, surface)
    few = jax.tree.map(lambda leaf: leaf[:8], light_of("contrasted"))
    turned = jnp.stack([few.axis, few.axis[:, [2, 1, 0]]])
    many = SphericalGaussians(
        turned, jnp.stack([few.sharpness] * 2), jnp.stack([few.amplitude] * 2)
    )
    found = jax.vmap(lambda light: shade_view(fields, light, view, surface))(many)
    for index in range(2):
        light = jax.tree.map(lambda leaf, i=index: leaf[i], many)
        np.testing.assert_allclose(
            found[index], shade_view(fields, light, view, surface), rtol=1e-4, atol=1e-5
        )
    assert not np.allclose(found[0], found[1], rtol=1e-2)


@pytest.mark.parametrize("material", ["diffuse", "ggx"])
def test_gradients_through_the_lobes_are_differences(material):
    known = replace(BOX, size=(8, 6))
    fields, surface = fields_of("distance-field", BOX), known.surface(*MATERIALS[material])
    view = view_of(fields, surface)
    rng = np.random.default_rng(0)
    axis = rng.normal(size=(5, 3))
    axis[:, 1] = np.abs(axis[:, 1]) + 0.3
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    lobes = SphericalGaussians(
        jnp.asarray(axis, jnp.float32),
        jnp.asarray([3.0, 8.0, 20.0, 50.0, 5.0]),
        jnp.asarray(rng.uniform(0.5, 2.0, (5, 3)), jnp.float32),
    )

    @jax.jit
    @jax.value_and_grad
    def total(light):
        length = jnp.linalg.norm(light.axis, axis=-1, keepdims=True)
        light = replace(light, axis=light.axis / length)
        return shade_view(fields, light, view, surface).sum()

    _, gradient = total(lobes)
    for name, step in (("amplitude", 0.1), ("sharpness", 0.05), ("axis", 2e-3)):
        leaf = getattr(lobes, name)
        slopes = getattr(gradient, name)
        assert np.all(np.isfinite(slopes))
        assert float(jnp.abs(slopes).max()) > 0.0
        for seed in range(3):
            towards = np.random.default_rng(seed).normal(size=leaf.shape).astype(np.float32)
            if name == "sharpness":
                towards = towards * np.asarray(leaf)
            ends = [
                float(total(replace(lobes, **{name: leaf + sign * step * towards}))[0])
                for sign in (1.0, -1.0)
            ]
            measured = (ends[0] - ends[1]) / (2.0 * step)
            scale = float(jnp.abs(slopes * towards).sum())
            # Bilinear distances have kinks, over which a difference in the axis steps.
            slack = 0.05 if name == "axis" else 0.02
            assert float((slopes * towards).sum()) == pytest.approx(measured, abs=slack * scale)


def test_views_that_were_not_sampled_are_refused():
    scene, surface = BOX.load(), surface_of(BOX)
    behind = replace(BOX, camera=Camera((-2.5, 2.0, -3.0), (0.0, 0.3, 0.0)))
    other = surface_of(behind)
    fields = PLACED.precompute_for(scene, surface, progress=False)
    assert np.all(np.isfinite(PLACED.shade(fields, light_of("contrasted"), surface)))
    with pytest.raises(ValueError, match="vertices that were not sampled: precompute") as error:
        PLACED.shade(fields, light_of("contrasted"), other)
    assert "\n" not in str(error.value)
    # Without a surface all views are.
    PLACED.shade(fields_of("adaptive", BOX), light_of("contrasted"), other)
    with pytest.raises(ValueError, match="another scene"):
        EVERY.shade(fields_of("distance-field", PLANE), light_of("contrasted"), surface)


def test_a_view_of_the_sky_alone_is_black():
    away = replace(BOX, camera=Camera((0.0, 5.0, 0.0), (0.0, 9.0, 1.0)))
    surface = surface_of(away)
    assert not np.asarray(surface.mask).any()
    fields = PLACED.precompute_for(BOX.load(), surface, progress=False)
    assert len(fields.samples) == 0
    for visibility in (fields, fields_of("distance-field", BOX)):
        image = PLACED.shade(visibility, light_of("contrasted"), surface)
        assert image.shape == (*surface.mask.shape, 3)
        assert not np.asarray(image).any()


def test_inside_a_closed_room_it_is_black():
    known = KnownScene("furnace", Camera((0.0, 0.0, 0.0), (0.3, -0.4, 1.0), field_of_view=1.2))
    for name in METHODS:
        image = image_of(name, known, light="uniform")
        assert np.asarray(surface_of(known).mask).all()
        assert np.abs(image).max() < (1e-4 if name != "shadow-map" else 0.02)


def test_visibility_is_computed_once(monkeypatch):
    scene = BOX.load()
    method = DistanceField(resolution=8, lights=8)
    folder = cache_folder() / "distance-fields"
    first = method.precompute(scene, progress=False)
    files = set(folder.iterdir())
    before = scene.tracer.rays_traced
    again = replace(method, lights=16, lobes="fitted").precompute(scene, progress=False)
    assert scene.tracer.rays_traced == before
    assert set(folder.iterdir()) == files
    for one, other in zip(jax.tree.leaves(first), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(one, other)
    assert again.rays_traced == first.rays_traced == 64 * len(first.samples)
    others = [replace(method, resolution=4), DistanceField(8, 8, fill="adaptive", coarsest=4)]
    others += [
        AdaptiveVisibility(8, 8, coarsest=4),
        AdaptiveVisibility(8, 8, coarsest=4, alpha=1.0),
    ]
    for count, other in enumerate(others, 1):
        other.precompute(scene, progress=False)
        assert len(set(folder.iterdir())) == len(files) + count
    two_sided = scene.with_materials(tuple(replace(m, two_sided=True) for m in scene.materials))
    assert len(method.precompute(two_sided, progress=False).backs) > 0


def test_names_make_them():
    assert {"distance-field", "adaptive", "shadow-map"} <= set(names())
    assert create("distance-field") == DistanceField()
    made = create("adaptive:resolution=64,largest=0.2,least=0.1,interpolation=inverse")
    assert made == AdaptiveVisibility(64, largest=0.2, least=0.1, interpolation="inverse")
    assert create("shadow-map:lobes=fitted,lights=32") == ShadowMaps(lights=32, lobes="fitted")
    for name in ("distance-field", "adaptive", "shadow-map"):
        assert not create(name).stochastic
        assert hash(create(name)) == hash(create(name))
    assert create("shadow-map").fill == "rasterized"


def refusal(made, name, value):
    """What a method says to a parameter. Set behind the back of the type checks."""
    made = replace(made)
    object.__setattr__(made, name, value)
    with pytest.raises(ValueError) as error:  # noqa: PT011 - the message is checked by the caller
        made.__post_init__()
    return str(error.value)


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("lobes", "some", "lobes must be one of cells, fitted, got 'some'"),
        ("fill", "rasterized", "fill must be one of adaptive, dense, got 'rasterized'"),
        ("lights", 7, "lights must be at least 8, got 7"),
        ("resolution", 3, "resolution must be from 4 to 1024, got 3"),
        ("resolution", 2048, "resolution must be from 4 to 1024, got 2048"),
    ],
)
def test_bad_parameters_of_all_are_named(name, value, says):
    assert refusal(DistanceField(), name, value) == says


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("resolution", 24, "resolution must be coarsest times a power of two"),
        ("coarsest", 0, "resolution must be coarsest times a power of two"),
        ("fill", "guess", "fill must be one of adaptive, dense, rasterized, got 'guess'"),
        ("interpolation", "cubic", "interpolation must be linear or inverse, got 'cubic'"),
        ("alpha", 0.0, "alpha must be positive, got 0.0"),
        ("alpha", float("nan"), "alpha must be positive, got nan"),
        ("budget", -1.0, "budget must be positive, got -1.0"),
        ("least", 0.2, "least must be from 0 to largest, got 0.2 and 0.1"),
        ("least", -0.1, "least must be from 0 to largest"),
        ("initial", 0.0, "initial must be above 0 and at most 1, got 0.0"),
        ("initial", 1.5, "initial must be above 0 and at most 1, got 1.5"),
        ("rounds", -1, "rounds must be at least 0, got -1"),
        ("near", 0, "near must be at least 1, got 0"),
    ],
)
def test_bad_parameters_of_placement_are_named(name, value, says):
    message = refusal(AdaptiveVisibility(), name, value)
    assert message.startswith(says)
    assert "\n" not in message
    if name == "fill":
        assert refusal(ShadowMaps(), name, "dense").endswith("rasterized, got 'dense'")


def test_evaluations_are_lobes_times_pixels():
    surface = surface_of(BOX)
    count = int(np.sum(surface.mask))
    assert EVERY.evaluations(fields_of("distance-field", BOX), light_of("uniform"), surface) == (
        count * int(light_of("uniform").sharpness.shape[0])
    )


def test_shade_is_differentiable_in_the_material():
    """A diffuse image is linear in its albedo."""
    fields, light, surface = fields_of("distance-field", BOX), light_of("uniform"), surface_of(BOX)

    def mean(scale):
        colour = scale * surface.material.base_colour
        lit = replace(surface, material=replace(surface.material, base_colour=colour))
        return jnp.mean(EVERY.shade(fields, light, lit))

    value, slope = jax.jit(jax.value_and_grad(mean))(1.0)
    assert float(value) > 0.1
    assert float(slope) == pytest.approx(float(value), rel=1e-4)
