"""Vectorized visibility as a method: known scenes, shadings, counts, transformations, gradients."""

from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.methods import Reference, VectorizedVisibility, create
from jaxvis.methods.vectorized import VisibilityPolygons, evaluation
from jaxvis.methods.vectorized.mesh import Mesh
from jaxvis.methods.vectorized.plan import needed_sites
from jaxvis.reflectance import Lambert, Material, Phong
from jaxvis.scene import Camera, build_scene, trace_surface
from tests.methods.known_scenes import MATERIALS, SCENES, KnownScene, contrasted, uniform_light
from tests.methods.vectorized.analytic import (
    as_environment,
    horizon,
    polygons,
    random_map,
    table_light,
    uniform,
)

SHADINGS = ("fragment", "vertex", "tessellated")
PLANE, WALL, BOX = SCENES[:3]
pytestmark = pytest.mark.usefixtures("own_caches")


@cache
def polygons_of(known: KnownScene) -> VisibilityPolygons:
    return VectorizedVisibility().precompute(known.load(), progress=False)


@cache
def light_of(name: str):
    environment = uniform_light(height=8) if name == "uniform" else contrasted()
    return VectorizedVisibility().light(environment)


@pytest.fixture(autouse=True)
def _one_size(monkeypatch):
    """All polygons take as long as the longest: fewer programs to compile."""
    monkeypatch.setattr(evaluation, "SIZES", 1)


def exact(known, surface, environment):
    method = Reference(subdivision=8)
    return np.asarray(
        method.shade(method.precompute(known.load()), method.light(environment), surface)
    )


def small(known=BOX, size=(6, 5), material="diffuse"):
    """A view of few pixels."""
    return replace(known, size=size).surface(*MATERIALS[material])


@pytest.mark.parametrize("shading", SHADINGS)
@pytest.mark.parametrize("material", ["diffuse", "phong"])
def test_an_open_plane_under_a_uniform_sky_is_its_albedo(shading, material):
    surface = PLANE.surface(*MATERIALS[material])
    image = VectorizedVisibility(shading=shading).shade(
        polygons_of(PLANE), light_of("uniform"), surface
    )
    covered = np.asarray(surface.coverage) == 1.0
    assert covered.any()
    if material == "diffuse":
        expected = np.broadcast_to([0.8, 0.6, 0.4], (covered.sum(), 3))
        np.testing.assert_allclose(np.asarray(image)[covered], expected, rtol=1e-3)
    else:
        wanted = exact(PLANE, surface, uniform_light())
        np.testing.assert_allclose(np.asarray(image)[covered], wanted[covered], rtol=2e-3)
    assert np.all(np.asarray(image)[np.asarray(surface.coverage) == 0.0] == 0.0)


@pytest.mark.parametrize("material", ["diffuse", "phong"])
def test_a_box_on_a_plane_agrees_with_the_reference(material):
    """To what polygons of 128 vectors at vertices this far apart allow; vertices alone are worse,
    and tessellation comes to the fragments' error.
    """
    surface = BOX.surface(*MATERIALS[material])
    wanted = exact(BOX, surface, contrasted())
    covered = np.asarray(surface.mask)
    error = {}
    for shading in SHADINGS:
        method = VectorizedVisibility(shading=shading, zeta=5.0)
        image = np.asarray(method.shade(polygons_of(BOX), light_of("contrasted"), surface))
        assert np.all(np.isfinite(image))
        difference = (image - wanted)[covered]
        error[shading] = np.sqrt(np.mean(difference**2)) / wanted[covered].mean()
    assert error["fragment"] < 0.07
    assert error["tessellated"] < 1.4 * error["fragment"]
    assert error["vertex"] > 2.0 * error["fragment"]


def test_inside_a_closed_box_it_is_black():
    known = KnownScene("furnace", Camera((0.0, 0.0, 0.0), (0.3, -0.4, 1.0), field_of_view=1.2))
    scene = known.load().with_materials(
        tuple(replace(m, two_sided=True) for m in known.load().materials)
    )
    surface = trace_surface(scene, known.camera, (6, 5))
    visibility = VectorizedVisibility().precompute(scene, progress=False)
    for shading in SHADINGS:
        method = VectorizedVisibility(shading=shading)
        image = method.shade(visibility, light_of("uniform"), surface)
        assert float(jnp.abs(image).max()) < 1e-5


