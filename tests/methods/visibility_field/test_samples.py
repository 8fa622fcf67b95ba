"""Surface samples: uniform where they should be, and never the same by accident."""

import numpy as np
import pytest
from scipy.stats import chisquare

from jaxvis.methods.visibility_field import samples as module
from jaxvis.methods.visibility_field.grid import Grid, cell_of
from jaxvis.methods.visibility_field.samples import (
    EVEN,
    Samples,
    Surface,
    areas,
    cell_weights,
    cut,
    draw,
    hemisphere_rays,
    surface_pieces,
)
from jaxvis.reflectance import Material
from jaxvis.sampling import hammersley
from jaxvis.sampling.hemisphere import sample_uniform
from jaxvis.scene import build_scene
from jaxvis.scene.builtin import builtin_scene
from tests.methods.visibility_field.mask_oracle import sample_directions


def drawn(scene, edge, count, sampling, seed=0):
    grid = Grid.covering(scene.positions, edge)
    surface = Surface.of(scene, grid, sampling)
    return draw(surface, grid, 0, count, total=count, seed=seed), grid


def triangles_of(scene, samples):
    """The triangle that each sample lies on, by a ray back onto it."""
    return scene.tracer.closest_hit(samples.origins, -samples.normals).triangle


def floor_with_ornaments(ornaments=12):
    """A square of 16 x 16 and above it, one a cell of 1 x 1 x 1, tiny triangles."""
    corners = [[-8, 0, -8], [-8, 0, 8], [8, 0, 8], [8, 0, -8]]
    faces = [[0, 1, 2], [0, 2, 3]]
    for k in range(ornaments):
        # The grid begins 0.63 cells before -8: these are middles of cells.
        start = np.array([-7.13 + k, 3.87, -7.13 + k])
        first = len(corners)
        corners += [start + step for step in ([0, 0, 0], [0, 0, 0.02], [0.02, 0, 0])]
        faces.append([first, first + 1, first + 2])
    return build_scene(np.array(corners, float), np.array(faces), name="ornaments")


def test_areas_by_hand():
    corners = np.array(
        [[[0, 0, 0], [2, 0, 0], [0, 3, 0]], [[1, 1, 1], [1, 1, 5], [1, 3, 1]]], np.float32
    )
    np.testing.assert_allclose(areas(corners), [3.0, 4.0])


@pytest.mark.parametrize("length", [0.3, 1.0, 100.0])
def test_pieces_are_short_and_cover_their_triangles(length):
    scene = builtin_scene("box-on-plane")
    corners = scene.positions[scene.triangles]
    pieces, triangle = cut(corners, length, 1 << 20)
    edges = np.linalg.norm(pieces - np.roll(pieces, 1, axis=1), axis=-1)
    assert edges.max() <= length * (1 + 1e-6) or length > edges.max()
    covered = np.bincount(triangle, areas(pieces), len(corners))
    np.testing.assert_allclose(covered, areas(corners), rtol=1e-5)
    # Every piece lies in the plane of its triangle, within its bounds.
    offsets = pieces - corners[triangle][:, :1]
    height = np.einsum("pka,pa->pk", offsets, scene.geometric_normals[triangle])
    assert np.abs(height).max() < 1e-5
    assert np.all(pieces.max(axis=1) <= corners[triangle].max(axis=1) + 1e-6)
    assert np.all(pieces.min(axis=1) >= corners[triangle].min(axis=1) - 1e-6)
    if length == 100.0:
        np.testing.assert_array_equal(pieces, corners)


def test_too_many_pieces_are_cut_coarser():
    corners = builtin_scene("plane").positions[builtin_scene("plane").triangles]
    fine, _ = cut(corners, 0.1, 1 << 20)
    coarse, triangle = cut(corners, 0.1, 5000)
    assert len(fine) > 5000 >= len(coarse) > len(corners)
    edges = np.linalg.norm(coarse - np.roll(coarse, 1, axis=1), axis=-1).max()
    assert edges <= 0.8
    np.testing.assert_allclose(np.bincount(triangle, areas(coarse)), areas(corners), rtol=1e-5)
    # More triangles than pieces are allowed: they stay whole.
    whole, _ = cut(corners, 0.1, 7)
    np.testing.assert_array_equal(whole, corners)


