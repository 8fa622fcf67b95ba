"""The paper's cubes and its search of cells: closed forms, and heights scanned one by one."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.methods import create
from jaxvis.methods.cones.cells import (
    fitting_cube,
    footprint,
    may_meet,
    occlusion,
    occlusion_by_areas,
    range_table,
    search,
)
from jaxvis.methods.cones.heights import LARGEST, Plan, mip_chain, stored_heights
from jaxvis.methods.cones.light import Sky
from jaxvis.methods.cones.march import Lightmaps, March, Points, cone_radiosity
from jaxvis.methods.cones.method import VoxelCones

SIZE = 64
HALF = math.pi / 6.0

cubes = jax.jit(fitting_cube, static_argnames="fit")
look = jax.jit(search)


def directions(count, seed=0):
    found = np.random.default_rng(seed).normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def lanes(rows):
    """Component arrays of a list of vectors."""
    return tuple(jnp.asarray(np.atleast_2d(rows)[:, axis], jnp.float32) for axis in range(3))


def chain(values):
    """All levels of a map [x, z]."""
    return mip_chain(jnp.asarray(values, jnp.float32).reshape(-1), len(values))


def lightmap(heights, rise=1.0):
    """Plan (texels of 1, its corner at the origin) and 16-bit heights, of a map [x, z] in [0, 1].

    Colours: red counts texels along x, green along z, blue is 1."""
    size = len(heights)
    texel, high = np.asarray(1.0, np.float32), np.asarray(rise, np.float32)
    plan = Plan(np.zeros(3, np.float32), texel, high, size)
    x, z = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5, indexing="ij")
    colours = tuple(chain(c).astype(jnp.float16) for c in (x, z, np.ones_like(x)))
    return plan, stored_heights(chain(heights)), colours


def searched(lightmap, start, toward, distance, half=HALF):
    """Coverage and colour found in the first cube of one cone."""
    toward = np.asarray(toward) / np.linalg.norm(toward)
    begin, axis = lanes(start), lanes(toward)
    cube = cubes(begin, axis, jnp.float32([distance]), half, fit="clean")
    found = look(*lightmap, begin, axis, half, cube, footprint(lightmap[0], cube))
    return float(found.coverage[0]), [float(c[0]) for c in found.colour]


def test_both_ends_of_the_papers_cube_touch_the_cone():
    toward = directions(2000)
    toward = toward[np.abs(toward).max(axis=1) < 0.999]
    start = np.random.default_rng(1).normal(size=toward.shape)
    distance = np.full(len(toward), 2.5)
    cube = cubes(lanes(start), lanes(toward), jnp.asarray(distance, jnp.float32), HALF, fit="paper")
    centre, side = np.stack(cube.centre, -1).astype(float), np.asarray(cube.side, float)
    ratio = side / distance
    assert 0.66 < ratio.min() < 0.68
    assert 1.25 < ratio.max() < 1.33
    # Corners of a body diagonal: for one of the four both are on the cone, one at the distance.
    misses = []
    for signs in ([1, 1, 1], [1, -1, 1], [-1, 1, 1], [-1, -1, 1]):
        ends = [centre + 0.5 * k * side[:, None] * np.array(signs) - start for k in (-1.0, 1.0)]
        along = np.stack([np.einsum("nk,nk->n", end, toward) for end in ends])
        angles = np.arccos(along / np.stack([np.linalg.norm(end, axis=1) for end in ends]))
        nearer = np.abs(along - distance).min(axis=0)
        misses.append(np.abs(angles - HALF).max(axis=0) + nearer)
    assert np.min(misses, axis=0).max() < 2e-5
    # Which it is not for the others.
    assert np.sort(misses, axis=0)[1].max() > 0.1


@pytest.mark.parametrize("fit", ["clean", "paper"])
def test_a_cube_along_an_axis_is_inscribed_in_the_section_where_it_begins(fit):
    cube = cubes(lanes([1.0, 2.0, 3.0]), lanes([0.0, -1.0, 0.0]), jnp.float32([4.0]), HALF, fit=fit)
    side = 4.0 * 2.0 * math.tan(HALF) / math.sqrt(2.0)
    np.testing.assert_allclose(cube.side, [side], rtol=1e-6)
    expected = [1.0, 2.0 - 4.0 - 0.5 * side, 3.0]
    np.testing.assert_allclose(np.ravel(cube.centre), expected, rtol=1e-6)


def test_occlusion_by_areas_is_the_papers_and_stays_from_0_to_1():
    heights = jnp.asarray([[2.0, 1.0, 4.0, 2.0], [5.0, 1.0, 1.0, 1.0], [1.0, 1.0, 0.0, 0.0]])
    found = occlusion_by_areas(*heights.T)
    np.testing.assert_allclose(found, [1.0 - 2.0 / 8.0, 0.0, 0.0])


def test_equation_17_is_equation_16_for_similar_triangles():
    # Sections grow as the square of the distance and heights with it: (16) is 1 - (d / (d + S))^3,
    # of which (17) keeps the term of first order in S.
    distance, side = jnp.float32([3.0]), jnp.float32([1e-3])
    ratio = (distance + side) / distance
    exact = occlusion_by_areas(distance, distance**0, distance * ratio, ratio**0)
    found = occlusion(jnp.float32([0.5]), side, distance, "paper")
    np.testing.assert_allclose(found, 0.5 * exact, rtol=1e-3)
    np.testing.assert_allclose(occlusion(jnp.float32([0.5]), side, distance, "clean"), [0.5])


def hills(seed=0):
    noise = np.random.default_rng(seed).random((SIZE, SIZE)) ** 4
    return np.round(noise * LARGEST) / LARGEST


def smooth_hills():
    x, z = np.meshgrid(np.arange(SIZE), np.arange(SIZE), indexing="ij")
    heights = 0.5 + 0.3 * np.sin(0.21 * x) + 0.2 * np.cos(0.17 * z + 0.05 * x)
    return np.round(heights * LARGEST) / LARGEST


def random_cubes(plan, count=1000):
    rng = np.random.default_rng(3)
    toward = directions(count, 4)
    start = rng.uniform(-10.0, SIZE + 10.0, (count, 3))
    start[:, 1] = rng.uniform(-0.2, 1.4, count) * float(plan.rise)
    distance = jnp.asarray(rng.uniform(0.3, 20.0, count), jnp.float32)
    return cubes(lanes(start), lanes(toward), distance, HALF, fit="clean")


def reached(heights, plan, cube):
    """Brute force: whether a texel that a cube's plan touches reaches its bottom."""
    found = []
    for x, y, z, side in zip(
        *(np.asarray(c, float) for c in (*cube.centre, cube.side)), strict=True
    ):
        low = [max(math.floor(c - 0.5 * side), 0) for c in (x, z)]
        high = [min(math.ceil(c + 0.5 * side), SIZE) for c in (x, z)]
        part = heights[low[0] : max(high[0], 0), low[1] : max(high[1], 0)] * float(plan.rise)
        found.append(bool(part.size and part.max() >= y - 0.5 * side))
    return np.array(found)


