"""Visibility correspondence as a method: shadings, counts, tracing, caches, refusals."""

from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.methods.vectorized import VectorizedVisibility, evaluation
from jaxvis.methods.vectorized import irradiance as integration
from jaxvis.methods.vectorized.correspondence import interpolated
from jaxvis.methods.vectorized.correspondence import method as module
from jaxvis.methods.vectorized.correspondence.method import VisibilityCorrespondence
from jaxvis.methods.vectorized.mesh import Mesh
from jaxvis.scene import build_scene
from tests.methods.known_scenes import MATERIALS, SCENES, contrasted
from tests.methods.vectorized.analytic import random_map, table_light, uniform
from tests.methods.vectorized.correspondence.staircases import corresponding

SHADINGS = ("fragment", "vertex", "tessellated")
PLANE, WALL, BOX = SCENES[:3]
pytestmark = pytest.mark.usefixtures("own_caches")
QUICK = {"vectors": 24, "pieces": 1}


@pytest.fixture(autouse=True)
def _one_size(monkeypatch):
    """All outlines take as long as the longest: fewer programs to compile."""
    monkeypatch.setattr(evaluation, "SIZES", 1)
    monkeypatch.setattr(interpolated, "SIZES", 1)


@cache
def polygons_of(known):
    return VectorizedVisibility(vectors=24).precompute(known.load(), progress=False)


@cache
def visibility_of(known, apart=False):
    """Entities in proportion: what they show is not to be looked at."""
    polygons = polygons_of(known)
    return corresponding(polygons, separate=[True] * len(polygons.triangles) if apart else None)


@cache
def light_of(kind="random"):
    if kind == "lobes":
        return VectorizedVisibility().light(contrasted())
    return table_light(uniform(1.0, 256) if kind == "uniform" else random_map())


def surface_of(known=BOX, size=(6, 5), material="diffuse"):
    return replace(known, size=size).surface(*MATERIALS[material])


@pytest.mark.parametrize("shading", SHADINGS)
def test_an_open_plane_under_a_uniform_sky_is_its_albedo(shading):
    surface = surface_of(PLANE)
    method = VisibilityCorrespondence(**QUICK, shading=shading)
    image = method.shade(visibility_of(PLANE), light_of("uniform"), surface)
    covered = np.asarray(surface.coverage) == 1.0
    expected = np.broadcast_to([0.8, 0.6, 0.4], (covered.sum(), 3))
    np.testing.assert_allclose(np.asarray(image)[covered], expected, rtol=2e-2)


@pytest.mark.parametrize(
    ("shading", "material"),
    [("fragment", "diffuse"), ("tessellated", "diffuse"), ("tessellated", "phong")],
)
def test_separate_faces_are_vectorized_bit_for_bit(shading, material):
    surface, options = surface_of(material=material), {**QUICK, "shading": shading}
    light = light_of("lobes" if material == "phong" else "random")
    apart = visibility_of(BOX, apart=True)
    found = VisibilityCorrespondence(**options).shade(apart, light, surface)
    expected = VectorizedVisibility(**options).shade(polygons_of(BOX), light, surface)
    np.testing.assert_array_equal(found, expected)


def test_evaluations_count_one_outline_a_site():
    surface, mask = surface_of(size=(18, 14)), surface_of(size=(18, 14)).mask
    mesh = Mesh.of(polygons_of(BOX))
    corners = len(np.unique(mesh.faces[np.asarray(surface.triangle)[np.asarray(mask)]]))

    def count(**options):
        method = VisibilityCorrespondence(**QUICK, **options)
        return method.evaluations(visibility_of(BOX), light_of(), surface)

    assert count(shading="fragment") == mask.sum()
    assert count(shading="vertex") == corners
    plan = VisibilityCorrespondence(**QUICK, zeta=2.0).plan(visibility_of(BOX), light_of(), surface)
    assert plan.evaluations == len(plan.sites.normal) + corners
    apart = visibility_of(BOX, apart=True)
    three = VisibilityCorrespondence(**QUICK, shading="fragment")
    assert three.evaluations(apart, light_of(), surface) > 2.5 * mask.sum()


def test_large_zeta_is_fragment_shading():
    surface = surface_of(size=(12, 10))

    def image(**options):
        method = VisibilityCorrespondence(**QUICK, **options)
        return np.asarray(method.shade(visibility_of(BOX), light_of("lobes"), surface))

    np.testing.assert_array_equal(image(zeta=0.0), image(shading="vertex"))
    fragment = image(shading="fragment")
    errors = [np.abs(image(zeta=zeta) - fragment).max() for zeta in (0.0, 6.0)]
    assert errors[1] < 0.5 * errors[0]


def test_what_is_interpolated_makes_a_difference():
    surface = surface_of()
    images = [
        VisibilityCorrespondence(**QUICK, shading="fragment", interpolation=mode).shade(
            visibility_of(BOX), light_of(), surface
        )
        for mode in ("position", "direction")
    ]
    assert float(jnp.abs(images[0] - images[1]).max()) > 1e-3 * float(images[0].max())


