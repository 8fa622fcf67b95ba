"""Where samples are needed and where they are not (paper 002, section 4.3; host)."""

from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Bool, Float32, Int, Int32

from jaxvis.cores import core_count
from jaxvis.methods.distance_field.foretold import Foretold
from jaxvis.methods.distance_field.neighbours import (
    NEARER,
    Nearest,
    Places,
    geometric_error,
    isolated,
    nearest_samples,
)

REACH = 2.5
"""Range of neighbours, in median distances (eq. 6) to the nearest one."""

FEWEST, MOST = 3, 12
"""Neighbours of a sample, in range or not."""


class Plan(NamedTuple):
    """How the samples change."""

    insert: Int32[np.ndarray, "inserted"]
    """Places that become samples, the most needed first."""
    need: Float32[np.ndarray, "inserted"]
    """The relative error for which each is inserted."""
    erase: Bool[np.ndarray, "samples"]
    """Samples that go."""


def neighbours(samples: Places) -> Nearest:
    """Other samples in the range of each: at least :data:`FEWEST`, at most :data:`MOST`."""
    near = nearest_samples(samples, samples, MOST + 1)
    # The sample itself is among them, if not always first: its twin may lie at the same place.
    own = near.samples == np.arange(len(samples.positions))[:, None]
    order = np.argsort(own, axis=1, kind="stable")[:, :MOST]
    found = np.take_along_axis(near.samples, order, axis=1)
    error = np.take_along_axis(near.error, order, axis=1)
    finite = error[:, 0][np.isfinite(error[:, 0])]
    reach = REACH * np.median(finite) if len(finite) else 0.0
    outside = (error > reach) & (np.arange(MOST) >= FEWEST)
    connected = np.take_along_axis(near.connected, order, axis=1) & ~outside
    return Nearest(
        np.where(outside, -1, found), np.where(outside, np.float32(np.inf), error), connected
    )


def plan(
    places: Places,
    allowed: Bool[np.ndarray, "places"],
    samples: Int[np.ndarray, "samples"],
    near: Nearest,
    found: Foretold,
    *,
    largest: float,
    least: float,
) -> Plan:
    """Which places to add to the samples and which samples to drop.

    A sample that its neighbours foretell with a relative error above ``largest`` gets new ones
    halfway to those neighbours that differ from it by more than that; one that they foretell with
    less than ``least`` goes if this is true of no neighbour of it.

    Args:
        places: all vertices.
        allowed: which of them could be samples.
        samples: indices of those that are.
        near: their neighbours, as indices into ``samples``.
        found: how far off these are.
        largest, least: relative errors E_v,max and E_v,min.
    """
    need = np.minimum(found.error[:, None], found.pairs)
    free = allowed.copy()
    free[samples] = False
    wanted = (near.samples >= 0) & (need > largest)
    insert = _between(places, np.flatnonzero(free), samples, near, wanted, need)
    return Plan(*insert, isolated(found.error < least, near))


def _between(
    places: Places,
    free: Int[np.ndarray, "free"],
    samples: Int[np.ndarray, "samples"],
    near: Nearest,
    wanted: Bool[np.ndarray, "samples near"],
    need: Float32[np.ndarray, "samples near"],
) -> tuple[Int32[np.ndarray, "inserted"], Float32[np.ndarray, "inserted"]]:
    """Free places nearest the middles of pairs, and nearer than their ends, in order of need."""
    first, slot = np.nonzero(wanted)
    if not len(first) or not len(free):
        return np.zeros(0, np.int32), np.zeros(0, np.float32)
    a, b = (places.take(ends) for ends in (samples[first], samples[near.samples[first, slot]]))
    normal = a.normals + b.normals
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    middle = Places.of(0.5 * (a.positions + b.positions), normal / np.maximum(length, NEARER), 1.0)
    _, found = scipy.spatial.KDTree(places.joint[free]).query(middle.joint, workers=core_count())
    found = free[np.asarray(found)]
    apart = near.error[first, slot]
    inside = geometric_error(places.take(found), middle) < 0.5 * apart
    found, need = found[inside], need[first, slot][inside]
    return most_needed(found, need, found)


def most_needed(
    places: Int[np.ndarray, "places"],
    need: Float32[np.ndarray, "places"],
    groups: Int[np.ndarray, "places"],
) -> tuple[Int32[np.ndarray, "groups"], Float32[np.ndarray, "groups"]]:
    """The most needed place of each group with its need, in order of that."""
    order = np.argsort(-need, kind="stable")
    _, once = np.unique(groups[order], return_index=True)
    chosen = order[np.sort(once)]
    return places[chosen].astype(np.int32), need[chosen]
