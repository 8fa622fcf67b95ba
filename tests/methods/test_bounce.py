"""One diffuse bounce against form factors, nested integrals and images of images."""

from dataclasses import fields, replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.errors import JaxvisWarning
from jaxvis.lighting import Environment
from jaxvis.methods import Reference, create, reference
from jaxvis.methods import bounce as bounce_module
from jaxvis.methods.bounce import bounced
from jaxvis.methods.reflectors import Reflectors, ReflectorVisibility
from jaxvis.methods.traced import RayVisibility, shading_points
from jaxvis.reflectance import Lambert, Material, Texture
from jaxvis.scene import Camera, build_scene, trace_surface
from jaxvis.sphere import latlong
from tests.methods.known_scenes import MATERIALS, SCENES, contrasted, lamps, uniform_light

GROUND = [[0.0, 0, -2], [0, 0, 2], [3, 0, 2], [3, 0, -2]]
WALL = [[0.0, 0, -1], [0, 2, -1], [0, 2, 1], [0, 0, 1]]
"""Corners counter-clockwise seen from the front: +Y and +X."""
PLACE = np.array([0.7, 0.0, 0.2])
GREY, ORANGE = (0.6, 0.6, 0.6), (0.9, 0.5, 0.1)


def corner(ground=GREY, wall=ORANGE, two_sided=False, away=False):
    """A wall at the end of a ground, facing it or away from it."""
    quads = [GROUND, WALL[::-1] if away else WALL]
    triangles = [[4 * q + i for i in t] for q in range(2) for t in ((0, 1, 2), (0, 2, 3))]
    materials = (Material(ground), Material(wall, two_sided=two_sided))
    return build_scene(
        np.concatenate(quads), triangles, materials=materials, material_ids=[0, 0, 1, 1]
    )


def at(scene, place=PLACE):
    """One pixel that sees a place of the ground."""
    x, y, z = place
    camera = Camera((x, y + 0.3, z), (x, y, z), up=(0.0, 0.0, -1.0), field_of_view=0.01)
    return trace_surface(scene, camera, (1, 1))


def solve(method, scene, environment, surface):
    return method.solve(method.precompute(scene), method.light(environment), surface)


def indirect_at(scene, environment, rays=4096, place=PLACE):
    """(light by a bounce [3], its standard error)."""
    solution = solve(Reference(bounces=1, bounce_rays=rays), scene, environment, at(scene, place))
    image, indirect = np.asarray(solution.image)[0, 0], np.asarray(solution.indirect)[0, 0]
    return indirect, solution.error * image.mean()


def form_factor(place, normal, polygon):
    """Share of a point's cosine-weighted hemisphere that a polygon before it fills (Lambert)."""
    to = np.asarray(polygon) - place
    to /= np.linalg.norm(to, axis=-1, keepdims=True)
    total = 0.0
    for a, b in zip(to, np.roll(to, -1, axis=0), strict=True):
        cross = np.cross(a, b)
        sine = np.linalg.norm(cross)
        if sine > 0.0:
            total += np.arctan2(sine, a @ b) * (cross @ np.asarray(normal, float)) / sine
    return abs(total) / (2.0 * np.pi)


def gathered(irradiance, place=PLACE, cells=120):
    """The integral over the wall of irradiance(y) / pi cos cos' / r^2 / pi, cell by cell."""
    y, z = np.meshgrid((np.arange(cells) + 0.5) / cells * 2.0, (np.arange(cells) + 0.5) / cells * 2)
    points = np.stack([0.0 * y, y, z - 1.0], axis=-1).reshape(-1, 3)
    away = points - place
    square = np.sum(away**2, axis=-1)
    kernel = away[:, 1] * -away[:, 0] / square**2 * (2.0 / cells) ** 2
    return (irradiance(points) * kernel[:, None]).sum(axis=0) / np.pi**2


