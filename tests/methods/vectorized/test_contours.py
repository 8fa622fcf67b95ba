import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from jaxvis.methods.vectorized.contours import cycles, trace_contours
from jaxvis.methods.vectorized.hemisphere_map import Samples, grid
from jaxvis.scene import RayTracer

SIDE = 17
INSIDE = (np.linalg.norm(grid(SIDE - 1), axis=-1) < 1.0).reshape(SIDE, SIDE)


class Fog(RayTracer):
    """Stands in for a tracer: every ray is blocked, or none."""

    def __init__(self, thick):
        self.thick = thick

    def occluded(self, origins, directions, max_distance=None):
        return np.full(len(origins), self.thick)


def contours_of(free, thick=True):
    samples = Samples.of(np.zeros((len(free), 3)), np.tile([[0.0, 0.0, 1.0]], (len(free), 1)))
    return trace_contours(Fog(thick), samples, free)


def loop_areas(contours):
    """Signed areas in cells, counter-clockwise positive."""
    row, column = (
        0.5 * (a + b)
        for a, b in zip(
            np.divmod(contours.free, SIDE), np.divmod(contours.blocked, SIDE), strict=True
        )
    )
    areas = []
    for start, length in zip(contours.starts, contours.lengths, strict=True):
        x, y = column[start : start + length], row[start : start + length]
        areas.append(0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    return np.array(areas)


def random_maps(seed, count=6):
    noise = ndimage.gaussian_filter(
        np.random.default_rng(seed).normal(size=(count, SIDE, SIDE)), (0, 0.8, 0.8)
    )
    return (noise > 0.0) & INSIDE


@settings(max_examples=30, deadline=None)
@given(st.permutations(range(40)))
def test_cycles_are_those_found_step_by_step(successor):
    order, starts, lengths = cycles(np.array(successor))
    assert sorted(order) == list(range(40))
    expected, seen = [], set()
    for first in range(40):
        cycle, here = [], first
        while here not in seen:
            seen.add(here)
            cycle.append(here)
            here = successor[here]
        if cycle:
            expected.append(cycle)
    assert [list(order[s : s + n]) for s, n in zip(starts, lengths, strict=True)] == expected


@pytest.mark.parametrize("seed", range(4))
def test_loops_walk_through_neighbouring_cells_with_the_free_side_on_the_left(seed):
    free = random_maps(seed)
    found = contours_of(free)
    maps = free.reshape(len(free), -1)
    assert maps[found.sample, found.free].all()
    assert not maps[found.sample, found.blocked].any()
    crossed = (free[:, 1:] != free[:, :-1]).sum() + (free[:, :, 1:] != free[:, :, :-1]).sum()
    assert len(found.sample) == crossed == found.lengths.sum()
    middle = 0.5 * np.stack([a // SIDE + 1j * (a % SIDE) for a in (found.free, found.blocked)]).sum(
        0
    )
    for start, length in zip(found.starts, found.lengths, strict=True):
        loop = middle[start : start + length]
        assert np.abs(np.roll(loop, -1) - loop).max() <= 1.0
        assert length >= 4
        assert len(set(found.sample[start : start + length])) == 1


@pytest.mark.parametrize("thick", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_loops_count_the_free_regions_and_their_holes(seed, thick):
    """Free regions meet at the corners of cells if the centres are free, holes if they are not."""
    free = random_maps(seed)
    found = contours_of(free, thick)
    areas, owner = loop_areas(found), found.sample[found.starts]
    corners = np.ones((3, 3))
    for k, values in enumerate(free):
        regions = ndimage.label(values, None if thick else corners)[1]
        holes = ndimage.label(~values, corners if thick else None)[1] - 1
        assert (areas[owner == k] > 0).sum() == regions
        assert (areas[owner == k] < 0).sum() == holes


def test_a_full_disc_is_one_loop_round_its_nodes():
    found = contours_of(INSIDE[None])
    assert len(found.starts) == 1
    assert abs(loop_areas(found)[0] - INSIDE.sum()) < 0.1 * INSIDE.sum()


def test_maps_without_free_nodes_have_no_loops():
    found = contours_of(np.zeros((3, SIDE, SIDE), bool))
    assert len(found.sample) == len(found.starts) == 0
