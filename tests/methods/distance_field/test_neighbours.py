"""Which samples are near, and how much they count: brute force, eq. 8 by hand, linear functions."""

import numpy as np
import pytest

from jaxvis.methods.distance_field.neighbours import (
    LARGEST_SUM,
    NEARER,
    Nearest,
    Places,
    check_interpolation,
    geometric_error,
    isolated,
    nearest_samples,
    weights,
)

UP = (0.0, 0.0, 1.0)


def random_places(count, seed=0, bend=0.6):
    """Points of a unit square with normals about +z."""
    rng = np.random.default_rng(seed)
    positions = np.concatenate([rng.random((count, 2)), np.zeros((count, 1))], axis=1)
    normals = rng.normal(size=(count, 3)) * bend + UP
    return Places.of(positions, normals / np.linalg.norm(normals, axis=1, keepdims=True), 1.0)


def flat(points, normal=UP):
    """Places of one normal."""
    points = np.asarray(points, np.float64).reshape(-1, 3)
    return Places.of(points, np.tile(normal, (len(points), 1)), 1.0)


def brute(samples, places):
    """e_g between all places and samples, in plain loops."""
    found = np.empty((len(places.positions), len(samples.positions)))
    for i in range(len(found)):
        for j in range(found.shape[1]):
            apart = places.positions[i].astype(np.float64) - samples.positions[j]
            turned = places.normals[i].astype(np.float64) - samples.normals[j]
            found[i, j] = np.sqrt(apart @ apart) + np.sqrt(turned @ turned)
    return found


def test_the_scale_is_that_of_positions_alone():
    a = Places.of(np.array([[1.0, 0.0, 0.0]]), np.array([UP]), 3.0)
    b = Places.of(np.array([[3.0, 0.0, 0.0]]), np.array([[1.0, 0.0, 0.0]]), 3.0)
    np.testing.assert_allclose(geometric_error(a, b), [6.0 + np.sqrt(2.0)], rtol=1e-6)
    # sqrt(2 - 2 n.m) is the difference of unit normals.
    x, y = random_places(50), random_places(50, seed=1)
    cosine = np.sum(x.normals * y.normals, axis=-1)
    expected = np.linalg.norm(x.positions - y.positions, axis=-1) + np.sqrt(2.0 - 2.0 * cosine)
    np.testing.assert_allclose(geometric_error(x, y), expected, atol=1e-3)


@pytest.mark.parametrize("bend", [0.0, 0.05, 0.6])
def test_the_nearest_are_those_of_least_error(bend):
    samples, places = random_places(200, bend=bend), random_places(100, seed=1, bend=bend)
    near = nearest_samples(samples, places, 8)
    exact = brute(samples, places)
    np.testing.assert_allclose(
        near.error, np.take_along_axis(exact, near.samples, axis=1), rtol=1e-4, atol=1e-6
    )
    assert np.all(np.diff(near.error, axis=1) >= 0.0)
    least = np.sort(exact, axis=1)[:, :8]
    # The joint space orders them a little otherwise; twice as many are looked at.
    assert (near.error <= least * 1.001 + 1e-6).mean() > (0.999 if bend == 0.0 else 0.97)
    assert np.all(near.error[:, 0] <= np.sqrt(2.0) * least[:, 0] + 1e-6)
    assert all(len(set(row)) == 8 for row in near.samples)
    # Positions alone are not enough.
    if bend > 0.1:
        apart = np.linalg.norm(places.positions[:, None] - samples.positions, axis=-1)
        assert (np.argmin(apart, axis=1) != near.samples[:, 0]).mean() > 0.3


def test_fewer_samples_than_asked_for():
    samples, places = random_places(3), random_places(10, seed=1)
    near = nearest_samples(samples, places, 8)
    assert near.samples.shape == near.error.shape == (10, 8)
    assert np.all(np.sort(near.samples[:, :3], axis=1) == [0, 1, 2])
    assert np.all(near.samples[:, 3:] == -1)
    assert np.all(np.isinf(near.error[:, 3:]))
    none = nearest_samples(samples.take(np.zeros(0, int)), places, 4)
    assert np.all(none.samples == -1)
    for interpolation in ("linear", "inverse"):
        share = weights(samples, places, near, interpolation)
        np.testing.assert_allclose(share.sum(axis=1), 1.0, atol=1e-5)
        assert np.all(share[:, 3:] == 0.0)
        assert not weights(samples, places, none, interpolation).any()


