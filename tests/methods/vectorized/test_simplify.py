import numpy as np
import pytest

from jaxvis.methods.vectorized.simplify import simplify
from tests.methods.vectorized.polygon_oracle import irradiance, unit

UP = np.array([0.0, 0.0, 1.0])


def star(count, axis, seed=0, radius=0.8, wobble=0.3):
    """A smooth counter-clockwise loop about a local axis."""
    rng = np.random.default_rng(seed)
    turn = 2 * np.pi * np.arange(count) / count
    phases = rng.uniform(0, 2 * np.pi, 3)
    angle = radius * (1 + wobble * sum(np.cos(k * turn + p) / k for k, p in enumerate(phases, 2)))
    axis = unit(np.asarray(axis, float))
    t = unit(np.cross(axis, [0.3, 0.5, 0.8]))
    ring = np.cos(turn)[:, None] * t + np.sin(turn)[:, None] * np.cross(axis, t)
    return np.cos(angle)[:, None] * axis + np.sin(angle)[:, None] * ring


def horizon(count):
    turn = 2 * np.pi * np.arange(count) / count
    return np.stack([np.cos(turn), np.sin(turn), 0 * turn], -1)


def reduced(loops, budget, tolerance=0.0, world=None, **options):
    """Kept points of one sample's loops."""
    local = np.concatenate(loops)
    loop = np.repeat(np.arange(len(loops)), [len(x) for x in loops])
    sample = np.zeros(len(local), int)
    world = local @ np.eye(3)[[1, 2, 0]].T if world is None else world(local)
    kept = simplify(local, world, sample, loop, np.array([budget]), tolerance=tolerance, **options)
    return local[kept], loop[kept]


def visvalingam(points, budget):
    """One removal at a time, by the area of the chords' triangle."""
    points = list(points)
    while len(points) > budget:
        p = np.array(points)
        area = np.linalg.norm(
            np.cross(np.roll(p, -1, 0) - p, np.roll(p, 1, 0) - p), axis=-1
        ) * np.maximum(p[:, 2], 0.1)
        points.pop(int(area.argmin()))
    return np.array(points)


@pytest.mark.parametrize("budget", [16, 48, 100])
def test_budgets_are_used_and_kept(budget):
    kept, _ = reduced([star(300, [0.2, 0.1, 1])], budget)
    assert len(kept) == budget


@pytest.mark.parametrize("seed", range(4))
def test_the_error_is_about_that_of_removal_one_by_one(seed):
    loop = star(300, [0.3, -0.2, 1], seed)
    exact = irradiance(loop[None], UP[None])[0]
    for budget in (24, 64):
        fast = irradiance(reduced([loop], budget)[0][None], UP[None])[0]
        slow = irradiance(visvalingam(loop, budget)[None], UP[None])[0]
        assert abs(fast - exact) < 2.5 * abs(slow - exact) + 2e-4


def test_points_go_below_the_tolerance_although_there_is_room():
    loop = star(300, [0, 0, 1])
    kept = [len(reduced([loop], 300, tolerance)[0]) for tolerance in (3e-6, 3e-5, 1e-3)]
    assert 300 > kept[0] > kept[1] > kept[2] >= 4


def trapezoid(world):
    """Solid angle between a closed loop and the north pole, edges being chords of the map."""
    longitude = np.arctan2(world[:, 0], -world[:, 2])
    steps = np.roll(longitude, -1) - longitude
    steps -= 2 * np.pi * np.rint(steps / (2 * np.pi))
    height = 1.0 - world[:, 1]
    return 0.5 * np.sum(steps * (height + np.roll(height, -1)))


@pytest.mark.parametrize("tilt", [0.2, 0.7, 1.3])
def test_great_circles_keep_what_chords_of_the_map_need(tilt):
    """A lune of angle 0.9 has a solid angle of 1.8 however it lies in the world."""
    c, s = np.cos(tilt), np.sin(tilt)

    def tilted(l):
        x, y, z = (l[:, [0, 2, 1]] * [1, 1, -1]).T
        return np.stack([x, c * y - s * z, s * y + c * z], -1)

    there = horizon(400)[:200]
    back = np.stack([-there[:, 0], np.cos(0.9) * there[:, 1], np.sin(0.9) * there[:, 1]], -1)
    lune = np.concatenate([there, back])
    kept, _ = reduced([lune], 128, 4e-6, tilted)
    assert len(kept) <= 128
    error = abs(trapezoid(tilted(kept)) - trapezoid(tilted(lune)))
    assert error < 2e-3
    evenly = lune[np.linspace(0, 400, 12, endpoint=False).astype(int)]
    assert abs(trapezoid(tilted(evenly)) - trapezoid(tilted(lune))) > 0.02  # negative control


def test_no_edge_jumps_to_the_other_side_of_a_pole():
    """A loop about the world's pole, and far off it, at the least size."""
    around = star(200, [0, 0, 1], radius=0.4)

    def polar(l):
        return l[:, [0, 2, 1]] * [1, 1, -1]

    kept, _ = reduced([around], 8, 1.0, polar)
    world = polar(kept)
    longitude = np.arctan2(world[:, 0], -world[:, 2])
    steps = np.diff(longitude, append=longitude[:1])
    assert np.abs(steps - 2 * np.pi * np.rint(steps / (2 * np.pi))).max() < 3.0


def test_no_loop_falls_below_the_fewest_points():
    loops = [star(100, [0, 0, 1]), star(30, [1, 0, 0.6], radius=0.05), star(5, [0, 1, 1])]
    _, loop = reduced(loops, 20, 1.0)
    assert np.bincount(loop).tolist() == [4, 4, 4]


def test_budgets_too_small_for_the_loops_are_refused():
    with pytest.raises(ValueError, match="raise vectors"):
        reduced([star(30, [0, 0, 1]), star(30, [1, 0, 1])], 7)


def test_samples_do_not_depend_on_each_other():
    rng = np.random.default_rng(3)
    loops = [star(rng.integers(60, 200), unit(rng.normal(size=3) + [0, 0, 2]), k) for k in range(6)]
    sizes = [len(x) for x in loops]
    sample, local = np.repeat(np.arange(6), sizes), np.concatenate(loops)
    budgets = np.array([20, 30, 40, 50, 60, 300])
    together = simplify(local, local, sample, sample, budgets, tolerance=4e-6)
    for k, loop in enumerate(loops):
        alone = simplify(
            loop,
            loop,
            0 * sample[: len(loop)],
            0 * sample[: len(loop)],
            budgets[k : k + 1],
            tolerance=4e-6,
        )
        offset = sum(sizes[:k])
        assert alone.tolist() == (together[sample[together] == k] - offset).tolist()


def test_nothing_stays_nothing():
    none = np.zeros((0, 3))
    index = np.zeros(0, int)
    assert len(simplify(none, none, index, index, np.array([8, 8]), tolerance=0.0)) == 0
