"""Pictures of a correspondence: what is drawn where."""

import numpy as np
import pytest
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.colors import to_rgb

from jaxvis.methods.vectorized.correspondence.candidates import Layout, rgb_tripoints
from jaxvis.report import draw_correspondence, draw_seams
from jaxvis.report.correspondence import (
    CORNER_COLOURS,
    entity_heights,
    equal_area,
    tripoints,
    unrolled,
    voronoi_picture,
)
from tests.methods.corresponding_polygons import SIDES, two_triangles


def layout_of(*corners: np.ndarray) -> Layout:
    """One face, whose corners see these unit vectors."""
    capacity = max(map(len, corners))
    rows = [np.concatenate([c, np.repeat(c[-1:], capacity - len(c), axis=0)]) for c in corners]
    directions = np.stack(rows)[None].astype(np.float32)
    counts = np.array([[len(c) for c in corners]], np.int32)
    return Layout(directions, np.zeros_like(directions), counts, np.ones(1, np.float32))


def random_directions(count: int, seed: int) -> np.ndarray:
    points = np.random.default_rng(seed).standard_normal((count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def test_unrolled_counts_on_from_the_first_triple_to_its_return():
    triples = np.array([[2, 0, 1], [3, 1, 1], [0, 2, 2], [1, 2, 0]])
    steps = unrolled(triples, np.array([4, 3, 3]))
    assert steps.tolist() == [[0, 0, 0], [1, 1, 0], [2, 2, 1], [3, 2, 2], [4, 3, 3]]


def test_entities_lie_in_the_middle_of_their_triples():
    assert entity_heights(np.array([0, 0, 0, 1, 2])).tolist() == [0.25, 0.75, 1.0]


def test_the_projection_keeps_areas():
    directions = random_directions(20000, seed=1)
    at, above = equal_area(directions, np.eye(3))
    assert (above == (directions[:, 2] >= 0.0)).all()
    radius = np.linalg.norm(at[above], axis=1)
    assert radius.max() <= 1.0
    # As many directions in each ring of equal area.
    counts, _ = np.histogram(radius**2, np.linspace(0.0, 1.0, 5))
    np.testing.assert_allclose(counts / above.sum(), 0.25, atol=0.02)


def test_the_tripoint_of_three_axes_is_their_mean():
    found = tripoints(layout_of(*np.eye(3)[:, None]))
    assert found.triples.tolist() == [[0, 0, 0]]
    np.testing.assert_allclose(found.directions, np.full((1, 3), 3**-0.5), atol=1e-6)
    np.testing.assert_allclose(found.distances, 1.5 * np.pi, atol=1e-6)


def test_tripoints_are_voronoi_vertices_and_candidates():
    seen = layout_of(*(random_directions(30, seed=k) for k in range(3)))
    found = tripoints(seen)
    candidates = rgb_tripoints(seen, tangent=None, seed=0)
    assert len(found.triples) > 10
    assert sorted(found.triples.tolist()) == sorted(candidates.triples.tolist())
    cosines = found.directions @ seen.directions.reshape(-1, 3).T
    own = np.stack(
        [cosines[np.arange(len(cosines)), 30 * k + found.triples[:, k]] for k in range(3)]
    )
    np.testing.assert_allclose(own, np.tile(cosines.max(axis=1), (3, 1)), atol=1e-5)


def test_cells_have_the_colour_of_the_nearest_site():
    sites, corner = random_directions(24, seed=4), np.arange(24) % 3
    pixels = 64
    picture = voronoi_picture(sites, corner, np.eye(3), pixels)
    assert picture[0, 0, 3] == 0.0
    assert picture[pixels // 2, pixels // 2, 3] == 1.0
    pure = np.array([to_rgb(colour) for colour in CORNER_COLOURS])
    for direction in random_directions(300, seed=5):
        (at,), (above,) = equal_area(direction[None], np.eye(3))
        nearest = np.sort(sites @ direction)[-2:]
        if above and nearest[1] - nearest[0] > 0.1:  # clear of the cells' borders
            column, row = int((at[0] + 1.0) * pixels / 2), int((1.0 - at[1]) * pixels / 2)
            own = pure[corner[np.argmax(sites @ direction)]]
            shown = picture[row, column, :3]
            assert np.argmax(shown) == np.argmax(own)


def test_a_layout_has_a_dot_for_each_entity_and_a_line_for_each_triple():
    visibility = two_triangles(shift=1)
    left, right = draw_correspondence(visibility, 1).axes
    lines = [c for c in left.collections if isinstance(c, LineCollection)]
    assert sum(len(c.get_paths()) for c in lines) == SIDES + 1  # the first comes back at the end
    dots = [c for c in left.collections if isinstance(c, PathCollection)]
    assert [len(c.get_offsets()) for c in dots] == [SIDES + 1] * 3
    assert f"{SIDES} triples, {SIDES} evaluated" in left.get_title()
    assert "RGB tripoints" in right.get_title()


def test_a_separate_face_has_no_lines():
    left, _ = draw_correspondence(two_triangles(separate=True), 1).axes
    assert not any(isinstance(c, LineCollection) for c in left.collections)
    assert "three evaluations" in left.get_title()


@pytest.mark.parametrize("triangle", [-1, 2])
def test_other_triangles_are_refused(triangle):
    with pytest.raises(ValueError, match=f"triangle must be from 0 to 1, got {triangle}"):
        draw_correspondence(two_triangles(), triangle)


def test_seams_are_summed_up_and_all_counted():
    percent = np.array([0.0, 0.5, 1.0, 250.0])
    (axes,) = draw_seams({"pixels": percent, "none": np.zeros(0)}).axes
    (label,) = (text.get_text() for text in axes.get_legend().get_texts())
    assert label.startswith("pixels: mean 63 %")
    assert label.endswith("largest 2.5e+02 %")
    (steps,) = (p for p in axes.patches if hasattr(p, "get_data"))
    assert steps.get_data().values.sum() == pytest.approx(100.0)
