import numpy as np
import pytest

from jaxvis.methods.vectorized.contours import trace_contours
from jaxvis.methods.vectorized.far_edges import far_edges
from jaxvis.methods.vectorized.hemisphere_map import Samples, visibility_map
from jaxvis.methods.vectorized.silhouettes import position_vectors
from jaxvis.scene import RayTracer
from jaxvis.scene.builtin import shapes
from tests.methods.vectorized.polygon_oracle import seen_from

UP = np.array([[0.0, 1.0, 0.0]])
RESOLUTION = 48


def traced(positions, triangles, samples, steps=8, far=True):
    positions = np.asarray(positions, np.float32)
    triangles = np.asarray(triangles, np.int32)
    tracer = RayTracer(positions, triangles)
    free = visibility_map(tracer, samples, RESOLUTION, RESOLUTION)
    contours = trace_contours(tracer, samples, free)
    corners = positions[triangles] if far else None
    vectors, local = position_vectors(
        tracer, samples, contours, RESOLUTION, steps=steps, corners=corners
    )
    return vectors, local, contours


def ball(centre):
    mesh = shapes.sphere(1.0, 64).moved(np.float64(centre))
    return mesh.positions, mesh.triangles


@pytest.mark.parametrize("centre", [(0, 3, 0), (1.5, 2, 1), (-2, 2.0, 0.5)])
def test_the_outline_of_a_ball(centre):
    samples = Samples.of(np.zeros((1, 3)), UP)
    vectors, local, _ = traced(*ball(centre), samples)
    distance = np.linalg.norm(centre)
    towards = np.array(centre) / distance
    solid = vectors[:, 3] == 1.0
    directions = seen_from(vectors.T[None], np.zeros((1, 3)))[0]
    angle = np.arccos(np.clip(directions[solid] @ towards, -1, 1))
    assert np.abs(angle - np.arcsin(1 / distance)).max() < 2e-3  # the mesh lies inside the sphere
    radius = np.linalg.norm(vectors[solid, :3] - centre, axis=-1)
    assert np.abs(radius - 1.0).max() < 5e-3
    np.testing.assert_allclose(
        samples.to_world(np.zeros(len(local), int), local), directions, atol=1e-5
    )


def test_every_bisection_halves_the_error():
    samples = Samples.of(np.zeros((1, 3)), UP)
    finest = traced(*ball((1.5, 2, 1)), samples, steps=16)[1]
    errors = [
        np.linalg.norm(traced(*ball((1.5, 2, 1)), samples, steps=n)[1] - finest, axis=-1).mean()
        for n in (2, 4, 6)
    ]
    assert 3.0 < errors[0] / errors[1] < 5.5
    assert 3.0 < errors[1] / errors[2] < 5.5


def test_the_open_horizon_lies_in_the_tangent_plane():
    normal = np.array([[0.48, 0.6, -0.64]], np.float32)
    far_below = np.array([[0, -9, 0], [1, -9, 0], [0, -9, 1]])
    vectors, local, _ = traced(far_below, [[0, 1, 2]], Samples.of(np.zeros((1, 3)), normal))
    assert np.all(vectors[:, 3] == 0.0)
    assert np.abs(vectors[:, :3] @ normal[0]).max() < 2e-7
    np.testing.assert_allclose(np.linalg.norm(vectors[:, :3], axis=-1), 1.0, atol=1e-6)
    np.testing.assert_array_equal(local[:, 2], 0.0)


def test_a_domain_that_dips_ends_at_its_rim():
    vectors, _, _ = traced(
        [[0, -9, 0], [1e-3, -9, 0], [0, -9, 1e-3]],
        [[0, 1, 2]],
        Samples.of(np.zeros((1, 3)), UP, dips=0.3),
    )
    assert np.all(vectors[:, 3] == 0.0)
    np.testing.assert_allclose(vectors[:, 1], -0.3, atol=1e-6)


# A vertex in a valley between two slopes that end at the height 0.2.
VALLEY = np.array(
    [[0, 0, 0], [0, 0, 1], [0, 0, -1], [1, 0.2, -1], [1, 0.2, 1], [-1, 0.2, 1], [-1, 0.2, -1]]
)
SLOPES = [[0, 1, 4], [0, 4, 3], [0, 3, 2], [0, 5, 1], [0, 6, 5], [0, 2, 6]]


def test_slopes_around_a_vertex_end_at_their_far_edges():
    origin = np.array([[0.0, 2e-5, 0.0]])
    samples = Samples.of(np.zeros((1, 3)), UP, origin)
    vectors, local, _ = traced(VALLEY, SLOPES, samples)
    slope = (vectors[:, 3] == 1.0) & (np.abs(local[:, 2]) > 0.02)
    assert slope.sum() > 20
    ends = np.abs(vectors[slope, :3])
    at_end = (np.abs(ends[:, 0] - 1.0) < 2e-3) | (np.abs(ends[:, 2] - 1.0) < 2e-3)
    assert at_end.all()
    plain = traced(VALLEY, SLOPES, samples, steps=4, far=False)[0]
    near = np.linalg.norm(plain[plain[:, 3] == 1.0, :3], axis=-1)
    assert (near < 0.1).any()  # negative control: coarse rays meet the slopes at the vertex


def test_rays_follow_a_floor_over_several_triangles():
    mesh = shapes.ground(8.0, 16)
    corners = mesh.positions[mesh.triangles].astype(np.float32)
    tracer = RayTracer(mesh.positions, mesh.triangles)
    origin = np.array([[0.1, 1e-5, 0.2]], np.float32)
    turn = np.linspace(0.05, 6.2, 12)
    down = np.stack([np.cos(turn), np.full(12, -1e-4), np.sin(turn)], -1).astype(np.float32)
    level = down * np.float32([1, 0, 1])
    samples = Samples.of(origin, np.array([[1.0, 0, 0]]))
    owner = np.zeros(12, int)
    hits = tracer.closest_hit(np.repeat(origin, 12, axis=0), down)
    reach = hits.distance[:, None] * level
    ends = far_edges(tracer, samples, owner, hits, corners, level, reach)
    before, after = np.linalg.norm(reach, axis=-1), np.linalg.norm(ends, axis=-1)
    assert before.max() < 0.2
    assert after.min() > 1.2  # some eight triangles further
    assert np.abs(ends[:, 1]).max() < 1e-4


def test_surfaces_met_steeply_stay_where_they_are():
    tracer = RayTracer(*ball((0, 3, 0)))
    corners = ball((0, 3, 0))[0].astype(np.float32)[ball((0, 3, 0))[1]]
    samples = Samples.of(np.zeros((1, 3)), UP)
    rays = np.float32([[0, 1, 0], [0.1, 1, 0.05]])
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    hits = tracer.closest_hit(np.zeros((2, 3), np.float32), rays)
    reach = hits.distance[:, None] * rays
    ends = far_edges(tracer, samples, np.zeros(2, int), hits, corners, rays, reach)
    np.testing.assert_allclose(ends, reach, rtol=1e-6)