def test_zeta_0_is_vertex_shading_and_large_zeta_fragment_shading():
    surface = small(size=(12, 10))
    visibility, light = polygons_of(BOX), light_of("contrasted")

    def image(**options):
        return np.asarray(VectorizedVisibility(**options).shade(visibility, light, surface))

    np.testing.assert_array_equal(image(zeta=0.0), image(shading="vertex"))
    fragment = image(shading="fragment")
    errors = [np.abs(image(zeta=zeta) - fragment).max() for zeta in (0.0, 3.0, 6.0)]
    assert errors[2] < 0.5 * errors[1] < 0.5 * errors[0]


def test_evaluations_count_each_polygon_of_each_site():
    surface = BOX.surface(*MATERIALS["diffuse"])
    visibility, light = polygons_of(BOX), light_of("contrasted")
    mesh, mask = Mesh.of(visibility), np.asarray(surface.mask)
    corners = len(np.unique(mesh.faces[np.asarray(surface.triangle)[mask]]))

    def count(**options):
        return VectorizedVisibility(**options).evaluations(visibility, light, surface)

    # A little less than three a pixel: buried polygons do not count.
    assert 2.5 * mask.sum() < count(shading="fragment") <= 3 * mask.sum()
    assert count(shading="vertex") == corners
    assert count(zeta=0.0) == 2 * corners
    counts = [count(zeta=zeta) for zeta in (0.0, 1.0, 2.0, 3.0)]
    assert np.all(np.diff(counts) > 0)
    plan = VectorizedVisibility(zeta=2.0).plan(visibility, light, surface)
    assert plan.evaluations == plan.sites.references + corners
    assert len(needed_sites(plan)) <= len(plan.sites.normal)


def test_two_sided_sheets_are_lit_from_the_side_that_is_seen():
    """A horizontal sheet under a sky that is bright above and dim below."""
    points = np.array([[-1.0, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]])
    material = Material(base_colour=(1.0,) * 3, two_sided=True)
    scene = build_scene(points, np.array([[0, 2, 1], [0, 3, 2]]), materials=(material,))
    radiance = np.asarray(uniform(1.0, 16)).copy()
    radiance[8:] = 0.25
    light = table_light(jnp.asarray(radiance.repeat(32, axis=0).repeat(32, axis=1)))
    visibility = VectorizedVisibility().precompute(scene, progress=False)
    for height, expected in ((2.0, 1.0), (-2.0, 0.25)):
        surface = trace_surface(scene, Camera((0.1, height, 0.2), (0.0, 0.0, 0.0)), (8, 6))
        assert int(surface.mask.sum()) > 4
        for shading in SHADINGS:
            image = VectorizedVisibility(shading=shading).shade(visibility, light, surface)
            np.testing.assert_allclose(np.asarray(image)[surface.mask], expected, rtol=5e-3)


def test_flat_triangles_hide_part_of_the_sky_of_their_smooth_normals():
    """Sites that triangles share see all of it; of a uniform sky pixels lose (1 - cos) / 2."""
    normal = np.array([np.sin(0.4), np.cos(0.4), 0.0])
    points = np.array([[-1.0, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]])
    scene = build_scene(
        points,
        np.array([[0, 2, 1], [0, 3, 2]]),
        normals=np.broadcast_to(normal, (2, 3, 3)),
        materials=(Material(base_colour=(1.0,) * 3),),
    )
    surface = trace_surface(scene, Camera((0.1, 2.0, 0.2), (0.0, 0.0, 0.0)), (8, 6))
    rings = [horizon(normal, 64)] * len(scene.positions)
    visibility = polygons(rings, scene.positions, scene.normals, scene.triangles)
    for shading in ("vertex", "tessellated"):
        method = VectorizedVisibility(shading=shading)
        image = method.shade(visibility, light_of("uniform"), surface)
        expected = (1.0 + np.cos(0.4)) / 2.0
        np.testing.assert_allclose(np.asarray(image)[surface.mask], expected, rtol=2e-3)


def test_the_order_of_vertices_does_not_matter():
    known = BOX
    scene = known.load()
    order = np.random.default_rng(0).permutation(len(scene.positions))
    turned = np.argsort(order)[scene.triangles].astype(np.int32)
    shuffled = replace(
        scene,
        positions=scene.positions[order],
        normals=scene.normals[order],
        triangles=np.roll(turned, 1, axis=1),
    )
    images = []
    for each in (scene, shuffled):
        surface = trace_surface(each, known.camera, (10, 8))
        visibility = VectorizedVisibility().precompute(each, progress=False)
        method = VectorizedVisibility(zeta=2.0)
        images.append(np.asarray(method.shade(visibility, light_of("contrasted"), surface)))
    difference = np.abs(images[1] - images[0])
    assert np.quantile(difference, 0.95) < 1e-4 * images[0].max()
    assert difference.max() < 0.05 * images[0].max()