@pytest.mark.parametrize("ranges", ["pyramid", "hsat"])
def test_a_skip_leaves_out_only_cubes_that_no_height_reaches(ranges):
    # Power means at coarse levels have lost what a rough map has there.
    heights = hills() if ranges == "pyramid" else smooth_hills()
    plan, stored, _ = lightmap(heights, rise=20.0)
    cube = random_cubes(plan)
    table = range_table(stored, plan, ranges)
    met = np.asarray(jax.jit(may_meet)(table, plan, footprint(plan, cube), cube))
    expected = reached(heights, plan, cube)
    assert 100 < expected.sum() < 900
    # Half of the others at least are skipped; power means may leave out some that are reached.
    assert (met & ~expected).sum() < 0.5 * (~expected).sum()
    assert (expected & ~met).sum() <= (0 if ranges == "pyramid" else 0.1 * expected.sum())


def test_ranges_are_asked_for_the_right_way_round():
    heights = np.zeros((SIZE, SIZE))
    heights[50, 10] = 1.0
    plan, stored, _ = lightmap(heights)
    start = lanes([[49.0, 0.9, 10.5], [9.0, 0.9, 50.5]])
    cube = cubes(start, lanes([[1.0, 0.0, 0.0]] * 2), jnp.full(2, 0.8), HALF, fit="clean")
    for ranges in ("pyramid", "hsat"):
        table = range_table(stored, plan, ranges)
        met = may_meet(table, plan, footprint(plan, cube), cube._replace(side=cube.side * 0.2))
        assert met.tolist() == [True, False]


