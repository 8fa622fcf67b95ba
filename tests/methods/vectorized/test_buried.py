import numpy as np

from jaxvis.methods.vectorized.buried import buried
from jaxvis.methods.vectorized.hemisphere_map import Samples
from jaxvis.methods.vertices import vertex_samples
from jaxvis.scene.builtin import builtin_scene


def found_in(scene, one_sided=True):
    vertices = vertex_samples(scene)
    samples = Samples.of(vertices.positions, vertices.normals, vertices.origins)
    sides = np.full(len(scene.triangles), one_sided)
    return vertices, buried(scene.tracer, samples, scene.geometric_normals, sides)


def test_the_floor_inside_a_box_is_buried():
    vertices, hidden = found_in(builtin_scene("box-on-plane", width=2.0))
    world = vertices.positions + builtin_scene("box-on-plane", width=2.0).origin
    floor = (np.abs(world[:, 1]) < 1e-4) & (vertices.normals[:, 1] > 0.9)
    inside = np.abs(world[:, [0, 2]]).max(axis=1)
    assert hidden[floor & (inside < 0.95)].all()
    assert not hidden[floor & (inside > 1.05)].any()
    assert not hidden[world[:, 1] > 0.05].any()


def test_nothing_in_the_open_is_buried():
    for name in ("sphere", "plane", "torus-on-plane"):
        vertices, hidden = found_in(builtin_scene(name))
        above = vertices.positions[:, 1] > vertices.positions[:, 1].min() + 1e-3
        assert not hidden[above].any()


def test_both_sides_of_two_sided_triangles_are_fronts():
    assert found_in(builtin_scene("box-on-plane"))[1].any()
    assert not found_in(builtin_scene("box-on-plane"), one_sided=False)[1].any()


def test_no_samples_no_answers():
    scene = builtin_scene("plane")
    none = Samples.of(np.zeros((0, 3)), np.zeros((0, 3)))
    hidden = buried(
        scene.tracer, none, scene.geometric_normals, np.ones(len(scene.triangles), bool)
    )
    assert hidden.shape == (0,)
