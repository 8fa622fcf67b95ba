"""Visibility maps: refinement against tracing every texel, hints, known texels, what rays cost."""

import numpy as np
import pytest

from jaxvis.methods.distance_field import maps as module
from jaxvis.methods.distance_field.build import HINTS, Vertices
from jaxvis.methods.distance_field.maps import (
    Known,
    Views,
    adaptive_maps,
    check_resolution,
    dense_maps,
)
from jaxvis.methods.distance_field.neighbours import nearest_samples
from jaxvis.scene import RayTracer, build_scene
from jaxvis.scene.builtin import builtin_scene
from jaxvis.sphere.hemisphere_grid import texel_directions

UPRIGHT = np.eye(3, dtype=np.float32)


def some_views(name, count, seed=0, **parameters):
    """(scene, views of some of its vertices, hints from the nearest of them)."""
    scene = builtin_scene(name, **parameters)
    vertices = Vertices.of(scene)
    total = len(vertices.samples.positions)
    ids = np.random.default_rng(seed).choice(total, min(count, total), replace=False)
    places = vertices.places(5.0).take(ids)
    return scene, vertices.views(ids), nearest_samples(places, places, HINTS + 1).samples[:, 1:]


def groups_of_views(name, groups=4, each=16, **parameters):
    """As :func:`some_views`, vertices that are near one another as samples are."""
    scene = builtin_scene(name, **parameters)
    vertices = Vertices.of(scene)
    places = vertices.places(5.0)
    middles = np.random.default_rng(0).choice(len(places.positions), groups, replace=False)
    near = nearest_samples(places, places.take(middles), each).samples
    ids = np.unique(near)
    own = places.take(ids)
    return scene, vertices.views(ids), nearest_samples(own, own, HINTS + 1).samples[:, 1:]


def one_by_one(tracer, views, resolution):
    """Each texel's centre, a sample at a time."""
    local = texel_directions(resolution).reshape(-1, 3)
    found = []
    for origin, frame in zip(*views, strict=True):
        rays = (local @ frame).astype(np.float32)
        found.append(~tracer.occluded(np.tile(origin, (len(rays), 1)), rays))
    return np.array(found).reshape(-1, resolution, resolution)


def patch_above(direction, distance=1.0, half=0.03):
    """A small square, at right angles to z, seen in a direction from 0."""
    x, y, z = distance * np.asarray(direction, np.float64) / direction[2]
    corners = [(x + a, y + b, z) for a, b in ((-half, -half), (half, -half), (half, half))]
    corners.append((x - half, y + half, z))
    return np.array(corners)


@pytest.mark.parametrize("name", ["box-on-plane", "sphere-on-plane"])
def test_dense_maps_are_rays_through_the_texel_centres(name):
    scene, views, _ = some_views(name, 40)
    traced = dense_maps(scene.tracer, views, 20)
    expected = one_by_one(scene.tracer, views, 20)
    assert 0.05 < (~expected).mean() < 0.95
    # In single precision, rays that graze an edge may differ.
    assert (traced.maps == expected).mean() > 0.9999
    assert traced.rays == 40 * 20**2
    turned = Views(views.origins, views.frames[:, [1, 0, 2]])
    assert (dense_maps(scene.tracer, turned, 20).maps == expected).mean() < 0.99


@pytest.mark.parametrize(("name", "detail"), [("balls", 24), ("hat", 64), ("walker", 16)])
def test_refined_maps_equal_dense_ones_at_a_fifth_of_the_rays(name, detail):
    scene, views, hints = groups_of_views(name, detail=detail)
    dense = dense_maps(scene.tracer, views, 128)
    found = adaptive_maps(scene.tracer, views, 128, 16, neighbours=hints)
    assert found.rays <= 0.2 * dense.rays
    assert (found.maps == dense.maps).mean() >= 0.99
    # The coarse maps alone, which any refinement has, are not as good.
    coarse = dense_maps(scene.tracer, views, 16).maps
    blocks = np.repeat(np.repeat(coarse, 8, axis=1), 8, axis=2)
    assert (found.maps != dense.maps).mean() < 0.4 * (blocks != dense.maps).mean()


