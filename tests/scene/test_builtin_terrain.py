"""The open world: its size, ground that is a height field, closed solids that stand on it."""

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from jaxvis.scene.build import build_scene
from jaxvis.scene.builtin import builtin_scene
from jaxvis.scene.builtin import terrain_buildings as buildings
from jaxvis.scene.builtin import terrain_parts as parts
from jaxvis.scene.builtin.mesh import Mesh
from jaxvis.scene.builtin.terrain import _plots, _stand, _tree_places, _tree_prototypes, _trees
from jaxvis.scene.builtin.terrain_ground import (
    SIZE,
    Ground,
    from_river,
    ground_height,
    make_ground,
    river_middle,
    street_distance,
)
from jaxvis.scene.weld import equal_rows
from tests.scene.builtin_checks import camera_rays, is_closed, least_alignment, sees_backs, volume

SQUARE = ((-1.0, 0.0), (-1.0, 2.0), (1.0, 2.0), (1.0, 0.0))
"""A profile (z, y), clockwise."""


@pytest.fixture(scope="module")
def scene():
    return builtin_scene("terrain")


def components(mesh):
    """Triangle numbers of each connected part, connected through equal positions."""
    _, place = equal_rows(*mesh.positions.T)
    a, b, c = place[mesh.triangles].T
    edges = (np.concatenate([a, b]), np.concatenate([b, c]))
    graph = coo_array((np.ones(2 * len(a), np.int8), edges), shape=(place.max() + 1,) * 2)
    _, label = connected_components(graph, directed=False)
    label = label[a]
    order = np.argsort(label, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(label[order])) + 1)


def part_of(mesh, triangles):
    used, corners = np.unique(mesh.triangles[triangles], return_inverse=True)
    return Mesh(mesh.positions[used], mesh.normals[used], corners.reshape(-1, 3))


def box(*size, base=0.0):
    return parts.box(size, (0.0, base, 0.0), 0)


@pytest.mark.parametrize("triangles", [100_000, 333_333, 1_850_000])
def test_size_parameter(triangles):
    scene = builtin_scene("terrain", triangles=triangles)
    assert len(scene.triangles) == pytest.approx(triangles, rel=0.05)
    assert np.sum(scene.material_ids == 0) > 0.4 * triangles
    assert np.allclose(scene.bounds[:, [0, 2]], [[-500.0, -500.0], [500.0, 500.0]], atol=1e-3)
    assert -10.0 < scene.bounds[0, 1] < -4.5
    assert 100.0 < scene.bounds[1, 1] < 300.0


def test_sizes_out_of_range():
    for triangles in (99_999, 1_850_001):
        with pytest.raises(
            ValueError, match="triangles must be a whole number from 100000 to 1850000"
        ):
            builtin_scene("terrain", triangles=triangles)


def test_the_seed_decides(scene):
    # That the same seed gives the same scene is tested for all built-in scenes together.
    other = builtin_scene("terrain", seed=1)
    assert other.geometry_hash != scene.geometry_hash
    land = [s.materials[0].base_colour_texture.texels for s in (scene, other)]
    assert not np.array_equal(*land)


def test_it_is_what_build_scene_makes_of_it(scene):
    """The maker welds, centres and freezes by itself: build_scene finds nothing left to do."""
    again = build_scene(
        scene.positions + scene.origin,
        scene.triangles,
        normals=scene.normals[scene.triangles],
        uvs=scene.uvs,
        materials=scene.materials,
        material_ids=scene.material_ids,
    )
    assert again.notes == ()
    assert len(again.triangles) == len(scene.triangles)
    assert len(again.positions) == len(scene.positions)
    assert np.allclose(again.origin, scene.origin, atol=1e-4)
    for array in (scene.positions, scene.normals, scene.triangles, scene.material_ids, scene.uvs):
        assert not array.flags.writeable
    assert np.allclose(np.linalg.norm(scene.normals, axis=-1), 1.0, atol=1e-6)


def test_the_ground_is_one_sheet_and_all_else_is_closed(scene):
    sheets = []
    for triangles in components(scene):
        part = part_of(scene, triangles)
        materials = set(scene.material_ids[triangles])
        if 0 in materials:
            sheets.append(triangles)
            assert materials == {0}
            assert not is_closed(part)
        else:
            assert is_closed(part)
            assert volume(part._replace(positions=part.positions - part.positions.mean(0))) > 0.0
    assert len(sheets) == 1
    assert scene.geometric_normals[sheets[0], 1].min() > 0.2


