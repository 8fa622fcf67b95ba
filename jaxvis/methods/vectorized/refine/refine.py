"""Samples are added where polygons interpolate badly, until an error or a budget is met."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Float32
from tqdm.auto import tqdm

from jaxvis.methods.vectorized.polygons import VisibilityPolygons
from jaxvis.methods.vectorized.precompute import Settings
from jaxvis.methods.vectorized.refine.bisection import (
    Edges,
    Leaves,
    bisected,
    closure,
    edges_of,
    numbered,
)
from jaxvis.methods.vectorized.refine.locate import Forest
from jaxvis.methods.vectorized.refine.probes import Probes, probe_centres, probe_edges
from jaxvis.methods.vectorized.refine.samples import Ground, Traced, Vertices, first_vertices
from jaxvis.scene import Scene

SHORTEST = 1.0 / 512.0
"""Of the scene's diagonal: edges shorter than this are not divided."""

BATCH = 0.5
"""Of the greatest need: edges that need it as much are divided together."""


class Goal(NamedTuple):
    """What refinement is for."""

    target: float = 0.02
    """Largest error of a uniform sky's irradiance, as a part of pi."""
    growth: float = 4.0
    """Most bytes, in units of those of the polygons at the vertices alone."""

    def check(self) -> None:
        """Raises ValueError if one is out of range."""
        if not 0.0 < self.target < 1.0:
            raise ValueError(f"refine must be above 0 and below 1, got {self.target}")
        if not self.growth >= 1.0:
            raise ValueError(f"growth must be at least 1, got {self.growth}")


class Refinement(NamedTuple):
    """What refinement did."""

    before: Float32[np.ndarray, "probes"]
    """Errors at the midpoints of the edges of the unrefined triangles, and at the centroids of
    those whose edges all meet the target; as parts of pi."""
    after: Float32[np.ndarray, "probes"]
    """The same of the refined triangles."""
    met: bool
    """Whether no edge that may be divided exceeds the target."""
    traced: int
    """Samples, those that were not kept included."""


class _State(NamedTuple):
    forest: Forest
    leaves: Leaves
    vertices: Vertices
    traced: Traced
    probes: Probes
    centres: Float32[np.ndarray, "nodes"]
    """Errors at the centroids of triangles, NaN where they are not known."""


def refine_polygons(
    scene: Scene,
    polygons: VisibilityPolygons,
    goal: Goal,
    settings: Settings = Settings(),  # noqa: B008 (frozen)
    *,
    progress: bool = True,
) -> tuple[VisibilityPolygons, Refinement]:
    """Polygons also at midpoints of edges, where those at the vertices interpolate badly.

    Args:
        scene: the scene.
        polygons: at its vertices alone.
        goal: the error that is asked for, and the budget.
        settings: how finely visibility is sampled.
        progress: shows a bar.

    Returns:
        (polygons, of which the first are the given ones; what was done)

    Raises:
        ValueError: the goal or a setting is out of range.
    """
    goal.check()
    settings.check()
    ground = Ground.of(scene)
    vertices, traced = first_vertices(polygons)
    count = len(polygons.triangles)
    every = np.arange(count, dtype=np.int32)
    state = _State(
        Forest.whole(count),
        Leaves(np.asarray(polygons.triangles), every, every),
        vertices,
        traced,
        Probes.none(),
        np.full(count, np.nan, np.float32),
    )
    before = None
    with tqdm(desc="refinement", unit="sample", disable=not progress) as bar:
        while True:
            state, edges = _probed(ground, settings, state, goal.target)
            bar.update(len(state.traced.counts) - bar.n)
            if before is None:
                before = _errors(state, edges)
            need = _need(state, edges, goal.target, SHORTEST * scene.diagonal)
            marked = _affordable(state, edges, need, goal.growth * polygons.nbytes)
            if not marked.any():
                break
            state = _divided(state, edges, marked)
    found = _collected(state, polygons)
    return found, Refinement(
        before, _errors(state, edges), not need.any(), len(state.traced.counts)
    )


def _probed(
    ground: Ground, settings: Settings, state: _State, target: float
) -> tuple[_State, Edges]:
    """With probes on all edges, and in triangles whose edges all meet the target."""
    edges = edges_of(state.leaves, state.vertices.positions)
    vertices, traced, probes = probe_edges(
        ground, settings, state.vertices, state.traced, state.probes, state.leaves, edges
    )
    meets = (probes.of(edges).error <= target)[edges.of].all(axis=1)
    chosen = np.flatnonzero(meets & np.isnan(state.centres[state.leaves.node]))
    leaves = Leaves(*(field[chosen] for field in state.leaves))
    centres = state.centres.copy()
    # These samples are not kept: half the resolution shows what they miss.
    half = settings._replace(resolution=settings.coarsest)
    centres[leaves.node] = probe_centres(ground, half, vertices, traced, leaves)
    return state._replace(vertices=vertices, traced=traced, probes=probes, centres=centres), edges


