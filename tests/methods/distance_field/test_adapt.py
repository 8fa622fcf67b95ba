"""Where samples are inserted and erased: open planes, walls, thresholds, budgets."""

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest

from jaxvis.methods.distance_field import adapt as module
from jaxvis.methods.distance_field.adapt import FEWEST, MOST, Plan, neighbours, plan
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
from jaxvis.methods.distance_field.coefficients import (
    magnitude,
    map_coefficients,
    visibility_error,
)
from jaxvis.methods.distance_field.foretold import Foretold, Seen, foretold
from jaxvis.methods.distance_field.initial import initial_samples
from jaxvis.methods.distance_field.neighbours import Nearest, Places, geometric_error, weights
from jaxvis.scene.builtin import builtin_scene

ANGULAR = Angular(32, "adaptive", 16)
SPATIAL = Spatial(5.0, 0.5, 0.10, 0.05, 4, 0.12, 8, "linear", "distances")


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


def everything(places):
    return np.ones(len(places.positions), bool)


class Planned(NamedTuple):
    plan: Plan
    off: Foretold
    near: Nearest
    places: Places
    sampling: Sampling


def planned(
    name, count=60, largest=0.1, least=0.05, interpolation="linear", measure="coefficients"
):
    vertices, places, sampling = sampled(name, count)
    own = places.take(sampling.ids)
    near = neighbours(own)
    seen = Seen(sampling.maps, sampling.distances, vertices.frames[sampling.ids])
    off = foretold(seen, near, weights(own, own, near, interpolation), measure)
    ids = sampling.ids
    found = plan(places, everything(places), ids, near, off, largest=largest, least=least)
    return Planned(found, off, near, places, sampling)


def coefficients_of(sampling):
    return map_coefficients(sampling.maps, sampling.vertices.frames[sampling.ids])


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


@pytest.mark.parametrize("measure", ["distances", "coefficients"])
def test_an_open_plane_needs_none_more_and_few_of_these(measure):
    found, off, near, places, sampling = planned("plane", measure=measure)
    assert off.error.max() < 1e-4
    assert len(found.insert) == 0
    # All are candidates, none of which is isolated; of a single pair none can go.
    assert not found.erase.any()
    # The check can fail: thresholds below 0 want everything.
    wanted = plan(places, everything(places), sampling.ids, near, off, largest=-1.0, least=-1.0)
    assert len(wanted.insert) > 0


def test_errors_are_those_of_what_neighbours_foretell():
    _, off, near, places, sampling = planned("wall", interpolation="inverse")
    coefficients = coefficients_of(sampling)
    checked = 0
    for sample in range(0, len(sampling.ids), 7):
        around = near.samples[sample][near.samples[sample] >= 0]
        normals = places.normals[sampling.ids]
        usable = normals[around] @ normals[sample] >= 0.5
        usable &= places.parts[sampling.ids][around] == places.parts[sampling.ids[sample]]
        if usable.sum() < 3:
            continue
        share = np.where(usable, 1.0 / (near.error[sample][near.samples[sample] >= 0] + 1e-4), 0.0)
        together = (share / share.sum()) @ coefficients[around]
        own = coefficients[sample : sample + 1]
        expected = (visibility_error(own, together[None].astype(np.float32)) / magnitude(own))[0]
        assert off.error[sample] == pytest.approx(expected, rel=1e-3, abs=1e-5)
        checked += 1
    assert checked >= 3


@pytest.mark.parametrize("measure", ["distances", "coefficients"])
def test_insertions_lie_near_the_wall(measure):
    found, _, _, _, sampling = planned("wall", largest=0.15, measure=measure)
    scene = builtin_scene("wall")
    vertices = Vertices.of(scene)
    assert len(found.insert) >= 3
    positions = vertices.samples.positions + scene.origin
    apart = np.abs(positions[:, 0])

    def on_ground(ids):
        return ids[np.abs(positions[ids, 1]) < 1e-3]

    needed = found.insert[: max(len(found.insert) // 2, 3)]  # the most needed come first
    inserted, before = on_ground(needed), on_ground(sampling.ids)
    assert len(inserted)
    assert np.median(apart[inserted]) < 0.7 * np.median(apart[before])


@pytest.mark.parametrize("measure", ["distances", "coefficients"])
def test_insertions_are_new_places_once_each_the_most_needed_first(measure):
    found, off, near, places, sampling = planned("box-on-plane", measure=measure)
    assert len(found.insert)
    assert len(np.unique(found.insert)) == len(found.insert)
    assert not np.isin(found.insert, sampling.ids).any()
    assert np.all(np.diff(found.need) <= 0.0)
    # By hand: the pairs that want a place, and the places nearest the middle of each.
    joint = places.joint.astype(np.float64)
    free = np.setdiff1d(np.arange(len(joint)), sampling.ids)
    chosen = dict(zip(found.insert.tolist(), found.need, strict=True))
    largest: dict[int, float] = {}
    for a in range(len(sampling.ids)):
        for slot in np.flatnonzero(near.samples[a] >= 0):
            b, value = near.samples[a, slot], min(off.error[a], off.pairs[a, slot])
            if value <= 0.1:
                continue
            i, j = sampling.ids[[a, b]]
            normal = joint[i, 3:] + joint[j, 3:]
            length = max(np.linalg.norm(normal), 1e-4)
            middle = np.concatenate([0.5 * (joint[i, :3] + joint[j, :3]), normal / length])
            apart = np.linalg.norm(joint[free] - middle, axis=1)
            ties = free[apart <= apart.min() + 1e-5]  # which of them is taken does not matter
            away = joint[ties] - middle
            error = np.linalg.norm(away[:, :3], axis=1) + np.linalg.norm(away[:, 3:], axis=1)
            if np.any(error < 0.5 * near.error[a, slot] - 1e-5):
                taken = [int(place) for place in ties if place in chosen]
                assert taken
                assert max(chosen[place] for place in taken) >= value - 1e-5
            for place in ties[error < 0.5 * near.error[a, slot] + 1e-5].tolist():
                largest[place] = max(largest.get(place, 0.0), float(value))
    # None is inserted for which no pair asks, or for more than any pair asks.
    assert set(chosen) <= set(largest)
    assert all(need <= largest[place] + 1e-5 for place, need in chosen.items())


def test_no_insertion_where_none_is_allowed():
    _, off, near, places, sampling = planned("box-on-plane")
    allowed = everything(places)
    free = plan(places, allowed, sampling.ids, near, off, largest=0.1, least=0.0)
    allowed[free.insert[0]] = False
    found = plan(places, allowed, sampling.ids, near, off, largest=0.1, least=0.0)
    assert len(found.insert)
    assert free.insert[0] not in found.insert


def test_thresholds_are_monotone():
    inserted = [len(planned("box-on-plane", largest=e).plan.insert) for e in (0.05, 0.1, 0.3, 10.0)]
    assert np.all(np.diff(inserted) <= 0)
    assert inserted[0] > inserted[2] > inserted[3] == 0
    erased = [planned("box-on-plane", least=e).plan for e in (0.0, 0.02)]
    assert not erased[0].erase.any()
    assert erased[1].erase.any()


@pytest.mark.parametrize("least", [0.02, 0.05, 0.1])
def test_only_isolated_and_foretold_samples_are_erased(least):
    found, off, near, _, sampling = planned("box-on-plane", least=least, largest=1.0)
    candidates = off.error < least
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
    assert len(sampling.ids) == len(sampling.maps) == len(sampling.distances)
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
