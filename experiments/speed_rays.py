"""How fast jaxvis traces rays, and how much of a Monte Carlo frame is ray tracing.

Prints two tables: the throughput of jaxvis.scene.rays beside that of bare embreex on the same rays
in as many threads, and, for each estimator, the share of a frame's time that is spent in Embree.
"""

import argparse
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import jax
import numpy as np
import pandas as pd
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

import jaxvis
from jaxvis import methods
from jaxvis.methods.traced import shading_points
from jaxvis.sampling.hemisphere import sample_cosine
from jaxvis.scene import RayTracer, Scene, Surface
from jaxvis.sphere.frames import to_world


def best_of(repeats: int, *functions: Callable[[], object]) -> list[float]:
    """Shortest time of each function, taking turns so that all meet the same machine."""
    best = [np.inf] * len(functions)
    for _ in range(repeats):
        for i, function in enumerate(functions):
            start = time.perf_counter()
            function()
            best[i] = min(best[i], time.perf_counter() - start)
    return best


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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", nargs="+", default=["courtyard:triangles=200000", "teapot"])
    parser.add_argument("--environment", default="windows")
    parser.add_argument("--size", nargs=2, type=int, default=[640, 480], metavar=("W", "H"))
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--rays", type=int, default=2_000_000)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    environment = jaxvis.load_environment(options.environment)
    rates, shares = [], []
    for name in options.scene:
        scene = jaxvis.load_scene(name)
        surface = jaxvis.trace_surface(scene, jaxvis.default_camera(scene), tuple(options.size))
        rates += throughput(scene, surface, options.rays, options.repeats)
        shares += frame_shares(scene, environment, surface, options.spp, options.repeats)
    for title, rows in {"Ray throughput": rates, "Share of a frame in Embree": shares}.items():
        print(
            f"\n{title}\n{pd.DataFrame(rows).to_string(index=False, float_format='{:.3g}'.format)}"
        )


if __name__ == "__main__":
    main()
