"""The scenes that move: one topology, sound in every frame, and moved as bodies move."""

import importlib
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from jaxvis.scene.builtin import ANIMATIONS, builtin_animation, gait
from jaxvis.scene.builtin.mesh import unit
from jaxvis.scene.builtin.moving import Body
from jaxvis.scene.builtin.noise import noise, smoothstep
from jaxvis.scene.rays import RayTracer
from jaxvis.scene.weld import equal_rows
from tests.scene.builtin_checks import camera_rays, is_closed, least_alignment, sees_backs, volume

# The package has functions of the same names.
balls, hat = (importlib.import_module(f"jaxvis.scene.builtin.{n}") for n in ("balls", "hat"))
animation = cache(builtin_animation)
FRAMES = [1, 17, 40, 77, 119]


def part(animated, frame, *numbers):
    """The positions and triangles of some of an animation's bodies."""
    scene = animated.scene(frame)
    chosen = np.isin(animated.parts[scene.triangles[:, 0]], numbers)
    return SimpleNamespace(
        positions=scene.positions.astype(float) + scene.origin,
        normals=scene.normals,
        triangles=scene.triangles[chosen],
    )


@pytest.mark.parametrize(
    ("name", "vertices", "still"), [("hat", 21_000, 0), ("balls", 30_000, 0), ("walker", 32_000, 0)]
)
def test_sizes_and_what_moves(name, vertices, still):
    animated = animation(name)
    assert abs(len(animated.base.positions) - vertices) < 0.05 * vertices
    moved = animated.moved(5, 6)
    assert not moved[animated.parts == still].any()
    # The walker stands on one of its feet.
    assert moved[animated.parts != still].mean() > 0.9
    resting = np.mean(animated.parts == still)
    assert 0.4 < resting < 0.9


@pytest.mark.parametrize("name", ANIMATIONS)
@pytest.mark.parametrize("frame", FRAMES)
def test_every_frame_is_sound(name, frame):
    animated = animation(name)
    scene = animated.scene(frame)
    assert np.array_equal(scene.triangles, animated.base.triangles)
    assert least_alignment(scene) > 0.0
    assert sees_backs(scene, *camera_rays(scene, 160, 120)) == 0
    for number in range(1, animated.parts.max() + 1):
        body = part(animated, frame, number)
        assert is_closed(body), number
        assert volume(body) > 1e-5, number


def test_is_closed_sees_a_hole():
    body = part(animation("hat"), 0, 1)
    body.triangles = body.triangles[1:]
    assert not is_closed(body)


def test_posed_normals_are_those_of_a_sphere():
    sphere = part(animation("balls"), 0, 1)
    _, triangles = np.unique(sphere.triangles, return_inverse=True)
    triangles = triangles.reshape(-1, 3)
    places = sphere.positions[np.unique(sphere.triangles)]
    uvs = np.zeros((len(triangles), 3, 2))
    _, normals = Body(triangles, uvs, np.zeros(len(triangles), int)).posed(places)
    exact = unit(places - balls._centre(0, np.array([0.0])))
    assert np.sum(normals * exact, axis=-1).min() > 0.999


# The hat


def depth_in_cloth(animated, frame, sink=0.0):
    """How deep the hat's vertices lie in the cloth, by rays; positive inside."""
    scene = animated.scene(frame)
    cloth = animated.parts[scene.triangles[:, 0]] == 0
    tracer = RayTracer(scene.positions, scene.triangles[cloth])
    places = scene.positions[animated.parts == 1] - [0.0, sink, 0.0]
    above = places + [0.0, 1.0, 0.0]
    hit = tracer.closest_hit(above, np.broadcast_to([0.0, -1.0, 0.0], above.shape))
    corners = scene.positions[scene.triangles[cloth][np.maximum(hit.triangle, 0)]]
    height = np.einsum("pk,pk->p", hit.barycentrics, corners[..., 1])
    return np.where(hit.triangle >= 0, height - places[:, 1], -np.inf).max()


@pytest.mark.parametrize("frame", [0, *FRAMES])
def test_the_hat_touches_the_cloth_and_no_more(frame):
    # Between its vertices the cloth may be a little higher or lower than its formula.
    assert -2.5 * hat.GAP < depth_in_cloth(animation("hat"), frame) < 0.0005
    assert depth_in_cloth(animation("hat"), frame, sink=0.01) > 0.005


def test_the_hat_deforms():
    animated = animation("hat")
    one, other = (animated.scene(frame).positions[animated.parts == 1] for frame in (0, 45))
    edges = one - one[0], other - other[0]
    # Not a rigid motion: distances change by centimetres.
    change = np.abs(np.linalg.norm(edges[0], axis=-1) - np.linalg.norm(edges[1], axis=-1))
    assert change.max() > 0.01


def test_the_hat_repeats():
    first, again = (hat._stance(frame) for frame in (3, 3 + hat.FRAMES))
    assert again.curl == pytest.approx(first.curl)
    assert again.dip == pytest.approx(first.dip)


# The balls