def one_texel(row, column, height=8, value=100.0):
    """Light from one texel, and its irradiance on a plane that sees all of it."""
    radiance = np.zeros((height, 2 * height, 3), np.float32)
    radiance[row, column] = value

    def irradiance(normal):
        fine = 32
        directions = latlong.texel_directions(height * fine, 2 * height * fine)
        angles = latlong.row_solid_angles(height * fine, 2 * height * fine)[:, None]
        rows = slice(row * fine, (row + 1) * fine)
        columns = slice(column * fine, (column + 1) * fine)
        cosine = np.maximum(directions[rows, columns] @ np.asarray(normal, float), 0.0)
        return value * float((cosine * angles[rows]).sum())

    return Environment(jnp.asarray(radiance)), irradiance


def test_the_sun_on_a_wall_lights_the_ground_by_the_form_factor():
    """rho rho' E F / pi: the whole wall is lit alike, from +X (column 4 of 16) and above."""
    environment, irradiance = one_texel(2, 3)
    factor = form_factor(PLACE, (0, 1, 0), WALL)
    expected = np.multiply(GREY, ORANGE) * irradiance((1, 0, 0)) * factor / np.pi
    found, error = indirect_at(corner(), environment)
    assert 0.0 < error < 0.02 * expected.mean()
    np.testing.assert_allclose(found, expected, atol=4.0 * error)
    beside = form_factor(PLACE + [0.1, 0.0, 0.0], (0, 1, 0), WALL)
    assert (1.0 - beside / factor) * expected.mean() > 8.0 * error  # would be noticed


def test_uniform_light_on_a_wall_that_the_ground_darkens():
    """The wall's irradiance is pi L (1 - F): what its points do not see of the ground is light."""

    def irradiance(points):
        seen = [form_factor(p, (1, 0, 0), GROUND) for p in points]
        return 2.0 * np.pi * (1.0 - np.array(seen))[:, None]

    expected = np.multiply(GREY, ORANGE) * gathered(irradiance, cells=40)
    found, error = indirect_at(corner(), uniform_light(2.0))
    assert 0.0 < error < 0.02 * expected.mean()
    np.testing.assert_allclose(found, expected, atol=4.0 * error)
    undarkened = np.multiply(GREY, ORANGE) * 2.0 * form_factor(PLACE, (0, 1, 0), WALL)
    assert undarkened.mean() > expected.mean() + 8.0 * error


def test_lamps_light_by_a_bounce():
    """E = pi L (r / d)^2 cos on the wall."""
    centre, radius = np.array([1.5, 1.0, 0.5]), 0.2
    environment = lamps((tuple(centre), radius, 50.0))
    radiance = np.array([50.0, 25.0, 12.5])

    def irradiance(points):
        away = centre - points
        distance = np.linalg.norm(away, axis=-1)
        return (np.pi * radius**2 * away[:, 0] / distance**3)[:, None] * radiance

    expected = np.multiply(GREY, ORANGE) * gathered(irradiance)
    found, error = indirect_at(corner(), environment)
    np.testing.assert_allclose(found, expected, atol=4.0 * error)
    assert error < 0.05 * expected.mean()


