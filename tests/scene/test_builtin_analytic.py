"""The answers in the docstrings of the analytic scenes, by rays over the hemisphere."""

import numpy as np
import pytest

from jaxvis.scene.builtin import builtin_scene
from tests.scene.builtin_checks import occluded_share


def rectangle_share(distance, height, half_width):
    """Form factor of a rectangle that stands on the plane, from a point before its middle."""
    reach = np.hypot(distance, height)
    return (
        np.arctan(half_width / distance) - distance / reach * np.arctan(half_width / reach)
    ) / np.pi


def test_plane():
    scene = builtin_scene("plane", size=4.0, cells=3)
    assert occluded_share(scene, (0.3, 0.0, 1.1)) == 0.0
    assert occluded_share(scene, (0.3, 0.0, 1.1), (0.0, -1.0, 0.0)) == 0.0
    assert np.allclose(scene.bounds, [[-2, 0, -2], [2, 0, 2]])
    assert np.allclose(scene.normals, [0.0, 1.0, 0.0])


@pytest.mark.parametrize("distance", [0.003, 0.5, 2.0])
def test_wall(distance):
    scene = builtin_scene("wall", height=3.0, width=5.0)
    expected = rectangle_share(distance, 3.0, 2.5)
    assert occluded_share(scene, (distance, 0.0, 0.0)) == pytest.approx(expected, abs=2e-3)
    if distance < 0.01:
        assert expected == pytest.approx(0.5, abs=1e-3)


def test_front_of_a_wall():
    scene = builtin_scene("wall", size=1000.0, height=2.0, width=4.0, cells=4)
    assert occluded_share(scene, (0.0, 1.0, 0.5), (1.0, 0.0, 0.0)) == pytest.approx(0.5, abs=3e-3)


@pytest.mark.parametrize("distance", [0.1, 1.0])
@pytest.mark.parametrize("side", [(1.0, 0.0), (0.0, -1.0)])
def test_box_on_plane(distance, side):
    scene = builtin_scene("box-on-plane", width=3.0, height=1.0)
    point = (side[0] * (1.5 + distance), 0.0, side[1] * (1.5 + distance))
    expected = rectangle_share(distance, 1.0, 1.5)
    assert occluded_share(scene, point) == pytest.approx(expected, abs=2e-3)
    assert occluded_share(scene, (0.4, 1.0, -0.3)) == 0.0


def test_sphere_is_convex():
    scene = builtin_scene("sphere", radius=2.0, rows=12, albedo=1.0)
    assert np.allclose(np.linalg.norm(scene.positions, axis=-1), 2.0, rtol=1e-6)
    assert np.allclose(scene.normals, scene.positions / 2.0, atol=1e-6)
    for triangle in (0, 40, 200):
        point = scene.positions[scene.triangles[triangle]].mean(axis=0)
        assert occluded_share(scene, point, scene.geometric_normals[triangle], 2000) == 0.0
    assert [material.base_colour for material in scene.materials] == [(1.0, 1.0, 1.0)]


@pytest.mark.parametrize(("clearance", "x"), [(0.0, 0.6), (0.0, 2.0), (1.5, 0.0), (1.5, 1.0)])
def test_sphere_on_plane(clearance, x):
    scene = builtin_scene("sphere-on-plane", radius=0.8, clearance=clearance, rows=48)
    centre = 0.8 + clearance
    distance = np.hypot(centre, x)
    expected = (0.8 / distance) ** 2 * centre / distance
    assert occluded_share(scene, (x, 0.0, 0.0)) == pytest.approx(expected, abs=3e-3)


@pytest.mark.parametrize("elevation", [-0.8, 0.0, 0.7])
def test_on_the_sphere_half_of_the_sky_turns_with_the_normal(elevation):
    scene = builtin_scene("sphere-on-plane", size=1000.0, cells=4)
    normal = np.array([np.cos(elevation), np.sin(elevation), 0.0])
    point = normal + [0.0, 1.001, 0.0]
    expected = 0.5 - 0.5 * np.sin(elevation)
    assert occluded_share(scene, point, normal) == pytest.approx(expected, abs=4e-3)


@pytest.mark.parametrize(("radius", "height"), [(1.0, 1.0), (0.3, 2.0), (2.0, 0.5)])
def test_cap(radius, height):
    scene = builtin_scene("cap", radius=radius, height=height)
    expected = radius**2 / (radius**2 + height**2)
    assert occluded_share(scene, (0.0, 0.0, 0.0)) == pytest.approx(expected, abs=1e-3)
    assert [material.two_sided for material in scene.materials] == [False, True]
    areas = _areas(scene)[scene.material_ids == 1]
    assert areas.sum() == pytest.approx(np.pi * radius**2, rel=1e-5)


def test_furnace():
    scene = builtin_scene("furnace", size=3.0, cells=2)
    for point, normal in (
        ((0.2, -1.5, 0.7), (0, 1, 0)),
        ((1.5, 0.3, 0.0), (-1, 0, 0)),
        ((1.499, 1.499, 1.499), (-1, -1, -1)),
        ((0.0, 0.0, 0.0), (0, 1, 0)),
    ):
        assert occluded_share(scene, point, normal, 5000) == 1.0
    assert np.allclose(scene.bounds, [[-1.5] * 3, [1.5] * 3])
    assert _areas(scene).sum() == pytest.approx(54.0)


@pytest.mark.parametrize(("ring", "tube"), [(2.0, 0.6), (1.0, 0.8)])
def test_torus_on_plane(ring, tube):
    scene = builtin_scene(
        "torus-on-plane", ring_radius=ring, tube_radius=tube, sphere_radius=0, around=96
    )
    expected = 1.0 - np.cos(2.0 * np.arctan(tube / ring)) ** 2
    assert occluded_share(scene, (0.0, 0.0, 0.0)) == pytest.approx(expected, abs=5e-3)


def test_sphere_in_torus_on_plane():
    scene = builtin_scene("torus-on-plane", ring_radius=2.0, tube_radius=0.6, sphere_radius=0.9)
    assert occluded_share(scene, (0.0, 1.8009, 0.0)) == 0.0
    # Under the sphere nothing of the sky is left.
    assert occluded_share(scene, (0.0, 0.0, 0.0)) == 1.0
    # The torus hides part of the sphere's side, but for the plane half of the sky would be seen.
    assert 0.55 < occluded_share(scene, (0.9, 0.9009, 0.0), (1.0, 0.0, 0.0)) < 0.9
    with pytest.raises(ValueError, match=r"sphere_radius must be a number .* at most 1\.66"):
        builtin_scene("torus-on-plane", ring_radius=2.0, tube_radius=0.6, sphere_radius=1.7)


def _areas(scene):
    corners = scene.positions[scene.triangles].astype(float)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return 0.5 * np.linalg.norm(cross, axis=-1)
