import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.methods.vectorized.hemisphere_map import (
    Samples,
    cell_solid_angle,
    grid,
    visibility_map,
)
from jaxvis.scene import RayTracer
from jaxvis.scene.builtin import builtin_scene, shapes
from jaxvis.sphere import hemisphere

NORMALS = np.array([[0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1], [0.6, -0.64, 0.48]], np.float32)


def tracer_of(mesh):
    return RayTracer(mesh.positions, mesh.triangles)


def ball(centre, radius=0.5):
    return tracer_of(shapes.sphere(radius, 48).moved(np.float64(centre)))


def test_frames_are_right_handed_about_the_normals():
    frames = Samples.of(NORMALS, NORMALS).frames
    np.testing.assert_allclose(
        frames @ np.swapaxes(frames, 1, 2), np.stack(5 * [np.eye(3)]), atol=1e-6
    )
    np.testing.assert_allclose(np.linalg.det(frames), 1.0, atol=1e-6)
    np.testing.assert_allclose(frames[:, 2], NORMALS, atol=1e-6)


def test_the_chart_is_lamberts_and_reaches_down_to_the_dip():
    samples = Samples.of(NORMALS[:2], NORMALS[:2], dips=np.float32([0.0, 0.4]))
    chart = np.random.default_rng(0).uniform(-0.7, 0.7, (200, 2)).astype(np.float32)
    level = samples.local(np.zeros(200, int), chart)
    np.testing.assert_allclose(hemisphere.from_direction(jnp.asarray(level)), chart, atol=1e-6)
    turn = np.linspace(0, 6, 50)
    rim = np.stack([np.cos(turn), np.sin(turn)], -1).astype(np.float32)
    below = samples.local(np.ones(50, int), rim)
    np.testing.assert_allclose(below[:, 2], -0.4, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(below, axis=-1), 1.0, atol=1e-6)


@pytest.mark.parametrize("dip", [0.0, 0.5])
def test_free_nodes_measure_solid_angles(dip):
    """A ball of radius 1/2 at a distance 1 hides a cap of half angle 30 degrees."""
    samples = Samples.of(np.zeros((5, 3)), NORMALS, dips=dip)
    centres = NORMALS / np.linalg.norm(NORMALS, axis=-1, keepdims=True)
    for k, centre in enumerate(centres):
        free = visibility_map(ball(centre), samples.take(slice(k, k + 1)), 128, 128)
        seen = free.sum() * cell_solid_angle(128, samples.dips)[k]
        hidden = 2 * np.pi * (1 + dip) - seen
        assert abs(hidden - 2 * np.pi * (1 - np.cos(np.pi / 6))) < 0.02


def test_the_outer_nodes_lie_outside():
    nodes = grid(32).reshape(33, 33, 2)
    border = np.concatenate([nodes[0], nodes[-1], nodes[:, 0], nodes[:, -1]])
    assert np.linalg.norm(border, axis=-1).min() > 1.0


def test_refined_maps_are_those_traced_fully():
    scene = builtin_scene("torus-on-plane")
    chosen = slice(0, None, 97)
    origins = scene.positions[chosen] + 1e-4 * scene.normals[chosen]
    samples = Samples.of(scene.positions[chosen], scene.normals[chosen], origins)
    full = visibility_map(scene.tracer, samples, 64, 64)
    before = scene.tracer.rays_traced
    refined = visibility_map(scene.tracer, samples, 64, 32)
    rays = scene.tracer.rays_traced - before
    assert np.mean(full != refined) < 1e-4
    assert rays < 0.6 * len(samples.origins) * (np.linalg.norm(grid(64), axis=-1) < 1).sum()


def test_what_lies_within_a_coarse_cell_is_missed():
    """Negative control for the refinement: a ball smaller than a cell of the coarsest grid."""
    samples = Samples.of(np.zeros((1, 3)), np.array([[0.0, 1.0, 0.0]]))
    node = 31 * 65 + 33  # off the nodes of the coarse grid, which are the multiples of 4
    towards = samples.directions(np.zeros(1, int), grid(64)[node : node + 1])[0]
    speck = ball(towards, 0.02)
    disc = (np.linalg.norm(grid(64), axis=-1) < 1).sum()
    assert visibility_map(speck, samples, 64, 64).sum() < disc
    assert visibility_map(speck, samples, 64, 16).sum() == disc


def test_grids_that_do_not_nest_are_refused():
    samples = Samples.of(np.zeros((1, 3)), NORMALS[:1])
    for resolution, coarsest in ((64, 48), (96, 32)):
        with pytest.raises(ValueError, match="power of two"):
            visibility_map(ball((0, 2, 0)), samples, resolution, coarsest)