def test_every_plumb_line_meets_the_ground_once(scene):
    land = scene.triangles[scene.material_ids == 0]
    x, _, z = np.moveaxis(scene.positions[land].astype(float), -1, 0)
    area = (z[:, 1] - z[:, 0]) * (x[:, 2] - x[:, 0]) - (x[:, 1] - x[:, 0]) * (z[:, 2] - z[:, 0])
    # All turn the same way seen from above, and together they are as large as the square is.
    assert area.min() > 0.0
    assert 0.5 * area.sum() == pytest.approx(SIZE**2, rel=1e-6)


def test_heights_of_the_grid_are_those_of_its_triangles():
    ground = make_ground(40, 3)
    mesh = ground.mesh()
    random = np.random.default_rng(1)
    corners = mesh.positions[mesh.triangles[random.integers(len(mesh.triangles), size=500)]]
    points = np.einsum("tk,tkx->tx", random.dirichlet([1.0, 1.0, 1.0], 500), corners)
    assert np.allclose(ground.at(points[:, 0], points[:, 2]), points[:, 1], atol=1e-9)
    tilted = Ground(np.add.outer(2.0 * np.arange(5.0), 3.0 * np.arange(5.0)))
    assert tilted.at(np.array([125.0]), np.array([-125.0]))[0] == pytest.approx(
        2.0 * 1.5 + 3.0 * 2.5
    )
    assert np.all(mesh.normals[:, 1] > 0.0)
    assert least_alignment(mesh) > 0.0


def test_heights_do_not_depend_on_the_grid_that_asks():
    x, z = np.linspace(-480.0, 470.0, 7), np.linspace(-490.0, 450.0, 5)
    whole = ground_height(x[None, :], z[:, None], 4)
    one_by_one = ground_height(*(a.reshape(-1) for a in np.meshgrid(x, z)), 4)
    assert np.allclose(whole.reshape(-1), one_by_one, atol=1e-9)
    assert np.ptp(whole) > 30.0


def test_the_river():
    x = np.linspace(-500.0, 500.0, 2001)
    z, slope = river_middle(x)
    assert np.allclose(np.gradient(z, x)[1:-1], slope[1:-1], atol=1e-4)
    assert z[1000] == pytest.approx(0.0, abs=1e-12)
    assert slope[1000] == pytest.approx(0.0, abs=1e-12)
    assert np.all(np.abs(z) < 200.0)
    assert np.all(ground_height(x, z, 0) < -4.0)


@pytest.mark.parametrize("seed", [0, 7])
def test_buildings_stand_in_the_ground(seed):
    ground = make_ground(153, seed)
    for plot in _plots(np.random.default_rng([seed, 1])):
        stood = _stand(plot, ground)
        assert least_alignment(stood.mesh) > 0.0
        solids = [
            stood.mesh.positions[np.unique(stood.mesh.triangles[triangles])]
            for triangles in components(stood.mesh)
        ]
        assert not floating(solids, ground)
        away = np.hypot(*(stood.mesh.positions - [plot.x, 0.0, plot.z]).T[[0, 2]])
        assert away.max() < plot.radius + 4.5


def floating(solids, ground):
    """Solids that neither reach 0.2 m into the ground wherever they are lowest nor rest on others.

    One rests on another if their bounds overlap and that one does not float.
    """
    left, firm = [], []
    for points in solids:
        lowest = points[points[:, 1] < points[:, 1].min() + 1e-6]
        sunk = np.all(lowest[:, 1] < ground.at(lowest[:, 0], lowest[:, 2]) - 0.2)
        (firm if sunk else left).append((points.min(axis=0), points.max(axis=0)))
    grown = True
    while grown:
        resting = [
            any(np.all((low < top) & (high > foot)) for foot, top in firm) for low, high in left
        ]
        grown = any(resting)
        firm += [bounds for bounds, rests in zip(left, resting, strict=True) if rests]
        left = [bounds for bounds, rests in zip(left, resting, strict=True) if not rests]
    return left


def test_what_floats_would_be_found():
    ground = Ground(np.zeros((2, 2)))
    wall, roof = box(4.0, 3.0, 4.0, base=-1.0), box(5.0, 1.0, 5.0, base=1.9)
    assert not floating([wall.mesh.positions, roof.mesh.positions], ground)
    assert len(floating([wall.mesh.positions, roof.mesh.positions + [0, 0.2, 0]], ground)) == 1
    assert len(floating([wall.mesh.positions + [0, 1.0, 0], roof.mesh.positions], ground)) == 2


