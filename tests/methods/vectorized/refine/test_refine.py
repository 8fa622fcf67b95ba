import dataclasses
from typing import Any

import jax
import numpy as np
import pytest

from jaxvis.methods import registry
from jaxvis.methods.vectorized import VectorizedVisibility, VisibilityPolygons, precompute_polygons
from jaxvis.methods.vectorized.mesh import Mesh, shaded_pixels
from jaxvis.methods.vectorized.precompute import Settings
from jaxvis.methods.vectorized.refine.locate import Forest, locate
from jaxvis.methods.vectorized.refine.refine import Goal, refine_polygons
from jaxvis.scene import Camera, build_scene, trace_surface
from tests.methods.vectorized.polygon_oracle import clamped, irradiance, seen_from
from tests.methods.vectorized.refine.ground import (
    ball_over_floor,
    beside_a_ball,
    random_barycentrics,
)

SMALL = Settings(vectors=64, resolution=48, coarsest=24)
GOAL = Goal(0.02, 100.0)


def refined(scene, goal=GOAL, settings=SMALL):
    base = precompute_polygons(scene, settings, progress=False)
    return base, *refine_polygons(scene, base, goal, settings, progress=False)


@pytest.fixture(scope="module")
def ball():
    scene = ball_over_floor()
    return scene, *refined(scene)