def test_it_is_what_a_camera_at_the_point_sees_reflected():
    """Images of the reference without bounces in all directions, added up: texture and box."""
    texels = np.random.default_rng(0).uniform(0.1, 0.9, (4, 4, 3)).astype(np.float32)
    scene = SCENES[2].load()
    corners = scene.positions[scene.triangles]
    uvs = corners[..., [0, 2]] + corners[..., [1, 1]]
    material = Material(base_colour_texture=Texture(texels))
    scene = replace(SCENES[2].with_material(material, Lambert()), uvs=uvs.astype(np.float32))
    place = np.array([1.6, 0.0, 0.3])
    surface = at(scene, place)
    size = 32
    plain = Reference(subdivision=6)
    total = np.zeros(3)
    # Pixels at (u, v, 1) of a cube's face cover (1 + u^2 + v^2)^(-3/2) (2 / size)^2.
    u = (np.arange(size) + 0.5) * 2.0 / size - 1.0
    angles = (1.0 + u[:, None] ** 2 + u**2) ** -1.5 * (2.0 / size) ** 2
    eye = place + [0.0, 1e-4, 0.0]
    for forward in ((1, 0, 0), (-1, 0, 0), (0, 0, 1), (0, 0, -1), (0, 1, 0)):
        up = (0.0, 1.0, 0.0) if forward[1] == 0 else (0.0, 0.0, 1.0)
        camera = Camera(tuple(eye), tuple(eye + forward), up=up, field_of_view=np.pi / 2)
        seen = trace_surface(scene, camera, (size, size))
        cosine = np.maximum(camera.directions(size, size)[..., 1], 0.0)
        image = np.asarray(solve(plain, scene, contrasted(), seen).image)
        total += np.einsum("rc,rck->k", angles * cosine, image)
    expected = np.asarray(surface.material.base_colour)[0, 0] * total / np.pi
    solution = solve(Reference(bounces=1, bounce_rays=8192), scene, contrasted(), surface)
    error = solution.error * np.asarray(solution.image).mean()
    assert 0.0 < error < 0.03 * expected.mean()
    found = np.asarray(solution.indirect)[0, 0]
    np.testing.assert_allclose(found, expected, atol=4.0 * error + 0.01 * expected.mean())


def test_nothing_around_is_no_bounce_at_all():
    plane = SCENES[0]
    surface = plane.surface(*MATERIALS["diffuse"])
    with_bounce = solve(Reference(bounces=1), plane.load(), contrasted(), surface)
    without = solve(Reference(), plane.load(), contrasted(), surface)
    assert np.all(np.asarray(with_bounce.indirect) == 0.0)
    assert with_bounce.error == 0.0
    np.testing.assert_array_equal(with_bounce.image, without.image)
    assert np.all(np.asarray(without.indirect) == 0.0)


def test_a_surface_that_sees_nothing_is_black():
    away = Camera((0.0, 3.0, 0.0), (0.0, 6.0, 1.0))
    surface = trace_surface(SCENES[0].load(), away, (4, 3))
    for method in (Reference(bounces=1), Reference(bounces=1, error=0.1)):
        solution = solve(method, SCENES[0].load(), contrasted(), surface)
        assert float(jnp.abs(solution.image).max()) == solution.error == 0.0


def test_the_image_is_direct_and_indirect_light():
    known = SCENES[2]
    scene = known.with_material(*MATERIALS["ggx"])
    surface = known.surface(*MATERIALS["ggx"])
    direct = solve(Reference(), scene, contrasted(), surface)
    both = solve(Reference(bounces=1), scene, contrasted(), surface)
    np.testing.assert_allclose(both.image, direct.image + both.indirect, rtol=1e-6)
    assert float(both.indirect.max()) > 0.0
    # Only the diffuse albedo bounces.
    matt = replace(MATERIALS["ggx"][0], specular=(0.0,) * 3)
    dull = known.with_material(matt, MATERIALS["ggx"][1])
    dull_surface = known.surface(matt, MATERIALS["ggx"][1])
    indirect = solve(Reference(bounces=1), dull, contrasted(), dull_surface).indirect
    np.testing.assert_array_equal(indirect, both.indirect)


def test_it_is_linear_in_both_albedos():
    plain, _ = indirect_at(corner(), contrasted(), rays=256)
    darker_ground, _ = indirect_at(corner(ground=(0.3, 0.2, 0.1)), contrasted(), rays=256)
    darker_wall, _ = indirect_at(corner(wall=(0.45, 0.25, 0.0)), contrasted(), rays=256)
    assert np.all(plain > 0.0)
    np.testing.assert_allclose(darker_ground, plain * [1 / 2, 1 / 3, 1 / 6], rtol=1e-5)
    np.testing.assert_allclose(darker_wall, plain * [1 / 2, 1 / 2, 0.0], rtol=1e-5)