def test_houses_do_not_stand_on_streets_in_the_river_or_in_each_other():
    plots = _plots(np.random.default_rng([0, 1]))
    ground = Ground(np.zeros((2, 2)))
    boxes = []
    for plot in plots[2:]:
        points = _stand(plot, ground).mesh.positions
        low = points[:, 1] < points[:, 1].min() + 0.01
        assert street_distance(points[low, 0], points[low, 2]).min() > 3.0
        assert np.abs(from_river(points[low, 0], points[low, 2])).min() > 25.0
        boxes.append(points[low][:, [0, 2]])
    for k, one in enumerate(boxes):
        for other in boxes[:k]:
            apart = (one.min(0) > other.max(0)) | (other.min(0) > one.max(0))
            assert apart.any() or np.linalg.norm(one[:, None] - other, axis=-1).min() > 2.0


def test_bridges_can_be_looked_under(scene):
    for x in (0.0, 148.0):
        middle, slope = (float(value[0]) for value in river_middle(np.array([x])))
        along = np.array([[1.0, 0.0, slope]]) / np.hypot(1.0, slope)
        above = np.array([[x, 30.0, middle]]) - scene.origin
        down = scene.tracer.closest_hit(above, np.array([[0.0, -1.0, 0.0]]))
        names = [material.name for material in scene.materials]
        deck = 30.0 - down.distance[0]
        assert names[scene.material_ids[down.triangle[0]]] in ("white plaster", "wood")
        assert deck > 1.0
        # From upstream to downstream, between the water and the deck.
        under = np.array([[x, -2.0, middle]]) - scene.origin - 8.0 * along
        assert scene.tracer.closest_hit(under, along).distance[0] > 16.0
        # And not through the deck.
        blocked = under + [[0.0, deck + 1.9, 0.0]]
        assert scene.tracer.closest_hit(blocked, along).distance[0] < 16.0


def test_trees_stand_in_the_ground_and_keep_off_streets_and_river():
    ground = make_ground(200, 0)
    plots = _plots(np.random.default_rng([0, 1]))
    x, z, conifer = _tree_places(plots, 0)
    assert len(x) > 5000
    assert 0.2 < conifer.mean() < 0.9
    assert np.abs(from_river(x, z)).min() > 16.0
    assert street_distance(x, z).min() > 7.0
    wood = _trees(30_000, plots, ground, 0)
    assert sum(len(trees.materials) for trees in wood) == pytest.approx(30_000, abs=300)
    names = [material.name for material in buildings.MATERIALS]
    for trees, prototype in zip(wood, _tree_prototypes(fine=False), strict=True):
        size = len(prototype.mesh.positions)
        bark = np.isin(
            np.arange(size), prototype.mesh.triangles[prototype.materials == names.index("bark")]
        )
        copies = trees.mesh.positions.reshape(-1, size, 3)
        feet, crowns = copies[:, bark], copies[:, ~bark]
        lowest = feet[np.arange(len(feet)), feet[..., 1].argmin(axis=1)]
        under = ground.at(lowest[:, 0], lowest[:, 2])
        assert np.all(lowest[:, 1] < under - 0.2)
        # The crown hangs over a gap, and the trunk reaches into it.
        gap = crowns[..., 1].min(axis=1) - ground.at(feet[:, 0, 0], feet[:, 0, 2])
        assert gap.min() > 0.5
        assert np.all(feet[..., 1].max(axis=1) > crowns[..., 1].min(axis=1))


def test_a_larger_scene_has_more_of_the_same_trees():
    ground = make_ground(100, 2)
    plots = _plots(np.random.default_rng([2, 1]))
    few, many = (_trees(budget, plots, ground, 2) for budget in (20_000, 60_000))
    for one, other in zip(few, many, strict=True):
        places = {tuple(point) for point in other.mesh.positions}
        assert len(other.mesh.positions) > len(one.mesh.positions)
        assert all(tuple(point) in places for point in one.mesh.positions)


