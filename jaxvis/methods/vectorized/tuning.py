"""Fits the one free constant of paper 000's contour integration: the sharpness of eq. 11.

The sharpness decides how fast beta goes from 0 to 1 as the light moves over an edge. It is fitted
by gradient through the jitted integrals against the same polygons with every edge cut into pieces
shorter than a texel, where beta no longer matters.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float, Int

from jaxvis.methods.vectorized.evaluation import References
from jaxvis.methods.vectorized.irradiance import edge_sharpness, outlines, projected
from jaxvis.methods.vectorized.light import PAPER_SHARPNESS, PolygonLight
from jaxvis.methods.vectorized.polygons import VisibilityPolygons
from jaxvis.sphere.contours import ContourTable, Lookup, trapezoid, vsat
from jaxvis.sphere.frames import frame
from jaxvis.sphere.polygons import Directions, normalized

SCAN = (1.0, 1024.0)
"""Sharpness in 1 / radians between which the scan looks for a place to start."""

SCAN_SCALED = (0.25, 64.0)
"""The same, times the edges' length."""

SCANNED = 11
"""Values of the scan."""

CUT_MULTIPLE = 1024
"""Finely cut polygons have a multiple of this many entries, so that few shapes are compiled."""

ORACLE_CHUNK = 32
"""Polygons with finely cut edges that are integrated together: bounds memory."""


class Samples(NamedTuple):
    """Polygons whose irradiance is known."""

    directions: Directions
    """Unit, above the horizon, [points, vectors]."""
    normals: Float[Array, "points 3"]
    irradiance: Float[Array, "points 3"]
    unoccluded: Float[Array, "3"]
    """Mean irradiance of the normals under the whole light."""


class SharpnessFit(NamedTuple):
    """A fitted sharpness; errors are :func:`relative_error` over the samples.

    With ``scaled`` the sharpness of an edge is ``sharpness`` over its length.
    """

    sharpness: float
    scaled: bool
    error_half: float
    """With beta = 1/2 everywhere."""
    error_before: float
    """At the paper's sharpness, 5.8 / radian."""
    error_after: float
    history: Float[np.ndarray, "steps 2"]
    """(sharpness, error) of the scan and then of each step."""


def fit_sharpness(
    visibility: VisibilityPolygons,
    light: PolygonLight,
    key: jax.Array,
    *,
    scaled: bool = False,
    polygons: int = 256,
    steps: int = 40,
    lookup: Lookup = "nearest",
) -> SharpnessFit:
    """The sharpness with the least error over a random subset of a scene's polygons.

    Args:
        visibility: polygons, seen from their own samples.
        light: gives the tables; its own sharpness plays no part.
        key: chooses the subset.
        scaled: fits the constant over the length of each edge instead of one for all edges.
        polygons: of the subset, at most.
        steps: of gradient descent, after the scan.
        lookup: of the vsat that is fitted; the oracle's are exact.

    Raises:
        ValueError: no polygon sees anything.
    """
    samples = sample_polygons(visibility, light, key, polygons)
    return fit_to_samples(samples, light, scaled=scaled, steps=steps, lookup=lookup)


def tuned(light: PolygonLight, fit: SharpnessFit) -> PolygonLight:
    """The light with the fitted sharpness."""
    return replace(light, sharpness=jnp.float32(fit.sharpness), scaled=fit.scaled)


def sample_polygons(
    visibility: VisibilityPolygons, light: PolygonLight, key: jax.Array, count: int
) -> Samples:
    """Random polygons among those that see something, with the oracle's irradiance.

    Raises:
        ValueError: none sees anything.
    """
    seeing = np.flatnonzero(np.asarray(visibility.counts) > 2)
    if not len(seeing):
        raise ValueError("no polygon sees anything: nothing to fit the sharpness to")
    count = min(count, len(seeing))
    chosen = jax.random.choice(key, jnp.asarray(seeing), (count,), replace=False)
    return with_oracle(own_outlines(visibility, chosen), visibility.normals[chosen], light)