def _errors(state: _State, edges: Edges) -> Float32[np.ndarray, "probes"]:
    """At all probes of the triangles as they are."""
    centres = state.centres[state.leaves.node]
    error = state.probes.of(edges).error
    return np.concatenate([error, centres[~np.isnan(centres)]])


def _need(
    state: _State, edges: Edges, target: float, shortest: float
) -> Float[np.ndarray, "joints"]:
    """How much each joint should be divided: the error times the length, 0 where it may stay."""
    error = state.probes.of(edges).error
    longest = np.take_along_axis(edges.of, edges.longest[:, None], axis=1)[:, 0]
    centres = np.nan_to_num(state.centres[state.leaves.node])
    np.maximum.at(error, longest, np.where(centres > target, centres, 0.0))
    need = np.where((error > target) & (edges.length >= shortest), error * edges.length, 0.0)
    joints = np.zeros(int(edges.joint.max(initial=-1)) + 1)
    np.maximum.at(joints, edges.joint, need)
    return joints


def _affordable(
    state: _State, edges: Edges, need: Float[np.ndarray, "joints"], budget: float
) -> Bool[np.ndarray, "joints"]:
    """The joints that need it most, and all that must be divided with them; none if none fits."""
    order = np.argsort(-need, kind="stable")
    greatest = need.max(initial=0.0)
    most = int(np.count_nonzero(need >= BATCH * greatest)) if greatest > 0.0 else 0

    def first(number: int) -> Bool[np.ndarray, "joints"]:
        marked = np.zeros(len(need), bool)
        marked[order[:number]] = True
        return closure(edges, marked)

    def fits(number: int) -> bool:
        return _bytes_after(state, edges, first(number)) <= budget

    if fits(most):
        return first(most)
    fitting = 0
    while most - fitting > 1:
        middle = (fitting + most) // 2
        fitting, most = (middle, most) if fits(middle) else (fitting, middle)
    return first(fitting)


def _bytes_after(state: _State, edges: Edges, marked: Bool[np.ndarray, "joints"]) -> int:
    """Of the polygons if these joints are divided."""
    divided = marked[edges.joint]
    midpoints = state.probes.of(edges).midpoint[divided]
    used = np.zeros(len(state.vertices.front), bool)
    used[state.leaves.corners] = True
    used[midpoints] = True
    vertices = state.vertices
    samples = int(np.count_nonzero(used) + np.count_nonzero(vertices.back[used] >= 0))
    row = sum(field[:1].nbytes for field in state.traced)
    new = int(np.count_nonzero(divided[edges.of]))
    sides = 2 if (vertices.back >= 0).any() else 1
    leaves = len(state.leaves.root) + new
    nodes = len(state.forest.splits) + 2 * new
    return samples * row + leaves * sides * 12 + nodes * 5


def _divided(state: _State, edges: Edges, marked: Bool[np.ndarray, "joints"]) -> _State:
    """With the marked joints divided."""
    midpoints = state.probes.of(edges).midpoint
    forest, leaves = bisected(state.forest, state.leaves, edges, marked, midpoints)
    new = len(forest.splits) - len(state.centres)
    centres = np.concatenate([state.centres, np.full(new, np.nan, np.float32)])
    return state._replace(forest=forest, leaves=leaves, centres=centres)


def _collected(state: _State, polygons: VisibilityPolygons) -> VisibilityPolygons:
    """The samples at the corners of triangles."""
    forest, leaves = numbered(state.forest, state.leaves)
    if len(forest.splits) == len(polygons.triangles):
        return polygons
    vertices = state.vertices
    triangles = vertices.front[leaves.corners]
    backs = np.zeros((0, 3), np.int32)
    if len(polygons.backs):
        turned = np.asarray(polygons.backs)[leaves.root, :1] >= 0
        backs = np.where(turned, vertices.back[leaves.corners], np.int32(-1))
    used = np.zeros(len(state.traced.counts), bool)
    used[: len(polygons.counts)] = True
    used[triangles] = True
    used[backs[backs >= 0]] = True
    number = np.where(used, np.cumsum(used) - 1, -1).astype(np.int32)
    kept = state.traced.take(np.flatnonzero(used))
    return VisibilityPolygons(
        **{name: jnp.asarray(field) for name, field in kept._asdict().items()},
        triangles=jnp.asarray(number[triangles]),
        backs=jnp.asarray(np.where(backs >= 0, number[backs], np.int32(-1))),
        splits=jnp.asarray(forest.splits),
        children=jnp.asarray(forest.children),
    )
