"""Decide, trace, add up: every ray that is left is traced once, whatever the chunks and threads."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.methods.traced import block_points, shading_points
from jaxvis.methods.visibility_field import stages
from jaxvis.methods.visibility_field.cull import ACCEPT, DROP, TRACE
from jaxvis.methods.visibility_field.hemisphere import (
    local_directions,
    turned_frames,
    world_directions,
)
from jaxvis.methods.visibility_field.left import Listed, Turned, settle
from jaxvis.methods.visibility_field.stages import Rays, traced_blocks
from jaxvis.scene import RayTracer
from tests.methods.known_scenes import MATERIALS, SCENES
from tests.methods.visibility_field.made_fields import by_component

SAMPLES = 16
BOX = SCENES[2]


@pytest.fixture(autouse=True)
def _several_small_blocks(monkeypatch):
    monkeypatch.setattr(stages, "RAYS_PER_BLOCK", 64 * SAMPLES)
    monkeypatch.setattr(stages, "RAYS_PER_JOB", 24 * SAMPLES)


def points_of(known=BOX):
    return shading_points(known.surface(*MATERIALS["diffuse"]))


def random_decisions(pixel, samples=SAMPLES):
    """What a field might decide: known from the pixel's number alone."""
    numbers = np.random.default_rng(0).integers(0, 3, (1 << 9, samples)).astype(np.uint8)
    return jnp.asarray(numbers)[pixel]


def draw(points, *, listed, samples=SAMPLES):
    """Rays of a block, about the normal."""
    local = local_directions(samples)
    frames = turned_frames(points.normal, points.pixel / 252.0)
    directions = Turned(frames, local)
    if listed:
        directions = Listed(world_directions(frames, local))
    return Rays(directions, random_decisions(points.pixel, samples))


def settled(tracer, points, *, listed=True, samples=SAMPLES, **options):
    """(decisions of all points, blocks) after tracing."""
    drawing = partial(draw, listed=listed, samples=samples)
    pairs = list(traced_blocks(tracer, points, drawing, samples, **options))
    return np.concatenate([decision[: block.inside] for block, decision in pairs]), pairs


def expected_decisions(tracer, points, samples=SAMPLES):
    """Each ray by itself."""
    rays = draw(points, listed=True, samples=samples)
    directions = np.stack(rays.directions.directions, axis=-1)
    origins = np.repeat(np.asarray(points.origin), samples, axis=0)
    blocked = tracer.occluded(origins, directions.reshape(-1, 3)).reshape(-1, samples)
    decision = np.asarray(rays.decision)
    return np.where(decision == TRACE, np.where(blocked, DROP, ACCEPT), decision)


@pytest.mark.parametrize("samples", [1, 3, 16, 100, 1 << 12])
def test_blocks_hold_a_power_of_two_points(samples):
    count = block_points(20_000, samples, stages.RAYS_PER_BLOCK)
    assert count & (count - 1) == 0
    assert (
        count == 1
        or count * samples <= stages.RAYS_PER_BLOCK < 2 * count * samples
        or count == 1 << 14
    )


@pytest.mark.parametrize("listed", [True, False])
def test_what_is_left_is_traced_and_the_rest_stays(listed):
    tracer, points = BOX.load().tracer, points_of()
    expected = expected_decisions(tracer, points)
    assert min((expected == ACCEPT).mean(), (expected == DROP).mean()) > 0.2
    left = np.count_nonzero(random_decisions(points.pixel) == TRACE)
    before = tracer.rays_traced
    found, pairs = settled(tracer, points, listed=listed)
    assert tracer.rays_traced - before == left  # none twice, none of the padding
    np.testing.assert_array_equal(found, expected)
    assert len(pairs) == -(-len(points.pixel) // 64)
    assert [block.first for block, _ in pairs] == list(range(0, len(points.pixel), 64))
    assert sum(block.inside for block, _ in pairs) == len(points.pixel)
    assert all(decision.shape == (64, SAMPLES) for _, decision in pairs)
    for block, _ in pairs:
        inside = np.asarray(block.points.pixel)[: block.inside]
        first = block.first
        np.testing.assert_array_equal(inside, points.pixel[first : first + block.inside])


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("chunk", [1, 128 * SAMPLES, 1 << 21])
def test_chunks_and_threads_change_nothing(threads, chunk):
    scene, points = BOX.load(), points_of()
    tracer = RayTracer(scene.positions, scene.triangles, threads=threads)
    done = []
    found, _ = settled(tracer, points, rays_per_chunk=chunk, advance=done.append)
    np.testing.assert_array_equal(found, expected_decisions(tracer, points))
    assert sum(done) == len(points.pixel)
    assert len(done) == {1: 4, 128 * SAMPLES: 2, 1 << 21: 1}[chunk]


def test_more_rays_a_point_than_a_block_holds():
    tracer, points = BOX.load().tracer, points_of()
    few = jax.tree.map(lambda leaf: leaf[:3], points)
    samples = 2 * stages.RAYS_PER_BLOCK
    found, pairs = settled(tracer, few, samples=samples)
    assert len(pairs) == 3
    np.testing.assert_array_equal(found, expected_decisions(tracer, few, samples))


def test_no_points_no_blocks():
    none = jax.tree.map(lambda leaf: leaf[:0], points_of())
    assert list(traced_blocks(BOX.load().tracer, none, partial(draw, listed=True), SAMPLES)) == []


class Recorder(RayTracer):
    """A tracer that keeps the rays it is given."""

    def occluded_block(self, origins, directions):
        self.origins, self.directions = origins, directions
        return super().occluded_block(origins, directions)


def recorder():
    scene = BOX.load()
    return Recorder(scene.positions, scene.triangles)


@pytest.mark.parametrize("kind", ["turned", "listed"])
def test_rays_are_listed_point_after_point(kind):
    """A part of a block's points, from the seventh on."""
    tracer, first, count, samples = recorder(), 7, 5, 6
    rng = np.random.default_rng(0)
    normal = rng.normal(size=(16, 3))
    normal = jnp.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True), jnp.float32)
    frames = turned_frames(normal, jnp.asarray(rng.random(16), jnp.float32))
    local = local_directions(samples)
    axes = world_directions(frames, local)
    directions = Turned(frames, local) if kind == "turned" else Listed(axes)
    origins = (rng.random((count, 3)) + [0.0, 3.0, 0.0]).astype(np.float32)
    decision = rng.integers(0, 3, (count, samples)).astype(np.uint8)
    before = decision.copy()
    settle(tracer, origins, directions, first, decision)
    point, sample = np.nonzero(before == TRACE)
    np.testing.assert_array_equal(tracer.origins, origins[point])
    expected = np.stack(axes, axis=-1)[first + point, sample]
    if kind == "listed":
        np.testing.assert_array_equal(tracer.directions, expected)
    np.testing.assert_allclose(tracer.directions, expected, atol=3e-7)
    blocked = tracer.occluded(origins[point], expected)
    np.testing.assert_array_equal(decision[point, sample], np.where(blocked, DROP, ACCEPT))
    np.testing.assert_array_equal(decision[before != TRACE], before[before != TRACE])


def test_nothing_left_traces_nothing():
    tracer = recorder()
    decision = np.array([[ACCEPT, DROP], [DROP, ACCEPT]], np.uint8)
    axes = by_component(np.zeros((2, 2, 3), np.float32))
    settle(tracer, np.zeros((2, 3), np.float32), Listed(axes), 0, decision)
    np.testing.assert_array_equal(decision, [[ACCEPT, DROP], [DROP, ACCEPT]])
    assert tracer.rays_traced == 0