def test_half_of_the_samples_goes_evenly_to_cells():
    cells = np.array([3, 3, 8], np.int32)
    weights = cell_weights(cells, np.array([0.25, 0.75, 3.0]))
    first, second = 0.25 + 0.5 / 4, 0.25 + 0.5 * 3 / 4
    np.testing.assert_allclose(weights, [0.25 * first, 0.75 * first, second])
    # A sliver that lost its area takes nothing, and gives no NaN.
    weights = cell_weights(np.array([1, 2], np.int32), np.array([0.0, 2.0]))
    assert weights[0] == 0.0
    assert weights[1] > 0.0


@pytest.mark.parametrize("sampling", ["random", "stratified"])
def test_weights_add_up_and_follow_the_cells(sampling):
    scene = builtin_scene("sphere-on-plane")
    grid = Grid.covering(scene.positions, 0.7)
    pieces = surface_pieces(scene, grid, sampling)
    assert pieces.cumulative[-1] == 1.0
    weights = np.diff(pieces.cumulative, prepend=0.0)
    assert weights.min() > 0.0
    if sampling == "random":
        area = areas(scene.positions[scene.triangles])
        np.testing.assert_allclose(weights, area / area.sum(), rtol=1e-9)
        return
    cells = cell_of(grid, pieces.corners.mean(axis=1))
    # A centroid on a cell's face may be rounded to either side of it.
    assert np.mean(np.diff(cells) < 0) < 0.002
    row = np.unique(cells, return_inverse=True)[1]
    assert np.bincount(row, weights).min() >= 0.9 * EVEN / (row.max() + 1)
    # Of one density in each cell.
    area = areas(pieces.corners)
    density = np.bincount(row, weights) / np.bincount(row, area)
    assert np.mean(np.abs(weights / area / density[row] - 1.0) > 1e-3) < 0.02


def test_random_samples_meet_triangles_by_area():
    scene = builtin_scene("sphere-on-plane", rows=8, cells=4)
    samples, _ = drawn(scene, 1.0, 40_000, "random")
    counts = np.bincount(triangles_of(scene, samples), minlength=len(scene.triangles))
    area = areas(scene.positions[scene.triangles])
    assert chisquare(counts, 40_000 * area / area.sum()).pvalue > 1e-3


@pytest.mark.parametrize("sampling", ["random", "stratified"])
def test_samples_are_uniform_within_a_cell(sampling):
    scene = builtin_scene("plane", size=4.0, cells=1)
    samples, _ = drawn(scene, 12.0, 20_000, sampling)
    assert len(np.unique(samples.cells)) == 1
    place = ((samples.origins[:, [0, 2]] + 2.0) * 2.0).astype(int)
    counts = np.bincount(place[:, 0] * 8 + place[:, 1], minlength=64)
    assert chisquare(counts).pvalue > 1e-3


def test_every_cell_gets_its_share_of_stratified_samples():
    scene = floor_with_ornaments()
    count = 4000
    samples, grid = drawn(scene, 1.0, count, "stratified")
    pieces = surface_pieces(scene, grid, "stratified")
    cells = len(np.unique(cell_of(grid, pieces.corners.mean(axis=1))))
    ornaments = cell_of(grid, scene.positions[scene.triangles[2:]].mean(axis=1))
    assert len(np.unique(ornaments)) == 12
    share = np.array([np.sum(samples.cells == cell) for cell in ornaments])
    assert share.min() >= np.floor(EVEN * count / cells)
    # Random samples all but miss them: that is what stratifying is for.
    samples, _ = drawn(scene, 1.0, count, "random")
    assert np.isin(samples.cells, ornaments).sum() <= 1


def test_stratified_samples_fall_one_into_each_equal_part():
    scene = builtin_scene("box-on-plane")
    grid = Grid.covering(scene.positions, 1.0)
    surface = Surface.of(scene, grid, "stratified")
    count = 3000
    samples = draw(surface, grid, 0, count, total=count, seed=4)
    weights = np.diff(surface.pieces.cumulative, prepend=0.0)
    share = np.bincount(surface.pieces.triangle, weights, len(scene.triangles))
    found = np.bincount(triangles_of(scene, samples), minlength=len(scene.triangles))
    # A triangle's pieces lie in a few cells: each run of them is right to within one sample.
    assert np.abs(found - count * share).max() < 6.0
    # Independent samples stray as the root of their number: about 50 a triangle and more.


