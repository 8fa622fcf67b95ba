"""Which samples are near a place, and how much each counts there (paper 002, eqs. 6, 8; host)."""

from typing import Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Bool, Float, Float32, Int32
from scipy.spatial import KDTree

from jaxvis.compiled import compiled
from jaxvis.cores import core_count

Interpolation = Literal["linear", "inverse"]

NEARER = 1e-4
"""Added to errors, so that their inverses are finite (in units of eq. 6)."""

OPPOSED = 0.5
"""Cosine below which a sample's normal is another side's, as long as :data:`FEWEST` remain."""

FEWEST = 3

STIFFNESS = 3e-3
"""How soon the linear fit gives way to the constant one where samples stand in a line."""


class Places(NamedTuple):
    """Points of surfaces with their normals, in lengths in which eq. 6 weighs them equally."""

    positions: Float32[np.ndarray, "places 3"]
    """Times alpha, over the scene's diagonal."""
    normals: Float32[np.ndarray, "places 3"]

    @staticmethod
    def of(
        positions: Float[np.ndarray, "places 3"],
        normals: Float[np.ndarray, "places 3"],
        scale: float,
    ) -> "Places":
        """Positions are multiplied by ``scale``, alpha over the scene's diagonal."""
        scaled = np.ascontiguousarray(scale * positions, np.float32)
        return Places(scaled, np.ascontiguousarray(normals, np.float32))

    def take(self, chosen: np.ndarray) -> "Places":
        """Some of them."""
        return Places(self.positions[chosen], self.normals[chosen])

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


def geometric_error(a: Places, b: Places) -> Float32[np.ndarray, "*places"]:
    """e_g between places that broadcast (eq. 6): alpha |x - y| + |n - m|."""
    apart = np.linalg.norm(a.positions - b.positions, axis=-1)
    return apart + np.linalg.norm(a.normals - b.normals, axis=-1)


def nearest_samples(samples: Places, places: Places, count: int) -> Nearest:
    """The ``count`` samples of least e_g among twice as many nearest in the joint space."""
    pool = min(2 * count, len(samples.positions))
    if not pool:
        empty = np.full((len(places.positions), count), -1, np.int32)
        return Nearest(empty, np.full(empty.shape, np.inf, np.float32))
    _, found = KDTree(samples.joint).query(places.joint, pool, workers=core_count())
    found = np.reshape(found, (len(places.positions), pool))
    error = geometric_error(
        Places(places.positions[:, None], places.normals[:, None]), samples.take(found)
    )
    order = np.argsort(error, axis=1, kind="stable")[:, :count]
    missing = ((0, 0), (0, count - order.shape[1]))
    return Nearest(
        np.pad(
            np.take_along_axis(found, order, axis=1).astype(np.int32), missing, constant_values=-1
        ),
        np.pad(
            np.take_along_axis(error, order, axis=1).astype(np.float32),
            missing,
            constant_values=np.inf,
        ),
    )


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
    weights may then be negative. A place on a sample has that sample's value. Samples whose normals
    are more than 60 degrees away do not count if enough others are near.
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
def _weigh(positions, normals, at, upright, near, error, linear, result):
    for place in range(len(at)):
        count = 0
        facing = 0
        for k in range(near.shape[1]):
            if near[place, k] >= 0:
                count += 1
                m = normals[near[place, k]]
                n = upright[place]
                facing += m[0] * n[0] + m[1] * n[1] + m[2] * n[2] >= OPPOSED
        if count == 0:
            continue
        if error[place, 0] <= NEARER:
            result[place, 0] = 1.0
            continue
        far = error[place, count - 1] * 1.001
        total = 0.0
        for k in range(count):
            m = normals[near[place, k]]
            n = upright[place]
            if facing >= FEWEST and m[0] * n[0] + m[1] * n[1] + m[2] * n[2] < OPPOSED:
                continue
            weight = 1.0 / (error[place, k] + NEARER)
            if linear:
                weight *= weight
                if count > FEWEST:
                    weight *= 1.0 - error[place, k] / far
            result[place, k] = weight
            total += weight
        for k in range(count):
            result[place, k] /= total
        if linear:
            _make_linear(positions, at[place], upright[place], near[place], count, result[place])


@compiled
def _make_linear(positions, at, normal, near, count, weights):
    """Multiplies the weights by the linear function that makes first moments zero."""
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
    for k in range(count):
        weights[k] *= 1.0 - slope_u * (u[k] - mean_u) - slope_v * (v[k] - mean_v)