def own_outlines(visibility: VisibilityPolygons, chosen: Int[Array, "chosen"]) -> Directions:
    """Unit directions of some polygons from their own places, above their own horizons."""
    normals = visibility.normals[chosen]
    seen = References(chosen, visibility.positions[chosen], normals, normals, ())
    return _unit_outlines(visibility.vectors, seen)


@jax.jit
def _unit_outlines(vectors: Float[Array, "polygons 4 capacity"], seen: References) -> Directions:
    return normalized(outlines(vectors, seen, vectors.shape[-1]))


def with_oracle(
    directions: Directions, normals: Float[Array, "points 3"], light: PolygonLight
) -> Samples:
    """Samples of unit directions above the horizon, with the oracle's irradiance."""
    unoccluded = oracle_irradiance(horizon(normals), normals, light.vector)
    irradiance = oracle_irradiance(directions, normals, light.vector)
    return Samples(directions, normals, irradiance, jnp.mean(unoccluded, axis=0))


def horizon(normals: Float[Array, "points 3"], count: int = 64) -> Directions:
    """The great circle that bounds each normal's hemisphere, as ``count`` edges."""
    tangent, bitangent = frame(normals)
    turn = 2.0 * jnp.pi * jnp.arange(count) / count
    circle = jnp.cos(turn) * tangent[..., None] + jnp.sin(turn) * bitangent[..., None]
    return Directions(*jnp.moveaxis(circle, 1, 0))


def oracle_irradiance(
    directions: Directions, normals: Float[Array, "points 3"], table: ContourTable
) -> Float[Array, "points 3"]:
    """Irradiance through polygons whose edges are cut into pieces shorter than a texel.

    The error of the trapezoid falls with the square of the pieces' length, and below a texel the
    light between an edge's two runs no longer depends on where it lies.

    Args:
        directions: unit, above the horizon.
        table: of direction times radiance times solid angle, 9 channels.
    """
    fine = cut(directions, np.pi / table.height)
    rows = np.asarray(table.corners).reshape(-1, table.corners.shape[-1])
    vector = np.empty((len(normals), rows.shape[-1]))
    for start in range(0, len(normals), ORACLE_CHUNK):
        part = slice(start, start + ORACLE_CHUNK)
        polygons = Directions(*(axis[part] for axis in fine))
        index, weight, south = map(np.asarray, _trapezoid(table.height, polygons, "bilinear"))
        # float64: thousands of entries of the table cancel.
        vector[part] = np.einsum("pk,pkc->pc", weight.astype(np.float64), rows[index])
        vector[part] += np.maximum(south, 0)[:, None] * np.asarray(table.total)
    vector = vector.reshape(-1, 3, 3)
    irradiance = np.einsum("pac,pa->pc", vector, np.asarray(normals, np.float64))
    return jnp.asarray(irradiance, jnp.float32)


