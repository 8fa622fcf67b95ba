"""From one frame of an animation to the next: what moved may be seen elsewhere (host).

Samples stay at their vertices. One on a vertex that did not move traces only the directions in
which something moved, then or now: the others see what they saw. The rest of a frame's work is in
proportion to the samples that are in view.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxvis.compiled import compiled
from jaxvis.methods.distance_field.build import (
    FEWEST,
    NEARBY,
    Angular,
    Sampling,
    Spatial,
    Vertices,
    adapt,
    buried,
    distance_fields,
    in_view,
    place_samples,
    sample_budget,
)
from jaxvis.methods.distance_field.field import DistanceFields
from jaxvis.methods.distance_field.initial import initial_samples
from jaxvis.methods.distance_field.maps import Known
from jaxvis.methods.distance_field.neighbours import Places, nearest_samples
from jaxvis.scene import Scene, Surface
from jaxvis.sphere.hemisphere_grid import texel_directions

CLUSTERS = 32
"""Balls around what moved, at the most."""

COARSE = 32
"""Texels along each side among which directions are found that may have changed."""

REACH = 5.0
"""A place is without samples if its nearest is farther than this many median distances."""


class Balls(NamedTuple):
    """Balls that hold all triangles that moved, before and after."""

    centres: Float[np.ndarray, "balls 3"]
    radii: Float[np.ndarray, "balls"]


def carry_over(
    previous: DistanceFields,
    scene: Scene,
    angular: Angular,
    spatial: Spatial,
    surface: Surface | None = None,
) -> DistanceFields:
    """The fields of the next frame of the scene that ``previous`` was made for.

    Places samples anew if the triangles are others.
    """
    vertices = Vertices.of(scene)
    if not _same_mesh(previous, vertices) or previous.resolution != angular.resolution:
        return place_samples(scene, angular, spatial, surface)
    placed = vertices.samples
    moved = np.any(np.asarray(previous.positions) != placed.positions, axis=-1)
    turned = moved | np.any(np.asarray(previous.normals) != placed.normals, axis=-1)
    shown = in_view(vertices, surface)
    candidates = np.flatnonzero(shown)
    places = vertices.places(NEARBY * spatial.alpha)

    ids = np.asarray(previous.samples)
    used = shown[ids]
    ids = ids[used]
    maps = previous.maps()[used]
    distances = np.asarray(previous.signed_distance)[used]
    old = np.asarray(previous.positions)
    balls = moving_balls(old, placed.positions, placed.triangles, moved)
    # Maps that coarse texels do not divide are looked at texel by texel.
    side = COARSE if angular.resolution % COARSE == 0 else angular.resolution
    stale = stale_texels(vertices, ids, balls, turned[ids], side)
    changed = stale.any(axis=(1, 2))
    sampling = Sampling.none(vertices, angular)
    sampling.adopt(ids[~changed], maps[~changed], distances[~changed])
    again = ids[changed]
    kept = ~buried(vertices, again) if len(again) else np.zeros(0, bool)
    fine = angular.resolution // side
    redone = np.repeat(np.repeat(stale[changed][kept], fine, axis=1), fine, axis=2)
    sampling.add(again[kept], places, Known(maps[changed][kept], redone))
    budget = sample_budget(spatial, len(places.positions))
    budget = min(budget, max(round(previous.density * len(candidates)), FEWEST))
    _fill_gaps(sampling, places, candidates, spatial, budget)
    if changed.any():
        adapt(sampling, places, candidates, spatial, budget, rounds=1)
    return distance_fields(
        sampling,
        places,
        candidates,
        near=spatial.near,
        interpolation=spatial.interpolation,
        density=previous.density,
    )


def _same_mesh(previous: DistanceFields, vertices: Vertices) -> bool:
    same = np.shape(previous.positions) == vertices.samples.positions.shape
    return same and np.array_equal(previous.triangles, vertices.samples.triangles)


def moving_balls(
    before: Float[np.ndarray, "vertices 3"],
    after: Float[np.ndarray, "vertices 3"],
    triangles: Int[np.ndarray, "triangles 3"],
    moved: Bool[np.ndarray, "vertices"],
) -> Balls:
    """Balls round all triangles with a corner that moved, where they were and where they are.

    Triangles are halved along the longest axis of their centres until there are
    :data:`CLUSTERS` groups.
    """
    touched = triangles[moved[triangles].any(axis=1)]
    if not len(touched):
        return Balls(np.zeros((0, 3)), np.zeros(0))
    corners = np.concatenate([before[touched], after[touched]], axis=1).astype(np.float64)
    centre = corners.mean(axis=1)
    groups = [np.arange(len(touched))]
    while len(groups) < CLUSTERS and len(groups[-1]) > 1:
        halves = []
        for group in groups:
            spread = np.ptp(centre[group], axis=0)
            order = group[np.argsort(centre[group, spread.argmax()], kind="stable")]
            halves += [half for half in np.array_split(order, 2) if len(half)]
        groups = halves
    centres, radii = [], []
    for group in groups:
        points = corners[group].reshape(-1, 3)
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        centres.append(middle)
        radii.append(np.linalg.norm(points - middle, axis=-1).max())
    return Balls(np.array(centres), np.array(radii))


def stale_texels(
    vertices: Vertices,
    ids: Int[np.ndarray, "samples"],
    balls: Balls,
    turned: Bool[np.ndarray, "samples"],
    side: int = COARSE,
) -> Bool[np.ndarray, "samples side side"]:
    """Texels of a coarse grid that may see a ball; all of samples that moved themselves."""
    stale = np.zeros((len(ids), side, side), bool)
    stale[turned] = True
    views = vertices.views(ids)
    # A texel's corners are at most this far from its centre: two sides of pi / side at most.
    margin = 0.75 * np.pi / side
    _mark_stale(views.origins, views.frames, texel_directions(side), *balls, margin, turned, stale)
    return stale


def _fill_gaps(
    sampling: Sampling,
    places: Places,
    candidates: Int[np.ndarray, "candidates"],
    spatial: Spatial,
    budget: int,
) -> None:
    """Samples where what came into view is far from any."""
    missing = np.ones(len(candidates), bool)
    if len(sampling.ids):
        own = places.take(sampling.ids)
        error = nearest_samples(own, places.take(candidates), 1).error[:, 0]
        missing = error > REACH * max(float(np.median(error)), 1e-6)
    gap = candidates[missing]
    room = budget - len(sampling.ids)
    share = spatial.initial * spatial.budget
    count = min(int(np.ceil(share * len(gap))), room)
    if count < 1 or not len(gap):
        return
    added = gap[initial_samples(places.take(gap), count)]
    added = np.setdiff1d(added, sampling.ids)
    added = added[~buried(sampling.vertices, added)] if len(added) else added
    if len(added):
        sampling.add(added, places)


@compiled
def _mark_stale(origins, frames, local, centres, radii, margin, whole, stale):
    side = stale.shape[1]
    for sample in range(stale.shape[0]):
        if whole[sample]:
            continue
        for ball in range(len(radii)):
            apart = np.zeros(3)
            square = 0.0
            for axis in range(3):
                apart[axis] = centres[ball, axis] - origins[sample, axis]
                square += apart[axis] * apart[axis]
            distance = np.sqrt(square)
            if distance <= radii[ball] * 1.001:
                stale[sample] = True
                break
            reach = np.arcsin(radii[ball] / distance) + margin
            if reach >= np.pi:
                stale[sample] = True
                break
            least = np.cos(reach)
            toward = np.zeros(3)
            for row in range(3):
                for axis in range(3):
                    toward[row] += frames[sample, row, axis] * apart[axis] / distance
            if toward[2] < -np.sin(min(reach, 0.5 * np.pi)):
                continue
            for i in range(side):
                for j in range(side):
                    u = local[i, j]
                    along = u[0] * toward[0] + u[1] * toward[1] + u[2] * toward[2]
                    if along >= least:
                        stale[sample, i, j] = True