def test_supersampled_pixels_are_means():
    surface = trace_surface(BOX.load(), BOX.camera, (5, 4), supersampling=2)
    fine = trace_surface(BOX.load(), BOX.camera, (10, 8))
    method = VectorizedVisibility(shading="fragment")
    arguments = polygons_of(BOX), light_of("contrasted")
    whole = np.asarray(method.shade(*arguments, fine))
    hit = np.asarray(fine.coverage)[..., None]
    sums = (whole * hit).reshape(4, 2, 5, 2, 3).sum(axis=(1, 3))
    hits = hit.reshape(4, 2, 5, 2, 1).sum(axis=(1, 3))
    np.testing.assert_allclose(
        method.shade(*arguments, surface), sums / np.maximum(hits, 1.0), rtol=1e-5, atol=1e-6
    )


def test_vmap_and_jit_over_lights():
    surface, visibility = small(), polygons_of(BOX)
    method = VectorizedVisibility(shading="fragment", pieces=1)
    maps = jnp.stack([random_map(16, seed) for seed in range(2)])

    def shade(radiance):
        return method.shade(visibility, table_light(radiance), surface)

    expected = np.stack([shade(radiance) for radiance in maps])
    scale = np.abs(expected).max()
    np.testing.assert_allclose(jax.jit(jax.vmap(shade))(maps), expected, atol=2e-5 * scale)
    np.testing.assert_allclose(jax.jit(shade)(maps[1]), expected[1], atol=2e-5 * scale)


def test_a_tessellation_under_jit_needs_its_plan_from_outside():
    surface, visibility = small(), polygons_of(BOX)
    method = VectorizedVisibility(zeta=2.0, pieces=1)
    light = table_light(random_map())
    with pytest.raises(ValueError, match="shade_planned"):
        jax.jit(lambda lit: method.shade(visibility, lit, surface))(light)
    plan = method.plan(visibility, light, surface)
    expected = method.shade(visibility, light, surface)
    found = jax.jit(lambda lit: method.shade_planned(visibility, lit, surface, plan))(light)
    np.testing.assert_allclose(found, expected, atol=2e-5 * float(expected.max()))
    # A traced material alone hides nothing that the plan needs.
    coloured = jax.jit(
        lambda colour: method.shade(
            visibility,
            light,
            replace(surface, material=replace(surface.material, base_colour=colour)),
        )
    )(surface.material.base_colour)
    np.testing.assert_allclose(coloured, expected, rtol=1e-5, atol=1e-6)
    with pytest.raises(ValueError, match="geometry is planned on the host"):
        jax.jit(lambda seen: method.shade(visibility, light, seen))(surface)


def slope(function, step):
    return (float(function(step)) - float(function(-step))) / (2.0 * step)


@pytest.mark.parametrize("shading", ["fragment", "tessellated"])
def test_gradients_are_those_of_finite_differences(shading):
    """With respect to texels, albedo and sharpness; tessellations are held fixed."""
    # Few vectors: with many, the sharpness hardly matters.
    options = {"integration": "vsat", "zeta": 2.0, "vectors": 24}
    method = VectorizedVisibility(shading=shading, **options)
    surface, visibility = small(), method.precompute(BOX.load(), progress=False)
    texels = random_map()
    plan = method.plan(visibility, table_light(texels), surface)

    rng = np.random.default_rng(0)
    target = method.shade_planned(visibility, table_light(texels), surface, plan)
    target += jnp.asarray(rng.normal(size=target.shape), jnp.float32)

    def loss(texels, colour, sharpness):
        light = replace(table_light(texels), sharpness=sharpness)
        seen = replace(surface, material=replace(surface.material, base_colour=colour))
        return jnp.sum((method.shade_planned(visibility, light, seen, plan) - target) ** 2)

    at = texels, surface.material.base_colour, jnp.float32(5.0)
    value_and_gradients = jax.jit(jax.value_and_grad(loss, argnums=(0, 1, 2)))
    _, gradients = value_and_gradients(*at)
    for which, step in ((0, 0.1), (1, 0.05), (2, 0.5)):
        # The steepest way: the image itself is rounded to a few 1e-5.
        way = gradients[which] / jnp.linalg.norm(gradients[which])

        def moved(amount, which=which, way=way):
            moved_to = (x + amount * way if k == which else x for k, x in enumerate(at))
            return value_and_gradients(*moved_to)[0]

        along = float(jnp.sum(gradients[which] * way))
        assert along == pytest.approx(slope(moved, step), rel=0.02)
        assert along > 1e-2
    # Outside jit, shade makes the plan itself.
    light = table_light(texels)
    eager = jax.grad(
        lambda sharpness: jnp.sum(
            (method.shade(visibility, replace(light, sharpness=sharpness), surface) - target) ** 2
        )
    )(at[2])
    assert float(eager) == pytest.approx(float(gradients[2]), rel=1e-3)


