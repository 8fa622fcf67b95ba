"""trace_surface: known positions, orientation, interpolation, sides and supersampling."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

from jaxvis.reflectance import BlinnPhong, Material, Texture
from jaxvis.scene import Camera, build_scene, trace_surface
from jaxvis.scene import trace as trace_module

SQUARE = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])
UV = ((SQUARE[:, :2] + 1.0) / 2.0)[FACES]
AHEAD = Camera((0, 0, 4), (0, 0, 0), field_of_view=2.0 * np.arctan(0.5))
"""Sees [-2, 2] x [-2, 2] of the plane z = 0."""


def square(**options):
    return build_scene(SQUARE, FACES, **options)


def test_a_plane_at_a_known_depth():
    surface = trace_surface(square(), AHEAD, (8, 8))
    centres = (np.arange(8) + 0.5) / 2.0 - 2.0
    x, y = np.meshgrid(centres, -centres)
    mask = np.asarray(surface.mask)
    np.testing.assert_array_equal(mask, (np.abs(x) < 1) & (np.abs(y) < 1))
    expected = np.stack([x, y, np.zeros_like(x)], axis=-1)
    np.testing.assert_allclose(surface.position[mask], expected[mask], atol=1e-6)
    np.testing.assert_allclose(surface.normal[mask], np.tile([0.0, 0, 1], (16, 1)))
    np.testing.assert_allclose(surface.geometric_normal[mask], np.tile([0.0, 0, 1], (16, 1)))
    to_eye = np.array([0, 0, 4.0]) - expected
    to_eye /= np.linalg.norm(to_eye, axis=-1, keepdims=True)
    np.testing.assert_allclose(surface.view[mask], to_eye[mask], atol=1e-6)
    np.testing.assert_array_equal(surface.triangle[~mask], -1)
    np.testing.assert_array_equal(surface.normal[~mask], 0.0)
    assert (surface.width, surface.height) == (8, 8)


def test_misses_keep_the_view_direction():
    surface = trace_surface(square(), AHEAD, (4, 4))
    expected = -AHEAD.directions(4, 4)
    np.testing.assert_allclose(surface.view, expected, atol=2e-7)


def test_the_eye_is_where_the_views_meet():
    """In centred coordinates: the square is moved away from the origin."""
    shift = np.array([3.0, -2.0, 7.0])
    eye = np.array([0.5, 0.25, 4.0])
    scene = build_scene(SQUARE + shift, FACES)
    surface = trace_surface(scene, Camera(eye + shift, shift), (8, 8))
    np.testing.assert_allclose(surface.eye, eye + shift - scene.origin, atol=1e-6)
    np.testing.assert_allclose(surface.origin, scene.origin, atol=1e-6)
    mask = np.asarray(surface.mask)
    away = np.asarray(surface.eye) - np.asarray(surface.position)[mask]
    distance = np.linalg.norm(away, axis=-1, keepdims=True)
    np.testing.assert_allclose(away / distance, np.asarray(surface.view)[mask], atol=1e-6)


def test_barycentrics_belong_to_the_triangle():
    scene = square()
    surface = trace_surface(scene, AHEAD, (9, 9))
    mask = np.asarray(surface.mask)
    corners = scene.positions[scene.triangles[np.asarray(surface.triangle)[mask]]]
    weights = np.asarray(surface.barycentrics)[mask]
    np.testing.assert_allclose(weights.sum(axis=-1), 1.0, atol=1e-6)
    np.testing.assert_allclose(
        np.einsum("pk,pkx->px", weights, corners), surface.position[mask], atol=1e-6
    )


def four_colours():
    """Red top left, green top right, blue bottom left, white bottom right."""
    texels = np.array([[[1, 0, 0], [0, 1, 0]], [[0, 0, 1], [1, 1, 1]]], np.float32)
    return Material((1, 1, 1), base_colour_texture=Texture(np.repeat(texels, 8, 0).repeat(8, 1)))


def test_a_textured_quad_stands_the_right_way():
    near = dataclasses.replace(AHEAD, field_of_view=2.0 * np.arctan(0.25))
    surface = trace_surface(square(uvs=UV, materials=(four_colours(),)), near, (4, 4))
    image = np.asarray(surface.material.base_colour)
    np.testing.assert_array_equal(image[0, 0], [1, 0, 0])
    np.testing.assert_array_equal(image[0, 3], [0, 1, 0])
    np.testing.assert_array_equal(image[3, 0], [0, 0, 1])
    np.testing.assert_array_equal(image[3, 3], [1, 1, 1])
    np.testing.assert_allclose(surface.uv[0, 0], [0.125, 0.875], atol=1e-6)
    np.testing.assert_allclose(surface.uv[3, 3], [0.875, 0.125], atol=1e-6)


def test_colours_are_interpolated_between_corners():
    colours = np.concatenate([UV, np.ones((2, 3, 1))], axis=-1)
    scene = square(colours=colours, materials=(Material((0.5, 0.5, 0.5)),))
    surface = trace_surface(scene, AHEAD, (8, 8))
    mask = np.asarray(surface.mask)
    expected = 0.5 * (np.asarray(surface.position)[mask] + 1.0) / 2.0
    np.testing.assert_allclose(
        surface.material.base_colour[mask][:, :2], expected[:, :2], atol=1e-6
    )


def test_materials_go_by_triangle():
    materials = (Material((1, 0, 0), roughness=0.25), Material((0, 1, 0), (0.5, 0.5, 0.5)))
    surface = trace_surface(square(materials=materials, material_ids=[1, 0]), AHEAD, (16, 16))
    mask = np.asarray(surface.mask)
    second = np.asarray(surface.triangle)[mask] == 0
    assert 0 < second.sum() < len(second)
    np.testing.assert_array_equal(
        surface.material.base_colour[mask][second], [[0, 1, 0]] * second.sum()
    )
    np.testing.assert_array_equal(surface.material.roughness[mask], np.where(second, 1.0, 0.25))


def test_supersampling_averages_cells_of_the_pixel():
    fine = trace_surface(square(), AHEAD, (16, 16))
    surface = trace_surface(square(), AHEAD, (8, 8), supersampling=2)
    assert surface.mask.shape == (16, 16)
    np.testing.assert_array_equal(surface.position, fine.position)
    # Shifted by a quarter pixel so that pixels are partly covered.
    moved = trace_surface(
        build_scene(SQUARE, FACES), Camera((0.3, 0, 4), (0.3, 0, 0)), (5, 5), supersampling=4
    )
    coverage = np.asarray(moved.mask, float).reshape(5, 4, 5, 4).mean(axis=(1, 3))
    np.testing.assert_allclose(moved.coverage, coverage)
    assert np.any((coverage > 0) & (coverage < 1))
    # The mean is over what was hit: a constant stays constant up to the border.
    image = moved.to_image(jnp.full((20, 20, 3), 0.7))
    np.testing.assert_allclose(image, 0.7 * (coverage > 0)[..., None] * np.ones(3), atol=1e-6)


def test_backs_of_one_sided_faces_are_black():
    behind = Camera((0, 0, -4), (0, 0, 0), field_of_view=AHEAD.field_of_view)
    surface = trace_surface(square(), behind, (8, 8))
    assert not surface.mask.any()
    assert int(surface.backs.sum()) == 16
    np.testing.assert_array_equal(surface.coverage, np.asarray(surface.backs, np.float32))
    np.testing.assert_array_equal(surface.to_image(jnp.ones((8, 8, 3))), 0.0)


def test_backs_of_two_sided_faces_turn_to_the_viewer():
    behind = Camera((0, 0, -4), (0, 0, 0), field_of_view=AHEAD.field_of_view)
    tilted = np.broadcast_to([0.6, 0.0, 0.8], (2, 3, 3))
    scene = square(normals=tilted, materials=(Material(two_sided=True),))
    surface = trace_surface(scene, behind, (8, 8))
    mask = np.asarray(surface.mask)
    assert mask.sum() == 16
    assert not surface.backs.any()
    np.testing.assert_allclose(surface.normal[mask], np.tile([-0.6, 0, -0.8], (16, 1)), atol=1e-6)
    np.testing.assert_allclose(surface.geometric_normal[mask], np.tile([0.0, 0, -1], (16, 1)))


def test_the_nearest_surface_is_seen():
    points = np.concatenate([SQUARE, 0.5 * SQUARE + [0, 0, 1]])
    scene = build_scene(points, np.concatenate([FACES, FACES + 4]))
    surface = trace_surface(scene, AHEAD, (9, 9))
    assert float(surface.position[4, 4, 2]) == pytest.approx(0.5)  # centred: z is in [-0.5, 0.5]
    assert int(surface.triangle[4, 4]) >= 2


def test_normals_are_interpolated_and_unit():
    sphere = trimesh.creation.icosphere(3)
    scene = build_scene(sphere.vertices, sphere.faces)
    surface = trace_surface(scene, Camera((0, 0, 5), (0, 0, 0)), (24, 24))
    mask = np.asarray(surface.mask)
    normal, position = np.asarray(surface.normal)[mask], np.asarray(surface.position)[mask]
    np.testing.assert_allclose(np.linalg.norm(normal, axis=-1), 1.0, atol=1e-6)
    radial = position / np.linalg.norm(position, axis=-1, keepdims=True)
    assert np.max(np.abs(normal - radial)) < 0.02
    flat = np.asarray(surface.geometric_normal)[mask]
    assert np.max(np.abs(normal - radial)) < 0.5 * np.max(np.abs(flat - radial))


def test_a_scene_far_away_gives_the_same_surface():
    torus = trimesh.creation.torus(1.0, 0.4)
    shift = np.array([1e6, 1e6, -2e6])
    eye, target = np.array([2.0, 1.5, 3.0]), np.zeros(3)
    near = trace_surface(build_scene(torus.vertices, torus.faces), Camera(eye, target), (32, 24))
    far = trace_surface(
        build_scene(torus.vertices + shift, torus.faces),
        Camera(eye + shift, target + shift),
        (32, 24),
    )
    assert near.mask.sum() > 100
    np.testing.assert_array_equal(near.mask, far.mask)
    np.testing.assert_allclose(far.position, near.position, atol=1e-6)
    np.testing.assert_allclose(far.normal, near.normal, atol=2e-5)


def test_bands_of_rows_join_without_a_seam(monkeypatch):
    sphere = trimesh.creation.icosphere(2)
    scene = build_scene(sphere.vertices, sphere.faces)
    camera = Camera((0, 1, 5), (0, 0, 0))
    whole = trace_surface(scene, camera, (13, 11))
    monkeypatch.setattr(trace_module, "RAYS_AT_ONCE", 30)
    for a, b in zip(
        jax.tree.leaves(whole), jax.tree.leaves(trace_surface(scene, camera, (13, 11))), strict=True
    ):
        np.testing.assert_array_equal(a, b)


def test_the_surface_is_a_pytree_with_static_model():
    surface = trace_surface(square(reflectance=BlinnPhong()), AHEAD, (4, 4), supersampling=2)
    assert all(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(surface))
    doubled = jax.jit(lambda s: jax.tree.map(lambda leaf: leaf, s))(surface)
    assert doubled.reflectance == BlinnPhong()
    assert doubled.supersampling == 2
    assert surface.position.dtype == np.float32


@pytest.mark.parametrize(
    ("size", "supersampling", "message"),
    [
        ((0, 4), 1, "size must be"),
        ((4, 4), 0, "supersampling must be an integer from 1"),
        ((4, 4), 17, "supersampling must be an integer from 1"),
    ],
)
def test_bad_sizes_are_refused(size, supersampling, message):
    with pytest.raises(ValueError, match=message):
        trace_surface(square(), AHEAD, size, supersampling=supersampling)


def test_shading_normals_face_the_viewer_along_silhouettes():
    """A coarse sphere with smooth normals: many that are interpolated face away, none is used."""
    mesh = trimesh.creation.icosphere(subdivisions=1)
    scene = build_scene(mesh.vertices, mesh.faces, crease_angle=np.pi)
    surface = trace_surface(
        scene, Camera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), field_of_view=0.75), (160, 160)
    )
    mask = np.asarray(surface.mask)
    corners = scene.triangles[np.asarray(surface.triangle)[mask]]
    weights = np.asarray(surface.barycentrics)[mask]
    interpolated = np.einsum("pk,pkc->pc", weights, scene.normals[corners])
    view, normal = np.asarray(surface.view)[mask], np.asarray(surface.normal)[mask]
    away = np.sum(interpolated * view, axis=-1) < 0.0
    assert away.sum() > 10
    assert np.all(np.sum(normal * view, axis=-1) > 0.0)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=-1), 1.0, atol=1e-6)
    facing = np.sum(interpolated * view, axis=-1) > 0.01
    unit = interpolated / np.linalg.norm(interpolated, axis=-1, keepdims=True)
    np.testing.assert_allclose(normal[facing], unit[facing], atol=1e-5)
