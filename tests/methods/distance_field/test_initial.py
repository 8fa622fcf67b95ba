"""The first samples: k-means against brute force, and that every place has one near."""

import numpy as np
import pytest

from jaxvis.methods.distance_field import initial
from jaxvis.methods.distance_field.build import Vertices
from jaxvis.methods.distance_field.initial import initial_samples
from jaxvis.methods.distance_field.neighbours import Places, geometric_error
from jaxvis.scene.builtin import builtin_scene


def places_of(name="box-on-plane", alpha=5.0, **parameters):
    return Vertices.of(builtin_scene(name, **parameters)).places(alpha)


def between(places, others):
    """e_g of every place to every other one."""
    return geometric_error(
        Places(*(f[:, None] for f in places)), Places(*(f[None] for f in others))
    )


def worst(places, chosen):
    return between(places, places.take(chosen)).min(axis=1)


def test_places_go_to_the_nearest_centre():
    places = places_of()
    centres = places.take(np.random.default_rng(0).choice(len(places.positions), 17))
    nearest, error = initial._assign(places, centres)
    exact = between(places, centres)
    np.testing.assert_allclose(error, exact.min(axis=1), rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(
        np.take_along_axis(exact, nearest[:, None], axis=1)[:, 0], exact.min(axis=1), atol=1e-6
    )
    _, first = initial._assign(places, centres, reverse=True)
    assert len(first) == len(np.unique(nearest))
    for owner in first:
        cluster = nearest == nearest[owner]
        assert error[owner] == error[cluster].min()


def test_centres_are_mean_positions_with_mean_normals():
    places = places_of()
    nearest = np.random.default_rng(0).integers(0, 5, len(places.positions)).astype(np.int32)
    means = initial._means(places, nearest, np.zeros(len(nearest), np.float32), 5)
    for cluster in range(5):
        own = nearest == cluster
        np.testing.assert_allclose(
            means.positions[cluster], places.positions[own].mean(0), atol=1e-5
        )
        normal = places.normals[own].mean(axis=0)
        np.testing.assert_allclose(
            means.normals[cluster], normal / np.linalg.norm(normal), atol=1e-5
        )


def test_an_empty_cluster_begins_again_at_the_worst_place():
    places = places_of()
    nearest = np.zeros(len(places.positions), np.int32)
    error = np.random.default_rng(0).random(len(nearest)).astype(np.float32)
    means = initial._means(places, nearest, error, 3)
    order = np.argsort(-error)
    np.testing.assert_array_equal(means.positions[1:], places.positions[order[:2]])
    np.testing.assert_array_equal(means.normals[1:], places.normals[order[:2]])


@pytest.mark.parametrize("count", [1, 2, 40])
def test_samples_are_places_and_the_same_every_time(count):
    places = places_of()
    chosen = initial_samples(places, count)
    assert 1 <= len(chosen) <= count
    assert np.all(np.diff(chosen) > 0)
    assert chosen.min() >= 0
    assert chosen.max() < len(places.positions)
    np.testing.assert_array_equal(chosen, initial_samples(places, count))
    if count == 40:
        assert len(chosen) > 35
        assert not np.array_equal(chosen, initial_samples(places, count, seed=1))


def test_as_many_as_there_are_places_are_all_of_them():
    places = places_of(cells=4).take(np.arange(30))
    for count in (30, 31, 1000):
        np.testing.assert_array_equal(initial_samples(places, count), np.arange(30))
    with pytest.raises(ValueError, match=r"^count must be at least 1, got 0$"):
        initial_samples(places, 0)


@pytest.mark.parametrize("name", ["box-on-plane", "sphere-on-plane"])
def test_samples_cover_better_than_random_ones(name):
    places = places_of(name)
    chosen = initial_samples(places, 60)
    found = worst(places, chosen)
    rng = np.random.default_rng(0)
    random = [
        worst(places, rng.choice(len(places.positions), len(chosen), replace=False))
        for _ in range(20)
    ]
    assert found.mean() < min(error.mean() for error in random)
    assert found.max() < min(error.max() for error in random)
    # Every side of the box has its own.
    if name == "box-on-plane":
        facing = np.unique(np.rint(places.normals[chosen]), axis=0)
        assert len(facing) == len(np.unique(np.rint(places.normals), axis=0)) >= 5


def test_alpha_weighs_distance_against_normals():
    """A larger one spreads samples over the plane, a smaller one over the ball's normals."""
    share = []
    for alpha in (0.5, 50.0):
        places = places_of("sphere-on-plane", alpha)
        chosen = initial_samples(places, 60)
        share.append((places.normals[chosen, 1] > 0.9999).mean())
    assert share[0] < 0.5 * share[1]


def test_places_that_coincide_do_not_fail():
    places = Places.of(np.zeros((20, 3)), np.tile([0.0, 0.0, 1.0], (20, 1)), 1.0)
    chosen = initial_samples(places, 5)
    assert 1 <= len(chosen) <= 5
