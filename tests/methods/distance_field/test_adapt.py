"""Where samples are inserted and erased: open planes, walls, thresholds, budgets."""

from functools import cache

import numpy as np
import pytest

from jaxvis.methods.distance_field import adapt as module
from jaxvis.methods.distance_field.adapt import FEWEST, MOST, neighbours, plan
from jaxvis.methods.distance_field.build import (
    Angular,
    Sampling,
    Spatial,
    Vertices,
    adapt,
    buried,
    place_samples,
    sample_budget,
)
from jaxvis.methods.distance_field.coefficients import magnitude, visibility_error
from jaxvis.methods.distance_field.initial import initial_samples
from jaxvis.methods.distance_field.neighbours import geometric_error
from jaxvis.scene.builtin import builtin_scene

ANGULAR = Angular(32, "adaptive", 16)
SPATIAL = Spatial(5.0, 0.5, 0.10, 0.05, 4, 0.12, 8, "linear")


@cache
def sampled(name, count, **parameters):
    """(vertices, places, sampling) with k-means samples."""
    vertices = Vertices.of(builtin_scene(name, **dict(parameters)))
    places = vertices.places(5.0)
    ids = initial_samples(places, count)
    ids = ids[~buried(vertices, ids)]
    sampling = Sampling.none(vertices, ANGULAR)
    sampling.add(ids, places)
    return vertices, places, sampling


def planned(name, count=60, largest=0.1, least=0.05, interpolation="linear"):
    _, places, sampling = sampled(name, count)
    near = neighbours(places.take(sampling.ids))
    found = plan(
        places,
        sampling.ids,
        sampling.coefficients,
        near,
        largest=largest,
        least=least,
        interpolation=interpolation,
    )
    return found, near, places, sampling


def test_neighbours_are_others_within_reach():
    _, places, sampling = sampled("box-on-plane", 60)
    own = places.take(sampling.ids)
    near = neighbours(own)
    count = len(sampling.ids)
    assert near.samples.shape == (count, MOST)
    there = near.samples >= 0
    assert there.sum(axis=1).min() >= FEWEST
    assert not np.any(near.samples == np.arange(count)[:, None])
    nearest = near.error[:, 0]
    reach = module.REACH * np.median(nearest)
    assert np.all(near.error[there & (np.arange(MOST) >= FEWEST)] <= reach * 1.0001)
    assert np.all(np.isinf(near.error[~there]))
    for sample in range(count):
        others = own.take(near.samples[sample, there[sample]])
        expected = geometric_error(own.take(np.full(len(others.positions), sample)), others)
        np.testing.assert_allclose(near.error[sample, there[sample]], expected, atol=1e-5)


def test_twins_are_neighbours_and_a_sample_is_not_its_own():
    _, places, sampling = sampled("box-on-plane", 60)
    ids = np.concatenate([sampling.ids, sampling.ids])
    near = neighbours(places.take(ids))
    count = len(sampling.ids)
    assert not np.any(near.samples == np.arange(2 * count)[:, None])
    np.testing.assert_array_equal(near.samples[:count, 0], np.arange(count) + count)
    assert near.error[:, 0].max() < 1e-6


@pytest.mark.parametrize("count", [1, 2, 4])
def test_few_samples_have_few_neighbours(count):
    _, places, sampling = sampled("box-on-plane", 60)
    near = neighbours(places.take(sampling.ids[:count]))
    assert near.samples.shape == (count, MOST)
    assert np.all((near.samples >= 0).sum(axis=1) == min(count - 1, MOST))


def test_an_open_plane_needs_none_more_and_few_of_these():
    found, near, places, sampling = planned("plane")
    assert found.error.max() < 1e-4
    assert len(found.insert) == 0
    # All are candidates, none of which is isolated; of a single pair none can go.
    assert not found.erase.any()
    # The check can fail: thresholds below 0 want everything.
    wanted = plan(
        places,
        sampling.ids,
        sampling.coefficients,
        near,
        largest=-1.0,
        least=-1.0,
        interpolation="linear",
    )
    assert len(wanted.insert) > 0


def test_errors_are_those_of_what_neighbours_foretell():
    found, near, places, sampling = planned("wall", interpolation="inverse")
    coefficients = sampling.coefficients
    for sample in range(0, len(sampling.ids), 7):
        around = near.samples[sample][near.samples[sample] >= 0]
        normals = places.normals[sampling.ids]
        facing = normals[around] @ normals[sample] >= 0.5
        if facing.sum() < 3:
            facing[:] = True
        share = np.where(facing, 1.0 / (near.error[sample][: len(around)] + 1e-4), 0.0)
        foretold = (share / share.sum()) @ coefficients[around]
        own = coefficients[sample : sample + 1]
        expected = (visibility_error(own, foretold[None].astype(np.float32)) / magnitude(own))[0]
        assert found.error[sample] == pytest.approx(expected, rel=1e-3, abs=1e-5)


