"""From frame to frame: what did not move costs nothing, and what is kept is what would be found."""

import gc
import tracemalloc
import weakref
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from jaxvis.methods.distance_field import AdaptiveVisibility
from jaxvis.methods.distance_field.build import Angular, Spatial, Vertices, place_samples
from jaxvis.methods.distance_field.carry import (
    CLUSTERS,
    Balls,
    carry_over,
    moving_balls,
    stale_texels,
)
from jaxvis.methods.distance_field.field import ARRAYS
from jaxvis.methods.distance_field.maps import dense_maps
from jaxvis.scene import build_scene, trace_surface
from jaxvis.scene.animation import moved_vertices
from jaxvis.scene.builtin import builtin_animation, builtin_scene, shapes
from jaxvis.scene.builtin.mesh import join

ANGULAR = Angular(32, "adaptive", 16)
# Nothing is inserted or erased: what is carried is all there is.
STILL = Spatial(5.0, 1.0, 1e9, 0.0, 0, 0.1, 8, "linear", "distances")
MOVING = STILL._replace(initial=0.5, largest=0.1, least=0.05, rounds=2, budget=0.12)


@cache
def animation():
    return builtin_animation("balls", detail=16)


@cache
def frame(number):
    return animation().scene(number)


@cache
def placed(angular=ANGULAR, spatial=STILL):
    return place_samples(frame(0), angular, spatial)


def rays_in(scene, function):
    before = scene.tracer.rays_traced
    return function(), scene.tracer.rays_traced - before


def pairs(one, other):
    """Rows of the samples that both fields have."""
    _, first, second = np.intersect1d(one.samples, other.samples, return_indices=True)
    return first, second


def ground_with(centre, radius, size=10.0, cells=24):
    """A plane and a ball, whose vertices have the same numbers wherever it is."""
    meshes = [shapes.ground(size, cells), shapes.sphere(radius, 8).moved(centre)]
    mesh = join(meshes)
    scene = build_scene(mesh.positions, mesh.triangles, normals=mesh.normals[mesh.triangles])
    # Always about the same origin, so that what stands still has the same coordinates.
    shifted = scene.positions.astype(np.float64) + scene.origin
    return replace(scene, positions=shifted.astype(np.float32), origin=np.zeros(3))


def test_where_nothing_moved_nothing_is_traced():
    scene = frame(0)
    first = placed()
    carried, rays = rays_in(scene, lambda: carry_over(first, scene, ANGULAR, STILL))
    assert rays == carried.rays_traced == 0
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(carried, name), getattr(first, name))


@pytest.mark.parametrize("resolution", [16, 32, 48, 64])
@pytest.mark.parametrize("fill", ["adaptive", "dense"])
def test_carried_maps_are_those_of_a_fresh_build_for_fewer_rays(resolution, fill):
    angular = Angular(resolution, fill, 16 if resolution != 48 else 12)
    first = placed(angular)
    scene = frame(1)
    carried = carry_over(first, scene, angular, STILL)
    vertices = Vertices.of(scene)
    ids = np.asarray(carried.samples)
    assert len(ids) > 0.9 * len(first.samples)
    exact = dense_maps(scene.tracer, vertices.views(ids), resolution).maps
    fresh = place_samples(scene, angular, STILL)
    assert carried.rays_traced < 0.7 * fresh.rays_traced
    np.testing.assert_array_equal(carried.frames, vertices.frames[ids])
    accuracy = 0.999 if fill == "dense" else 0.985
    assert (carried.maps() == exact).mean() >= accuracy
    own, others = pairs(carried, fresh)
    assert len(own) > 20
    assert (carried.maps()[own] == fresh.maps()[others]).mean() >= 0.995
    # What was known before is not good enough: something moved.
    own, others = pairs(carried, first)
    assert (carried.maps()[own] != first.maps()[others]).mean() > 0.003
    distances = np.asarray(carried.signed_distance)
    np.testing.assert_array_equal(distances > 0.0, carried.maps())


def test_over_many_frames_maps_stay_as_good():
    fields = place_samples(frame(0), ANGULAR, MOVING)
    for number in range(1, 7):
        fields = carry_over(fields, frame(number), ANGULAR, MOVING)
    scene = frame(6)
    ids = np.asarray(fields.samples)
    exact = dense_maps(scene.tracer, Vertices.of(scene).views(ids), 32).maps
    assert (fields.maps() == exact).mean() > 0.98
    assert len(np.unique(ids)) == len(ids)
    total = len(fields.positions)
    assert 0.02 * total < len(ids) <= max(int(0.12 * total), 16)
    np.testing.assert_allclose(np.asarray(fields.weights).sum(axis=1), 1.0, atol=1e-4)