def test_a_red_wall_reddens_the_ground():
    scene = corner(wall=(0.9, 0.05, 0.05))
    near = np.asarray(
        solve(Reference(bounces=1), scene, uniform_light(), at(scene, (0.2, 0.0, 0.0))).image
    )[0, 0]
    far = np.asarray(
        solve(Reference(bounces=1), scene, uniform_light(), at(scene, (2.8, 0.0, 0.0))).image
    )[0, 0]
    assert near[0] > 1.3 * near[1]
    assert 1.0 < far[0] / far[1] < 0.5 * (1.0 + near[0] / near[1])


def test_sides():
    """Backs of one-sided faces send nothing; two-sided ones send what falls on the ray's side."""
    front, _ = one_texel(2, 3)
    behind, _ = one_texel(2, 11)
    facing, _ = indirect_at(corner(), front, rays=256)
    assert facing.min() > 0.0
    assert np.all(indirect_at(corner(away=True), front, rays=256)[0] == 0.0)
    turned, _ = indirect_at(corner(away=True, two_sided=True), front, rays=256)
    np.testing.assert_allclose(turned, facing, rtol=1e-5)
    for scene in (corner(), corner(two_sided=True), corner(away=True, two_sided=True)):
        assert np.all(indirect_at(scene, behind, rays=256)[0] == 0.0)


@cache
def mixed_scene():
    """A smooth ball on a ground, made of everything: textures, colours, one and two sides."""
    scene = SCENES[3].load()
    count = len(scene.triangles)
    rng = np.random.default_rng(1)

    def texture(channels):
        return Texture(rng.uniform(0.0, 1.0, (5, 3, channels)).astype(np.float32))

    shared = texture(3)
    materials = (
        Material((0.9, 0.8, 0.7), base_colour_texture=shared),
        Material((0.2, 0.5, 0.4), two_sided=True),
        Material((0.7, 0.9, 0.6), base_colour_texture=texture(1), two_sided=True),
        Material((0.3, 0.3, 0.9), base_colour_texture=shared),
    )
    flipped = scene.triangles.copy()
    flipped[::5] = flipped[::5, ::-1]
    return replace(
        scene,
        triangles=flipped,
        materials=materials,
        material_ids=(np.arange(count) % 4).astype(np.int32),
        uvs=rng.uniform(-1.0, 2.0, (count, 3, 2)).astype(np.float32),
        colours=rng.uniform(0.1, 1.0, (count, 3, 3)).astype(np.float32),
    )


def test_hits_are_what_a_camera_sees():
    scene, camera = mixed_scene(), SCENES[3].camera
    surface = trace_surface(scene, camera, (40, 30))
    directions = camera.directions(40, 30).reshape(-1, 3).astype(np.float32)
    eye = np.broadcast_to(np.asarray(surface.eye), directions.shape)
    hits = scene.tracer.closest_hit(eye, directions)
    found = Reflectors(ReflectorVisibility.of(scene)).at(hits, directions)
    mask = np.asarray(surface.mask).reshape(-1)
    assert mask.sum() > 300
    assert np.asarray(surface.backs).sum() > 20
    np.testing.assert_array_equal(found.ray, np.flatnonzero(mask))
    expected = shading_points(surface)
    for name, values in (
        ("origin", expected.origin),
        ("normal", expected.normal),
        ("geometric_normal", expected.geometric_normal),
        ("view", expected.view),
        ("albedo", expected.material.base_colour),
    ):
        np.testing.assert_allclose(getattr(found, name), values, atol=3e-6, err_msg=name)


def estimates_of(scene, surface, environment, rays=256, seed=0):
    method = Reference(bounces=1)
    visibility, light = method.precompute(scene), method.light(environment)
    return next(bounced(visibility, light, shading_points(surface), rays, seed=seed))[0]


