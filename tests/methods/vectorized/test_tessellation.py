"""Tessellation plans against a slow reading of what they shall do, pixel by pixel."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.methods.vectorized.contrast import VISIBLE, contrast
from jaxvis.methods.vectorized.mesh import (
    Mesh,
    faces_in_view,
    polygons_in_view,
    shaded_pixels,
)
from jaxvis.methods.vectorized.plan import needed_sites, plan_fragments, room
from jaxvis.methods.vectorized.resolve import interpolate
from jaxvis.methods.vectorized.tessellation import Levels, edge_levels, plan_tessellation
from jaxvis.scene import Camera, build_scene, trace_surface
from jaxvis.scene.builtin import builtin_scene
from tests.methods.vectorized.analytic import horizon, polygons

SIZE = (40, 30)


def bumpy(seed=0, side=4):
    """A grid of triangles with random heights, seen from above: (visibility, surface)."""
    rng = np.random.default_rng(seed)
    x, z = np.meshgrid(np.arange(side + 1.0), np.arange(side + 1.0), indexing="ij")
    height = rng.uniform(0.0, 0.5, x.shape)
    points = np.stack([x, height, z], axis=-1).reshape(-1, 3)
    a = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    b, c, d = a + 1, a + side + 1, a + side + 2
    triangles = np.concatenate([np.stack([a, b, d], 1), np.stack([a, d, c], 1)])
    # Corners in any order, so that shared edges run both ways.
    turns = rng.integers(0, 3, len(triangles))
    triangles = np.stack([np.roll(t, k) for t, k in zip(triangles, turns, strict=True)])
    scene = build_scene(points, triangles, crease_angle=np.pi)
    camera = Camera((side / 2 + 0.3, 5.0, side / 2 + 0.2), (side / 2, 0.0, side / 2))
    return on_horizons(scene), trace_surface(scene, camera, SIZE)


def on_horizons(scene, backs=None, **options):
    """Polygons of the whole sky at every vertex of a scene."""
    rings = [horizon(n / np.linalg.norm(n), 8) for n in np.asarray(scene.normals, float)]
    return polygons(rings, scene.positions, scene.normals, scene.triangles, 8, backs, **options)


def planned(visibility, surface, difference, zeta):
    mesh = Mesh.of(visibility)
    pixels = shaded_pixels(mesh, surface)
    faces = faces_in_view(mesh, pixels)
    corners = polygons_in_view(mesh, faces, len(visibility.counts))
    levels = edge_levels(mesh, faces, difference, zeta)
    plan = plan_tessellation(visibility, mesh, pixels, corners, levels, surface.mask.size)
    return mesh, pixels, levels, plan


def height_of(position):
    """Something that varies fast over the plane."""
    p = np.asarray(position, np.float64)
    return np.sin(7.0 * p[..., 0] + 1.0) * np.cos(5.0 * p[..., 2]) + 0.3 * p[..., 1]


def at_pixels(plan, values):
    """Each pixel's interpolated value."""
    padded = np.zeros((plan.capacity, 1), np.float32)
    padded[: len(values), 0] = values
    return np.asarray(interpolate(jnp.asarray(padded), plan.stencil))[:, 0]


def slow_value(corners, levels, bary):
    """One pixel: ``height_of`` at the grid points around it, on a coarser edge between its own.

    ``levels`` are those of the edges opposite the corners.
    """
    n = 2 ** max(levels)

    def at_node(node):
        for k in range(3):
            if node[k] == 0 and 0 < node[(k + 1) % 3] < n:
                step = n // 2 ** levels[k]
                one, two = (k + 1) % 3, (k + 2) % 3
                low = node[one] // step * step
                ends = []
                for along in (low, low + step):
                    place = [0, 0, 0]
                    place[one], place[two] = along, n - along
                    ends.append(height_of(np.array(place) / n @ corners))
                share = (node[one] - low) / step
                return (1 - share) * ends[0] + share * (ends[1] if share else 0.0)
        return height_of(np.array(node) / n @ corners)

    x, y = n * bary[1], n * bary[2]
    i, j = min(int(x), n - 1), min(int(y), n - 1)
    j = min(j, n - 1 - i)
    x, y = x - i, y - j
    if x + y <= 1 or i + j + 2 > n:
        small = [((i, j), 1 - x - y), ((i + 1, j), x), ((i, j + 1), y)]
    else:
        small = [((i + 1, j + 1), x + y - 1), ((i + 1, j), 1 - y), ((i, j + 1), 1 - x)]
    return sum(w * at_node((n - a - b, a, b)) for (a, b), w in small)