def ridge(first=20, last=32, height=1.0):
    """Zero but for a block across all z."""
    heights = np.zeros((SIZE, SIZE))
    heights[first:last] = height
    return heights


def test_a_flat_plane_adds_nothing_to_cones_above_it():
    plane = lightmap(np.full((SIZE, SIZE), 0.5), rise=10.0)
    start = [30.2, 5.001, 31.7]
    for toward in ([0, 1, 0], [math.sin(math.pi / 3), 0.5, 0], [-0.5, 0.51, -0.7]):
        for distance in (0.1, 1.0, 9.0):
            assert searched(plane, start, toward, distance) == (0.0, [0.0, 0.0, 0.0])
    # While one downwards meets nothing else.
    coverage, colour = searched(plane, [30.2, 9.0, 31.7], [0, -1, 0], 3.0)
    assert coverage == 1.0
    np.testing.assert_allclose(colour, [30.2, 31.7, 1.0], atol=0.6)


def slope(sign):
    """Rises along +x by half a texel a texel, or falls."""
    x = (np.arange(SIZE) + 0.5) / SIZE
    return np.broadcast_to((x if sign > 0 else 1.0 - x)[:, None], (SIZE, SIZE))


def test_back_faces_add_no_light():
    up, down = (lightmap(slope(sign), rise=0.5 * SIZE) for sign in (1, -1))
    coverage, colour = searched(up, [10.0, 5.5, 32.0], [1.0, 0.0, 0.0], 8.0)
    assert coverage > 0.5
    assert colour[2] == pytest.approx(1.0, abs=1e-3)
    # From within the hill its surface is seen from below.
    coverage, colour = searched(down, [10.0, 5.5, 32.0], [1.0, 0.0, 0.0], 8.0)
    assert coverage > 0.2
    assert colour == [0.0, 0.0, 0.0]


def test_a_ridge_hides_what_is_behind_it():
    toward, distance = [1.0, 0.0, 0.0], 18.4
    side = distance * 2.0 * math.tan(HALF) / math.sqrt(2.0)
    start = [2.0, 0.5, 32.0]
    # Three rows of cells in the cube from x = 20.4 on, about 5 texels each.
    first = 2.0 + distance + side * np.array([1, 3, 5]) / 6.0
    assert [20 < x < 36 for x in first] == [True, True, True]
    equal = lightmap(ridge(first=0, last=SIZE), rise=8.0)
    plateau, _ = searched(equal, start, toward, distance)
    # A plateau's nearest row is seen under the largest elevation.
    assert plateau == pytest.approx(1.0 / 3.0)
    stairs = ridge(first=0, last=SIZE)
    for row, share in zip(first, (0.2, 0.6, 1.0), strict=True):
        stairs[int(row - side / 6) :] = share
    assert searched(lightmap(stairs, rise=8.0), start, toward, distance)[0] == pytest.approx(1.0)


def oracle(heights, rise, start, toward, cube):
    """Coverage from sorted cells of a map without levels: the search as a horizon that is carried
    from one cell to the next."""
    x, y, z, side = (float(c[0]) for c in (*cube.centre, cube.side))
    flat = math.hypot(toward[0], toward[2])
    lower = math.asin(toward[1]) - HALF
    cells = []
    for i in range(3):
        for j in range(3):
            px, pz = x + side * (i - 1) / 3.0, z + side * (j - 1) / 3.0
            h = heights(px, pz) * rise - start[1]
            dx, dz = px - start[0], pz - start[2]
            away = math.hypot(dx, dz)
            edge = math.tan(lower) * away if lower > -0.5 * math.pi else -math.inf
            advance = (dx * toward[0] + dz * toward[2]) / flat
            cells.append((advance, h / away, h >= max(edge, y - 0.5 * side - start[1])))
    cells.sort()
    seen, horizon = 0, -math.inf
    for advance, elevation, high in cells:
        seen += high and elevation >= horizon
        if advance > 0.0:
            horizon = max(horizon, elevation)
    return seen / 9.0


