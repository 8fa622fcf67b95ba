"""Mip chains of voxels with six sides, and reading them, against slow loops."""

from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.methods.cones.volume import FACES, Grid, level_offset, mip_chain, sample_volume

N = 8


def random_base(seed=0, n=N):
    """Two premultiplied channels and opacity."""
    rng = np.random.default_rng(seed)
    opacity = rng.uniform(0.0, 1.0, (FACES, n**3)) * rng.integers(0, 2, (FACES, n**3))
    channels = [opacity * rng.uniform(0.0, 2.0, opacity.shape) for _ in range(2)]
    return tuple(values.astype(np.float16) for values in (*channels, opacity))


def level_of(channel, level, n=N):
    """[6, side, side, side] of a flat mip chain."""
    channel = np.asarray(channel, np.float64).reshape(FACES, -1)
    side = n >> level
    return channel[:, level_offset(n, level) :][:, : side**3].reshape(FACES, side, side, side)


def oracle_chain(base, n=N):
    """Cell by cell: the front one of two children covers the one behind; four pairs' mean."""
    finest = [values.astype(np.float64).reshape(FACES, n, n, n) for values in base]
    levels = [finest]
    while (side := levels[-1][0].shape[1] // 2) >= 1:
        fine = levels[-1]
        coarse = [np.zeros((FACES, side, side, side)) for _ in base]
        for face, *cell in product(range(FACES), *[range(side)] * 3):
            axis, backwards = divmod(face, 2)
            for pair in product((0, 1), (0, 1)):
                place = [2 * c for c in cell]
                for other, step in zip([a for a in range(3) if a != axis], pair, strict=True):
                    place[other] += step
                near, far = list(place), list(place)
                (near if backwards else far)[axis] += 1
                cover = fine[-1][(face, *near)]
                for c, values in enumerate(fine):
                    both = values[(face, *near)] + (1.0 - cover) * values[(face, *far)]
                    coarse[c][(face, *cell)] += 0.25 * both
        levels.append(coarse)
    return levels


def test_mip_chains_are_those_of_plain_loops():
    base = random_base()
    chain = mip_chain(tuple(map(jnp.asarray, base)), N)
    for level, values in enumerate(oracle_chain(base)):
        for c, expected in enumerate(values):
            # Each level is rounded to float16.
            np.testing.assert_allclose(level_of(chain[c], level), expected, rtol=3e-3, atol=1e-4)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("place", [0, 3, 4])
def test_a_wall_stays_opaque_from_the_front_and_thin_from_the_side(axis, place):
    wall = np.zeros((N, N, N))
    np.moveaxis(wall, axis, 0)[place] = 1.0
    opacity = np.broadcast_to(wall.reshape(-1), (FACES, N**3)).astype(np.float16)
    (chain,) = mip_chain((jnp.asarray(opacity),), N)
    # From the side, two halves behind each other count as independent: 1/2, 3/8, 39/128.
    side = [1.0, 0.5, 0.375, 0.3046875]
    for level in range(N.bit_length()):
        for face in range(FACES):
            across = np.moveaxis(level_of(chain, level)[face], axis, 0)
            expected = 1.0 if face // 2 == axis else side[level]
            np.testing.assert_allclose(across[place >> level], expected, rtol=1e-3)
            assert np.delete(across, place >> level, axis=0).sum() == 0.0


def test_the_nearer_of_two_walls_is_seen():
    """Red, then green, along +x: from the other side green."""
    red, green, opacity = (np.zeros((FACES, 8), np.float16) for _ in range(3))
    opacity[:] = 1.0
    red[:, :4] = 1.0  # x-major: the first half is at low x
    green[:, 4:] = 1.0
    chain = mip_chain(tuple(map(jnp.asarray, (red, green, opacity))), 2)
    top = [level_of(values, 1, 2)[:, 0, 0, 0] for values in chain]
    np.testing.assert_allclose(top[0], [1, 0, 0.5, 0.5, 0.5, 0.5])
    np.testing.assert_allclose(top[1], [0, 1, 0.5, 0.5, 0.5, 0.5])
    np.testing.assert_allclose(top[2], 1.0)


GRID = Grid(np.float32([-1.0, 0.5, 2.0]), np.array(0.25, np.float32), N)


def oracle_sample(chain, at, toward, level):
    """One lane, every channel; the border goes on, levels beyond the last are the last."""
    last = N.bit_length() - 1
    level = min(max(level, 0.0), last)
    below = min(int(np.floor(level)), last - 1)
    total = np.zeros(len(chain))
    for k, share in ((below, 1.0 - (level - below)), (below + 1, level - below)):
        side, size = N >> k, float(GRID.voxel) * 2**k
        place = (np.asarray(at) - GRID.low) / size - 0.5
        base = np.floor(place).astype(int)
        for corner in product((0, 1), repeat=3):
            weight = np.prod(
                [1 - abs(p - (b + c)) for p, b, c in zip(place, base, corner, strict=True)]
            )
            cell = tuple(np.clip(base + corner, 0, side - 1))
            for axis, d in enumerate(toward):
                face = 2 * axis + (0 if d > 0 else 1)
                for c, channel in enumerate(chain):
                    total[c] += share * weight * d * d * level_of(channel, k)[(face, *cell)]
    return total


def lanes(count=60, seed=1):
    rng = np.random.default_rng(seed)
    extent = N * float(GRID.voxel)
    at = GRID.low + rng.uniform(-0.2, 1.2, (count, 3)) * extent
    toward = rng.normal(size=(count, 3))
    toward /= np.linalg.norm(toward, axis=-1, keepdims=True)
    toward[:6] = np.concatenate([np.eye(3), -np.eye(3)])
    level = rng.uniform(-0.5, 4.0, count)
    level[:5] = [0.0, 1.0, 2.0, 3.0, 7.0]
    return at, toward, level


def columns(vectors):
    return tuple(jnp.asarray(vectors[:, axis], jnp.float32) for axis in range(3))


def test_samples_are_those_of_plain_loops():
    chain = mip_chain(tuple(map(jnp.asarray, random_base(2))), N)
    at, toward, level = lanes()
    found = jax.jit(sample_volume)(
        GRID, chain, columns(at), columns(toward), jnp.asarray(level, jnp.float32)
    )
    expected = [oracle_sample(chain, *lane) for lane in zip(at, toward, level, strict=True)]
    np.testing.assert_allclose(np.stack(found, -1), expected, atol=2e-4)
    assert np.std(expected) > 0.05


def test_a_constant_volume_gives_the_constant():
    chain = (jnp.full(FACES * GRID.cells, 0.75),)
    at, toward, level = lanes(200)
    (found,) = sample_volume(
        GRID, chain, columns(at), columns(toward), jnp.asarray(level, jnp.float32)
    )
    np.testing.assert_allclose(found, 0.75, rtol=1e-5)


def test_gradients_are_finite_differences():
    rng = np.random.default_rng(3)
    channel = jnp.asarray(rng.uniform(size=FACES * GRID.cells), jnp.float32)
    at, toward, level = lanes(30)
    weights = jnp.asarray(rng.normal(size=30), jnp.float32)
    levels = jnp.asarray(level, jnp.float32)

    @jax.jit
    def value(channel):
        (found,) = sample_volume(GRID, (channel,), columns(at), columns(toward), levels)
        return jnp.vdot(weights, found)

    step = jnp.asarray(rng.normal(size=channel.shape), jnp.float32)
    difference = value(channel + step) - value(channel - step)  # linear: any step is exact
    slope = jnp.vdot(jax.grad(value)(channel), step)
    np.testing.assert_allclose(slope, 0.5 * difference, rtol=1e-3)
    assert abs(float(slope)) > 0.1


def test_grids_hold_their_box_with_a_voxel_to_spare():
    low, high = np.array([0.0, -1.0, 2.0]), np.array([3.0, 1.0, 2.5])
    grid = Grid.around(low, high, 16)
    top = grid.low + 16 * float(grid.voxel)
    assert (grid.low <= low - 0.99 * float(grid.voxel)).all()
    assert (top >= high + 0.99 * float(grid.voxel)).all()
    np.testing.assert_allclose(float(grid.voxel), 3.0 / 14)
    assert grid.levels == 5
    assert grid.cells == 16**3 + 8**3 + 4**3 + 2**3 + 1