def test_vmap_and_jit_over_lights():
    surface, visibility = surface_of(), visibility_of(BOX)
    method = VisibilityCorrespondence(**QUICK, zeta=2.0)
    maps = jnp.stack([random_map(16, seed) for seed in range(2)])
    plan = method.plan(visibility, table_light(maps[0]), surface)

    def shade(radiance):
        return method.shade_planned(visibility, table_light(radiance), surface, plan)

    expected = np.stack([shade(radiance) for radiance in maps])
    scale = np.abs(expected).max()
    np.testing.assert_allclose(jax.jit(jax.vmap(shade))(maps), expected, atol=2e-5 * scale)
    np.testing.assert_allclose(jax.jit(shade)(maps[1]), expected[1], atol=2e-5 * scale)
    with pytest.raises(ValueError, match="shade_planned"):
        jax.jit(lambda light: method.shade(visibility, light, surface))(light_of())


def test_gradients_are_those_of_finite_differences():
    """With respect to texels and sharpness, along the steepest way."""
    surface, visibility, texels = surface_of(), visibility_of(BOX), random_map()
    method = VisibilityCorrespondence(vectors=24, integration="vsat", shading="fragment")
    target = method.shade(visibility, table_light(texels), surface)
    target += jnp.asarray(np.random.default_rng(0).normal(size=target.shape), jnp.float32)

    def loss(texels, sharpness):
        light = replace(table_light(texels), sharpness=sharpness)
        return jnp.sum((method.shade(visibility, light, surface) - target) ** 2)

    at = texels, jnp.float32(5.0)
    value_and_gradients = jax.jit(jax.value_and_grad(loss, argnums=(0, 1)))
    _, gradients = value_and_gradients(*at)
    for which, step in ((0, 0.1), (1, 0.5)):
        way = gradients[which] / jnp.linalg.norm(gradients[which])
        low, high = (
            value_and_gradients(
                *(x + sign * step * way if k == which else x for k, x in enumerate(at))
            )[0]
            for sign in (-1.0, 1.0)
        )
        along = float(jnp.sum(gradients[which] * way))
        assert along == pytest.approx(float(high - low) / (2.0 * step), rel=0.02)
        assert along > 1e-3


def test_gradients_of_glossy_images_reach_the_roughness():
    surface, visibility = surface_of(material="phong"), visibility_of(BOX)
    method = VisibilityCorrespondence(**QUICK, shading="vertex")

    def mean(amount):
        rough = surface.material.roughness + amount
        material = replace(surface.material, roughness=rough)
        seen = replace(surface, material=material)
        return jnp.mean(method.shade(visibility, light_of("lobes"), seen))

    gradient = float(jax.jit(jax.grad(mean))(0.0))
    assert np.isfinite(gradient)
    assert abs(gradient) > 1e-8


def test_a_second_frame_compiles_nothing():
    surface, visibility = surface_of(size=(12, 10)), visibility_of(BOX)
    method = VisibilityCorrespondence(**QUICK, zeta=2.0)
    stages = integration.outline_pieces, integration.contour_lookups, integration.projected
    first = method.shade(visibility, light_of(), surface)
    programs = [stage._cache_size() for stage in stages]
    assert min(programs) > 0
    np.testing.assert_array_equal(method.shade(visibility, light_of(), surface), first)
    assert [stage._cache_size() for stage in stages] == programs


def test_correspondences_are_cached_beside_their_polygons(monkeypatch):
    calls = []

    def build(polygons, tracer, settings, *, progress):
        calls.append(settings)
        return corresponding(polygons)

    monkeypatch.setattr(module.build, "build_correspondence", build)
    scene = build_scene(np.array([[0.0, 0, 0], [0, 0, 1], [1, 0, 0]]), np.array([[0, 1, 2]]))
    first = VisibilityCorrespondence().precompute(scene, progress=False)
    again = VisibilityCorrespondence(shading="vertex", zeta=1.0).precompute(scene, progress=False)
    assert len(calls) == 1
    for a, b in zip(jax.tree.leaves(first), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(a, b)
    expected = VectorizedVisibility().precompute(scene, progress=False)
    for a, b in zip(jax.tree.leaves(first.polygons), jax.tree.leaves(expected), strict=True):
        np.testing.assert_array_equal(a, b)
    VisibilityCorrespondence(seed=1).precompute(scene, progress=False)
    VisibilityCorrespondence(construction="paper").precompute(scene, progress=False)
    VisibilityCorrespondence(vectors=64).precompute(scene, progress=False)
    assert [call.seed for call in calls] == [0, 1, 0, 0]
    assert calls[2].construction == "paper"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"seed": -1}, "seed must not be negative"),
        ({"zeta": -1.0}, "zeta must be from 0 to 8"),
    ],
)
def test_bad_parameters_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        VisibilityCorrespondence(**options)


def test_each_method_asks_for_its_own_visibility():
    surface = surface_of()
    with pytest.raises(ValueError, match="correspondence shades CorrespondingPolygons"):
        VisibilityCorrespondence().shade(polygons_of(BOX), light_of(), surface)
    with pytest.raises(ValueError, match="vectorized shades VisibilityPolygons"):
        VectorizedVisibility().shade(visibility_of(BOX), light_of(), surface)