def test_gradients_of_glossy_images_are_finite_and_reach_the_roughness():
    surface, visibility = small(material="phong"), polygons_of(BOX)
    method, light = VectorizedVisibility(shading="vertex", pieces=1), light_of("contrasted")

    def mean(amount):
        rough = surface.material.roughness + amount
        material = replace(surface.material, roughness=rough)
        return jnp.mean(method.shade(visibility, light, replace(surface, material=material)))

    mean_and_gradient = jax.jit(jax.value_and_grad(mean))
    gradient = float(mean_and_gradient(0.0)[1])
    assert np.isfinite(gradient)
    assert gradient == pytest.approx(slope(lambda at: mean_and_gradient(at)[0], 0.01), rel=0.1)


def test_precomputation_is_cached_by_geometry_sides_and_parameters(monkeypatch):
    from jaxvis.methods.vectorized import method as module

    calls = []

    def counted(scene, settings, **options):
        calls.append(settings)
        return precompute(scene, settings, **options)

    precompute = module.precompute_polygons
    monkeypatch.setattr(module, "precompute_polygons", counted)
    scene = build_scene(np.array([[0.0, 0, 0], [0, 0, 1], [1, 0, 0]]), np.array([[0, 1, 2]]))
    first = VectorizedVisibility().precompute(scene, progress=False)
    again = VectorizedVisibility(shading="vertex", zeta=1.0).precompute(scene, progress=False)
    assert len(calls) == 1
    for a, b in zip(jax.tree.leaves(first), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(a, b)
    VectorizedVisibility(vectors=64).precompute(scene, progress=False)
    VectorizedVisibility(resolution=64).precompute(scene, progress=False)
    two_sided = scene.with_materials((replace(scene.materials[0], two_sided=True),))
    assert int(VectorizedVisibility().precompute(two_sided, progress=False).backs.max()) >= 0
    assert len(calls) == 4


def test_it_is_registered_with_its_parameters():
    method = create("vectorized:shading=fragment,zeta=2,integration=vsat,vectors=64")
    assert method == VectorizedVisibility(64, "fragment", 2.0, "vsat")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"zeta": -1.0}, "zeta must be from 0 to 8"),
        ({"zeta": float("nan")}, "zeta must be from 0 to 8"),
        ({"pieces": 0}, "pieces must be at least 1"),
        ({"integration": "vsat", "pieces": 2}, "pieces must be 1"),
        ({"vectors": 2}, "vectors must be"),
    ],
)
def test_bad_parameters_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        VectorizedVisibility(**options)


def test_a_view_of_nothing_is_black():
    away = trace_surface(PLANE.load(), Camera((0.0, 3.0, 0.0), (0.0, 6.0, 1.0)), (4, 3))
    for shading in SHADINGS:
        method = VectorizedVisibility(shading=shading)
        for reflectance in (Lambert(), Phong()):
            seen = replace(away, reflectance=reflectance)
            image = method.shade(polygons_of(PLANE), light_of("contrasted"), seen)
            assert float(jnp.abs(image).max()) == 0.0
        assert method.evaluations(polygons_of(PLANE), light_of("contrasted"), away) == 0


def test_light_is_differentiable_with_respect_to_the_environment():
    """The whole chain, from the environment's texels on."""
    surface, visibility = small(PLANE, (2, 2)), polygons_of(PLANE)
    method = VectorizedVisibility(shading="vertex", pieces=1)

    def mean(factor):
        environment = as_environment(contrasted().radiance * factor)
        return jnp.mean(method.shade(visibility, method.light(environment), surface))

    value, gradient = jax.jit(jax.value_and_grad(mean))(1.0)
    assert float(gradient) == pytest.approx(float(value), rel=1e-4)
