"""From a scene to visibility polygons at its vertices: batches of samples (host)."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Float32, Int32
from tqdm.auto import tqdm

from jaxvis.cluster import map_jobs
from jaxvis.methods.vectorized.buried import buried
from jaxvis.methods.vectorized.contours import Contours, trace_contours
from jaxvis.methods.vectorized.hemisphere_map import (
    Samples,
    cell_solid_angle,
    grid,
    visibility_map,
)
from jaxvis.methods.vectorized.polygons import VisibilityPolygons
from jaxvis.methods.vectorized.sequences import sequences
from jaxvis.methods.vectorized.silhouettes import position_vectors
from jaxvis.methods.vectorized.simplify import simplify
from jaxvis.methods.vectorized.touching import clear_of_surfaces
from jaxvis.methods.vertices import vertex_samples
from jaxvis.scene import RayTracer, Scene
from jaxvis.scene.rays import offset_origins

BATCH = 256
"""Samples traced together: enough to hide the calls, few enough to stay in cache."""

FEWEST = 4
"""Points of a loop that simplification leaves."""

LEAST_LOOP = 0.25
"""Of a grid cell's solid angle: smaller loops are dropped."""


class Settings(NamedTuple):
    """How finely visibility is sampled.

    ``vectors`` is the most position vectors of a polygon, ``resolution`` the cells along each edge
    of the fine grid and ``coarsest`` those of the one that is traced fully; ``tolerance`` is what a
    vector may cost, in cosine-weighted steradians, to be left out although there is room for it.
    """

    vectors: int = 128
    resolution: int = 96
    coarsest: int = 48
    tolerance: float = 4e-6

    def check(self) -> None:
        """Raises ValueError if a setting is out of range."""
        if self.vectors < 16:
            raise ValueError(f"vectors must be at least 16, got {self.vectors}")
        ratio, rest = divmod(self.resolution, max(self.coarsest, 1))
        if self.coarsest < 4 or rest or ratio < 1 or ratio & (ratio - 1):
            raise ValueError(
                "resolution must be coarsest times a power of two and coarsest at least 4, "
                f"got {self.resolution} and {self.coarsest}"
            )
        if not self.tolerance >= 0.0:
            raise ValueError(f"tolerance must not be negative, got {self.tolerance}")


def precompute_polygons(
    scene: Scene,
    settings: Settings = Settings(),  # noqa: B008 (frozen)
    *,
    progress: bool = True,
) -> VisibilityPolygons:
    """Polygons at the scene's vertices, and a second set for the backs of two-sided materials.

    Raises:
        ValueError: a setting is out of range.
    """
    settings.check()
    vertices = vertex_samples(scene)
    vectors, counts, hidden = trace_samples(
        scene,
        vertices.positions,
        vertices.normals,
        vertices.origins,
        vertices.dips,
        settings,
        progress=progress,
    )
    return VisibilityPolygons(
        vectors=jnp.asarray(vectors),
        counts=jnp.asarray(counts),
        positions=jnp.asarray(vertices.positions),
        normals=jnp.asarray(vertices.normals),
        triangles=jnp.asarray(vertices.triangles),
        backs=jnp.asarray(vertices.backs),
        buried=jnp.asarray(hidden),
    )


def trace_samples(
    scene: Scene,
    positions: Float32[np.ndarray, "samples 3"],
    normals: Float32[np.ndarray, "samples 3"],
    origins: Float32[np.ndarray, "samples 3"],
    dips: Float32[np.ndarray, "samples"],
    settings: Settings,
    *,
    progress: bool,
) -> tuple[
    Float32[np.ndarray, "samples 4 vectors"],
    Int32[np.ndarray, "samples"],
    Bool[np.ndarray, "samples"],
]:
    """(position vectors, how many of them are used, whether it is buried) of each sample.

    The arguments are those of :func:`trace_polygons`.
    """
    one_sided = np.array([not m.two_sided for m in scene.materials])[scene.material_ids]
    samples = Samples.of(positions, normals, origins)
    surfaces = scene.geometric_normals, one_sided
    origins = clear_of_surfaces(scene.tracer, samples, *surfaces)
    vectors, counts = trace_polygons(
        scene.tracer,
        positions,
        normals,
        origins=origins,
        dips=dips,
        corners=scene.positions[scene.triangles],
        settings=settings,
        progress=progress,
    )
    hidden = buried(scene.tracer, samples._replace(origins=origins), *surfaces)
    return vectors, counts, hidden


