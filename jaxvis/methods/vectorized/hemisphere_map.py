"""Which directions of a sample's hemisphere are free: a map refined where it changes (host).

The chart is Lambert's equal-area disc (``jaxvis.sphere.hemisphere``), scaled so that the unit
circle is the rim of the sample's domain: its tangent plane, or a cone below it (:class:`Samples`).
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from jaxvis.scene import Hits, RayTracer
from jaxvis.sphere.frames import frames_on_host


class Samples(NamedTuple):
    """Points from which visibility is traced, each with its own domain of directions.

    A domain is the hemisphere about the normal, or more: directions whose cosine with the normal
    is greater than -``dips``.
    """

    positions: Float32[np.ndarray, "samples 3"]
    origins: Float32[np.ndarray, "samples 3"]
    """Where rays start: beside the positions, off the surface."""
    frames: Float32[np.ndarray, "samples 3 3"]
    """Rows: tangent, bitangent, normal; right-handed."""
    dips: Float32[np.ndarray, "samples"]

    @staticmethod
    def of(
        positions: Float[np.ndarray, "samples 3"],
        normals: Float[np.ndarray, "samples 3"],
        origins: Float[np.ndarray, "samples 3"] | None = None,
        dips: Float[np.ndarray, "samples"] | float = 0.0,
    ) -> "Samples":
        """With frames about unit normals; those of zero length become +y."""
        normal = normals.astype(np.float64)
        length = np.linalg.norm(normal, axis=-1, keepdims=True)
        normal = np.where(length > 0.0, normal, [0.0, 1.0, 0.0]) / np.where(length > 0, length, 1)
        return Samples(
            np.ascontiguousarray(positions, np.float32),
            np.ascontiguousarray(positions if origins is None else origins, np.float32),
            frames_on_host(normal),
            np.broadcast_to(np.float32(dips), len(normal)),
        )

    def take(self, chosen: slice) -> "Samples":
        """Some of them."""
        return Samples(*(field[chosen] for field in self))

    def to_world(
        self, sample: Int[np.ndarray, "rays"], local: Float[np.ndarray, "rays 3"]
    ) -> Float32[np.ndarray, "rays 3"]:
        """World directions of local ones."""
        x, y, z = self.frames[:, 0], self.frames[:, 1], self.frames[:, 2]
        world = local[:, 0:1] * x.take(sample, axis=0)
        world += local[:, 1:2] * y.take(sample, axis=0)
        world += local[:, 2:3] * z.take(sample, axis=0)
        return world

    def directions(
        self, sample: Int[np.ndarray, "rays"], chart: Float[np.ndarray, "rays 2"]
    ) -> Float32[np.ndarray, "rays 3"]:
        """World directions of points of the samples' unit discs."""
        return self.to_world(sample, self.local(sample, chart))

    def local(
        self, sample: Int[np.ndarray, "rays"], chart: Float[np.ndarray, "rays 2"]
    ) -> Float32[np.ndarray, "rays 3"]:
        """Local directions (normal along z) of points of the samples' unit discs."""
        square = (1.0 + self.dips).take(sample)
        x, y = chart[:, 0], chart[:, 1]
        height = square * (x * x + y * y)
        scale = np.sqrt(square * np.maximum(2.0 - height, 0.0))
        return np.stack([x * scale, y * scale, 1.0 - height], axis=-1).astype(np.float32)


def grid(resolution: int) -> Float32[np.ndarray, "nodes 2"]:
    """Chart coordinates of the (resolution + 1)^2 nodes, row by row; the outer ones lie outside
    the unit disc, so that no boundary leaves the grid.
    """
    axis = (1.0 + 2.0 / resolution) * np.linspace(-1.0, 1.0, resolution + 1)
    y, x = np.meshgrid(axis, axis, indexing="ij")
    return np.stack([x, y], axis=-1).reshape(-1, 2).astype(np.float32)


COARSE_CELLS = 10
"""Along each edge of the grid of :func:`look_around`: some 60 rays a sample."""

SAMPLES_AT_ONCE = 4096
"""Bounds the memory of these rays to some 20 MB."""