def test_insertions_lie_near_the_wall():
    found, _, _, sampling = planned("wall", largest=0.15)
    scene = builtin_scene("wall")
    vertices = Vertices.of(scene)
    assert len(found.insert) >= 3
    positions = vertices.samples.positions + scene.origin
    apart = np.abs(positions[:, 0])

    def on_ground(ids):
        return ids[np.abs(positions[ids, 1]) < 1e-3]

    inserted, before = on_ground(found.insert), on_ground(sampling.ids)
    assert len(inserted)
    assert np.median(apart[inserted]) < 0.7 * np.median(apart[before])


def test_insertions_are_new_places_once_each_the_most_needed_first():
    found, near, places, sampling = planned("box-on-plane")
    assert len(found.insert)
    assert len(np.unique(found.insert)) == len(found.insert)
    assert not np.isin(found.insert, sampling.ids).any()
    # By hand: between which pairs they lie, and how much those differ.
    own = sampling.coefficients
    pairs = visibility_error(own[:, None], own) / magnitude(own)[:, None]
    need = {}
    joint = places.joint.astype(np.float64)
    for a in range(len(sampling.ids)):
        for b in near.samples[a][near.samples[a] >= 0]:
            pair = pairs[a, b]
            if found.error[a] > 0.1 and pair > 0.1:
                i, j = sampling.ids[[a, b]]
                normal = joint[i, 3:] + joint[j, 3:]
                length = max(np.linalg.norm(normal), 1e-4)
                middle = np.concatenate([0.5 * (joint[i, :3] + joint[j, :3]), normal / length])
                place = int(np.argmin(np.linalg.norm(joint - middle, axis=1)))
                need[place] = max(need.get(place, 0.0), min(float(found.error[a]), float(pair)))
    need = {place: value for place, value in need.items() if place not in set(sampling.ids)}
    overlap = len(set(need) & set(found.insert.tolist()))
    # Ties between places equally near the middle may go either way.
    assert overlap >= 0.8 * max(len(need), len(found.insert))
    order = [need[place] for place in found.insert.tolist() if place in need]
    assert np.mean(np.diff(order) <= 1e-6) > 0.8


def test_thresholds_are_monotone():
    inserted = [len(planned("box-on-plane", largest=e)[0].insert) for e in (0.05, 0.1, 0.3, 10.0)]
    assert np.all(np.diff(inserted) <= 0)
    assert inserted[0] > inserted[2] > inserted[3] == 0
    erased = [planned("box-on-plane", least=e)[0] for e in (0.0, 0.02)]
    assert not erased[0].erase.any()
    assert erased[1].erase.any()


@pytest.mark.parametrize("least", [0.02, 0.05, 0.1])
def test_only_isolated_and_foretold_samples_are_erased(least):
    found, near, _, sampling = planned("box-on-plane", least=least, largest=1.0)
    candidates = found.error < least
    assert np.all(candidates[found.erase])
    for sample in range(len(sampling.ids)):
        around = near.samples[sample][near.samples[sample] >= 0]
        assert found.erase[sample] == (candidates[sample] and not candidates[around].any())
    assert found.erase.sum() < candidates.sum()


@pytest.mark.parametrize("budget", [16, 30, 60])
def test_the_budget_is_kept(budget):
    vertices = Vertices.of(builtin_scene("box-on-plane"))
    places = vertices.places(5.0)
    candidates = np.arange(len(places.positions))
    sampling = Sampling.none(vertices, ANGULAR)
    sampling.add(initial_samples(places, 16), places)
    start = len(sampling.ids)
    adapt(sampling, places, candidates, SPATIAL._replace(largest=0.02, least=0.0), budget)
    assert start <= len(sampling.ids) <= max(budget, start)
    assert len(sampling.ids) == len(sampling.maps) == len(sampling.coefficients)
    assert len(np.unique(sampling.ids)) == len(sampling.ids)
    if budget > 16:
        assert len(sampling.ids) > start


def test_only_candidates_that_are_not_buried_become_samples():
    scene = builtin_scene("box-on-plane")
    vertices = Vertices.of(scene)
    places = vertices.places(5.0)
    candidates = np.flatnonzero(places.positions[:, 0] > 0.0)
    sampling = Sampling.none(vertices, ANGULAR)
    first = candidates[initial_samples(places.take(candidates), 20)]
    sampling.add(first[~buried(vertices, first)], places)
    adapt(sampling, places, candidates, SPATIAL._replace(largest=0.02, least=0.0), 200)
    assert len(sampling.ids) > 25
    assert np.isin(sampling.ids, candidates).all()
    assert not buried(vertices, sampling.ids).any()
    assert buried(vertices, candidates).any()


def test_no_rounds_leave_the_first_samples():
    scene = builtin_scene("box-on-plane")
    spatial = SPATIAL._replace(rounds=0)
    fields = place_samples(scene, ANGULAR, spatial)
    vertices = Vertices.of(scene)
    budget = sample_budget(spatial, len(vertices.samples.positions))
    first = initial_samples(vertices.places(5.0), round(0.5 * budget))
    np.testing.assert_array_equal(fields.samples, first[~buried(vertices, first)])
    more = place_samples(scene, ANGULAR, SPATIAL)
    assert len(fields.samples) < len(more.samples) <= budget


def test_the_budget_is_a_share_of_the_vertices_and_a_handful_at_least():
    assert sample_budget(SPATIAL, 10_000) == 1200
    assert sample_budget(SPATIAL, 10) == 16
