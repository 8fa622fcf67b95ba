import dataclasses

import numpy as np

from jaxvis.methods.vertices import LARGEST_DIP, connected_surfaces, vertex_samples
from jaxvis.reflectance import Material
from jaxvis.scene import build_scene, load_scene
from jaxvis.scene.builtin import builtin_scene


def test_every_vertex_is_sampled_once_on_its_front():
    scene = builtin_scene("sphere")
    found = vertex_samples(scene)
    np.testing.assert_array_equal(
        found.positions[found.triangles], scene.positions[scene.triangles]
    )
    np.testing.assert_allclose(
        found.normals[found.triangles], scene.normals[scene.triangles], atol=1e-6
    )
    assert len(found.positions) == len(scene.positions)
    assert found.backs.shape == (0, 3)


def test_unused_vertices_are_left_out():
    scene = builtin_scene("plane")
    fewer = dataclasses.replace(
        scene, triangles=scene.triangles[:2], material_ids=scene.material_ids[:2]
    )
    assert len(vertex_samples(fewer).positions) == len(np.unique(scene.triangles[:2]))


def test_two_sided_materials_get_their_backs():
    positions = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [2, 0, 0]]
    scene = build_scene(
        positions,
        [[0, 1, 2], [1, 3, 2], [1, 4, 3]],
        materials=(Material(), Material(two_sided=True)),
        material_ids=[0, 1, 1],
    )
    found = vertex_samples(scene)
    assert len(found.positions) == 5 + 4
    assert np.all(found.backs[0] == -1)
    front, back = found.triangles[1:], found.backs[1:]
    np.testing.assert_array_equal(found.positions[front], found.positions[back])
    np.testing.assert_array_equal(found.normals[front], -found.normals[back])
    off = np.sum((found.origins - found.positions) * found.normals, axis=-1)
    assert off.min() > 0.0


def test_domains_dip_as_far_as_the_triangles_around():
    """Flat ones do not dip; on a sphere they do by about half the angle between its facets."""
    assert vertex_samples(builtin_scene("plane")).dips.max() == 0.0
    assert vertex_samples(builtin_scene("box-on-plane")).dips.max() == 0.0
    scene = builtin_scene("sphere", rows=24)
    found = vertex_samples(scene)
    cosine = np.sum(
        found.normals[found.triangles] * scene.geometric_normals[:, None], axis=-1
    ).clip(-1, 1)
    sines = np.zeros(len(found.dips))
    np.maximum.at(sines, found.triangles, np.sin(np.arccos(cosine)))
    np.testing.assert_allclose(found.dips, sines, atol=2e-4)
    assert np.all(vertex_samples(builtin_scene("sphere", rows=3)).dips <= np.float32(LARGEST_DIP))


def test_origins_leave_creases_into_their_own_surface():
    """At the foot of a wall, the floor's samples start before the wall and the wall's above it."""
    corner = build_scene(
        [[0, 0, 0], [0, 0, 1], [1, 0, 0], [1, 0, 1], [0, 1, 0], [0, 1, 1]],
        [[0, 1, 2], [2, 1, 3], [0, 4, 1], [1, 4, 5]],
    )
    found = vertex_samples(corner)
    off = found.origins - found.positions
    floor = np.abs(found.normals[:, 1]) > 0.9
    foot = np.abs(found.positions[:, :2] - corner.positions[:, :2].min(axis=0)).max(axis=1) < 1e-6
    assert (foot & floor).sum() == (foot & ~floor).sum() == 2
    assert off[foot & floor, 0].min() > 0.0
    assert off[foot & ~floor, 1].min() > 0.0
    assert np.sum(off * found.normals, axis=-1).min() > 0.0


def test_zero_normals_are_replaced_by_a_triangles():
    scene = builtin_scene("plane")
    broken = dataclasses.replace(scene, normals=np.zeros_like(scene.normals))
    np.testing.assert_allclose(vertex_samples(broken).normals, scene.normals, atol=1e-6)


def test_connected_surfaces_are_those_that_share_vertices_or_their_positions():
    placed = vertex_samples(builtin_scene("box-on-plane"))
    parts = connected_surfaces(placed)
    # The box has hard edges: its faces share positions but no vertices. The plane is apart.
    assert len(np.unique(parts)) == 2
    for corners in placed.triangles:
        assert len(np.unique(parts[corners])) == 1
    height = placed.positions[:, 1]
    rising = placed.triangles[np.ptp(height[placed.triangles], axis=1) > 0.0]
    box = np.unique(parts[rising])
    assert len(box) == 1
    assert np.ptp(height[parts != box[0]]) == 0.0


def test_the_two_sides_of_a_sheet_are_two_surfaces():
    scene = load_scene("plane", two_sided=True)
    placed = vertex_samples(scene)
    parts = connected_surfaces(placed)
    assert len(np.unique(parts)) == 2
    assert len(np.unique(parts[np.unique(placed.backs)])) == 1