def test_the_stated_error_is_the_spread_over_seeds():
    known = SCENES[2]
    surface = known.surface(*MATERIALS["diffuse"])
    scene = known.with_material(*MATERIALS["diffuse"])
    runs = np.stack([estimates_of(scene, surface, contrasted(), seed=s) for s in range(12)])
    stated = np.sqrt((runs.var(axis=1, ddof=1) / runs.shape[1]).mean(axis=(1, 2)))
    real = np.sqrt(runs.mean(axis=1).var(axis=0, ddof=1).mean())
    assert real > 0.005 * runs.mean()
    assert 0.5 < np.sqrt((stated**2).mean()) / real < 2.0
    assert np.all((stated > 0.3 * real) & (stated < 3.0 * real))
    # Unbiased: many runs of few rays agree with one of many.
    method = Reference(bounces=1, bounce_rays=2048)
    fine = solve(method, scene, contrasted(), surface)
    mean = np.asarray(fine.indirect)[np.asarray(surface.mask)].mean()
    of_mean = runs.mean(axis=(1, 2, 3)).std(ddof=1) / np.sqrt(len(runs))
    assert abs(runs.mean() - mean) < 4.0 * of_mean + 0.005 * mean


def test_neither_threads_nor_other_points_change_a_bit(monkeypatch):
    known = SCENES[2]
    scene = known.with_material(*MATERIALS["diffuse"])
    surface = trace_surface(scene, known.camera, (64, 48))
    assert len(shading_points(surface).pixel) * 64 > 2 * 65536  # several blocks
    whole = estimates_of(scene, surface, contrasted(), rays=256)
    for threads in (1, 3):
        monkeypatch.setattr(scene.tracer, "threads", threads)
        again = estimates_of(scene, surface, contrasted(), rays=256)
        np.testing.assert_array_equal(again, whole)
    # The lower half of the image alone, whose points then stand elsewhere in the blocks.
    upper = np.asarray(surface.mask).copy()
    upper[:20] = False
    fewer = estimates_of(scene, replace(surface, mask=jnp.asarray(upper)), contrasted(), rays=256)
    kept = upper[np.asarray(surface.mask)]
    np.testing.assert_array_equal(fewer, whole[:, kept])
    assert np.any(estimates_of(scene, surface, contrasted(), rays=256, seed=1) != whole)


def test_an_error_target_doubles_the_rays(monkeypatch):
    known = SCENES[2]
    scene = known.with_material(*MATERIALS["diffuse"])
    surface = known.surface(*MATERIALS["diffuse"])
    solutions = [
        solve(Reference(error=e, bounces=1, bounce_rays=128), scene, contrasted(), surface)
        for e in (0.05, 0.01)
    ]
    for solution, target in zip(solutions, (0.05, 0.01), strict=True):
        assert 0.0 < solution.error <= target
    assert solutions[1].directions > solutions[0].directions
    difference = np.asarray(solutions[0].image - solutions[1].image)[np.asarray(surface.mask)]
    relative = np.sqrt(np.mean(difference**2)) / np.asarray(solutions[1].image).mean()
    assert relative < 4.0 * solutions[0].error
    monkeypatch.setattr(reference, "MOST_BOUNCE_RAYS", 256)
    with pytest.warns(JaxvisWarning, match="after 256 bounce rays, not 0.002"):
        capped = solve(
            Reference(error=0.002, bounces=1, bounce_rays=128), scene, contrasted(), surface
        )
    assert capped.error > 0.002


def test_solutions_are_cached_with_their_indirect_light(tmp_path, monkeypatch):
    monkeypatch.setenv("JAXVIS_CACHE", str(tmp_path))
    known, method = SCENES[2], Reference(bounces=1, bounce_rays=256)
    scene = known.with_material(*MATERIALS["diffuse"])
    surface = known.surface(*MATERIALS["diffuse"])
    light = method.light(contrasted())
    first, cached_first = method.solve_cached(method.precompute(scene), light, surface)
    second, cached_second = method.solve_cached(method.precompute(scene), light, surface)
    assert (cached_first, cached_second) == (False, True)
    for field in fields(first):
        np.testing.assert_array_equal(getattr(first, field.name), getattr(second, field.name))
    assert float(second.indirect.max()) > 0.0
    redder = known.with_material(Material((0.9, 0.1, 0.1)), Lambert())  # what the rays meet
    others = [
        (method, method.precompute(redder)),
        (Reference(bounces=1, bounce_rays=512), method.precompute(scene)),
        (Reference(), RayVisibility.of(scene)),
    ]
    for other, visibility in others:
        solution, cached = other.solve_cached(visibility, light, surface)
        assert not cached
    assert float(jnp.abs(solution.indirect).max()) == 0.0
    again, cached = Reference().solve_cached(RayVisibility.of(scene), light, surface)
    assert cached
    np.testing.assert_array_equal(again.indirect, solution.indirect)


