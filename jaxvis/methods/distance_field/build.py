"""From a scene to distance fields: at every vertex, or at adaptively placed samples (host)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float16, Float32, Int, Int32
from tqdm.auto import tqdm

from jaxvis.cache import cached_arrays
from jaxvis.methods.backs import behind_surfaces
from jaxvis.methods.distance_field.adapt import most_needed, neighbours, plan
from jaxvis.methods.distance_field.field import ARRAYS, KIND, DistanceFields, packed
from jaxvis.methods.distance_field.foretold import Measure, Seen, contested, foretold
from jaxvis.methods.distance_field.initial import initial_samples
from jaxvis.methods.distance_field.maps import Known, Traced, Views, adaptive_maps
from jaxvis.methods.distance_field.neighbours import (
    Interpolation,
    Places,
    nearest_samples,
    weights,
)
from jaxvis.methods.distance_field.rasterize import rasterized_maps
from jaxvis.methods.touching import cleared_origins
from jaxvis.methods.vertices import VertexSamples, connected_surfaces, vertex_samples
from jaxvis.scene import Hits, Scene, Surface
from jaxvis.sphere.distance_host import signed_distances
from jaxvis.sphere.frames import frames_on_host
from jaxvis.sphere.hemisphere_grid import texel_directions

Fill = Literal["adaptive", "dense", "rasterized"]

HINTS = 4
"""Neighbours whose boundaries a sample looks at."""

AT_ONCE = 1024
"""Samples filled between two steps of the progress bar."""

NEARBY = 4.0
"""Times alpha where samples speak for places: what is seen depends on where from, and normals tell
little more than the side; initial samples rather follow the surface's bends."""

CONTEST = 2.0
"""What samples disagree by, over the error of what they say together: roughly, in smooth places."""

FEWEST = 16
"""Samples that any scene may have."""

EVEN = 5.0
"""alpha by which vertices that lie behind surfaces find others, where every vertex is sampled."""


class Angular(NamedTuple):
    """How maps are filled."""

    resolution: int
    fill: Fill
    coarsest: int = 16


class Spatial(NamedTuple):
    """How samples are placed (paper 002, sections 4.1 and 4.3): see ``AdaptiveVisibility``."""

    alpha: float
    initial: float
    largest: float
    least: float
    rounds: int
    budget: float
    near: int
    interpolation: Interpolation
    measure: Measure


class Vertices(NamedTuple):
    """All vertices as places for samples."""

    scene: Scene
    samples: VertexSamples
    frames: Float32[np.ndarray, "vertices 3 3"]

    @staticmethod
    def of(scene: Scene) -> "Vertices":
        placed = vertex_samples(scene, largest_dip=0.0)
        return Vertices(scene, placed, frames_on_host(placed.normals))

    def views(self, chosen: Int[np.ndarray, "chosen"]) -> Views:
        """Where some of them are looked from."""
        return Views(self.samples.origins[chosen], self.frames[chosen])

    def places(self, alpha: float) -> Places:
        """All of them, in lengths of the scene's diagonal over alpha."""
        placed, scale = self.samples, alpha / self.scene.diagonal
        return Places.of(placed.positions, placed.normals, scale, connected_surfaces(placed))


def in_view(vertices: Vertices, surface: Surface | None) -> Bool[np.ndarray, "vertices"]:
    """Vertices of the triangles that pixels see, on the side seen; all without a surface."""
    count = len(vertices.samples.positions)
    if surface is None:
        return np.ones(count, bool)
    mask = np.asarray(surface.mask).reshape(-1)
    triangle = np.asarray(surface.triangle).reshape(-1)[mask]
    normal = np.asarray(surface.geometric_normal).reshape(-1, 3)[mask]
    front = vertices.scene.geometric_normals.take(triangle, axis=0)
    behind = np.einsum("pc,pc->p", front, normal) < 0.0
    shown = np.zeros(count, bool)
    shown[vertices.samples.triangles[triangle[~behind]].reshape(-1)] = True
    if len(vertices.samples.backs):
        shown[vertices.samples.backs[triangle[behind]].reshape(-1)] = True
    return shown


def buried(vertices: Vertices, chosen: Int[np.ndarray, "chosen"]) -> Bool[np.ndarray, "chosen"]:
    """Which of some vertices lie behind surfaces, where maps say nothing of what pixels see.

    Before, the rays' origins at those that lie in other surfaces are moved to their fronts.
    """
    scene, origins = vertices.scene, vertices.samples.origins
    one_sided = np.array([not m.two_sided for m in scene.materials])[scene.material_ids]
    if not one_sided.any():
        return np.zeros(len(chosen), bool)
    found = [np.zeros(0, bool)]
    for start in range(0, len(chosen), 4096):
        part = chosen[start : start + 4096]
        positions, upright = vertices.samples.positions[part], vertices.samples.normals[part]
        surfaces = scene.geometric_normals, one_sided
        rays, hits = _look_around(vertices, part)
        origins[part] = cleared_origins(positions, origins[part], upright, rays, hits, *surfaces)
        found.append(behind_surfaces(*_look_around(vertices, part), *surfaces))
    return np.concatenate(found)


