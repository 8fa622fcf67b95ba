import numpy as np
import pytest

from jaxvis.methods.vectorized.sequences import sequences
from tests.methods.vectorized.polygon_oracle import irradiance, unit

EMPTY = np.array([[0.0, 0.0, 1.0, 0.0]], np.float32)


def circle(axis, radius, count, hole=False):
    axis = unit(np.asarray(axis, float))
    t = unit(np.cross(axis, [0.3, 0.5, 0.8]))
    turn = 2 * np.pi * np.arange(count) / count * (-1 if hole else 1)
    ring = np.cos(turn)[:, None] * t + np.sin(turn)[:, None] * np.cross(axis, t)
    return np.cos(radius) * axis + np.sin(radius) * ring


LOOPS = [
    circle([0, 0, 1], 1.3, 40),
    circle([0.5, 0, 1], 0.2, 12, hole=True),
    circle([-0.5, 0.2, 1], 0.3, 16, hole=True),
    circle([-0.5, 0.2, 1], 0.1, 9),
]


def joined(samples, capacity):
    """Sequences of the samples, each a list of loops."""
    loops = [loop for one in samples for loop in one]
    points = np.concatenate([np.zeros((0, 3)), *loops])
    sample = np.repeat(np.arange(len(samples)), [sum(map(len, one)) for one in samples])
    loop = np.repeat(np.arange(len(loops)), [len(x) for x in loops])
    vectors = np.concatenate([points, np.zeros((len(points), 1))], axis=1).astype(np.float32)
    empty = np.repeat(EMPTY, len(samples), axis=0)
    return sequences(vectors, points, sample, loop, empty, capacity)


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_bridges_change_no_integral(number):
    loops = LOOPS[:number]
    table, counts = joined([loops], 96)
    sequence = np.moveaxis(table[:, :3].astype(float), 1, -1)
    normal = unit(np.array([[0.2, -0.1, 1.0]]))
    expected = sum(irradiance(loop[None], normal)[0] for loop in loops)
    np.testing.assert_allclose(irradiance(sequence, normal)[0], expected, atol=1e-6)
    assert counts[0] == sum(map(len, loops)) + 2 * (number - 1)


def test_every_edge_of_the_loops_is_walked_once_in_order():
    table, counts = joined([LOOPS], 96)
    sequence = table[0, :3, : counts[0]].T
    edges = {(tuple(a), tuple(b)) for a, b in zip(sequence, np.roll(sequence, -1, 0), strict=True)}
    for loop in LOOPS:
        loop = loop.astype(np.float32)
        for a, b in zip(loop, np.roll(loop, -1, 0), strict=True):
            assert (tuple(a), tuple(b)) in edges
    bridges = len(edges) - sum(map(len, LOOPS))
    assert bridges == 2 * (len(LOOPS) - 1)
    assert all(
        (b, a) in edges
        for a, b in edges
        if np.linalg.norm(np.subtract(a, b)) > 0.25  # longer than the edges of the loops
    )


def test_padding_repeats_the_last_entry():
    table, counts = joined([LOOPS[:1], LOOPS], 128)
    for k in range(2):
        tail = table[k, :, counts[k] - 1 :]
        np.testing.assert_array_equal(tail, np.repeat(tail[:, :1], tail.shape[1], axis=1))


def test_samples_without_loops_are_one_repeated_point():
    table, counts = joined([[], LOOPS[:2], []], 64)
    assert counts.tolist() == [1, 54, 1]
    np.testing.assert_array_equal(table[0], np.repeat(EMPTY[0][:, None], 64, axis=1))
    none, counts = joined([[]], 16)
    assert none.shape == (1, 4, 16)
    assert counts.tolist() == [1]


def test_more_vectors_than_there_is_room_for_are_refused():
    with pytest.raises(ValueError, match="raise vectors"):
        joined([LOOPS], 82)
    joined([LOOPS], 83)