def test_names_of_methods_without_bounces_are_as_before():
    """Cached results are found by them."""
    assert repr(Reference()) == "Reference(error=None, rows=None, subdivision=1)"
    assert repr(Reference(0.01)) == "Reference(error=0.01, rows=None, subdivision=1)"
    shown = repr(Reference(bounces=1, bounce_rays=64))
    assert shown.endswith("bounces=1, bounce_rays=64)")
    assert eval(shown) == Reference(bounces=1, bounce_rays=64)
    assert create("reference:bounces=1,bounce_rays=64") == Reference(bounces=1, bounce_rays=64)


def test_what_triangles_reflect_can_be_stored(tmp_path):
    scene = mixed_scene()
    kept = ReflectorVisibility.of(scene)
    assert len(kept.textures) == 2  # a shared one is stored once
    kept.save(tmp_path / "kept.npz")
    loaded = ReflectorVisibility.load(tmp_path / "kept.npz")
    assert loaded.nbytes == kept.nbytes > RayVisibility.of(scene).nbytes
    for a, b in zip(jax.tree.leaves(kept), jax.tree.leaves(loaded), strict=True):
        np.testing.assert_array_equal(a, b)
    surface = trace_surface(scene, SCENES[3].camera, (8, 6))
    method = Reference(bounces=1, bounce_rays=256)
    light = method.light(contrasted())
    np.testing.assert_array_equal(
        method.solve(kept, light, surface).indirect, method.solve(loaded, light, surface).indirect
    )
    plain = SCENES[0].load()  # no texture coordinates, no colours
    ReflectorVisibility.of(plain).save(tmp_path / "plain.npz")
    assert ReflectorVisibility.load(tmp_path / "plain.npz").uvs is None


def test_directions_are_counted():
    known = SCENES[2]
    surface = known.surface(*MATERIALS["diffuse"])
    pixels = int(surface.mask.sum())
    method = Reference(bounces=1, bounce_rays=256)
    visibility = method.precompute(known.load())
    for environment, at_ends in ((contrasted(), 0), (lamps(((3.0, 2.0, 1.0), 0.2, 1.0)), 1)):
        light = method.light(environment)
        texels = environment.radiance[..., 0].size
        spheres = at_ends * 4 * reference.SPHERE_DIRECTIONS
        each = texels + spheres + 256 * (1 + bounce_module.LIGHTS_PER_HIT + 1 + at_ends)
        assert method.solve(visibility, light, surface).directions == each
        assert method.evaluations(visibility, light, surface) == each * pixels


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"bounces": 2}, "bounces must be 0 or 1, got 2"),
        ({"bounces": -1}, "bounces must be 0 or 1, got -1"),
        ({"bounce_rays": 100}, "bounce_rays must be a power of two from 4 to 16384, got 100"),
        ({"bounce_rays": 2}, "bounce_rays must be a power of two"),
        ({"bounce_rays": 1 << 15}, "bounce_rays must be a power of two"),
    ],
)
def test_bad_parameters_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        Reference(**arguments)


def test_visibility_without_materials_is_refused():
    known, method = SCENES[2], Reference(bounces=1)
    surface = known.surface(*MATERIALS["diffuse"])
    with pytest.raises(ValueError, match="precompute it with the same bounces"):
        method.solve(RayVisibility.of(known.load()), method.light(contrasted()), surface)
