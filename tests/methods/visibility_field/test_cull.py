"""Which rays are traced: rules by hand, decisions against one ray at a time."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.methods.traced import shading_points
from jaxvis.methods.visibility_field import cull
from jaxvis.methods.visibility_field.cull import (
    ACCEPT,
    BOTH,
    DROP,
    TRACE,
    TRACE_ALL,
    UNKNOWN,
    Table,
    decide,
    decision_of,
    locate,
    rule,
    rules,
)
from jaxvis.methods.visibility_field.field import packed
from jaxvis.methods.visibility_field.grid import Grid
from jaxvis.scene.builtin import builtin_scene
from jaxvis.sphere import octahedral
from tests.methods.known_scenes import MATERIALS, SCENES
from tests.methods.visibility_field.made_fields import (
    LABELS,
    NEITHER,
    VO,
    O,
    V,
    by_component,
    cells_at,
    fate,
    filled,
    inside_texels,
    label_of,
    of_texels,
)

STATES = (NEITHER, V, O, VO)

# Cells of 2 x 2 texels: (what is in them, label by the paper's rule, label by the balanced one).
CELLS = [
    ((V, V, V, O), 0, 0),
    ((O, O, O, NEITHER), 1, 1),
    ((O, O, VO, VO), 1, 1),
    ((V, VO, NEITHER, NEITHER), 0, 0),
    ((O, NEITHER, NEITHER, NEITHER), 0, 1),  # little is known to be occluded, nothing visible
    ((VO, VO, VO, V), 1, 0),
    ((O, O, V, V), 0, 0),  # half is not more than half
    ((NEITHER,) * 4, 0, 0),
]


def tiny_field():
    scene = builtin_scene("plane")
    texels = np.array([texels for texels, _, _ in CELLS]).reshape(-1, 2, 2)
    return of_texels(scene, Grid.covering(scene.positions, 4.0), 3 * np.arange(len(CELLS)), texels)


def table_of(chosen):
    """Decisions for the four states of a texel."""
    return {state: (int(chosen) >> (2 * state)) & 3 for state in STATES}


def test_a_rule_holds_four_decisions():
    assert (UNKNOWN, BOTH) == (NEITHER, VO)
    assert len({DROP, ACCEPT, TRACE}) == 3
    made = table_of(rule(DROP, ACCEPT, TRACE, ACCEPT))
    assert made == {NEITHER: DROP, V: ACCEPT, O: TRACE, VO: ACCEPT}
    assert set(table_of(TRACE_ALL).values()) == {TRACE}


def test_four_states_need_no_labels():
    chosen, inverted = rules(tiny_field(), "four-state", conservative=False)
    for row in chosen[:-1]:
        assert table_of(row) == {NEITHER: TRACE, V: ACCEPT, O: DROP, VO: TRACE}
    assert not np.asarray(inverted).any()
    careful, _ = rules(tiny_field(), "four-state", conservative=True)
    np.testing.assert_array_equal(careful, chosen)


@pytest.mark.parametrize("conservative", [False, True])
@pytest.mark.parametrize(("labels", "column"), [("paper", 1), ("balanced", 2), ("visible", None)])
def test_rules_follow_each_cells_label(labels, column, conservative):
    chosen, inverted = rules(tiny_field(), labels, conservative=conservative)
    for cell, row, zero in zip(CELLS, chosen, inverted, strict=False):
        label = 1 if column is None else cell[column]
        assert label_of(np.array(cell[0]), labels) == label
        assert bool(zero) == (label == 0)
        expected = {s: fate(s, label, conservative=conservative) for s in STATES}
        assert table_of(row) == expected
    unknown = {table_of(row)[NEITHER] for row in chosen[:-1]}
    if conservative:
        assert unknown == {TRACE}
    else:
        assert unknown <= {DROP, ACCEPT}


@pytest.mark.parametrize("labels", LABELS)
def test_the_last_row_traces_everything_and_is_not_inverted(labels):
    chosen, inverted = rules(tiny_field(), labels, conservative=False)
    assert len(chosen) == len(inverted) == len(CELLS) + 1
    assert int(chosen[-1]) == TRACE_ALL
    assert not bool(inverted[-1])


@pytest.mark.parametrize("labels", LABELS[1:])
@pytest.mark.parametrize("conservative", [False, True])
def test_glossy_rays_ignore_labels(labels, conservative):
    """Section 6: what may be visible is traced, whatever the label."""
    chosen, inverted = rules(tiny_field(), labels, conservative=conservative, inverted=False)
    visible, _ = rules(tiny_field(), "visible", conservative=conservative)
    np.testing.assert_array_equal(chosen, visible)
    assert not np.asarray(inverted).any()


@pytest.mark.parametrize("size", [1, 7, 18, 33])
@pytest.mark.parametrize("labels", LABELS)
def test_decisions_are_those_of_one_ray_at_a_time(size, labels):
    rng = np.random.default_rng(size)
    cells, points, samples = 5, 24, 40
    texels = rng.integers(0, 4, (cells, size, size)).astype(np.uint8)
    texels[1][texels[1] == O] = V  # so that there are cells of both labels
    texels[2][texels[2] == V] = O
    scene = builtin_scene("plane")
    grid = Grid.covering(scene.positions, 4.0)
    stored = of_texels(scene, grid, np.sort(rng.choice(grid.cells, cells, False)), texels)
    row = rng.integers(0, cells, points)
    above = rng.random((points, samples)) < 0.8
    directions, i, j = inside_texels(rng, size, (points, samples))
    conservative = bool(size % 2)
    chosen, _ = rules(stored, labels, conservative=conservative)
    found = decide(
        jnp.asarray(stored.words),
        jnp.asarray(row),
        chosen[row],
        jnp.asarray(above),
        by_component(directions),
        size=size,
    )
    expected = np.zeros((points, samples), np.uint8)
    four_state = labels == "four-state"
    for point in range(points):
        label = label_of(texels[row[point]], labels)
        for ray in range(samples):
            state = int(texels[row[point], i[point, ray], j[point, ray]])
            decision = fate(state, label, four_state=four_state, conservative=conservative)
            expected[point, ray] = decision if above[point, ray] else DROP
    np.testing.assert_array_equal(found, expected)
    assert found.dtype == jnp.uint8


def test_the_words_of_large_masks_are_all_reached():
    """One texel at a time in a mask of many words."""
    size = 33
    texels = np.full((2, size, size), V, np.uint8)
    rng = np.random.default_rng(0)
    marked = rng.integers(0, size, (40, 2))
    texels[1][tuple(marked.T)] = O
    points = 2.0 * (marked + 0.5) / size - 1.0
    directions = np.asarray(octahedral.decode(jnp.asarray(points, jnp.float32)))[None]
    chosen = jnp.full(1, rule(TRACE, ACCEPT, DROP, TRACE), jnp.uint32)
    for row, decision in ((0, ACCEPT), (1, DROP)):
        found = decide(
            jnp.asarray(packed(texels)),
            jnp.array([row]),
            chosen,
            jnp.ones((1, 40), bool),
            by_component(directions),
            size=size,
        )
        assert np.all(np.asarray(found) == decision)


def some_points():
    """Points of the box and its plane, with rays all around each."""
    known = SCENES[2]
    points = shading_points(known.surface(*MATERIALS["diffuse"]))
    directions = np.random.default_rng(0).normal(size=(len(points.pixel), 8, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    return known.load(), points, directions.astype(np.float32)


def above(points, directions):
    return np.einsum("pc,psc->ps", points.geometric_normal, directions) > 0.0


def test_what_is_below_its_triangle_is_dropped_and_without_a_field_the_rest_is_traced():
    _, points, directions = some_points()
    found = np.asarray(decision_of(None, points, by_component(directions)))
    np.testing.assert_array_equal(found, np.where(above(points, directions), TRACE, DROP))
    assert 0.4 < (found == TRACE).mean() < 0.6


@pytest.mark.parametrize("state", STATES)
def test_points_outside_the_grid_or_in_cells_without_masks_are_traced_never_black(state):
    scene, points, directions = some_points()
    stored = filled(scene, state, edge=1.0)
    near = np.asarray(points.origin)[:, 0] > 0.5
    here = cells_at(stored.grid, points.origin)
    kept = ~np.isin(np.asarray(stored.keys), here[near])
    texels = np.full((kept.sum(), 6, 6), state)
    holes = of_texels(scene, stored.grid, np.asarray(stored.keys)[kept], texels)
    without = ~np.isin(here, np.asarray(holes.keys))
    assert 0.1 < without.mean() < 0.9, without.mean()
    chosen, _ = rules(holes, "four-state", conservative=False)
    table = Table.of(holes, chosen)
    np.testing.assert_array_equal(np.asarray(locate(table, points)) == -1, without)
    found = np.asarray(decision_of(table, points, by_component(directions)))
    up = above(points, directions)
    assert np.all(found[without] == np.where(up, TRACE, DROP)[without])
    expected = fate(state, 1, four_state=True)
    assert np.all(found[~without] == np.where(up, expected, DROP)[~without])

    outside = replace(points, origin=points.origin + jnp.array([1e3, 0.0, 0.0]))
    assert np.all(np.asarray(locate(table, outside)) == -1)
    found = np.asarray(decision_of(table, outside, by_component(directions)))
    np.testing.assert_array_equal(found, np.where(up, TRACE, DROP))


def test_a_field_without_cells_traces_everything():
    scene, points, directions = some_points()
    empty = of_texels(scene, Grid.covering(scene.positions, 1.0), [], np.zeros((0, 6, 6)))
    for labels in LABELS:
        chosen, _ = rules(empty, labels, conservative=False)
        found = np.asarray(decision_of(Table.of(empty, chosen), points, by_component(directions)))
        np.testing.assert_array_equal(found, np.where(above(points, directions), TRACE, DROP))


def test_points_find_their_own_cells_masks():
    scene, points, directions = some_points()
    grid = Grid.covering(scene.positions, 0.7)
    keys = np.unique(cells_at(grid, points.origin))
    states = np.random.default_rng(1).integers(0, 4, len(keys))
    stored = of_texels(scene, grid, keys, np.tile(states[:, None, None], (1, 4, 4)))
    chosen, _ = rules(stored, "four-state", conservative=False)
    table = Table.of(stored, chosen)
    row = np.searchsorted(keys, cells_at(grid, points.origin))
    np.testing.assert_array_equal(locate(table, points), row)
    found = np.asarray(decision_of(table, points, by_component(directions)))
    fates = np.array([fate(int(state), 1, four_state=True) for state in states])
    expected = np.where(above(points, directions), fates[row][:, None], DROP)
    np.testing.assert_array_equal(found, expected)


def test_tables_pass_through_jit():
    scene, points, directions = some_points()
    stored = filled(scene, VO)
    table = Table.of(stored, rules(stored, "paper", conservative=True)[0])
    assert all(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(table))
    before = cull.decision_of._cache_size()
    decision_of(table, points, by_component(directions))
    other = Table.of(stored, rules(stored, "four-state", conservative=True)[0])
    decision_of(other, points, by_component(directions))
    assert cull.decision_of._cache_size() <= before + 1  # other rules are no other program