def test_rays_are_counted_as_they_are_traced():
    scene, views, hints = some_views("sphere-on-plane", 50)
    before = scene.tracer.rays_traced
    found = adaptive_maps(scene.tracer, views, 64, 16, neighbours=hints)
    assert found.rays == scene.tracer.rays_traced - before
    assert found.rays >= 50 * 16**2


def test_what_one_sample_misses_its_neighbours_tell_it():
    # Over the first sample the patch is between four texels of the coarse map; the second one sees
    # it in a texel's centre.
    zenith = patch_above((0.0, 0.0, 1.0))
    direction = texel_directions(16)[8, 8]
    beside = -direction / direction[2] + [0.0, 0.0, 1.0]
    far = np.array([[50.0, 50.0, -50.0], [51.0, 50.0, -50.0], [50.0, 51.0, -50.0]])
    scene = build_scene(np.concatenate([zenith, far]), [[0, 1, 2], [0, 2, 3], [4, 5, 6]])
    origins = (np.array([[0.0, 0.0, 0.0], beside]) - scene.origin).astype(np.float32)
    views = Views(origins, np.array([UPRIGHT, UPRIGHT]))
    dense = dense_maps(scene.tracer, views, 64)
    assert np.all((~dense.maps).sum(axis=(1, 2)) >= 4)
    alone = adaptive_maps(scene.tracer, views, 64, 16)
    assert alone.maps[0].all()
    np.testing.assert_array_equal(alone.maps[1], dense.maps[1])
    told = adaptive_maps(scene.tracer, views, 64, 16, neighbours=np.array([[1], [-1]], np.int32))
    assert not told.maps[0].all()
    assert (told.maps == dense.maps).mean() > 0.999
    # None is no neighbour, and a neighbour that sees nothing has nothing to tell.
    for useless in ([[-1], [0]], [[0], [1]]):
        again = adaptive_maps(scene.tracer, views, 64, 16, neighbours=np.array(useless, np.int32))
        assert again.maps[0].all()


@pytest.mark.parametrize(("side", "reach"), [(8, 4), (16, 4), (32, 2)])
def test_own_boundaries_make_hints_unnecessary_only_nearby(side, reach):
    """At the finest level nearer ones: a wider reach let light leak under the ball of ``balls``."""
    own = np.zeros((side, side), bool)
    own[0, 0] = True
    assert module._any_beside(own, reach, reach)
    assert not module._any_beside(own, reach + 1, 0)
    assert not module._any_beside(own, 0, reach + 1)


def test_hints_are_directions_of_the_world():
    """The sample that is told looks another way round: the same patch is elsewhere in its map."""
    direction = np.array([0.3, 0.2, 1.0])
    direction /= np.linalg.norm(direction)
    scene = build_scene(patch_above(direction), [[0, 1, 2], [0, 2, 3]])
    origin = (-scene.origin).astype(np.float32)
    angle = 2.0
    c, s = np.cos(angle), np.sin(angle)
    # The pole of the second frame is turned, and the whole frame tilted.
    tilt = np.array([[1, 0, 0], [0, np.cos(0.4), np.sin(0.4)], [0, -np.sin(0.4), np.cos(0.4)]])
    turned = (np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ tilt).astype(np.float32)
    frames = np.array([UPRIGHT, turned])
    own = np.zeros((2, 16, 16), np.bool_)
    theta, phi = np.arccos(direction[0]), np.arctan2(direction[2], direction[1])
    own[0, int(theta / np.pi * 16), int(phi / np.pi * 16)] = True
    marked = np.zeros((1, 16, 16), np.bool_)
    neighbours = np.array([[0]], np.int32)
    module._mark_hints(own, frames, texel_directions(16), np.array([1]), neighbours, marked)
    assert marked.sum() == 1
    i, j = np.argwhere(marked[0])[0]
    towards = texel_directions(16)[i, j] @ turned
    assert np.arccos(towards @ direction) < 2.0 * np.pi / 16
    views = Views(np.array([origin, origin]), frames)
    assert (~dense_maps(scene.tracer, views, 64).maps).sum(axis=(1, 2)).min() > 0


