import numpy as np

from jaxvis.methods.vectorized.refine.indicator import (
    VECTORS_PER_CHUNK,
    interpolation_errors,
    sky_vectors,
)
from jaxvis.methods.vectorized.refine.samples import Traced
from tests.methods.vectorized.analytic import UP, horizon, window
from tests.methods.vectorized.polygon_oracle import clamped, irradiance, seen_from

DOWN_TO = np.array([np.sqrt(0.5), np.sqrt(0.5), 0.0])


def traced(rings, positions, normals, buried=None, capacity=64):
    vectors = [np.pad(r, ((0, capacity - len(r)), (0, 0)), mode="edge").T for r in rings]
    return Traced(
        np.stack(vectors).astype(np.float32),
        np.array([len(r) for r in rings], np.int32),
        np.asarray(positions, np.float32),
        np.asarray(normals, np.float32),
        np.zeros(len(rings), bool) if buried is None else np.asarray(buried),
    )


def test_the_sky_above_a_slope():
    """pi along the normal for a whole hemisphere; above two planes at 45 degrees, the wedge's."""
    rings = horizon(UP, 64)[None]
    table = traced(rings, [np.zeros(3)], [UP])
    place = np.zeros((1, 3)), UP[None]
    np.testing.assert_allclose(
        sky_vectors(table.vectors, np.zeros(1, int), *place, UP[None])[0], np.pi * UP, atol=6e-3
    )
    found = sky_vectors(table.vectors, np.zeros(1, int), *place, DOWN_TO[None])[0]
    assert abs(found[1] - np.pi * 0.5 * (1.0 + np.sqrt(0.5))) < 2e-2
    # The half turn about the edge of the wedge that both planes share.
    np.testing.assert_allclose(found[0], np.pi * 0.5 * np.sqrt(0.5), atol=2e-2)


def test_it_agrees_with_the_oracle_in_several_chunks():
    rng = np.random.default_rng(0)
    count = 2 * (VECTORS_PER_CHUNK // 64) + 7
    rings = [window(np.array([0.3, 1.0, 0.1]), UP, 0.4 + 0.2 * k, 40) for k in range(5)]
    table = traced(rings, np.zeros((5, 3)), np.tile(UP, (5, 1)))
    polygon = rng.integers(0, 5, count)
    places = rng.uniform(-0.3, 0.3, (count, 3)) * [1, 0, 1]
    normals = np.tile(UP, (count, 1))
    found = sky_vectors(table.vectors, polygon, places, normals, normals)
    some = rng.integers(0, count, 50)
    seen = clamped(seen_from(table.vectors[polygon[some]], places[some]), normals[some])
    expected = np.pi * irradiance(seen, normals[some])
    np.testing.assert_allclose(found[some, 1], expected, atol=1e-4)


def test_errors_are_differences_of_the_sky_seen():
    """Corners that see everything, and a probe that sees half; then the buried."""
    whole, half = horizon(UP, 64), horizon(UP, 64)
    half[:, 0] = np.maximum(half[:, 0], 0.0)
    half[half[:, 0] == 0.0, 1] = 0.0
    half = np.concatenate([half[half[:, 0] > 0.0], [[0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 1, 0]]])
    order = np.argsort(-np.arctan2(half[:, 2], half[:, 0]))
    half = half[np.roll(order, 0)]
    table = traced([whole, half], np.zeros((2, 3)), np.tile(UP, (2, 1)))
    corners = np.array([[0, 0], [0, 1], [1, 1]])
    up = np.tile(UP, (3, 1))
    own = table.take(np.zeros(3, int))
    error = interpolation_errors(table, corners, own, up)
    assert error[0] < 1e-6
    assert 0.2 < error[1] < 0.6
    np.testing.assert_allclose(error[2], 2.0 * error[1], rtol=1e-5)
    hidden = table._replace(buried=np.array([False, True]))
    found = interpolation_errors(hidden, corners, hidden.take(np.zeros(3, int)), up)
    assert found[1] < 1e-6
    np.testing.assert_allclose(found[2], error[2], rtol=1e-5)
    assert interpolation_errors(hidden, corners[:1], hidden.take(np.ones(1, int)), up[:1]) == 0.0
