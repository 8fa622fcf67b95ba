"""How fast jaxvis traces rays, and how much of a Monte Carlo frame is ray tracing.

Prints two tables: the throughput of jaxvis.scene.rays beside that of bare embreex on the same rays
in as many threads, and, for each estimator, the share of a frame's time that is spent in Embree.
"""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import jax
import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

import jaxvis
from experiments.measuring import best_of
from experiments.output import Output
from experiments.settings import Common, execute, setting
from jaxvis import methods
from jaxvis.methods.traced import shading_points
from jaxvis.sampling.hemisphere import sample_cosine
from jaxvis.scene import RayTracer, Scene, Surface
from jaxvis.sphere.frames import to_world


@dataclass(frozen=True)
class Settings(Common):
    scene: tuple[str, ...] = setting(("courtyard:triangles=200000", "teapot"), "what is traced")
    environment: str = setting("windows", "what lights it")
    size: tuple[int, int] = setting((640, 480), "of the frames", metavar=("W", "H"))
    spp: int = setting(64, "samples a pixel")
    rays: int = setting(2_000_000, "rays of the throughput")
    repeats: int = setting(5, "rounds of timing")


def cosine_rays(surface: Surface, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Shadow rays as a renderer traces them: cosine-distributed, point after point."""
    points = shading_points(surface)
    samples = -(-count // len(points.pixel))
    uniforms = jax.random.uniform(jax.random.key(0), (len(points.pixel), samples, 2))
    local = sample_cosine(uniforms)
    directions = np.asarray(to_world(local, points.geometric_normal[:, None]))
    origins = np.repeat(np.asarray(points.origin), samples, axis=0)
    return origins[:count], np.ascontiguousarray(directions.reshape(-1, 3)[:count])


def bare_embree(scene: Scene, threads: int) -> Callable[[str, np.ndarray, np.ndarray], None]:
    """embreex alone at its best: contiguous float32 rays, in slices shared among threads."""
    embree = EmbreeScene(robust=True)
    TriangleMesh(embree, scene.positions, scene.triangles)
    embree.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))
    pool = ThreadPoolExecutor(threads)

    def trace(query: str, origins: np.ndarray, directions: np.ndarray) -> None:
        parts = np.array_split(np.arange(len(origins)), 16 * threads)
        options = {"output": 1} if query == "closest hit" else {"query": "OCCLUDED"}
        list(
            pool.map(
                lambda p: embree.run(
                    origins[p[0] : p[-1] + 1], directions[p[0] : p[-1] + 1], **options
                ),
                parts,
            )
        )

    return trace


def throughput(scene: Scene, surface: Surface, rays: int, repeats: int) -> list[dict[str, object]]:
    """Million rays a second of both, for shadow rays and for closest hits."""
    origins, directions = cosine_rays(surface, rays)
    tracer = RayTracer(scene.positions, scene.triangles)
    bare = bare_embree(scene, tracer.threads)
    rows = []
    for query, ours in {"occluded": tracer.occluded, "closest hit": tracer.closest_hit}.items():
        alone, through = best_of(
            repeats,
            lambda query=query: bare(query, origins, directions),
            lambda ours=ours: ours(origins, directions),
        )
        rows.append(
            {
                "scene": scene.name,
                "query": query,
                "rays": rays,
                "threads": tracer.threads,
                "embreex Mrays/s": rays / alone / 1e6,
                "jaxvis Mrays/s": rays / through / 1e6,
                "ratio": alone / through,
            }
        )
    return rows


def frame_shares(
    scene: Scene, environment: jaxvis.Environment, surface: Surface, spp: int, repeats: int
) -> list[dict[str, object]]:
    """Share of each estimator's frame that is spent in the tracing calls."""
    rows = []
    for name in ("mc-uniform", "mc-environment", "mc-brdf", "mc-mis"):
        method = methods.create(name, spp=spp)
        visibility, light = method.precompute(scene), method.light(environment)
        tracer, key = visibility.tracer, jax.random.key(0)
        jax.block_until_ready(method.shade(visibility, light, surface, key=key))
        best = None
        for _ in range(repeats):
            rays, seconds, start = tracer.rays_traced, tracer.embree_seconds, time.perf_counter()
            jax.block_until_ready(method.shade(visibility, light, surface, key=key))
            frame = time.perf_counter() - start
            if best is None or frame < best["frame s"]:
                best = {
                    "scene": scene.name,
                    "method": name,
                    "spp": spp,
                    "frame s": frame,
                    "Embree s": (tracer.embree_seconds - seconds) / tracer.threads,
                    "share": (tracer.embree_seconds - seconds) / tracer.threads / frame,
                    "Mrays traced": (tracer.rays_traced - rays) / 1e6,
                }
        rows.append(best)
    return rows


def run(settings: Settings, output: Output) -> None:
    """All scenes under one light."""
    environment = jaxvis.load_environment(settings.environment)
    rates, shares = [], []
    for name in settings.scene:
        scene = jaxvis.load_scene(name)
        surface = jaxvis.trace_surface(scene, jaxvis.default_camera(scene), settings.size)
        rates += throughput(scene, surface, settings.rays, settings.repeats)
        shares += frame_shares(scene, environment, surface, settings.spp, settings.repeats)
    output.table("throughput", "Ray throughput", rates)
    output.table("shares", "Share of a frame in Embree", shares)


if __name__ == "__main__":
    execute(Settings, run, __doc__)