@pytest.mark.parametrize("name", ["open", "blocked"])
def test_maps_without_boundaries_cost_the_coarse_rays_alone(name):
    scene = builtin_scene("plane" if name == "open" else "furnace")
    ids = np.arange(20)
    vertices = Vertices.of(scene)
    found = adaptive_maps(scene.tracer, vertices.views(ids), 128, 16)
    assert np.all(found.maps == (name == "open"))
    assert found.rays == 20 * 16**2


def test_where_nothing_is_stale_nothing_is_traced():
    scene, views, hints = some_views("box-on-plane", 30)
    maps = np.random.default_rng(0).random((30, 64, 64)) < 0.5  # whatever they are
    clean = Known(maps, np.zeros(maps.shape, bool))
    found = adaptive_maps(scene.tracer, views, 64, 16, neighbours=hints, known=clean)
    assert found.rays == 0
    np.testing.assert_array_equal(found.maps, maps)


def test_stale_texels_are_traced_and_the_others_kept():
    scene, views, _ = some_views("box-on-plane", 30)
    dense = dense_maps(scene.tracer, views, 64)
    stale = np.zeros(dense.maps.shape, bool)
    stale[:, 16:40, 8:32] = True
    stale[3] = True
    # What is kept is what was given, even where it is wrong; what is stale does not matter.
    given = dense.maps.copy()
    given[stale] = ~given[stale]
    given[0, :8] = False
    found = adaptive_maps(scene.tracer, views, 64, 16, known=Known(given, stale))
    np.testing.assert_array_equal(found.maps[~stale], given[~stale])
    assert (found.maps[stale] == dense.maps[stale]).mean() > 0.99
    every = adaptive_maps(scene.tracer, views, 64, 64, known=Known(given, stale))
    np.testing.assert_array_equal(every.maps, np.where(stale, dense.maps, given))
    assert every.rays == stale.sum()
    assert found.rays < 0.5 * every.rays


def test_all_stale_is_as_if_nothing_were_known():
    scene, views, hints = some_views("sphere-on-plane", 30)
    known = Known(np.zeros((30, 64, 64), bool), np.ones((30, 64, 64), bool))
    again = adaptive_maps(scene.tracer, views, 64, 16, neighbours=hints, known=known)
    fresh = adaptive_maps(scene.tracer, views, 64, 16, neighbours=hints)
    np.testing.assert_array_equal(again.maps, fresh.maps)
    assert again.rays == fresh.rays


@pytest.mark.parametrize("per_job", [1, 7, 1000])
def test_maps_depend_neither_on_threads_nor_on_jobs(per_job, monkeypatch):
    scene, views, hints = some_views("sphere-on-plane", 40)
    expected = adaptive_maps(scene.tracer, views, 64, 16, neighbours=hints)
    monkeypatch.setattr(module, "SAMPLES_PER_JOB", per_job)
    for threads in (1, 3):
        tracer = RayTracer(scene.positions, scene.triangles, threads=threads)
        found = adaptive_maps(tracer, views, 64, 16, neighbours=hints)
        np.testing.assert_array_equal(found.maps, expected.maps)
        assert found.rays == expected.rays == tracer.rays_traced


def test_no_samples_have_no_maps():
    scene, views, _ = some_views("plane", 1)
    found = adaptive_maps(scene.tracer, views.take(slice(0, 0)), 32)
    assert found.maps.shape == (0, 32, 32)
    assert found.rays == 0


@pytest.mark.parametrize(
    ("resolution", "coarsest"), [(64, 24), (8, 16), (96, 16), (0, 16), (64, 1), (64, 0), (-16, 16)]
)
def test_resolutions_that_do_not_double_are_refused(resolution, coarsest):
    with pytest.raises(ValueError, match="coarsest times a power of two") as error:
        check_resolution(resolution, coarsest)
    assert str(resolution) in str(error.value)
    assert "\n" not in str(error.value)
    scene, views, _ = some_views("plane", 1)
    with pytest.raises(ValueError, match="power of two"):
        adaptive_maps(scene.tracer, views, resolution, coarsest)
    for fits in ((16, 16), (32, 2), (48, 12), (96, 3)):
        check_resolution(*fits)
