import dataclasses

import numpy as np
import pytest

from jaxvis.methods.vectorized import precompute
from jaxvis.methods.vectorized.precompute import Settings, precompute_polygons, trace_polygons
from jaxvis.methods.vertices import vertex_samples
from jaxvis.scene import RayTracer, build_scene
from jaxvis.scene.builtin import builtin_scene
from tests.methods.vectorized.polygon_oracle import (
    clamped,
    irradiance,
    own_irradiance,
    seen_from,
    unit,
)

SMALL = Settings(resolution=32, coarsest=16)


def polygons_of(name, settings=None, **parameters):
    scene = builtin_scene(name, **parameters)
    return scene, precompute_polygons(scene, settings or Settings(), progress=False)


def test_the_open_plane_sees_half_the_sky():
    _, polygons = polygons_of("plane")
    np.testing.assert_allclose(own_irradiance(polygons), 1.0, atol=1e-5)
    assert np.all(np.asarray(polygons.vectors)[:, 3] == 0.0)


def test_a_convex_body_sees_its_hemispheres():
    _, polygons = polygons_of("sphere", rows=12)
    np.testing.assert_allclose(own_irradiance(polygons), 1.0, atol=2e-4)


def test_a_ball_over_a_plane():
    """The ball takes (r / D)^2 (c / D) of the sky of a point of the plane."""
    scene = builtin_scene("sphere-on-plane", clearance=0.5, rows=48)
    world = scene.positions + scene.origin
    floor = np.flatnonzero(world[:, 1] < 1e-4)[::3]
    ask = (scene.positions[floor], scene.normals[floor])
    table, _ = trace_polygons(scene.tracer, *ask)
    distance = np.hypot(1.5, np.hypot(world[floor, 0], world[floor, 2]))
    found = irradiance(seen_from(table, ask[0]), ask[1].astype(float))
    error = found - (1.0 - 1.5 / distance**3)
    assert np.abs(error).max() < 4e-3  # of which the facets take some
    assert np.abs(error).mean() < 1e-3


def test_the_foot_of_a_wall_sees_half_the_sky():
    """Vertices of the floor before the wall, and of the wall's own front."""
    scene, polygons = polygons_of("wall")
    world = np.asarray(polygons.positions) + scene.origin
    front = (world[:, 0] > -1e-4) & (np.asarray(polygons.normals)[:, 0] > 0.9)
    above = front & (world[:, 1] > 0.01)
    found = own_irradiance(polygons)
    h, a, d = 4.0, 4.0, world[:, 0]
    r = np.hypot(d, h)
    form = (np.arctan2(a, d) - d / r * np.arctan2(a, r)) / np.pi
    floor = (np.abs(world[:, 1]) < 1e-4) & (np.abs(world[:, 2]) < 1e-4) & (d > 0.01)
    assert floor.sum() > 3
    np.testing.assert_allclose(found[floor], 1.0 - form[floor], atol=1e-3)
    # More than the 1/2 before an infinite plane by the sky below the horizon of one that ends at 8.
    height = world[above, 1]
    more = found[above] - 0.5
    assert np.all((more > 0.0) & (more < 0.7 * height / 8.0))


def test_places_beside_the_vertices_see_what_there_is_above_a_sphere():
    """Shading points on the facets, with interpolated normals: a domain that ended at the tangent
    planes of the vertices would lose up to 1 - cos of the angle to them.
    """
    scene = builtin_scene("sphere", rows=8)
    lost = []
    for reach in (0.6, 0.0):
        v = vertex_samples(scene, largest_dip=reach)
        vectors, _ = trace_polygons(
            scene.tracer,
            v.positions,
            v.normals,
            origins=v.origins,
            dips=v.dips,
            corners=scene.positions[scene.triangles],
            settings=SMALL,
        )
        place = scene.positions[scene.triangles].mean(axis=1)
        normal = scene.geometric_normals.astype(float)
        seen = [
            irradiance(clamped(seen_from(vectors[v.triangles[:, k]], place), normal), normal)
            for k in range(3)
        ]
        lost.append(np.abs(1.0 - np.mean(seen, axis=0)).max())
    assert lost[0] < 5e-3
    assert lost[1] > 1e-2  # negative control


def test_samples_that_see_nothing_are_one_point():
    scene, polygons = polygons_of("box-on-plane", SMALL)
    world = np.asarray(polygons.positions) + scene.origin
    inside = (np.abs(world[:, 1]) < 1e-4) & (np.abs(world[:, [0, 2]]).max(axis=1) < 0.9)
    inside &= np.asarray(polygons.normals)[:, 1] > 0.9
    assert inside.any()
    assert np.all(np.asarray(polygons.counts)[inside] == 1)
    assert np.asarray(polygons.buried)[inside].all()
    vectors = np.asarray(polygons.vectors)[inside]
    np.testing.assert_array_equal(vectors, np.repeat(vectors[..., :1], vectors.shape[-1], axis=-1))
    np.testing.assert_allclose(vectors[:, :3, 0], np.asarray(polygons.normals)[inside], atol=1e-6)
    assert np.abs(own_irradiance(polygons)[inside]).max() == 0.0


def test_every_answer_is_between_nothing_and_everything():
    _, polygons = polygons_of("teapot", Settings(resolution=16, coarsest=16, vectors=64))
    found = own_irradiance(polygons)
    assert np.isfinite(np.asarray(polygons.vectors)).all()
    assert found.min() > -1e-3
    assert found.max() < 1.0 + 1e-3
    assert np.asarray(polygons.counts).min() >= 1
    assert np.asarray(polygons.counts).max() <= 64


