"""Heights over the plan: where they come from, how they are stored, and how they are read."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.methods.cones.heights import (
    LARGEST,
    Plan,
    corners,
    level_offset,
    look_down,
    mip_chain,
    stored_heights,
)
from tests.methods.cones.made_scenes import flat_ground, heights, paint, scene

N = 16
LINE = np.linspace(0.0, 2.0, 5)


def seen_of(made, resolution=N):
    points = made.positions.astype(np.float64)
    plan = Plan.around(points.min(axis=0), points.max(axis=0), resolution)
    return plan, look_down(made, np.ones(len(made.triangles), bool), plan)


def test_a_ramp_is_exact_at_texel_centres():
    made = scene(
        heights(lambda x, z: 0.3 * x + 0.1 * z, LINE, LINE), materials=(paint(0.2, 0.4, 0.6),)
    )
    plan, seen = seen_of(made)
    centre = (np.arange(N) + 0.5) * 2.0 / N  # of the world: the ramp begins at 0
    x, z = np.meshgrid(centre, centre, indexing="ij")
    assert seen.there.all()
    height = float(plan.rise) * seen.height.reshape(N, N)
    np.testing.assert_allclose(height, 0.3 * x + 0.1 * z, atol=1e-5)
    np.testing.assert_allclose(seen.position[:, 0].reshape(N, N), x - 1.0, atol=1e-5)
    np.testing.assert_allclose(seen.position[:, 2].reshape(N, N), z - 1.0, atol=1e-5)
    upward = np.array([-0.3, 1.0, -0.1]) / np.linalg.norm([-0.3, 1.0, -0.1])
    np.testing.assert_allclose(seen.normal, [upward] * N * N, atol=1e-5)
    np.testing.assert_allclose(seen.albedo, [[0.2, 0.4, 0.6]] * N * N, atol=1e-6)
    np.testing.assert_allclose([float(plan.rise), float(plan.texel)], [0.8, 0.125], rtol=1e-5)


def test_the_topmost_of_chosen_triangles_is_seen_whichever_way_it_winds():
    points, faces = flat_ground(2.0, y=1.0)
    made = scene(flat_ground(2.0), (points, faces[:, ::-1]), kinds=(0, 1), materials=(paint(),) * 2)
    _, both = seen_of(made, 4)
    np.testing.assert_allclose(both.height, 1.0, atol=1e-5)
    np.testing.assert_allclose(both.normal[:, 1], 1.0, atol=1e-6)
    plan, _ = seen_of(made, 4)
    below = look_down(made, made.material_ids == 0, plan)
    np.testing.assert_allclose(below.height, 0.0, atol=1e-5)


def test_where_nothing_is_the_height_is_the_lowest():
    made = scene(heights(lambda x, z: x, LINE, 0.5 * LINE))
    _, seen = seen_of(made, 8)
    there = seen.there.reshape(8, 8)
    # Centred: the plan's square is twice as wide along z as the mesh.
    assert there[:, 2:6].all()
    assert not there[:, [0, 1, 6, 7]].any()
    assert (seen.height[~seen.there] == 0.0).all()
    assert (seen.albedo[~seen.there] == 0.0).all()


def test_stored_heights_are_off_by_half_a_step():
    rng = np.random.default_rng(0)
    exact = np.concatenate([rng.uniform(size=5000), [0.0, 1.0, -1e-6, 1.0 + 1e-6]])
    stored = stored_heights(jnp.asarray(exact, jnp.float32))
    assert stored.dtype == jnp.uint16
    assert np.abs(np.asarray(stored) / LARGEST - exact).max() <= 0.51 / LARGEST + 1e-6
    assert np.asarray(stored)[5000:].tolist() == [0, LARGEST, 0, LARGEST]


def pyramid(base):
    levels = [base]
    while len(levels[-1]) > 1:
        fine = levels[-1]
        half = len(fine) // 2
        coarse = np.zeros((half, half))
        for i in range(half):
            for j in range(half):
                coarse[i, j] = fine[2 * i : 2 * i + 2, 2 * j : 2 * j + 2].mean()
        levels.append(coarse)
    return levels


def test_mip_chains_are_means():
    base = np.random.default_rng(1).uniform(size=(N, N))
    chain = np.asarray(mip_chain(jnp.asarray(base.reshape(-1), jnp.float32), N))
    levels = pyramid(base)
    assert len(chain) == sum(level.size for level in levels) == level_offset(N, N.bit_length())
    for k, level in enumerate(levels):
        found = chain[level_offset(N, k) :][: level.size].reshape(level.shape)
        np.testing.assert_allclose(found, level, atol=1e-6)


PLAN = Plan(np.float32([-1.0, 0.0, 3.0]), np.array(0.125, np.float32), np.array(1.0, np.float32), N)


def bilinear(levels, x, z, level):
    """Place by place; what lies beyond the border is the border's."""
    values, size = levels[level], float(PLAN.texel) * 2**level
    p, q = (x - PLAN.low[0]) / size - 0.5, (z - PLAN.low[2]) / size - 0.5
    i, j = int(np.floor(p)), int(np.floor(q))
    total = 0.0
    for a, u in ((i, i + 1 - p), (i + 1, p - i)):
        for b, v in ((j, j + 1 - q), (j + 1, q - j)):
            last = len(values) - 1
            total += u * v * values[np.clip(a, 0, last), np.clip(b, 0, last)]
    return total


@pytest.mark.parametrize("inside", [True, False])
def test_reading_is_bilinear_and_goes_on_beyond_the_border(inside):
    rng = np.random.default_rng(2)
    base = rng.uniform(size=(N, N))
    chain = mip_chain(jnp.asarray(base.reshape(-1), jnp.float32), N)
    reach = (0.0, 2.0) if inside else (-1.0, 3.0)
    x, z = PLAN.low[0] + rng.uniform(*reach, 100), PLAN.low[2] + rng.uniform(*reach, 100)
    level = np.arange(100) % PLAN.levels
    at = corners(PLAN, jnp.asarray(x, jnp.float32), jnp.asarray(z, jnp.float32), jnp.asarray(level))
    expected = [bilinear(pyramid(base), *lane) for lane in zip(x, z, level, strict=True)]
    np.testing.assert_allclose(at.read(chain), expected, atol=1e-4)
    np.testing.assert_allclose(at.read(chain, 3.0), 3.0 * np.array(expected), atol=3e-4)
    np.testing.assert_allclose(sum(at.weights), 1.0, atol=1e-5)
