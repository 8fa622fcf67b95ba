"""A large Monte Carlo frame in bounded memory: time, peak memory, and the same bits for any chunk.

Renders one frame for each chunk size, each in a process of its own, so that peaks do not mix.
"""

import hashlib
import multiprocessing
import resource
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import jax
import numpy as np

import jaxvis
from experiments.output import Output
from experiments.settings import Common, execute, setting


@dataclass(frozen=True)
class Settings(Common):
    scene: str = setting("courtyard:triangles=200000", "what is lit")
    environment: str = setting("windows", "what lights it")
    size: tuple[int, int] = setting((1920, 1080), "of the frame", metavar=("W", "H"))
    spp: int = setting(64, "samples a pixel")
    chunks: tuple[int, ...] = setting((1 << 17, 1 << 20), "rays traced together")


def render(settings: Settings, chunk: int) -> dict[str, object]:
    """One frame: its time, its hash, and the peak memory of this process so far."""
    scene = jaxvis.load_scene(settings.scene)
    environment = jaxvis.load_environment(settings.environment)
    width, height = settings.size
    camera = jaxvis.default_camera(scene, aspect=width / height)
    surface = jaxvis.trace_surface(scene, camera, (width, height))
    method = jaxvis.MonteCarlo("mis", settings.spp, rays_per_chunk=chunk)
    visibility, light = method.precompute(scene), method.light(environment)
    start = time.perf_counter()
    image = np.asarray(method.shade(visibility, light, surface, key=jax.random.key(0)))
    return {
        "chunk rays": chunk,
        "seconds": time.perf_counter() - start,
        "Mrays": visibility.rays_traced / 1e6,
        "peak GiB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
        "sha256": hashlib.sha256(image.tobytes()).hexdigest()[:16],
    }


def render_apart(settings: Settings, chunk: int) -> dict[str, object]:
    """The same in a process of its own."""
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max_workers=1, mp_context=fresh) as process:
        return process.submit(render, settings, chunk).result()


def run(settings: Settings, output: Output) -> None:
    """A frame for each chunk size."""
    rows = [render_apart(settings, chunk) for chunk in settings.chunks]
    output.table("chunks", "One frame in several chunk sizes", rows)
    same = len({row["sha256"] for row in rows}) == 1
    output.say(f"The images are {'bit-identical' if same else 'DIFFERENT'}.")


if __name__ == "__main__":
    execute(Settings, run, __doc__)