@pytest.mark.parametrize("threads", [1, 2])
def test_batches_and_threads_change_nothing(monkeypatch, threads):
    scene = builtin_scene("torus-on-plane")
    tracer = RayTracer(scene.positions, scene.triangles, threads)
    chosen = slice(0, 2400, 40)
    ask = (scene.positions[chosen], scene.normals[chosen])
    whole = trace_polygons(scene.tracer, *ask, settings=SMALL)
    monkeypatch.setattr(precompute, "BATCH", 7)
    parts = trace_polygons(tracer, *ask, settings=SMALL)
    np.testing.assert_array_equal(whole[1], parts[1])
    np.testing.assert_array_equal(whole[0], parts[0])


def test_fewer_vectors_cost_accuracy_only():
    scene = builtin_scene("torus-on-plane")
    chosen = slice(0, 2400, 24)
    normals = scene.normals[chosen].astype(float)
    found = []
    for vectors in (16, 32, 128):
        settings = Settings(vectors=vectors, tolerance=0.0)
        table, counts = trace_polygons(
            scene.tracer, scene.positions[chosen], scene.normals[chosen], settings=settings
        )
        assert table.shape == (len(normals), 4, vectors)
        assert counts.max() <= vectors
        found.append(irradiance(seen_from(table, scene.positions[chosen]), normals))
    assert np.abs(found[1] - found[2]).mean() < 0.5 * np.abs(found[0] - found[2]).mean()


def test_zero_normals_see_nothing():
    scene = builtin_scene("plane")
    normals = np.array([[0, 0, 0], [0, 1, 0]], np.float32)
    table, counts = trace_polygons(scene.tracer, scene.positions[:2], normals, settings=SMALL)
    assert counts[0] == 1 < counts[1]
    assert np.isfinite(table).all()


def test_broken_meshes_work():
    """Triangles in one place, one inside another, and non-manifold edges."""
    rng = np.random.default_rng(0)
    points = rng.normal(size=(12, 3))
    faces = np.array([rng.permutation(12)[:3] for _ in range(30)])
    scene = build_scene(
        np.concatenate([points, 2 * points]), np.concatenate([faces, faces, faces + 12])
    )
    polygons = precompute_polygons(scene, SMALL, progress=False)
    assert np.isfinite(np.asarray(polygons.vectors)).all()
    assert np.isfinite(own_irradiance(polygons)).all()


def test_points_at_infinity_are_units_and_others_lie_on_the_scene():
    scene, polygons = polygons_of("torus-on-plane", SMALL)
    vectors = np.moveaxis(np.asarray(polygons.vectors), 1, -1)
    rim, solid = vectors[..., 3] == 0.0, vectors[..., 3] == 1.0
    assert np.all(rim | solid)
    np.testing.assert_allclose(np.linalg.norm(vectors[rim, :3], axis=-1), 1.0, atol=1e-5)
    low, high = scene.positions.min(axis=0) - 0.05, scene.positions.max(axis=0) + 0.05
    assert np.all((vectors[solid, :3] > low) & (vectors[solid, :3] < high))


def test_two_sided_sheets_see_the_sky_on_both_sides():
    scene = builtin_scene("plane", cells=2)
    sheet = scene.with_materials(
        tuple(dataclasses.replace(m, two_sided=True) for m in scene.materials)
    )
    polygons = precompute_polygons(sheet, SMALL, progress=False)
    assert len(polygons.counts) == 2 * len(scene.positions)
    np.testing.assert_allclose(own_irradiance(polygons), 1.0, atol=1e-4)
    up = np.asarray(polygons.normals)[np.asarray(polygons.backs)]
    np.testing.assert_allclose(up, np.broadcast_to([0.0, -1.0, 0.0], up.shape), atol=1e-6)


def test_turned_scenes_see_the_same():
    """Rotation moves poles and seams; the polygons' own irradiance stays."""
    scene = builtin_scene("torus-on-plane")
    turn = unit(np.array([[0.8, 0.5, 0.3], [-0.2, 0.9, 0.1], [0.1, -0.3, 0.7]]))
    turn, _ = np.linalg.qr(turn)
    turn *= np.linalg.det(turn)
    turned = RayTracer((scene.positions @ turn.T).astype(np.float32), scene.triangles)
    chosen = slice(0, 2400, 24)
    x, n = scene.positions[chosen], scene.normals[chosen]
    here, _ = trace_polygons(scene.tracer, x, n)
    x2, n2 = (x @ turn.T).astype(np.float32), (n @ turn.T).astype(np.float32)
    there, _ = trace_polygons(turned, x2, n2)
    a = irradiance(seen_from(here, x), n.astype(float))
    b = irradiance(seen_from(there, x2), n2.astype(float))
    assert np.abs(a - b).mean() < 6e-4
    assert np.percentile(np.abs(a - b), 95) < 2e-3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"vectors": 8}, "vectors"),
        ({"resolution": 60, "coarsest": 16}, "resolution"),
        ({"coarsest": 0}, "coarsest"),
        ({"tolerance": -1.0}, "tolerance"),
        ({"tolerance": float("nan")}, "tolerance"),
    ],
)
def test_settings_out_of_range_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        polygons_of("plane", Settings(**change))


def test_no_samples_no_polygons():
    scene = builtin_scene("plane")
    table, counts = trace_polygons(scene.tracer, np.zeros((0, 3)), np.zeros((0, 3)))
    assert table.shape == (0, 4, 128)
    assert counts.shape == (0,)