@pytest.mark.parametrize("seed", range(3))
def test_pixels_have_the_values_of_the_slow_tessellation(seed):
    visibility, surface = bumpy(seed)
    rng = np.random.default_rng(seed)
    difference = rng.random(len(visibility.counts)).astype(np.float32) ** 2
    mesh, pixels, levels, plan = planned(visibility, surface, difference, 3.0)
    found = at_pixels(plan, height_of(plan.sites.position))
    rows = {face: row for row, face in enumerate(levels.faces)}
    expected = np.zeros(surface.mask.size)
    corners = np.asarray(visibility.positions, float)[mesh.faces]
    for index, face, bary in zip(*pixels, strict=True):
        level = [int(v) for v in levels.edge[rows[face]]]
        expected[index] = slow_value(corners[face], level, bary.astype(float))
    assert len(np.unique(levels.face)) >= 3
    np.testing.assert_allclose(found, expected, atol=2e-4)


def test_levels_are_by_edge_and_shared():
    visibility, _ = bumpy()
    mesh = Mesh.of(visibility)
    faces = np.arange(len(mesh.planes), dtype=np.int32)
    difference = np.random.default_rng(0).random(len(visibility.counts)).astype(np.float32)
    levels = edge_levels(mesh, faces, difference, 4.0)
    for row, face in enumerate(faces):
        a, b, c = difference[mesh.faces[face]]
        pairs = [max(b, c), max(c, a), max(a, b)]
        np.testing.assert_array_equal(levels.edge[row], np.rint(4.0 * np.array(pairs)))
        assert levels.face[row] == levels.edge[row].max()
    known = {}
    for edge, level in zip(mesh.edges[faces].ravel(), levels.edge.ravel(), strict=True):
        assert known.setdefault(edge, level) == level
    assert mesh.edge_count >= len(known)