@pytest.mark.parametrize("interpolation", ["linear", "inverse"])
def test_weights_add_up_to_one_and_a_sample_has_its_own_value(interpolation):
    samples, places = random_places(300, bend=0.2), random_places(200, seed=1, bend=0.2)
    near = nearest_samples(samples, places, 8)
    np.testing.assert_allclose(
        weights(samples, places, near, interpolation).sum(axis=1), 1.0, atol=1e-5
    )
    own = weights(samples, samples, nearest_samples(samples, samples, 8), interpolation)
    np.testing.assert_array_equal(own, np.eye(8)[np.zeros(300, int)])


def test_inverse_is_equation_8():
    samples = flat([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    place = flat([[0.25, 0.0, 0.0]])
    near = nearest_samples(samples, place, 3)
    np.testing.assert_array_equal(near.samples, [[0, 1, 2]])
    inverse = 1.0 / (np.array([0.25, 0.75, np.sqrt(0.25**2 + 4.0)]) + NEARER)
    share = weights(samples, place, near, "inverse")
    np.testing.assert_allclose(share, [inverse / inverse.sum()], rtol=1e-5)


def test_linear_functions_of_the_plane_are_nearly_exact():
    """But for the fit's stiffness, which matters where one sample is much nearer than others."""
    rng = np.random.default_rng(5)
    normal = np.array([0.3, -0.5, 0.7])
    normal /= np.linalg.norm(normal)
    across = np.linalg.svd(normal[None])[2][1:]
    samples = flat(rng.random((400, 2)) @ across, normal)
    places = flat((0.2 + 0.6 * rng.random((200, 2))) @ across, normal)
    near = nearest_samples(samples, places, 8)
    slope = 2.0 * across[0] - 1.0 * across[1]

    def error(interpolation):
        share = weights(samples, places, near, interpolation)
        found = np.sum(share * (samples.positions @ slope)[near.samples], axis=1)
        return np.abs(found - places.positions @ slope)

    # Samples are 0.05 apart: an interpolation that knows no slope is wrong by a good part of that.
    # A few places, at which the exact weights would grow too large, are held back from them.
    assert np.mean(error("linear") > 0.02) <= 0.02
    assert error("linear").max() < 0.04
    assert np.median(error("linear")) < 2e-3
    assert error("inverse").mean() > 5.0 * error("linear").mean()


def test_on_a_curved_surface_linear_is_better():
    """Values that are smooth over a cap, at places between its samples."""
    rng = np.random.default_rng(2)

    def cap(count):
        xy = 0.5 * (2.0 * rng.random((count, 2)) - 1.0)
        normals = np.concatenate([xy, np.sqrt(1.0 - np.square(xy).sum(axis=1, keepdims=True))], 1)
        return Places.of(normals, normals, 1.0)

    samples, places = cap(300), cap(100)
    near = nearest_samples(samples, places, 8)
    error = {}
    for interpolation in ("linear", "inverse"):
        share = weights(samples, places, near, interpolation)
        found = np.einsum("pk,pk->p", share, np.sin(3.0 * samples.positions[near.samples][..., 0]))
        error[interpolation] = np.abs(found - np.sin(3.0 * places.positions[:, 0])).mean()
    assert error["linear"] < 0.5 * error["inverse"]


def test_samples_in_a_line_or_in_one_place_give_finite_weights():
    line = flat([[0.1 * k, 0.0, 0.0] for k in range(6)])
    for samples in (line, flat(np.zeros((5, 3)))):
        for at in ([0.23, 0.0, 0.0], [0.23, 0.4, 0.0]):
            place = flat([at])
            share = weights(samples, place, nearest_samples(samples, place, 5), "linear")
            assert np.all(np.isfinite(share))
            assert np.abs(share).max() < 3.0
            assert share.sum() == pytest.approx(1.0, abs=1e-4)
    # Along the line the slope is still known.
    place = flat([[0.23, 0.0, 0.0]])
    near = nearest_samples(line, place, 5)
    share = weights(line, place, near, "linear")
    found = float((share * line.positions[near.samples][..., 0]).sum())
    assert found == pytest.approx(0.23, abs=3e-3)


@pytest.mark.parametrize("interpolation", ["linear", "inverse"])
def test_samples_of_other_surfaces_do_not_count_if_enough_others_are_near(interpolation):
    """A shelf near a wall: the wall's places take nothing from it, though it is nearer."""
    shelf = [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.02, 0.02, 0.0]]
    wall = [[0.3, 0.0, 0.0], [0.0, 0.3, 0.0], [-0.3, 0.0, 0.0], [0.0, -0.3, 0.0]]
    place = Places.of(np.zeros((1, 3)), np.array([UP]), 1.0, np.array([7]))

    def on_shelf(kept):
        positions = np.array(shelf + wall[:kept])
        parts = np.array([3] * 3 + [7] * kept)
        samples = Places.of(positions, np.tile(UP, (len(positions), 1)), 1.0, parts)
        near = nearest_samples(samples, place, 8)
        np.testing.assert_array_equal(near.connected[0, :kept], True)
        share = weights(samples, place, near, interpolation)[0]
        return float(share[(near.samples[0] >= 0) & (near.samples[0] < 3)].sum())

    assert on_shelf(4) == on_shelf(3) == 0.0
    assert on_shelf(2) > 0.0
    # Without any of its own a place takes those of the nearest other surface.
    assert on_shelf(0) == pytest.approx(1.0, abs=1e-5)


def test_linear_functions_are_not_continued_far_beyond_the_samples():
    samples = flat([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.1, 0.1, 0.0]])
    places = flat([[x, 0.05, 0.0] for x in (0.05, 0.2, 0.5, 2.0)])
    share = weights(samples, places, nearest_samples(samples, places, 4), "linear")
    assert np.abs(share).sum(axis=1).max() <= LARGEST_SUM + 1e-4
    np.testing.assert_allclose(share.sum(axis=1), 1.0, atol=1e-5)
    assert np.abs(share[-1]).sum() > 1.4  # but some way