def cut(directions: Directions, longest: float) -> Directions:
    """Each great-circle edge in equal pieces of at most ``longest`` radians (host, float64).

    All polygons get as many entries as the largest needs and up to a multiple of ``CUT_MULTIPLE``:
    the last one repeats.
    """
    a = np.stack([np.asarray(axis, np.float64) for axis in directions], axis=-1)
    b = np.roll(a, -1, axis=1)
    angle = 2.0 * np.arcsin(np.minimum(0.5 * np.linalg.norm(b - a, axis=-1), 1.0))
    pieces = np.ceil(angle / longest).astype(np.int64)
    pieces[:, 0] = np.maximum(pieces[:, 0], 1)  # a polygon of one repeated direction keeps it
    edge = np.repeat(np.arange(pieces.size), pieces.reshape(-1))
    first = np.cumsum(pieces) - pieces.reshape(-1)
    t = ((np.arange(len(edge)) - first[edge]) / pieces.reshape(-1)[edge])[:, None]
    whole = angle.reshape(-1)[edge, None]
    sine = np.where(whole > 0.0, np.sin(whole), 1.0)
    start = np.where(whole > 0.0, np.sin((1.0 - t) * whole) / sine, 1.0)
    points = start * a.reshape(-1, 3)[edge] + np.sin(t * whole) / sine * b.reshape(-1, 3)[edge]
    lengths = pieces.sum(axis=1)
    capacity = -(-lengths.max() // CUT_MULTIPLE) * CUT_MULTIPLE
    place = np.minimum(np.arange(capacity), lengths[:, None] - 1)
    cut_ = points[first[:: a.shape[1]][:, None] + place]
    return Directions(*(jnp.asarray(cut_[..., i], jnp.float32) for i in range(3)))


def fit_to_samples(
    samples: Samples,
    light: PolygonLight,
    *,
    scaled: bool = False,
    steps: int = 40,
    lookup: Lookup = "nearest",
) -> SharpnessFit:
    """As :func:`fit_sharpness`, for polygons whose irradiance is known.

    A scan over a geometric series finds where to start, because far from the optimum the hyperbolic
    tangent is saturated and the gradient vanishes; Adam then descends in the sharpness' logarithm,
    and the best value met is returned.
    """
    error = partial(relative_error, samples, light, lookup=lookup)
    low, high = SCAN_SCALED if scaled else SCAN
    history = [(s, float(error(s, scaled=scaled))) for s in np.geomspace(low, high, SCANNED)]
    start = min(history, key=lambda entry: entry[1])[0]
    history += _descend(lambda log: error(jnp.exp(log), scaled=scaled), float(np.log(start)), steps)
    before = float(error(PAPER_SHARPNESS, scaled=False))
    best, after = min(history, key=lambda entry: entry[1])
    half = float(error(0.0, scaled=False))
    return SharpnessFit(float(best), scaled, half, before, after, np.array(history))


def _descend(
    error: Callable[[Array], Array], start: float, steps: int
) -> list[tuple[float, float]]:
    """(sharpness, error) of each step of Adam in the logarithm."""
    optimizer = optax.adam(optax.cosine_decay_schedule(0.15, max(steps, 1)), eps=1e-20)
    log = jnp.float32(start)
    state = optimizer.init(log)
    slope = jax.value_and_grad(lambda log: jnp.square(error(log)))
    visited = []
    for _ in range(steps):
        value, gradient = slope(log)
        visited.append((float(jnp.exp(log)), float(jnp.sqrt(value))))
        update, state = optimizer.update(gradient, state)
        log = jnp.asarray(optax.apply_updates(log, update))
    return visited


def relative_error(
    samples: Samples,
    light: PolygonLight,
    sharpness: float | Float[Array, ""],
    *,
    scaled: bool = False,
    lookup: Lookup = "nearest",
) -> Float[Array, ""]:
    """Root mean square error of vsat's irradiance over the mean unoccluded irradiance.

    Differentiable in ``sharpness``; channels count alike, as they are.
    """
    irradiance = vsat_irradiance(
        samples.directions, samples.normals, light, sharpness, scaled=scaled, lookup=lookup
    )
    error = (irradiance - samples.irradiance) / jnp.mean(samples.unoccluded)
    # A square root has no gradient at 0.
    return jnp.sqrt(jnp.mean(jnp.square(error)) + 1e-30)


def vsat_irradiance(
    directions: Directions,
    normals: Float[Array, "points 3"],
    light: PolygonLight,
    sharpness: float | Float[Array, ""],
    *,
    scaled: bool = False,
    lookup: Lookup = "nearest",
) -> Float[Array, "points 3"]:
    """Irradiance through polygons by paper 000's vsat (eqs. 9 to 12).

    Args:
        directions: unit, above the horizon.
        sharpness: in 1 / radians, or with ``scaled`` a number over each edge's length.
    """
    light = replace(light, sharpness=jnp.asarray(sharpness, jnp.float32), scaled=scaled)
    # Two jitted calls: in one, XLA would find the lookups again for every channel.
    return projected(light.vector, _vsat(light, directions, lookup), normals)


@partial(jax.jit, static_argnames="lookup")
def _vsat(light, directions, lookup):
    return vsat(light.luminous, [directions], edge_sharpness(light, directions), lookup)


@partial(jax.jit, static_argnames=("height", "lookup"))
def _trapezoid(height, directions, lookup):
    return trapezoid(height, [directions], lookup)