def test_two_sided_materials_are_sampled_on_both_sides():
    scene = builtin_scene("plane")
    one, _ = drawn(scene, 1.0, 4000, "stratified")
    np.testing.assert_array_equal(one.normals, np.tile(np.float32([0, 1, 0]), (4000, 1)))
    both = scene.with_materials((Material(two_sided=True),))
    for sampling in ("random", "stratified"):
        samples, grid = drawn(both, 1.0, 4000, sampling)
        up = samples.normals[:, 1] > 0.0
        assert abs(up.mean() - 0.5) < 0.04
        np.testing.assert_array_equal(samples.normals[~up, 1], -1.0)
        assert np.all((samples.origins[:, 1] > 0.0) == up)
        np.testing.assert_array_equal(samples.cells, cell_of(grid, samples.origins))


def test_draws_do_not_depend_on_how_many_follow_and_differ_by_seed():
    scene = builtin_scene("sphere-on-plane")
    grid = Grid.covering(scene.positions, 0.5)
    surface = Surface.of(scene, grid, "random")
    few = draw(surface, grid, 0, 100, total=100, seed=1)
    again = draw(surface, grid, 0, 100, total=100, seed=1)
    for one, other in zip(few, again, strict=True):
        np.testing.assert_array_equal(one, other)
    for other in (
        draw(surface, grid, 0, 100, total=100, seed=2),
        draw(surface, grid, 100, 200, total=200, seed=1),
    ):
        assert not np.any(np.all(few.origins == other.origins, axis=1))


def test_sorting_keeps_samples_together():
    samples, _ = drawn(builtin_scene("sphere-on-plane"), 1.0, 1000, "random")
    ordered = samples.by_cell()
    assert np.all(np.diff(ordered.cells) >= 0)
    assert np.any(np.diff(samples.cells) < 0)
    rows = [np.column_stack(part).tolist() for part in (samples, ordered)]
    assert sorted(rows[0]) == sorted(rows[1])


def test_rays_are_the_hemisphere_points_turned_about_the_normal():
    samples, _ = drawn(builtin_scene("sphere-on-plane"), 1.0, 60, "random")
    axes = np.concatenate([np.eye(3), -np.eye(3)]).astype(np.float32)
    normals = np.concatenate([samples.normals, axes])
    samples = Samples(
        np.concatenate([samples.origins, axes]),
        normals,
        np.linspace(0.0, 6.28, len(normals), dtype=np.float32),
        np.zeros(len(normals), np.int32),
    )
    local = np.asarray(sample_uniform(hammersley(32)))
    starts, directions = hemisphere_rays(samples, slice(10, None), local)
    directions = directions.reshape(-1, 32, 3)
    for row, sample in enumerate(range(10, len(normals))):
        expected = sample_directions(normals[sample], samples.angles[sample], 32)
        np.testing.assert_allclose(directions[row], expected, atol=1e-6)
        assert np.all(directions[row] @ normals[sample] > 0.0)
    np.testing.assert_array_equal(starts, np.repeat(samples.origins[10:], 32, axis=0))


def test_slivers_of_many_cells_give_weights_without_nan():
    positions = np.array([[0, 0, 0], [1e4, 1e-4, 0], [2e4, 0, 1.0]])
    scene = build_scene(positions, np.array([[0, 1, 2]]), name="sliver")
    pieces = surface_pieces(scene, Grid.covering(scene.positions, 1.0), "stratified")
    assert len(pieces.triangle) > 1000
    assert np.all(np.diff(pieces.cumulative, prepend=0.0) >= 0.0)
    assert pieces.cumulative[-1] == 1.0


def test_the_cap_reaches_the_pieces(monkeypatch):
    scene = builtin_scene("plane")
    monkeypatch.setattr(module, "MOST_PIECES", 1000)
    pieces = surface_pieces(scene, Grid.covering(scene.positions, 0.05), "stratified")
    assert len(scene.triangles) < len(pieces.triangle) <= 1000