@pytest.mark.parametrize("interpolation", ["linear", "inverse"])
def test_samples_of_another_side_do_not_count_if_enough_others_are_near(interpolation):
    front = [[0.1, 0, 0], [0, 0.1, 0], [-0.1, -0.1, 0], [0.1, 0.1, 0]]
    positions = np.array([*front, [0.0, 0.0, 0.01]])
    normals = np.array([*[UP] * 4, (0.0, 0.0, -1.0)])
    place = flat([[0.0, 0.0, 0.0]])

    def other(kept):
        chosen = [*range(kept), 4]
        samples = Places.of(positions[chosen], normals[chosen], 1.0)
        near = nearest_samples(samples, place, len(chosen))
        share = weights(samples, place, near, interpolation)[0]
        return float(share[near.samples[0] == kept][0])

    assert other(3) == other(4) == 0.0
    if interpolation == "inverse":
        assert other(2) > 0.0


def test_weights_do_not_jump_where_the_set_of_neighbours_changes():
    samples = random_places(100, bend=0.0)
    ends = [[0.3, 0.4, 0.0], [0.6, 0.5, 0.0]]
    path = flat(np.linspace(*ends, 3001))
    near = nearest_samples(samples, path, 8)
    assert (np.sort(near.samples, axis=1)[1:] != np.sort(near.samples, axis=1)[:-1]).any()
    values = np.random.default_rng(0).normal(size=100)
    largest = {}
    for interpolation in ("linear", "inverse"):
        share = weights(samples, path, near, interpolation)
        found = np.sum(share * values[near.samples], axis=1)
        largest[interpolation] = np.abs(np.diff(found)).max()
    assert largest["linear"] < 0.02
    assert largest["inverse"] > largest["linear"]


def test_isolated_are_candidates_without_candidates_beside_them():
    # A chain of places, each with the one before and after.
    count = 9
    chain = np.stack([np.arange(count) - 1, np.arange(count) + 1], axis=1)
    chain[-1, 1] = -1
    near = Nearest(chain.astype(np.int32), np.zeros(chain.shape, np.float32), chain >= 0)
    candidates = np.zeros(count, bool)
    candidates[[0, 2, 3, 5, 8]] = True
    np.testing.assert_array_equal(np.flatnonzero(isolated(candidates, near)), [0, 5, 8])
    # "None", index -1, is not the last sample.
    none = np.zeros((count, 2), bool)
    alone = Nearest(np.full((count, 2), -1, np.int32), np.zeros((count, 2), np.float32), none)
    np.testing.assert_array_equal(isolated(candidates, alone), candidates)
    assert not isolated(np.zeros(count, bool), near).any()


def test_a_wrong_interpolation_is_named():
    with pytest.raises(ValueError, match=r"^interpolation must be linear or inverse, got 'cubic'$"):
        check_interpolation("cubic")
