"""The reference against closed forms, and its stated error against what it really errs."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.lighting import Environment
from jaxvis.methods import Reference
from jaxvis.methods.traced import RayVisibility
from jaxvis.reflectance import Lambert, Material
from jaxvis.scene import Camera, build_scene, trace_surface
from jaxvis.sphere import latlong
from tests.methods.known_scenes import MATERIALS, SCENES, contrasted, uniform_light

pytestmark = pytest.mark.usefixtures("optimised")

WHITE = Material(base_colour=(1.0,) * 3)


def solve(method, scene, environment, surface):
    visibility = method.precompute(scene)
    return method.solve(visibility, method.light(environment), surface)


def plane_point(normal):
    """One pixel on a one-triangle plane with this unit normal, and the scene."""
    normal = np.asarray(normal, float)
    axis = np.eye(3)[np.argmin(np.abs(normal))]
    tangent = np.cross(axis, normal)
    tangent /= np.linalg.norm(tangent)
    corners = np.stack([tangent, np.cross(normal, tangent), -tangent - np.cross(normal, tangent)])
    triangles = np.array([[0, 1, 2]])
    scene = build_scene(10.0 * corners, triangles, materials=(WHITE,))
    camera = Camera(tuple(3.0 * normal + 0.1 * tangent), (0.0, 0.0, 0.0), up=tuple(tangent))
    return scene, trace_surface(scene, camera, (1, 1))


@pytest.mark.parametrize("name", ["diffuse", "phong", "ggx"])
def test_uniform_light_on_an_open_plane_is_the_albedo(name):
    """Lambert: exactly the albedo. Others: below their albedo bound, and above the diffuse part."""
    material, reflectance = MATERIALS[name]
    known = SCENES[0]
    surface = known.surface(material, reflectance)
    image = np.asarray(
        solve(Reference(subdivision=16), known.load(), uniform_light(2.0), surface).image
    )
    covered = np.asarray(surface.coverage) == 1.0
    assert covered.any()
    if name == "diffuse":
        np.testing.assert_allclose(
            image[covered] / 2.0, [[0.8, 0.6, 0.4]] * covered.sum(), rtol=2e-3
        )
    else:
        assert np.all(image[covered] < 2.0)
        assert np.all(image[covered] > 0.2 * np.asarray(material.base_colour))
    assert np.all(image[~covered] == 0.0)


@pytest.mark.parametrize(
    "normal",
    [
        *(np.array([x, y, z]) / np.sqrt(3.0) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)),
        (0.0, 1.0, 0.0),
        (0.0, -1.0, 0.0),
        (0.0, 0.0, -1.0),
    ],
    ids=str,
)
def test_one_bright_texel_lights_the_side_that_it_is_on(normal):
    """E = L Omega max(n.l, 0): the sky is where the conventions say, not mirrored."""
    height, width = 8, 16
    scene, surface = plane_point(normal)
    row, column = (int(i) for i in latlong.texel(jnp.asarray(normal, jnp.float32), height, width))
    radiance = np.zeros((height, width, 3), np.float32)
    radiance[row, column] = (100.0, 50.0, 25.0)
    direction = latlong.texel_directions(height, width)[row, column]
    solid_angle = latlong.row_solid_angles(height, width)[row]
    image = solve(Reference(), scene, Environment(jnp.asarray(radiance)), surface).image
    expected = radiance[row, column] * solid_angle * np.dot(normal, direction) / np.pi
    np.testing.assert_allclose(image[0, 0], expected, rtol=1e-4)
    opposite = np.zeros_like(radiance)
    opposite[height - 1 - row, (column + width // 2) % width] = 1.0
    dark = solve(Reference(), scene, Environment(jnp.asarray(opposite)), surface).image
    assert np.all(np.asarray(dark) == 0.0)


def test_a_closed_box_is_black_and_a_foot_of_a_wall_sees_half():
    from jaxvis.scene.builtin import builtin_scene

    inside = builtin_scene("furnace")
    camera = Camera((0.0, 0.0, 0.0), (0.3, -0.4, 1.0), field_of_view=1.2)
    surface = trace_surface(
        replace(inside, materials=(replace(WHITE, two_sided=True),)), camera, (6, 5)
    )
    assert bool(surface.mask.all())
    image = solve(Reference(), inside, uniform_light(), surface).image
    assert float(jnp.abs(image).max()) == 0.0


@pytest.mark.parametrize("name", ["diffuse", "ggx"])
def test_a_subset_errs_by_what_it_states(name):
    known = SCENES[2]
    material, reflectance = MATERIALS[name]
    surface = known.surface(material, reflectance)
    environment = contrasted()
    exact = solve(Reference(subdivision=16), known.load(), environment, surface)
    subset = solve(Reference(error=0.01), known.load(), environment, surface)
    assert exact.error == 0.0
    assert 0.0 < subset.error <= 0.01
    covered = np.asarray(surface.mask)
    difference = np.asarray(subset.image - exact.image)[covered]
    error = np.sqrt(np.mean(difference**2)) / np.asarray(exact.image)[covered].mean()
    assert error < 2.5 * subset.error + 2e-3  # the second term: what 16^2 points a texel leave
    assert error > 0.1 * subset.error
    finer = solve(Reference(error=0.004), known.load(), environment, surface)
    assert finer.directions > subset.directions


def test_rows_resample_the_light():
    known = SCENES[0]
    surface = known.surface(WHITE, Lambert())
    coarse = Reference(rows=4).light(contrasted())
    assert coarse.environment.height == 4
    full = solve(Reference(subdivision=8), known.load(), contrasted(), surface).image
    less = solve(Reference(rows=4, subdivision=8), known.load(), contrasted(), surface).image
    assert float(jnp.abs(less / full - 1.0).max()) < 0.5
    assert float(jnp.abs(less / full - 1.0).max()) > 1e-3


def test_solutions_are_cached_by_content(tmp_path, monkeypatch):
    monkeypatch.setenv("JAXVIS_CACHE", str(tmp_path))
    known, method = SCENES[2], Reference(subdivision=2)
    surface = known.surface(*MATERIALS["diffuse"])
    visibility, light = method.precompute(known.load()), method.light(contrasted())
    first, cached_first = method.solve_cached(visibility, light, surface)
    second, cached_second = method.solve_cached(visibility, light, surface)
    assert (cached_first, cached_second) == (False, True)
    np.testing.assert_array_equal(first.image, second.image)
    others = [
        (method, visibility, method.light(contrasted(seed=1)), surface),
        (Reference(subdivision=3), visibility, light, surface),
        (method, visibility, light, known.surface(*MATERIALS["phong"])),
        (method, RayVisibility.of(SCENES[1].load()), light, surface),
    ]
    for other, *arguments in others:
        assert not other.solve_cached(*arguments)[1]


def test_a_surface_that_sees_nothing_is_black():
    known = SCENES[0]
    away = Camera((0.0, 3.0, 0.0), (0.0, 6.0, 1.0))
    surface = trace_surface(known.load(), away, (4, 3))
    for method in (Reference(), Reference(error=0.1)):
        solution = solve(method, known.load(), contrasted(), surface)
        assert float(jnp.abs(solution.image).max()) == 0.0