def trace_polygons(
    tracer: RayTracer,
    positions: Float[np.ndarray, "samples 3"],
    normals: Float[np.ndarray, "samples 3"],
    *,
    origins: Float[np.ndarray, "samples 3"] | None = None,
    dips: Float[np.ndarray, "samples"] | float = 0.0,
    corners: Float[np.ndarray, "triangles 3 3"] | None = None,
    settings: Settings = Settings(),  # noqa: B008 (frozen)
    progress: bool = False,
) -> tuple[Float32[np.ndarray, "samples 4 vectors"], Int32[np.ndarray, "samples"]]:
    """The visibility polygon of each sample (see :class:`VisibilityPolygons`).

    Args:
        tracer: the scene, centred coordinates.
        positions: of the samples.
        normals: unit; a zero one sees nothing.
        origins: where the rays start; ``positions`` moved off along the normals if None.
        dips: sine of the angle by which each domain reaches below the tangent plane, so that the
            polygon holds what shading points with other normals see; they clamp it to their own
            hemisphere.
        corners: of the tracer's triangles, to find the far edges of those that rays run along.
        settings: how finely.
        progress: shows a bar.

    Returns:
        (homogeneous position vectors, how many of them are used)

    Raises:
        ValueError: a setting is out of range.
    """
    settings.check()
    count = len(positions)
    normals = np.asarray(normals, np.float32)
    if origins is None:
        origins = offset_origins(np.asarray(positions, np.float32), normals)
    samples = Samples.of(positions, normals, origins, dips)
    faceless = ~(np.abs(normals).max(axis=-1, initial=0.0) > 0.0)
    parts = [slice(start, start + BATCH) for start in range(0, count, BATCH)]
    batches = ((samples.take(part), faceless[part]) for part in parts)
    shared = tracer, corners, settings
    done = []
    with tqdm(total=count, desc="visibility", unit="vertex", disable=not progress) as bar:
        for result in map_jobs(_trace_batch, shared, batches, threads=tracer.threads):
            done.append(result)
            bar.update(len(result[1]))
    if not done:
        return np.zeros((0, 4, settings.vectors), np.float32), np.zeros(0, np.int32)
    return np.concatenate([d[0] for d in done]), np.concatenate([d[1] for d in done])


def _trace_batch(
    tracer: RayTracer,
    corners: Float[np.ndarray, "triangles 3 3"] | None,
    settings: Settings,
    batch: tuple[Samples, Bool[np.ndarray, "samples"]],
) -> tuple[Float32[np.ndarray, "samples 4 vectors"], Int32[np.ndarray, "samples"]]:
    samples, faceless = batch
    free = visibility_map(tracer, samples, settings.resolution, settings.coarsest)
    free[faceless] = False
    contours = _drop_loops(trace_contours(tracer, samples, free), samples, settings)
    vectors, local = position_vectors(
        tracer, samples, contours, settings.resolution, corners=corners
    )
    loop = np.repeat(np.arange(len(contours.lengths)), contours.lengths)
    loops = np.bincount(contours.sample[contours.starts], minlength=len(samples.origins))
    kept = simplify(
        local,
        samples.to_world(contours.sample, local),
        contours.sample,
        loop,
        settings.vectors - 2 * np.maximum(loops - 1, 0),
        tolerance=settings.tolerance,
        fewest=FEWEST,
    )
    normals = samples.frames[:, 2]
    empty = np.concatenate([normals, np.zeros_like(normals[:, :1])], axis=1)
    sample = contours.sample[kept]
    return sequences(vectors[kept], local[kept], sample, loop[kept], empty, settings.vectors)


def _drop_loops(contours: Contours, samples: Samples, settings: Settings) -> Contours:
    """Without loops smaller than a part of a grid cell, and without the smallest of too many.

    Each sample keeps its largest loop.
    """
    if not len(contours.starts):
        return contours
    nodes = grid(settings.resolution)
    point = 0.5 * (nodes[contours.free] + nodes[contours.blocked]).astype(np.float64)
    following = np.arange(1, len(point) + 1)
    following[contours.starts + contours.lengths - 1] = contours.starts
    cross = point[:, 0] * point[following, 1] - point[:, 1] * point[following, 0]
    owner = contours.sample[contours.starts]
    # Half the sum of cross products is the loop's area, and a unit of the chart's 2 sr.
    area = np.abs(np.add.reduceat(cross, contours.starts)) * (1.0 + samples.dips[owner])
    order = np.lexsort((-area, owner))
    rank = np.empty(len(order), np.int64)
    first = np.flatnonzero(np.diff(owner[order], prepend=-1) != 0)
    rank[order] = np.arange(len(order)) - np.repeat(first, np.diff(first, append=len(order)))
    most = settings.vectors // (2 * FEWEST)
    large = area >= LEAST_LOOP * cell_solid_angle(settings.resolution, samples.dips[owner])
    return _select(contours, (rank == 0) | (large & (rank < most)))


def _select(contours: Contours, chosen: Bool[np.ndarray, "loops"]) -> Contours:
    """Some of the loops."""
    points = np.repeat(chosen, contours.lengths)
    lengths = contours.lengths[chosen]
    return Contours(
        contours.sample[points],
        contours.free[points],
        contours.blocked[points],
        np.cumsum(lengths) - lengths,
        lengths,
    )