@pytest.mark.parametrize("number", [0, 1])
def test_balls_lie_in_the_dish_and_apart(number):
    frames = np.arange(balls.FRAMES, dtype=float)
    centre, other = balls._centre(number, frames), balls._centre(1 - number, frames)
    radius = balls.RADII[number]
    depth = np.linalg.norm(centre - [0.0, balls.BOWL, 0.0], axis=-1)
    np.testing.assert_allclose(balls.BOWL - depth, radius * (1.0 + balls.CONTACT), rtol=1e-9)
    assert np.hypot(centre[:, 0], centre[:, 2]).max() + radius < 1.0
    assert np.linalg.norm(centre - other, axis=-1).min() > 1.1 * sum(balls.RADII)


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize("frame", [1, 50, 200])
def test_balls_roll_without_slipping(number, frame):
    times = np.array([frame - 1.0, frame, frame + 1.0])
    before, here, after = balls._centre(number, times)
    contact = balls.RADII[number] * unit(here - [0.0, balls.BOWL, 0.0])
    on_ball = balls._turn(number, frame).T @ contact
    moved = (after + balls._turn(number, frame + 1) @ on_ball) - (
        before + balls._turn(number, frame - 1) @ on_ball
    )
    travelled = np.linalg.norm(after - before)
    assert np.linalg.norm(moved) < 0.02 * travelled
    # The point on top goes twice as fast as the centre.
    top = (after - balls._turn(number, frame + 1) @ on_ball) - (
        before - balls._turn(number, frame - 1) @ on_ball
    )
    assert np.linalg.norm(top) == pytest.approx(2.0 * travelled, rel=0.05)


# The walker


@pytest.mark.parametrize("side", [0, 1])
def test_feet_stand_still_while_they_carry(side):
    figures = [gait.figure(frame) for frame in range(2 * gait.CYCLE)]
    ball = np.array([0.0, 0.0, gait.BALL])
    places = np.array([f.feet[side].frame.place(ball) for f in figures])
    phase = (np.arange(len(places)) / gait.CYCLE + 0.5 * side) % 1.0
    # Flat on the ground, and on the toes; the heel's landing comes before.
    standing = (phase > 0.2) & (phase < gait.STANCE)
    steps = np.linalg.norm(np.diff(places, axis=0), axis=-1)
    both = standing[1:] & standing[:-1]
    assert both.sum() > 10
    assert steps[both].max() < 1e-3
    assert steps[~both].max() > 0.05
    assert places[:, 1].min() > -1e-9


def test_bones_keep_their_length():
    for frame in range(gait.CYCLE):
        figure = gait.figure(frame)
        for limbs, lengths in (
            (figure.legs, (gait.THIGH, gait.SHIN)),
            (figure.arms, (gait.UPPER_ARM, gait.LOWER_ARM)),
        ):
            for limb in limbs:
                bones = np.linalg.norm(np.diff(limb.joints, axis=0), axis=-1)
                np.testing.assert_allclose(bones, lengths, rtol=0.03)


def test_the_walk_is_a_round():
    start, end = gait.figure(0), gait.figure(gait.CYCLE * gait.CYCLES)
    for one, other in zip(start.legs + start.arms, end.legs + end.arms, strict=True):
        np.testing.assert_allclose(one.joints, other.joints, atol=1e-9)


@pytest.mark.parametrize("frame", [0, *FRAMES])
def test_nothing_of_the_walker_is_below_the_ground(frame):
    animated = animation("walker")
    scene = animated.scene(frame)
    height = scene.positions[animated.parts > 0, 1] + scene.origin[1]
    assert -1e-6 < height.min() < 0.012
    assert 1.7 < height.max() < 1.9


def test_the_walker_is_on_the_plane():
    animated = animation("walker")
    plane = np.abs(part(animated, 0, 0).positions[animated.parts == 0]).max()
    for frame in FRAMES:
        figure = animated.scene(frame).positions[animated.parts > 0] + animated.base.origin
        assert np.abs(figure[:, [0, 2]]).max() < plane - 0.2


# Noise


def test_noise_is_smooth_and_repeats():
    points = np.random.default_rng(0).uniform(-3.0, 40.0, (4000, 3))
    value = noise(points, 3, seed=1)
    assert value.min() >= 0.0
    assert value.max() <= 1.0
    assert abs(value.mean() - 0.5) < 0.02
    assert value.std() > 0.08
    np.testing.assert_allclose(noise(points + [32.0, 0.0, -32.0], 3, seed=1), value, atol=1e-4)
    assert np.abs(noise(points + 1e-3, 3, seed=1) - value).max() < 0.02
    assert np.abs(noise(points, 3, seed=2) - value).max() > 0.2


def test_noise_at_the_lattice_is_the_table():
    points = np.array([[0.0, 1.0, 2.0], [5.0, 33.0, -1.0]])
    table = np.random.default_rng(4).uniform(size=(32, 32, 32))
    expected = [table[0, 1, 2], table[5, 1, 31]]
    np.testing.assert_allclose(noise(points, 1, seed=4), expected, atol=1e-6)


def test_smoothstep():
    x = np.array([-1.0, 0.0, 0.5, 1.0, 2.0])
    np.testing.assert_allclose(smoothstep(0.0, 1.0, x), [0.0, 0.0, 0.5, 1.0, 1.0])
    np.testing.assert_allclose(smoothstep(1.0, 0.0, x), [1.0, 1.0, 0.5, 0.0, 0.0])


def test_vertices_are_welded_once():
    # A body's grid repeats its first column: the scene has each place once.
    for name in ANIMATIONS:
        scene = animation(name).base
        first, _ = equal_rows(*scene.positions.T)
        assert len(first) == len(scene.positions)