def two_triangles(levels):
    """A square of two triangles that share a diagonal, with given levels of each one's edges."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]])
    scene = build_scene(points, np.array([[2, 0, 3], [0, 2, 1]])[:, ::-1])
    visibility = on_horizons(scene)
    mesh = Mesh.of(visibility)
    # A camera that sees both triangles in a few hundred pixels.
    surface = trace_surface(scene, Camera((0.5, 2.0, 0.5001), (0.5, 0.0, 0.5)), SIZE)
    pixels = shaded_pixels(mesh, surface)
    edge = np.asarray(levels, np.int32)
    return visibility, mesh, pixels, Levels(np.arange(2, dtype=np.int32), edge, edge.max(axis=1))


def along_shared_edge(*levels, count=200):
    """Values at the same places of the shared edge, seen from each of its two triangles.

    Each triangle has its own idea of the levels of both.
    """
    t = np.random.default_rng(0).random(count).astype(np.float32)
    values = []
    for face in (0, 1):
        visibility, mesh, pixels, known = two_triangles(levels[face])
        shared = np.intersect1d(mesh.edges[0], mesh.edges[1])[0]
        side = int(np.flatnonzero(mesh.edges[face] == shared)[0])
        one, two = (side + 1) % 3, (side + 2) % 3
        if mesh.faces[face, one] > mesh.faces[face, two]:
            one, two = two, one
        bary = np.zeros((count, 3), np.float32)
        bary[:, one], bary[:, two] = 1.0 - t, t
        index = np.arange(count, dtype=np.int32)
        some = pixels._replace(index=index, face=np.full(count, face, np.int32), barycentrics=bary)
        corners = np.arange(4, dtype=np.int32)
        plan = plan_tessellation(visibility, mesh, some, corners, known, count)
        values.append(at_pixels(plan, height_of(plan.sites.position)))
    return values


def test_triangles_of_different_levels_agree_along_their_edge():
    """Negative control: where each divides the edge as it divides itself, they do not."""
    mesh = two_triangles(np.zeros((2, 3)))[1]
    shared = np.intersect1d(mesh.edges[0], mesh.edges[1])[0]
    for fine in (1, 2, 4):
        for common in range(fine):
            levels = np.where(mesh.edges[:2] == shared, common, [[fine], [0]])
            first, second = along_shared_edge(levels, levels)
            np.testing.assert_allclose(first, second, atol=1e-5)
    first, second = along_shared_edge(np.full((2, 3), 4), np.zeros((2, 3)))
    assert np.abs(first - second).max() > 0.1


def test_each_place_is_a_site_once_and_only_where_pixels_need_it():
    visibility, surface = bumpy()
    difference = np.ones(len(visibility.counts), np.float32)
    mesh, pixels, levels, plan = planned(visibility, surface, difference, 3.0)
    position = plan.sites.position
    grid = np.round(position / 1e-4).astype(np.int64)
    assert len(np.unique(grid, axis=0)) == len(grid)
    corners = len(polygons_in_view(mesh, levels.faces, len(visibility.counts)))
    needed = needed_sites(plan)
    np.testing.assert_array_equal(needed[needed >= corners], np.arange(corners, len(position)))
    # One polygon at a mesh vertex, two on a mesh edge, three inside a triangle.
    count = (plan.sites.polygon >= 0).sum(axis=1)
    assert np.all(count[:corners] == 1)
    assert set(count[corners:]) == {2, 3}
    assert plan.evaluations == plan.sites.references == count.sum()
    assert plan.sites.references < 3 * len(pixels.index)
    weight = np.where(plan.sites.polygon >= 0, plan.sites.weight, 0.0)
    own = np.asarray(visibility.positions)[np.maximum(plan.sites.polygon, 0)]
    np.testing.assert_allclose(np.einsum("pk,pkc->pc", weight, own), position, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(plan.sites.normal, axis=-1), 1.0, atol=1e-6)


def test_without_difference_the_mesh_is_as_it_is():
    visibility, surface = bumpy()
    nothing = np.zeros(len(visibility.counts), np.float32)
    mesh, pixels, levels, plan = planned(visibility, surface, nothing, 4.0)
    assert not levels.edge.any()
    found = at_pixels(plan, height_of(plan.sites.position)).take(pixels.index)
    corners = height_of(visibility.positions)[mesh.faces[pixels.face]]
    np.testing.assert_allclose(
        found, np.einsum("pk,pk->p", corners, pixels.barycentrics), atol=1e-5
    )
    ones = np.ones(len(visibility.counts), np.float32)
    unchanged = planned(visibility, surface, ones, 0.0)[-1]
    np.testing.assert_array_equal(unchanged.stencil.nodes, plan.stencil.nodes)
    np.testing.assert_array_equal(unchanged.stencil.weights, plan.stencil.weights)


def test_finer_levels_come_to_the_function_itself():
    visibility, surface = bumpy()
    ones = np.ones(len(visibility.counts), np.float32)
    mask = np.asarray(surface.mask).reshape(-1)
    exact = height_of(np.asarray(surface.position).reshape(-1, 3)[mask])
    errors = []
    for zeta in (0.0, 1.0, 2.0, 3.0, 4.0, 5.0):
        plan = planned(visibility, surface, ones, zeta)[-1]
        found = at_pixels(plan, height_of(plan.sites.position))
        errors.append(np.abs(found[mask] - exact).mean())
        assert np.all(found[~mask] == 0.0)
    assert np.all(np.diff(np.log2(errors[2:])) < -1.0)
    assert errors[-1] < 2e-2 * errors[0]


def test_fragments_have_a_site_a_pixel():
    visibility, surface = bumpy()
    mesh = Mesh.of(visibility)
    pixels = shaded_pixels(mesh, surface)
    plan = plan_fragments(visibility, mesh, pixels, surface)
    mask = np.asarray(surface.mask)
    assert len(plan.sites.normal) == mask.sum()
    found = at_pixels(plan, height_of(plan.sites.position)).reshape(mask.shape)
    np.testing.assert_allclose(found[mask], height_of(surface.position)[mask], atol=1e-5)
    np.testing.assert_array_equal(plan.sites.plane, np.asarray(surface.geometric_normal)[mask])


def test_buried_polygons_do_not_count_where_others_remain():
    visibility, surface = bumpy()
    buried = np.zeros(len(visibility.counts), bool)
    buried[12] = True  # the middle of the grid
    hidden = replace(visibility, buried=jnp.asarray(buried))
    mesh = Mesh.of(hidden)
    pixels = shaded_pixels(mesh, surface)
    fragments = plan_fragments(hidden, mesh, pixels, surface)
    assert not np.any(fragments.sites.polygon == 12)
    np.testing.assert_allclose(fragments.sites.weight.sum(axis=1), 1.0, atol=1e-5)
    difference = np.ones(len(buried), np.float32)
    plan = planned(hidden, surface, difference, 2.0)[-1]
    values = np.where((plan.sites.polygon == 12).any(axis=1), 100.0, 1.0)
    found = at_pixels(plan, values)[pixels.index]
    np.testing.assert_allclose(found, 1.0, atol=1e-4)


def test_backs_have_polygons_of_their_own_or_are_refused():
    scene = builtin_scene("plane")
    below = trace_surface(scene, Camera((0.1, -3.0, 0.2), (0.0, 0.0, 0.0)), SIZE)
    below = replace(below, mask=below.backs)
    count = len(scene.positions)
    with pytest.raises(ValueError, match="two-sided"):
        shaded_pixels(Mesh.of(on_horizons(scene)), below)
    rings = [horizon(sign * np.asarray(n, float), 8) for sign in (1, -1) for n in scene.normals]
    both = polygons(
        rings,
        np.tile(scene.positions, (2, 1)),
        np.concatenate([scene.normals, -scene.normals]),
        scene.triangles,
        8,
        backs=scene.triangles + count,
    )
    mesh = Mesh.of(both)
    # Here the surface's normals still face up, as those of a one-sided material do.
    turned = replace(below, geometric_normal=-jnp.abs(below.geometric_normal))
    pixels = shaded_pixels(mesh, turned)
    assert np.all(pixels.face >= len(mesh.planes))
    assert np.all(mesh.faces[pixels.face] >= count)


def test_rooms_are_few_and_large_enough():
    rooms = [room(n) for n in range(1, 70_000, 7)]
    assert all(n <= r < max(4 * n, 16385) for n, r in zip(range(1, 70_000, 7), rooms, strict=True))
    assert set(rooms) == {16384, 65536, 262144}


def test_contrast_is_relative_to_white_and_to_what_is_seen():
    light = np.array([[1.0, 1.0, 1.0]] * 400 + [[0.5, 0.5, 0.5], [0.01, 0.01, 0.01]])
    np.testing.assert_array_equal(contrast(light, light), 0.0)
    faint = contrast(light, 1.002 * light)
    assert np.all((faint > 0.0) & (faint < 0.5))
    np.testing.assert_allclose(contrast(7.0 * light, 7.014 * light), faint, rtol=1e-4)
    assert np.all(contrast(light, 1.2 * light)[:401] == 1.0)
    np.testing.assert_array_equal(contrast(0.0 * light, light), 0.0)
    assert len(contrast(light[:0], light[:0])) == 0
    # By CIE 1976 a lightness of 100 - x is a luminance of ((116 - x) / 116)^3.
    half = np.full((1, 3), ((116.0 - 0.5 * VISIBLE) / 116.0) ** 3)
    np.testing.assert_allclose(contrast(np.ones((1, 3)), half), 0.5, atol=1e-5)
