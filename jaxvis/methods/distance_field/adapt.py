"""Where samples are needed and where they are not (paper 002, section 4.3; host)."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int32
from scipy.spatial import KDTree

from jaxvis.cores import core_count
from jaxvis.methods.distance_field.coefficients import magnitude, visibility_error
from jaxvis.methods.distance_field.neighbours import (
    NEARER,
    Interpolation,
    Nearest,
    Places,
    isolated,
    nearest_samples,
    weights,
)

REACH = 2.5
"""Range of neighbours, in median distances (eq. 6) to the nearest one."""

FEWEST, MOST = 3, 12
"""Neighbours of a sample, in range or not."""


class Plan(NamedTuple):
    """How the samples change."""

    insert: Int32[np.ndarray, "inserted"]
    """Places that become samples, the most needed first."""
    erase: Bool[np.ndarray, "samples"]
    """Samples that go."""
    error: Float32[np.ndarray, "samples"]
    """Relative visibility error of what the neighbours say of each sample."""


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
    return Nearest(np.where(outside, -1, found), np.where(outside, np.float32(np.inf), error))


def plan(
    places: Places,
    samples: Int[np.ndarray, "samples"],
    coefficients: Float[np.ndarray, "samples 16"],
    near: Nearest,
    *,
    largest: float,
    least: float,
    interpolation: Interpolation,
) -> Plan:
    """Which places to add to the samples and which samples to drop.

    A sample that its neighbours foretell (eq. 8, on coefficients) with a relative error above
    ``largest`` gets new ones halfway to those neighbours that differ from it by more than that;
    one that they foretell with less than ``least`` goes if this is true of no neighbour of it.

    Args:
        places: all that could be samples.
        samples: indices of those that are.
        coefficients: of their maps.
        near: their neighbours, as indices into ``samples``.
        largest, least: relative errors E_v,max and E_v,min.
        interpolation: how neighbours foretell.
    """
    own = places.take(samples)
    share = weights(own, own, near, interpolation)
    there = near.samples >= 0
    around = coefficients[np.where(there, near.samples, 0)]
    foretold = np.einsum("sk,skb->sb", share, around)
    size = magnitude(coefficients)
    error = (visibility_error(coefficients, foretold) / size).astype(np.float32)
    pairs = visibility_error(coefficients[:, None], around) / size[:, None]
    wanted = there & (error[:, None] > largest) & (pairs > largest)
    insert = _between(places, samples, near, wanted, np.minimum(error[:, None], pairs))
    erase = isolated(error < least, near)
    return Plan(insert, erase, error)


def _between(
    places: Places,
    samples: Int[np.ndarray, "samples"],
    near: Nearest,
    wanted: Bool[np.ndarray, "samples near"],
    need: Float[np.ndarray, "samples near"],
) -> Int32[np.ndarray, "inserted"]:
    """Places nearest the middles of pairs that are none of the samples, in order of need."""
    first, slot = np.nonzero(wanted)
    if not len(first):
        return np.zeros(0, np.int32)
    a, b = samples[first], samples[near.samples[first, slot]]
    middle = 0.5 * (places.positions[a] + places.positions[b])
    normal = places.normals[a] + places.normals[b]
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = normal / np.maximum(length, NEARER)
    wanted_places = np.concatenate([middle, normal], axis=-1)
    _, found = KDTree(places.joint).query(wanted_places, workers=core_count())
    found = np.asarray(found)
    taken = np.zeros(len(places.positions), bool)
    taken[samples] = True
    free = ~taken[found]
    found, need = found[free], need[first, slot][free]
    order = np.argsort(-need, kind="stable")
    _, once = np.unique(found[order], return_index=True)
    return found[order][np.sort(once)].astype(np.int32)