@pytest.mark.parametrize("seed", range(4))
def test_the_camera_sees_the_place(seed):
    scene = builtin_scene("terrain", seed=seed)
    origins, directions = camera_rays(scene, 160, 90)
    hits = scene.tracer.closest_hit(origins, directions)
    hit = hits.triangle >= 0
    assert hit.mean() > 0.6
    assert hits.distance[hit].min() > 15.0
    seen = scene.material_ids[hits.triangle[hit]]
    assert len(set(seen)) >= 10
    assert 0.04 < np.mean(seen != 0) < 0.5
    assert sees_backs(scene, origins, directions) == 0


def test_materials(scene):
    assert set(np.unique(scene.material_ids)) == set(range(len(scene.materials)))
    assert not any(material.two_sided for material in scene.materials)
    texels = scene.materials[0].base_colour_texture.texels
    assert texels.min() > 0.02
    assert texels.max() <= np.float32(0.9)
    for name in ("roof tiles", "yellow plaster"):
        colour = next(m.base_colour for m in scene.materials if m.name == name)
        assert max(colour) > 4.0 * min(colour)


def test_the_texture_lies_where_the_land_does(scene):
    texture = scene.materials[0].base_colour_texture
    land = scene.material_ids == 0
    points = scene.positions[scene.triangles[land]].reshape(-1, 3) + scene.origin
    colours = texture.sample(scene.uvs[land].reshape(-1, 2))
    d = np.abs(from_river(points[:, 0], points[:, 2]))
    blue, red = colours[:, 2], colours[:, 0]
    assert np.all(blue[d < 10.0] > 1.5 * red[d < 10.0])
    dry = (d > 30.0) & (d < 60.0)
    assert np.mean(blue[dry] < red[dry]) > 0.95


@pytest.mark.parametrize(
    ("made", "expected"),
    [
        (box(2.0, 3.0, 4.0), 24.0),
        (parts.prism(SQUARE, (-1.5, 1.5), [0] * 4, 0), 12.0),
        # A hip takes two pyramids off a prism: 1/2 * 2 * 1 * 6 less 2 * (1/3 * 2 * 1/2).
        (parts.prism([(-1, 0), (0, 1), (1, 0)], (-3, 3), [0] * 3, 0, [0, 1, 0]), 6.0 - 2.0 / 3.0),
        (parts.strip(np.arange(4.0), np.zeros(4), 1.0 + np.arange(4.0), (0, 2), (0, 1)), 15.0),
        (parts.turned([(0, 0), (1, 0), (1, 2), (0, 2)], 4, 0), 4.0),
        (parts.turned([(0, 0), (2, 0), (0, 3)], 4, 0), 8.0),
        (
            parts.solid(
                parts.block(
                    [0, 1, 2, 3], [0, 2], [0, 1, 2], np.array([[1, 1], [1, 0], [1, 1]], bool)
                )[0],
                0,
            ),
            10.0,
        ),
    ],
    ids=["box", "prism", "hip", "strip", "cylinder", "cone", "U"],
)
def test_parts_are_closed_and_as_large_as_they_should_be(made, expected):
    assert is_closed(made.mesh)
    assert volume(made.mesh) == pytest.approx(expected, rel=1e-12)
    assert least_alignment(made.mesh) > 0.5
    assert len(made.materials) == len(made.mesh.triangles)


def test_an_open_solid_would_be_found():
    mesh = box(2.0, 3.0, 4.0).mesh
    assert not is_closed(mesh._replace(triangles=mesh.triangles[1:]))
    flipped = mesh._replace(triangles=mesh.triangles[:, ::-1])
    assert volume(flipped) < 0.0


def test_copies_of_a_part():
    made = box(2.0, 3.0, 4.0, base=1.0)
    copies = parts.instances(
        made,
        np.array([[10.0, 0.0, 0.0], [0.0, 5.0, 0.0]]),
        np.array([0.0, 0.5 * np.pi]),
        np.array([1.0, 2.0]),
        np.array([1.0, 0.5]),
    )
    first, second = copies.mesh.positions.reshape(2, -1, 3)
    assert np.allclose([first.min(0), first.max(0)], [[9, 1, -2], [11, 4, 2]])
    # Turned by a quarter, +z to +x, twice as wide and half as high.
    assert np.allclose([second.min(0), second.max(0)], [[-4, 5.5, -2], [4, 7, 2]])
    assert least_alignment(copies.mesh) == pytest.approx(1.0)
    assert volume(copies.mesh) == pytest.approx(24.0 + 2.0 * 24.0)