def floor_errors(scene, polygons, count=400):
    """Interpolated irradiance at random places of the floor against the ball's formula."""
    floor = np.flatnonzero(scene.geometric_normals[:, 1] > 0.999)[:2]
    triangle = np.repeat(floor, count // 2).astype(np.int32)
    barycentrics = random_barycentrics(len(triangle))
    place = np.einsum("pk,pkc->pc", barycentrics, scene.positions[scene.triangles[triangle]])
    leaf = triangle
    if len(polygons.splits):
        forest = Forest(np.asarray(polygons.splits), np.asarray(polygons.children))
        leaf, barycentrics = locate(forest, triangle, barycentrics)
    up = np.tile([0.0, 1.0, 0.0], (len(place), 1))
    found = np.zeros(len(place))
    for k in range(3):
        polygon = np.asarray(polygons.triangles)[leaf, k]
        seen = seen_from(np.asarray(polygons.vectors)[polygon], place)
        found += barycentrics[:, k] * irradiance(clamped(seen, up), up)
    return np.abs(found - beside_a_ball(place + scene.origin))


def leaf_edges(polygons, triangles):
    """Rounded positions of the ends of all edges of some triangles, as a set."""
    p = np.round(np.asarray(polygons.positions, np.float64)[triangles], 5)
    pairs = np.stack([p, np.roll(p, -1, axis=1)], axis=2).reshape(-1, 2, 3)
    return {frozenset(map(tuple, pair)) for pair in pairs}


def test_a_ball_over_two_triangles(ball):
    scene, base, polygons, record = ball
    assert record.met
    assert record.before.max() > 4.0 * GOAL.target
    assert record.after.max() <= GOAL.target
    error = floor_errors(scene, polygons)
    assert np.mean(error) < 0.3 * GOAL.target
    assert np.mean(error > 1.5 * GOAL.target) < 0.01
    before = floor_errors(scene, base)  # negative control
    assert np.mean(before) > 3.0 * np.mean(error)
    assert np.mean(before > 1.5 * GOAL.target) > 0.05


def test_the_first_samples_stay(ball):
    _, base, polygons, _ = ball
    count = len(base.counts)
    for name in ("vectors", "counts", "positions", "normals", "buried"):
        np.testing.assert_array_equal(
            np.asarray(getattr(polygons, name))[:count], np.asarray(getattr(base, name))
        )
    assert base.splits.shape == base.children.shape == (0,)


def test_samples_lie_on_the_surface_with_its_normals(ball):
    scene, _, polygons, _ = ball
    forest = Forest(np.asarray(polygons.splits), np.asarray(polygons.children))
    triangle = np.arange(len(scene.triangles), dtype=np.int32).repeat(20)
    barycentrics = random_barycentrics(len(triangle))
    leaf, inside = locate(forest, triangle, barycentrics)
    corners = np.asarray(polygons.triangles)[leaf]
    for ours, theirs in (("positions", scene.positions), ("normals", scene.normals)):
        here = np.einsum("pk,pkc->pc", barycentrics, theirs[scene.triangles[triangle]])
        there = np.einsum("pk,pkc->pc", inside, np.asarray(getattr(polygons, ours))[corners])
        exact = ours == "positions"
        np.testing.assert_allclose(there, here, atol=1e-5 if exact else 0.02)


def test_the_size_stays_in_the_budget(ball):
    scene, base, most, _ = ball
    assert most.nbytes > 1.15 * base.nbytes
    for growth in (1.0, 1.05, 1.1):
        polygons, record = refine_polygons(
            scene, base, Goal(GOAL.target, growth), SMALL, progress=False
        )
        assert polygons.nbytes <= growth * base.nbytes
        assert polygons.nbytes > (growth - 0.03) * base.nbytes
        assert not record.met
    assert polygons is not base
    errors = [np.mean(floor_errors(scene, p)) for p in (base, polygons, most)]
    assert errors[0] > errors[1] > errors[2]


def test_what_meets_the_target_stays_as_it_is():
    scene = ball_over_floor()
    base, polygons, record = refined(scene, Goal(0.95))
    assert polygons is base
    assert record.met
    np.testing.assert_array_equal(record.before, record.after)


def test_both_sides_of_a_crease_have_the_same_samples():
    """Only the floor's half under the card needs them; the slope's vertices are its own."""
    z = [-2.0, 2.0]
    positions = [[-2, 0, a] for a in z] + [[0, 0, a] for a in z] + [[2, -1.5, a] for a in z]
    card = [[-1.0, 0.3, 0.4], [-0.1, 0.3, 0.4], [-0.1, 0.3, 1.0], [-1.0, 0.3, 1.0]]
    scene = build_scene(
        np.array(positions + card),
        [[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 5], [6, 7, 8], [6, 8, 9]],
        crease_angle=0.1,
    )
    _, polygons, record = refined(scene, Goal(0.03, 100.0))
    assert record.met
    plane = Mesh.of(polygons).planes
    sides = []
    for normal in ([0, 1, 0], np.array([0.6, 0.8, 0])):
        chosen = np.asarray(polygons.triangles)[plane @ np.asarray(normal, np.float32) > 0.999]
        found = leaf_edges(polygons, chosen)
        crease = scene.positions[np.abs(scene.positions[:, 0] + scene.origin[0]) < 1e-5]
        x, y = np.round(crease[0, :2].astype(np.float64), 5)
        sides.append({e for e in found if all(abs(p[0] - x) + abs(p[1] - y) < 1e-4 for p in e)})
    assert sides[0] == sides[1]
    assert len(sides[0]) > 1


def test_backs_of_two_sided_triangles_are_refined_too():
    scene = ball_over_floor(two_sided=True, below=True)
    base, polygons, record = refined(scene)
    assert record.met
    triangles, backs = np.asarray(polygons.triangles), np.asarray(polygons.backs)
    assert len(backs) == len(triangles) > len(base.triangles)
    sheet = backs[:, 0] >= 0
    assert sheet.sum() > 10
    assert (~sheet).sum() > 10
    positions, normals = np.asarray(polygons.positions), np.asarray(polygons.normals)
    front, back = triangles[sheet], backs[sheet]
    np.testing.assert_array_equal(positions[front], positions[back])
    np.testing.assert_allclose(normals[front], -normals[back], atol=1e-6)
    # The ball is below: only the backs see it.
    blocked = np.asarray(polygons.vectors)[:, 3] > 0.0
    assert not blocked[front].any()
    assert blocked[back].any()


def test_pixels_get_the_small_triangles(ball):
    scene, base, polygons, _ = ball
    surface = trace_surface(scene, Camera((0.0, 6.0, 5.0), (0.0, 0.0, 0.0)), (24, 20))
    mesh = Mesh.of(polygons)
    pixels = shaded_pixels(mesh, surface)
    assert pixels.face.max() >= len(base.triangles)
    corners = np.asarray(polygons.positions)[mesh.faces[pixels.face]]
    place = np.einsum("pk,pkc->pc", pixels.barycentrics, corners)
    seen = np.asarray(surface.position).reshape(-1, 3)[pixels.index]
    np.testing.assert_allclose(place, seen, atol=1e-4)
    other = trace_surface(ball_over_floor(rows=20), Camera((0, 6, 5), (0, 0, 0)), (24, 20))
    with pytest.raises(ValueError, match="another scene"):
        shaded_pixels(mesh, other)


def test_files_hold_the_locator(ball, tmp_path):
    polygons = ball[2]
    polygons.save(tmp_path / "polygons.npz")
    again = VisibilityPolygons.load(tmp_path / "polygons.npz")
    for here, there in zip(jax.tree.leaves(polygons), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(here, there)
    assert polygons.nbytes == sum(
        getattr(polygons, field.name).nbytes for field in dataclasses.fields(polygons)
    )


def test_the_method_refines_and_caches(own_caches):
    scene = ball_over_floor(rows=6)
    options: dict[str, Any] = {"resolution": 32, "vectors": 32}
    plain = VectorizedVisibility(**options).precompute(scene, progress=False)
    spec = "vectorized:refine=0.02,growth=1.2"
    method = registry.create(spec, **options)
    first = method.precompute(scene, progress=False)
    rays = scene.tracer.rays_traced
    second = method.precompute(scene, progress=False)
    assert scene.tracer.rays_traced == rays
    for here, there in zip(jax.tree.leaves(first), jax.tree.leaves(second), strict=True):
        np.testing.assert_array_equal(here, there)
    assert len(plain.counts) < len(first.counts)
    more = dataclasses.replace(method, growth=3.0).precompute(scene, progress=False)
    assert len(first.counts) < len(more.counts)
    again = VectorizedVisibility(**options).precompute(scene, progress=False)
    assert len(again.counts) == len(plain.counts)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"refine": 0.0}, "refine must be above 0 and below 1, got 0"),
        ({"refine": 1.0}, "refine must be"),
        ({"refine": float("nan")}, "refine must be"),
        ({"refine": 0.02, "growth": 0.5}, "growth must be at least 1, got 0.5"),
        ({"growth": float("nan")}, "growth must be"),
    ],
)
def test_bad_parameters_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        VectorizedVisibility(**options)
