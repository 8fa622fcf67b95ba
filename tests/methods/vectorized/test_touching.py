import numpy as np
import pytest

from jaxvis.methods.vectorized.hemisphere_map import Samples
from jaxvis.methods.vectorized.precompute import Settings, precompute_polygons, trace_polygons
from jaxvis.methods.vectorized.touching import clear_of_surfaces
from jaxvis.methods.vertices import vertex_samples
from jaxvis.scene.builtin import builtin_scene
from tests.methods.vectorized.polygon_oracle import clamped, irradiance, own_irradiance, seen_from

SMALL = Settings(resolution=48, coarsest=24)


def moved(scene, one_sided=True):
    vertices = vertex_samples(scene)
    samples = Samples.of(vertices.positions, vertices.normals, vertices.origins)
    sides = np.full(len(scene.triangles), one_sided)
    origins = clear_of_surfaces(scene.tracer, samples, scene.geometric_normals, sides)
    return vertices, origins, np.any(origins != vertices.origins, axis=-1)


def foot(scene, vertices):
    """The floor's vertices in the plane of the wall's front."""
    world = vertices.positions + scene.origin
    there = (np.abs(world[:, :2]).max(axis=1) < 1e-4) & (vertices.normals[:, 1] > 0.9)
    return there & (np.abs(world[:, 2]) < 3.9)


def test_the_floor_at_the_foot_of_a_wall_moves_before_the_wall():
    scene = builtin_scene("wall")
    vertices, origins, changed = moved(scene)
    there = foot(scene, vertices)
    assert there.sum() > 5
    assert (origins[there, 0] + scene.origin[0]).min() > 0.0
    assert (changed & ~there).sum() <= 2  # the wall's corners
    step = np.linalg.norm(vertices.origins - vertices.positions, axis=-1)
    assert np.all(np.linalg.norm(origins - vertices.origins, axis=-1) < 2.0 * step)
    height = np.sum((origins - vertices.positions) * vertices.normals, axis=-1)
    assert height.min() > 0.0


def test_the_foot_of_a_wall_sees_half_the_sky_where_rounding_would_have_decided():
    scene = builtin_scene("wall")
    polygons = precompute_polygons(scene, SMALL, progress=False)
    vertices = vertex_samples(scene)
    there = foot(scene, vertices)
    np.testing.assert_allclose(own_irradiance(polygons)[there], 0.5, atol=0.02)
    assert not np.asarray(polygons.buried)[there].any()
    chosen = [field[there] for field in vertices[:3]]
    vectors, _ = trace_polygons(
        scene.tracer, chosen[0], chosen[1], origins=chosen[2], settings=SMALL
    )
    seen = clamped(seen_from(vectors, chosen[0]), chosen[1])
    found = irradiance(seen, chosen[1].astype(float))
    assert np.abs(found - 0.5).max() > 0.2  # negative control


@pytest.mark.parametrize("name", ["sphere", "plane", "box-on-plane", "torus-on-plane"])
def test_samples_in_the_open_stay(name):
    assert not moved(builtin_scene(name))[2].any()


def test_both_sides_of_two_sided_surfaces_are_seen():
    assert not moved(builtin_scene("wall"), one_sided=False)[2].any()


def test_no_samples():
    scene = builtin_scene("plane")
    none = Samples.of(np.zeros((0, 3)), np.zeros((0, 3)))
    sides = np.ones(len(scene.triangles), bool)
    found = clear_of_surfaces(scene.tracer, none, scene.geometric_normals, sides)
    assert found.shape == (0, 3)