def test_rays_grow_with_what_moved():
    """A ball far above the plane: a small one is seen in few directions, a large one in more."""
    rays = []
    for radius in (0.1, 0.5, 2.0):
        one, two = (ground_with((x, 4.0, 0.0), radius) for x in (0.0, 0.1))
        first = place_samples(one, ANGULAR, STILL)
        carried = carry_over(first, two, ANGULAR, STILL)
        assert len(carried.samples) > 10
        rays.append(carried.rays_traced / len(carried.samples) / 32**2)
    # Its own samples trace all that they see; see the test of stale texels for shares alone.
    assert rays[0] < rays[1] < rays[2]
    assert rays[0] < 0.3


def test_another_mesh_or_resolution_is_placed_anew():
    first, scene = placed(), frame(1)
    other = carry_over(first, builtin_scene("box-on-plane"), ANGULAR, STILL)
    np.testing.assert_array_equal(
        other.samples, place_samples(builtin_scene("box-on-plane"), ANGULAR, STILL).samples
    )
    finer = carry_over(first, scene, ANGULAR._replace(resolution=64), STILL)
    assert finer.resolution == 64
    fewer = replace(
        scene, triangles=scene.triangles[::-1].copy(), material_ids=scene.material_ids[::-1].copy()
    )
    turned = carry_over(first, fewer, ANGULAR, STILL)
    fresh = place_samples(fewer, ANGULAR, STILL)
    assert turned.rays_traced == fresh.rays_traced
    np.testing.assert_array_equal(turned.samples, fresh.samples)


def test_only_what_the_view_shows_is_carried():
    size = (40, 30)
    scene = frame(0)
    surface = trace_surface(scene, scene.camera, size)
    first = place_samples(scene, ANGULAR, MOVING, surface)
    second = frame(1)
    away = trace_surface(second, replace(scene.camera, eye=(0.5, 1.9, -2.6)), size)
    carried = carry_over(first, second, ANGULAR, MOVING, away)
    shown = np.any(np.asarray(carried.weights) != 0.0, axis=1)
    assert shown[np.asarray(carried.samples)].all()
    assert not shown.all()
    # What came into view is sampled: no vertex is farther from a sample than before by much.
    AdaptiveVisibility(32, 16).shade(carried, AdaptiveVisibility(32, 16).light(uniform()), away)


def uniform():
    from tests.methods.known_scenes import uniform_light

    return uniform_light()


def random_motion(seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(6, 200))
    before = rng.normal(size=(count, 3)).astype(np.float32)
    triangles = rng.integers(0, count, (int(rng.integers(1, 300)), 3)).astype(np.int32)
    moved = rng.random(count) < rng.uniform(0.05, 1.0)
    after = before + (moved[:, None] * rng.normal(size=(count, 3)) * 0.3).astype(np.float32)
    return before, after, triangles, moved


@pytest.mark.parametrize("seed", range(30))
def test_balls_hold_all_triangles_that_moved(seed):
    before, after, triangles, moved = random_motion(seed)
    balls = moving_balls(before, after, triangles, moved)
    touched = triangles[moved[triangles].any(axis=1)]
    assert len(balls.radii) <= CLUSTERS
    assert (len(balls.radii) == 0) == (len(touched) == 0)
    if not len(touched):
        return
    # Every triangle is in one ball, with all corners then and now: so are all points between.
    corners = np.concatenate([before[touched], after[touched]], axis=1).astype(np.float64)
    apart = np.linalg.norm(corners[:, None] - balls.centres[None, :, None], axis=-1)
    inside = (apart <= balls.radii[None, :, None] * (1 + 1e-9) + 1e-12).all(axis=2)
    assert inside.any(axis=1).all()
    if len(touched) >= 4 * CLUSTERS:
        # Not one ball round everything.
        everything = np.linalg.norm(corners.reshape(-1, 3), axis=1).max()
        assert np.median(balls.radii) < 0.9 * everything


def test_nothing_that_moved_has_no_balls():
    before, _, triangles, moved = random_motion(0)
    balls = moving_balls(before, before, triangles, np.zeros_like(moved))
    assert balls.centres.shape == (0, 3)
    vertices = Vertices.of(frame(0))
    ids = np.arange(5)
    assert not stale_texels(vertices, ids, balls, np.zeros(5, bool)).any()
    turned = np.array([False, True, False, False, True])
    np.testing.assert_array_equal(
        stale_texels(vertices, ids, balls, turned).all(axis=(1, 2)), turned
    )


@pytest.mark.parametrize(("first", "second"), [(0, 1), (0, 8), (20, 50)])
def test_every_texel_that_changes_is_stale(first, second):
    one, two = frame(first), frame(second)
    vertices = Vertices.of(two)
    still = ~moved_vertices(one, two)
    count = len(vertices.samples.positions)
    assert count == len(one.positions)  # one-sided and no vertex without triangles
    ids = np.random.default_rng(0).choice(np.flatnonzero(still), 150, replace=False)
    balls = moving_balls(
        Vertices.of(one).samples.positions,
        vertices.samples.positions,
        vertices.samples.triangles,
        ~still,
    )
    stale = stale_texels(vertices, ids, balls, np.zeros(len(ids), bool))
    stale = np.repeat(np.repeat(stale, 2, axis=1), 2, axis=2)
    before = dense_maps(one.tracer, Vertices.of(one).views(ids), 64).maps
    after = dense_maps(two.tracer, vertices.views(ids), 64).maps
    changed = before != after
    assert changed.sum() > 100
    # But for rays that graze an edge, whose origins are rounded otherwise.
    assert (changed & ~stale).sum() <= 1e-5 * changed.size
    assert stale.mean() < 0.8
    # Smaller balls would miss some: the check can fail.
    small = Balls(balls.centres, 0.3 * balls.radii)
    missed = ~stale_texels(vertices, ids, small, np.zeros(len(ids), bool), 64)
    assert (changed & missed).sum() > 10