def _look_around(
    vertices: Vertices, chosen: Int[np.ndarray, "chosen"]
) -> tuple[Float32[np.ndarray, "chosen rays 3"], Hits]:
    """A few rays from some vertices, and what they meet."""
    views, local = vertices.views(chosen), texel_directions(8).reshape(-1, 3)
    rays = np.einsum("ka,sac->skc", local, views.frames)
    origins = np.repeat(views.origins, len(local), axis=0)
    return rays, vertices.scene.tracer.closest_hit(origins, rays.reshape(-1, 3))


@dataclass(eq=False)
class Sampling:
    """Samples with their maps while they are placed. Numbers are those of vertices."""

    vertices: Vertices
    angular: Angular
    ids: Int[np.ndarray, "samples"]
    maps: Bool[np.ndarray, "samples n n"]
    distances: Float16[np.ndarray, "samples n n"]
    rays: int = 0

    @staticmethod
    def none(vertices: Vertices, angular: Angular) -> "Sampling":
        size = angular.resolution
        maps = np.zeros((0, size, size), bool)
        return Sampling(vertices, angular, np.zeros(0, np.int32), maps, maps.astype(np.float16))

    def adopt(
        self,
        ids: Int[np.ndarray, "adopted"],
        maps: Bool[np.ndarray, "adopted n n"],
        distances: Float16[np.ndarray, "adopted n n"],
    ) -> None:
        """Takes samples over as they are."""
        self.ids = np.concatenate([self.ids, ids.astype(np.int32)])
        self.maps = np.concatenate([self.maps, maps])
        self.distances = np.concatenate([self.distances, distances])

    def add(
        self,
        ids: Int[np.ndarray, "added"],
        places: Places | None = None,
        known: Known | None = None,
        progress: bool = False,
    ) -> None:
        """Fills the maps of more vertices, which may look at one another for hints."""
        maps = [self.maps[:0]]
        with tqdm(total=len(ids), desc="maps", unit="sample", disable=not progress) as bar:
            for start in range(0, len(ids), AT_ONCE):
                part = slice(start, start + AT_ONCE)
                old = known and Known(known.maps[part], known.stale[part])
                traced = fill_maps(self.vertices, self.angular, ids[part], places, old)
                maps.append(traced.maps)
                self.rays += traced.rays
                bar.update(len(ids[part]))
        added = np.concatenate(maps)
        self.adopt(ids, added, signed_distances(added))

    def keep(self, kept: Bool[np.ndarray, "samples"]) -> None:
        """Drops the other samples."""
        self.ids, self.maps = self.ids[kept], self.maps[kept]
        self.distances = self.distances[kept]


def fill_maps(
    vertices: Vertices,
    angular: Angular,
    ids: Int[np.ndarray, "samples"],
    places: Places | None,
    known: Known | None = None,
) -> Traced:
    """The maps of some vertices."""
    scene, views = vertices.scene, vertices.views(ids)
    if angular.fill == "rasterized":
        maps = rasterized_maps(scene, views.origins, views.frames, angular.resolution)
        return Traced(maps, 0)
    if angular.fill == "dense":
        size = angular.resolution
        return adaptive_maps(scene.tracer, views, size, size, known=known)
    hints = None
    if places is not None and len(ids) > 1:
        own = places.take(ids)
        hints = nearest_samples(own, own, HINTS + 1).samples[:, 1:]
    return adaptive_maps(
        scene.tracer,
        views,
        angular.resolution,
        angular.coarsest,
        neighbours=hints,
        known=known,
    )


def sample_every_vertex(
    scene: Scene,
    angular: Angular,
    *,
    progress: bool = False,
) -> DistanceFields:
    """Samples at all vertices; those that lie behind surfaces take the distances of others."""
    vertices = Vertices.of(scene)
    candidates = np.arange(len(vertices.samples.positions))
    hidden = buried(vertices, candidates)
    places = vertices.places(EVEN)
    sampling = Sampling.none(vertices, angular)
    sampling.add(candidates[~hidden], places, progress=progress)
    near = 4 if hidden.any() else 1
    return distance_fields(sampling, places, candidates, near=near, interpolation="inverse")


def place_samples(
    scene: Scene,
    angular: Angular,
    spatial: Spatial,
    surface: Surface | None = None,
    *,
    progress: bool = False,
) -> DistanceFields:
    """Samples where they are needed: initial ones, then rounds of insertion and erasure."""
    vertices = Vertices.of(scene)
    places = vertices.places(NEARBY * spatial.alpha)
    candidates = np.flatnonzero(in_view(vertices, surface))
    budget = sample_budget(spatial, len(vertices.samples.positions))
    sampling = Sampling.none(vertices, angular)
    if len(candidates):
        first = max(round(spatial.initial * budget), 1)
        bends = vertices.places(spatial.alpha).take(candidates)
        start = candidates[initial_samples(bends, first)]
        start = start[~buried(vertices, start)]
        sampling.add(start, places, progress=progress)
    adapt(sampling, places, candidates, spatial, budget, progress=progress)
    return distance_fields(
        sampling, places, candidates, near=spatial.near, interpolation=spatial.interpolation
    )