def test_the_search_is_a_horizon_carried_over_sorted_cells():
    # Smooth enough that its levels are its values: a tilted, curved sheet.
    def sheet(x, z):
        return 0.5 + 0.25 * np.sin(0.11 * x + 0.5) + 0.2 * np.sin(0.13 * z)

    grid = np.arange(SIZE) + 0.5
    made = lightmap(sheet(grid[:, None], grid[None]), rise=12.0)
    agree, covers = [], []
    rng = np.random.default_rng(8)
    for toward in directions(200, 9):
        start = [*rng.uniform(25.0, 39.0, 3)]
        start[1] = float(rng.uniform(2.0, 11.0))
        distance = rng.uniform(4.0, 9.0)
        cube = cubes(lanes(start), lanes(toward), jnp.float32([distance]), HALF, fit="clean")
        found = look(*made, lanes(start), lanes(toward), HALF, cube, footprint(made[0], cube))
        covers.append(float(found.coverage[0]))
        agree.append(abs(covers[-1] - oracle(sheet, 12.0, start, toward, cube)))
    # Cells at a threshold may fall either way: heights here are bilinear and 16-bit.
    assert np.mean(np.array(agree) < 0.01) > 0.85
    assert np.max(agree) < 0.35
    assert 0.2 < np.mean(covers) < 0.8


def sky_of_one():
    return Sky.of(jnp.ones((16, 32, 3)))


def gathered(heights, rise, positions, colours=True, **options):
    plan, stored, paint = lightmap(heights, rise)
    table = range_table(stored, plan, "pyramid")
    maps = Lightmaps(None, (), plan, stored, paint if colours else (), table)
    count = len(positions)
    up = jnp.tile(jnp.float32([[0.0, 1.0, 0.0]]), (count, 1))
    away, first = jnp.full(count, 0.25), jnp.ones(count)
    points = Points(jnp.asarray(positions, jnp.float32), up, away, first, jnp.zeros(count))
    march = March("cubes", 6, 9, search="cells", **options)
    return maps, points, march


@pytest.mark.parametrize("fit", ["clean", "paper"])
@pytest.mark.parametrize("accumulation", ["clean", "paper"])
def test_above_a_plane_all_light_comes_from_the_sky(fit, accumulation):
    maps, points, march = gathered(
        np.full((SIZE, SIZE), 0.5), 10.0, [[32.0, 5.0, 32.0]], fit=fit, accumulation=accumulation
    )
    found = cone_radiosity(maps, sky_of_one(), points, 2.0 * HALF, march)
    # Of white light from everywhere: cones 60 degrees across reach no lower than the plane.
    np.testing.assert_allclose(found, np.pi, rtol=1e-3)


def test_a_ridge_takes_light_and_gradients_are_finite():
    maps, points, march = gathered(
        ridge(34, 48), 16.0, [[32.0, 0.0, 32.0], [4.0, 0.0, 32.0]], colours=False
    )

    def light(aperture):
        return cone_radiosity(maps, sky_of_one(), points, aperture, march)[:, 0]

    near, far = light(2.0 * HALF)
    assert near < far < np.pi + 1e-3
    assert near < 0.9 * np.pi
    assert np.isfinite(jax.jit(jax.jacfwd(light))(2.0 * HALF)).all()

    def lit(scale):
        colours = tuple(scale * jnp.ones_like(maps.heights, jnp.float32) for _ in range(3))
        coloured = Lightmaps(None, (), maps.plan, maps.heights, colours, maps.ranges)
        return cone_radiosity(coloured, sky_of_one(), points, 2.0 * HALF, march).sum()

    slope = jax.jit(jax.grad(lit))(1.0)
    # Light is linear in what the heights send.
    np.testing.assert_allclose(slope, lit(2.0) - lit(1.0), rtol=1e-4)
    assert slope > 0.1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("search=sorted", "search must be one of horizon, cells"),
        ("fit=loose", "fit must be one of clean, paper"),
        ("accumulation=sum", "accumulation must be one of clean, paper"),
        ("ranges=sat", "ranges must be one of pyramid, hsat"),
        ("search=cells,stepping=half", "need stepping=cubes"),
        ("fit=paper,stepping=half", "need stepping=cubes"),
        ("fit=paper,aperture=1.6", "1.5 radians at most"),
    ],
)
def test_what_does_not_go_together_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        create(f"hybrid-cones:{options}")


def test_voxel_cones_have_no_cells_to_search():
    with pytest.raises(ValueError, match="need stepping=cubes"):
        VoxelCones(search="cells")