def test_stale_texels_see_the_ball():
    """Known: directions within asin(r / d) of a ball's centre, and no more than a texel beyond."""
    vertices = Vertices.of(builtin_scene("plane", cells=8))
    ids = np.arange(0, 80, 7)
    views = vertices.views(ids)
    balls = Balls(np.array([[0.5, 3.0, -0.4]]), np.array([0.7]))
    from jaxvis.sphere.hemisphere_grid import texel_directions

    for side in (32, 48):
        stale = stale_texels(vertices, ids, balls, np.zeros(len(ids), bool), side)
        world = np.einsum("ijk,skc->sijc", texel_directions(side), views.frames)
        apart = balls.centres[0] - views.origins
        distance = np.linalg.norm(apart, axis=-1)
        cosine = np.einsum("sijc,sc->sij", world, apart / distance[:, None])
        angle = np.arccos(np.clip(cosine, -1.0, 1.0))
        radius = np.arcsin(0.7 / distance)[:, None, None]
        assert stale[angle <= radius].all()
        assert not stale[angle > radius + 1.01 * 0.75 * np.pi / side].any()
        assert 0.0 < stale.mean() < 0.15
        assert stale.any(axis=(1, 2)).all()


def test_a_sample_within_a_ball_sees_it_everywhere():
    vertices = Vertices.of(builtin_scene("plane", cells=8))
    ids = np.arange(10)
    at = vertices.samples.positions[3].astype(np.float64)
    balls = Balls((at + [0.0, 0.1, 0.0])[None], np.array([0.2]))
    stale = stale_texels(vertices, ids, balls, np.zeros(10, bool))
    assert stale[3].all()
    assert not stale.all()
    # Below the horizon nothing is seen.
    below = Balls(np.array([[0.0, -5.0, 0.0]]), np.array([0.5]))
    assert not stale_texels(vertices, ids, below, np.zeros(10, bool)).any()


def growth(keep):
    """Bytes that a frame more holds, and what its distances have; ``keep`` hears each frame."""
    method = AdaptiveVisibility(resolution=16, lights=16, coarsest=8)
    light = method.light(uniform())

    def one(number, previous):
        scene = frame(number)
        surface = trace_surface(scene, scene.camera, (16, 12))
        fields = method.precompute_for(scene, surface, previous, progress=False)
        method.shade(fields, light, surface)
        return fields

    def held():
        gc.collect()
        # Not tables of weak references, whose space grows by leaps when their turn comes.
        others = tracemalloc.Filter(False, weakref.__file__)
        known = tracemalloc.take_snapshot().filter_traces([others])
        return sum(trace.size for trace in known.traces)

    cycle = range(5)  # of the animation, whose frames hold more and less
    for number in cycle:
        frame(number)
    fields = None
    tracemalloc.start()  # before all: what replaces memory that is not traced would count as more
    try:
        # Programs are compiled for numbers of samples that were not before, until these settle.
        for number in list(cycle) * 4:
            fields = one(number, fields)
        after_each = [held()]
        for _ in range(5):
            for number in cycle:
                fields = one(number, fields)
                keep(fields)
            after_each.append(held())
    finally:
        tracemalloc.stop()
    # The median: a cache of JAX may let go of much at once, or a late program be compiled.
    return float(np.median(np.diff(after_each))) / len(cycle), fields.signed_distance.nbytes


def test_frame_after_frame_keeps_no_memory():
    more, distances = growth(lambda fields: None)
    assert more < 0.1 * distances
    # The test of the test: what is kept shows.
    kept = []
    more, distances = growth(lambda fields: kept.append(np.array(fields.signed_distance)))
    assert more > 0.9 * distances


def test_frames_keep_to_the_density_of_the_first():
    """What is needed in passing does not pile up, however large the budget."""
    spatial = MOVING._replace(budget=1.0, initial=0.1, rounds=1, least=0.0)
    fields = place_samples(frame(0), ANGULAR, spatial)
    placed_first = len(fields.samples)
    for number in range(1, 4):
        fields = carry_over(fields, frame(number), ANGULAR, spatial)
        assert len(fields.samples) <= placed_first
        assert fields.density == placed_first / len(fields.positions)
    # Without it there would be more.
    free = carry_over(replace(fields, density=1.0), frame(4), ANGULAR, spatial)
    assert len(free.samples) > placed_first