def sample_budget(spatial: Spatial, vertices: int) -> int:
    """Most samples, at least a handful."""
    return max(int(spatial.budget * vertices), FEWEST)


def adapt(
    sampling: Sampling,
    places: Places,
    candidates: Int[np.ndarray, "candidates"],
    spatial: Spatial,
    budget: int,
    *,
    rounds: int | None = None,
    progress: bool = False,
) -> None:
    """Rounds of insertion and erasure until nothing changes, the budget is spent or rounds end."""
    allowed = np.zeros(len(places.positions), bool)
    allowed[candidates] = True
    rounds = spatial.rounds if rounds is None else rounds
    for left in range(rounds, 0, -1):
        if len(sampling.ids) < 2:
            return
        own = places.take(sampling.ids)
        near = neighbours(own)
        seen = Seen(sampling.maps, sampling.distances, sampling.vertices.frames[sampling.ids])
        share = weights(own, own, near, spatial.interpolation)
        change = plan(
            places,
            allowed,
            sampling.ids,
            near,
            foretold(seen, near, share, spatial.measure),
            largest=spatial.largest,
            least=spatial.least,
        )
        insert, need = change.insert, change.need
        if spatial.measure == "distances":
            free = np.setdiff1d(np.flatnonzero(allowed), sampling.ids)
            doubtful, doubt = _contested(seen, own, places, free, spatial)
            groups = np.concatenate([insert, doubtful])
            insert, _ = most_needed(groups, np.concatenate([need, doubt]), groups)
        sampling.keep(~change.erase)
        # Half of what is left, for what only shows when there are more samples.
        room = max(budget - len(sampling.ids), 0)
        insert = insert[: room if left == 1 else -(-room // 2)]
        hidden = buried(sampling.vertices, insert)
        allowed[insert[hidden]] = False
        if hidden.all():
            return
        sampling.add(insert[~hidden], places, progress=progress)


def _contested(
    seen: Seen,
    own: Places,
    places: Places,
    free: Int[np.ndarray, "free"],
    spatial: Spatial,
) -> tuple[Int32[np.ndarray, "inserted"], Float32[np.ndarray, "inserted"]]:
    """Vertices about which samples disagree, the most contested one by each sample, and errors."""
    at = places.take(free)
    near = nearest_samples(own, at, spatial.near)
    share = weights(own, at, near, spatial.interpolation)
    error = contested(seen, frames_on_host(at.normals), near, share) / np.float32(CONTEST)
    doubtful = error > spatial.largest
    return most_needed(free[doubtful], error[doubtful], near.samples[doubtful, 0])


def distance_fields(
    sampling: Sampling,
    places: Places,
    candidates: Int[np.ndarray, "candidates"],
    *,
    near: int,
    interpolation: Interpolation,
    density: float | None = None,
) -> DistanceFields:
    """Distances at the samples, and the weights of vertices; ``density`` as they were placed, if
    they are carried over."""
    vertices, count = sampling.vertices, len(places.positions)
    own, at = places.take(sampling.ids), places.take(candidates)
    found = nearest_samples(own, at, near)
    share = weights(own, at, found, interpolation)
    all_near = np.zeros((count, near), np.int32)
    all_near[candidates] = np.maximum(found.samples, 0)
    all_weights = np.zeros((count, near), np.float32)
    all_weights[candidates] = share
    placed = vertices.samples
    return DistanceFields(
        signed_distance=sampling.distances,
        frames=vertices.frames[sampling.ids],
        bits=packed(sampling.maps),
        samples=sampling.ids,
        near=all_near,
        weights=all_weights,
        positions=placed.positions,
        normals=placed.normals,
        triangles=placed.triangles,
        backs=placed.backs,
        rays_traced=sampling.rays,
        density=len(sampling.ids) / max(len(candidates), 1) if density is None else density,
    )


def cached_fields(key: str, build: Callable[[], DistanceFields]) -> DistanceFields:
    """The fields cached under a key, or those of ``build``, stored for the next time."""

    def arrays() -> dict[str, np.ndarray]:
        made = build()
        found = {name: np.asarray(getattr(made, name)) for name in ARRAYS}
        return found | {"rays": np.array(made.rays_traced), "density": np.array(made.density)}

    found, _ = cached_arrays(KIND, key, arrays)
    rays, density = int(found["rays"]), float(found["density"])
    return DistanceFields(**{k: found[k] for k in ARRAYS}, rays_traced=rays, density=density)