def look_around(
    tracer: RayTracer, samples: Samples
) -> Iterator[tuple[Samples, Float32[np.ndarray, "samples rays 3"], Hits]]:
    """What samples see in a few directions, a part of them at a time.

    Yields:
        (samples, directions of their rays, what the rays hit, one sample's after another's)
    """
    nodes = grid(COARSE_CELLS)
    nodes = nodes[np.sum(nodes * nodes, axis=-1) < 1.0]
    for start in range(0, len(samples.origins), SAMPLES_AT_ONCE):
        part = samples.take(slice(start, start + SAMPLES_AT_ONCE))
        owner = np.repeat(np.arange(len(part.origins)), len(nodes))
        rays = part.directions(owner, np.tile(nodes, (len(part.origins), 1)))
        hits = tracer.closest_hit(part.origins.take(owner, axis=0), rays)
        yield part, rays.reshape(-1, len(nodes), 3), hits


def cell_solid_angle(
    resolution: int, dips: Float[np.ndarray, "*samples"]
) -> Float[np.ndarray, "*samples"]:
    """Steradians of one cell of the grid."""
    spacing = (1.0 + 2.0 / resolution) * 2.0 / resolution
    return 2.0 * (1.0 + dips) * spacing**2


def visibility_map(
    tracer: RayTracer, samples: Samples, resolution: int, coarsest: int
) -> Bool[np.ndarray, "samples rows columns"]:
    """Which nodes of the grid see out of the scene; nodes outside the disc do not.

    The grid with ``coarsest`` cells along each edge is traced fully, finer ones where the nodes of
    a cell differ, and on until every cell with nodes that differ has been traced at all four.
    ``coarsest == resolution`` traces every node. What is smaller than a coarse cell and lies
    wholly in one may be missed.

    Raises:
        ValueError: ``resolution`` is not ``coarsest`` times a power of two.
    """
    ratio, rest = divmod(resolution, coarsest)
    if rest or ratio & (ratio - 1):
        raise ValueError(
            f"resolution must be coarsest times a power of two, got {resolution} and {coarsest}"
        )
    nodes, side = grid(resolution), resolution + 1
    inside = (np.sum(np.square(nodes, dtype=np.float64), axis=-1) < 1.0).reshape(side, side)
    shape = (len(samples.origins), side, side)
    free = np.zeros(shape, bool)
    known = np.broadcast_to(~inside, shape).copy()

    def trace(wanted: Bool[np.ndarray, "samples rows columns"], step: int) -> None:
        sample, row, column = np.nonzero(wanted)
        node = (row * side + column) * step
        rays = samples.directions(sample, nodes.take(node, axis=0))
        blocked = tracer.occluded(samples.origins.take(sample, axis=0), rays)
        free[:, ::step, ::step][sample, row, column] = ~blocked
        known[:, ::step, ::step][sample, row, column] = True

    step = ratio
    trace(~known[:, ::step, ::step], step)
    while step > 1:
        differing = _differing(free[:, ::step, ::step])
        step //= 2
        values, traced = free[:, ::step, ::step], known[:, ::step, ::step]
        _inherit(values, traced)
        wanted = _nodes(differing, 2) & ~traced
        while wanted.any():
            trace(wanted, step)
            wanted = _nodes(_differing(values), 1) & ~traced
    return free


def _differing(
    values: Bool[np.ndarray, "samples rows columns"],
) -> Bool[np.ndarray, "samples cell_rows cell_columns"]:
    """Cells whose four nodes differ."""
    a, b = values[:, :-1, :-1], values[:, :-1, 1:]
    c, d = values[:, 1:, :-1], values[:, 1:, 1:]
    return (a != b) | (c != d) | (a != c)


def _nodes(
    cells: Bool[np.ndarray, "samples cell_rows cell_columns"], steps: int
) -> Bool[np.ndarray, "samples rows columns"]:
    """Nodes in or on the edge of the marked cells, in a grid with ``steps`` steps a cell."""
    count, rows, columns = cells.shape
    nodes = np.zeros((count, steps * rows + 1, steps * columns + 1), bool)
    for row in range(steps + 1):
        for column in range(steps + 1):
            last = row + steps * rows - steps + 1, column + steps * columns - steps + 1
            nodes[:, row : last[0] : steps, column : last[1] : steps] |= cells
    return nodes


def _inherit(
    values: Bool[np.ndarray, "samples rows columns"],
    known: Bool[np.ndarray, "samples rows columns"],
) -> None:
    """Gives the nodes between the even ones the value of an even neighbour, where not known."""
    coarse = values[:, ::2, ::2]
    for row, column in ((0, 1), (1, 0), (1, 1)):
        target = values[:, row::2, column::2]
        source = coarse[:, : target.shape[1], : target.shape[2]]
        target[...] = np.where(known[:, row::2, column::2], target, source)
