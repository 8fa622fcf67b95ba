"""Which samples are near a place, and how much each counts there (paper 002, eqs. 6, 8; host)."""

from typing import Literal, NamedTuple, get_args

import numpy as np
import scipy
from jaxtyping import Bool, Float, Float32, Int, Int32

from jaxvis.compiled import compiled
from jaxvis.cores import core_count

Interpolation = Literal["linear", "inverse"]

NEARER = 1e-4
"""Added to errors, so that their inverses are finite (in units of eq. 6)."""

OPPOSED = 0.5
"""Cosine below which a sample's normal is another side's, as long as :data:`FEWEST` remain."""

FEWEST = 3
"""Samples that are enough to leave out those that face another way or are on other surfaces."""

LARGEST_SUM = 1.5
"""Of the weights' absolute values: linear functions are not continued far beyond the samples."""

ELSEWHERE = 100.0
"""Distance between surfaces in the joint space, more than their places can be apart."""

STIFFNESS = 3e-3
"""How soon the linear fit gives way to the constant one where samples stand in a line."""


class Places(NamedTuple):
    """Points of surfaces with their normals, in lengths in which eq. 6 weighs them equally."""

    positions: Float32[np.ndarray, "places 3"]
    """Times alpha, over the scene's diagonal."""
    normals: Float32[np.ndarray, "places 3"]
    parts: Int32[np.ndarray, "places"]
    """Which connected surface each is on."""

    @staticmethod
    def of(
        positions: Float[np.ndarray, "places 3"],
        normals: Float[np.ndarray, "places 3"],
        scale: float,
        parts: Int[np.ndarray, "places"] | None = None,
    ) -> "Places":
        """Positions are multiplied by ``scale``, alpha over the scene's diagonal. All are on one
        surface unless ``parts`` tells."""
        scaled = np.ascontiguousarray(scale * positions, np.float32)
        parts = np.zeros(len(scaled), np.int32) if parts is None else parts.astype(np.int32)
        return Places(scaled, np.ascontiguousarray(normals, np.float32), parts)

    def take(self, chosen: np.ndarray) -> "Places":
        """Some of them."""
        return Places(*(field[chosen] for field in self))

    @property
    def joint(self) -> Float32[np.ndarray, "places 6"]:
        """Both as one vector, whose Euclidean distance bounds eq. 6 within a factor of sqrt(2)."""
        return np.concatenate([self.positions, self.normals], axis=-1)


class Nearest(NamedTuple):
    """Samples near places, by eq. 6, nearest first. Numbers are those of the samples; -1 is none.

    ``error`` is e_g = alpha |dx| + |dn|, infinite where there is none.
    """

    samples: Int32[np.ndarray, "places near"]
    error: Float32[np.ndarray, "places near"]
    connected: Bool[np.ndarray, "places near"]
    """Whether sample and place are on one connected surface."""


def geometric_error(a: Places, b: Places) -> Float32[np.ndarray, "*places"]:
    """e_g between places that broadcast (eq. 6): alpha |x - y| + |n - m|."""
    apart = np.linalg.norm(a.positions - b.positions, axis=-1)
    return apart + np.linalg.norm(a.normals - b.normals, axis=-1)


def nearest_samples(samples: Places, places: Places, count: int) -> Nearest:
    """The ``count`` samples of least e_g, those on each place's own surface before all others.

    They are chosen among twice as many nearest in the joint space.
    """
    found = _pool(samples, places, min(2 * count, len(samples.positions)))
    error = geometric_error(Places(*(f[:, None] for f in places)), samples.take(found))
    connected = samples.parts[found] == places.parts[:, None]
    order = np.lexsort((error, ~connected), axis=1)[:, :count]
    missing = ((0, 0), (0, count - order.shape[1]))
    fields = (found.astype(np.int32), -1), (error.astype(np.float32), np.inf), (connected, False)
    return Nearest(
        *(
            np.pad(np.take_along_axis(values, order, axis=1), missing, constant_values=none)
            for values, none in fields
        )
    )


def _pool(samples: Places, places: Places, count: int) -> Int[np.ndarray, "places count"]:
    """Samples nearest to places in the joint space, on the same surface where it has any."""
    if not count:
        return np.zeros((len(places.positions), 0), np.int64)
    workers = core_count()
    tree = scipy.spatial.KDTree(np.column_stack([samples.joint, ELSEWHERE * samples.parts]))
    joint = np.column_stack([places.joint, ELSEWHERE * places.parts])
    found = tree.query(joint, count, workers=workers)[1].reshape(len(joint), count)
    # Surfaces without samples take those of others, whose numbers mean nothing.
    bare = ~np.isin(places.parts, samples.parts)
    if bare.any():
        tree = scipy.spatial.KDTree(samples.joint)
        found[bare] = tree.query(places.joint[bare], count, workers=workers)[1].reshape(-1, count)
    return found


def check_interpolation(interpolation: str) -> None:
    """Raises ValueError unless it is one of :data:`Interpolation`."""
    if interpolation not in get_args(Interpolation):
        allowed = " or ".join(get_args(Interpolation))
        raise ValueError(f"interpolation must be {allowed}, got {interpolation!r}")


def weights(
    samples: Places,
    places: Places,
    near: Nearest,
    interpolation: Interpolation = "linear",
) -> Float32[np.ndarray, "places near"]:
    """How much each of the nearest samples counts at a place; they add up to 1.

    ``"inverse"`` is the paper's: in proportion to 1 / e_g (eq. 8). ``"linear"`` adds what makes
    functions that are linear over the tangent plane nearly exact (a moving least squares fit, held
    back where samples stand in a line, with weights
    1 / e_g^2 that fall to 0 at the last sample, so that nothing jumps where the set changes);
    weights may then be negative. A place on a sample has that sample's value. Samples that are on
    surfaces not connected with the place's, or whose normals are more than 60 degrees away, do not
    count if enough others are near.
    """
    check_interpolation(interpolation)
    result = np.zeros(near.samples.shape, np.float32)
    _weigh(
        samples.positions,
        samples.normals,
        places.positions,
        places.normals,
        near.samples,
        near.error,
        near.connected,
        interpolation == "linear",
        result,
    )
    return result


def isolated(candidates: Bool[np.ndarray, "samples"], near: Nearest) -> Bool[np.ndarray, "samples"]:
    """Candidates none of whose neighbours is a candidate (paper 002, section 4.3)."""
    there = near.samples >= 0
    beside = np.any(there & candidates[np.where(there, near.samples, 0)], axis=1)
    return candidates & ~beside


@compiled
def _weigh(positions, normals, at, upright, near, error, connected, linear, result):
    slots = near.shape[1]
    usable = np.zeros(slots, np.bool_)
    for place in range(len(at)):
        if slots and near[place, 0] >= 0 and error[place, 0] <= NEARER:
            result[place, 0] = 1.0
            continue
        chosen = _choose(normals, upright[place], near[place], connected[place], usable)
        if chosen == 0:
            continue
        far = 0.0
        for k in range(slots):
            if usable[k]:
                far = max(far, error[place, k] * 1.001)
        total = 0.0
        for k in range(slots):
            if not usable[k]:
                continue
            weight = 1.0 / (error[place, k] + NEARER)
            if linear:
                weight *= weight
                if chosen > FEWEST:
                    weight *= 1.0 - error[place, k] / far
            result[place, k] = weight
            total += weight
        for k in range(slots):
            result[place, k] /= total
        if linear:
            _make_linear(positions, at[place], upright[place], near[place], result[place])


@compiled
def _choose(normals, upright, near, connected, usable):
    """Connected samples that face the same way; if these are few, all that face the same way, or
    all. Returns how many."""
    both = 0
    facing = 0
    there = 0
    for k in range(len(near)):
        usable[k] = False
        if near[k] < 0:
            continue
        m = normals[near[k]]
        usable[k] = m[0] * upright[0] + m[1] * upright[1] + m[2] * upright[2] >= OPPOSED
        there += 1
        facing += usable[k]
        both += usable[k] and connected[k]
    for k in range(len(near)):
        if both >= FEWEST:
            usable[k] = usable[k] and connected[k]
        elif facing < FEWEST:
            usable[k] = near[k] >= 0
    if both >= FEWEST:
        return both
    return facing if facing >= FEWEST else there


@compiled
def _make_linear(positions, at, normal, near, weights):
    """Multiplies the weights by the linear function that makes first moments zero, or by what lies
    between it and 1 where weights would grow too large."""
    count = len(near)
    sign = 1.0 if normal[2] >= 0.0 else -1.0  # Duff et al. 2017, as in jaxvis.sphere.frames
    a = -1.0 / (sign + normal[2])
    b = normal[0] * normal[1] * a
    tangent = np.array([1.0 + sign * normal[0] * normal[0] * a, sign * b, -sign * normal[0]])
    bitangent = np.array([b, sign + normal[1] * normal[1] * a, -normal[1]])
    u = np.zeros(count)
    v = np.zeros(count)
    mean_u = mean_v = uu = uv = vv = 0.0
    for k in range(count):
        if weights[k] == 0.0:
            continue
        for axis in range(3):
            apart = positions[near[k], axis] - at[axis]
            u[k] += apart * tangent[axis]
            v[k] += apart * bitangent[axis]
        mean_u += weights[k] * u[k]
        mean_v += weights[k] * v[k]
        uu += weights[k] * u[k] * u[k]
        uv += weights[k] * u[k] * v[k]
        vv += weights[k] * v[k] * v[k]
    # Offsets about their mean; the fit is stiffened so that it exists for samples in a line.
    uu, uv, vv = uu - mean_u * mean_u, uv - mean_u * mean_v, vv - mean_v * mean_v
    widest = 0.0
    for k in range(count):
        if weights[k] != 0.0:
            widest = max(widest, u[k] * u[k] + v[k] * v[k])
    stiffness = STIFFNESS * widest + 1e-12
    uu += stiffness
    vv += stiffness
    determinant = uu * vv - uv * uv
    slope_u = (vv * mean_u - uv * mean_v) / determinant
    slope_v = (uu * mean_v - uv * mean_u) / determinant
    total = 0.0
    for k in range(count):
        u[k] = slope_u * (u[k] - mean_u) + slope_v * (v[k] - mean_v)
        total += abs(weights[k] * (1.0 - u[k]))
    part = min(1.0, (LARGEST_SUM - 1.0) / max(total - 1.0, 1e-12))
    for k in range(count):
        weights[k] *= 1.0 - part * u[k]
