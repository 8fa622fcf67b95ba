"""Large frames in bounded memory: time, peak memory, and the same bits for any chunk.

Each frame is rendered in a process of its own, so that peaks do not mix: precomputation, light and
compilation are part of them. ``--gradient`` names methods whose image is also differentiated with
respect to all numbers of their light.
"""

import hashlib
import multiprocessing
import resource
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from experiments.output import Output
from experiments.settings import Common, execute, setting
from jaxvis.compare import prepare
from jaxvis.compare.measurement import rays_traced
from jaxvis.methods import create

METHODS = (
    *("mc-mis:spp=64", "mc-mis:spp=64,rays_per_chunk=1048576", "mc-ides:spp=64"),
    *("mc-adaptive:spp=64", "visibility-field:spp=64", "correspondence", "distance-field"),
    *("adaptive", "hybrid-cones"),
)


@dataclass(frozen=True)
class Settings(Common):
    scene: str = setting("courtyard:triangles=20000", "what is lit")
    environment: str = setting("windows", "what lights it")
    size: tuple[int, int] = setting((1920, 1080), "of the frame", metavar=("W", "H"))
    method: tuple[str, ...] = setting(METHODS, "methods")
    gradient: tuple[str, ...] = setting(
        ("correspondence", "distance-field", "hybrid-cones"), "methods"
    )


def render(settings: Settings, name: str, gradient: bool) -> dict[str, object]:
    """One frame: its time, its hash, and the peak memory of this process."""
    found = prepare(settings.scene, settings.environment, settings.size)
    method = create(name)
    visibility = method.precompute_for(found.scene, found.surface, progress=False)
    rays = rays_traced(visibility)
    leaves, structure = jax.tree.flatten(method.light(found.environment))
    numbers = [np.issubdtype(np.asarray(leaf).dtype, np.floating) for leaf in leaves]

    def image(values: list[jax.Array]) -> jax.Array:
        left = iter(values)
        lit = [next(left) if own else leaf for own, leaf in zip(numbers, leaves, strict=True)]
        light = structure.unflatten(lit)
        return method.shade(visibility, light, found.surface, key=jax.random.key(0))

    values = [leaf for own, leaf in zip(numbers, leaves, strict=True) if own]
    function = jax.grad(lambda values: jnp.mean(image(values))) if gradient else image
    start = time.perf_counter()
    results = [np.asarray(result) for result in jax.tree.leaves(function(values))]
    return {
        "method": name,
        "what": "gradient" if gradient else "image",
        "seconds": time.perf_counter() - start,
        "Mrays": (rays_traced(visibility) - rays) / 1e6,
        "peak GiB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
        "finite": all(bool(np.isfinite(result).all()) for result in results),
        "sha256": hashlib.sha256(results[0].tobytes()).hexdigest()[:16],
    }


def render_apart(settings: Settings, name: str, gradient: bool) -> dict[str, object]:
    """The same in a process of its own."""
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max_workers=1, mp_context=fresh) as process:
        return process.submit(render, settings, name, gradient).result()


def run(settings: Settings, output: Output) -> None:
    """A frame of each method."""
    rows = [render_apart(settings, name, False) for name in settings.method]
    rows += [render_apart(settings, name, True) for name in settings.gradient]
    output.table("frames", "{} x {} pixels".format(*settings.size), rows)
    images: dict[str, set[object]] = {}
    for row in rows[: len(settings.method)]:
        name = str(row["method"]).partition(",rays_per_chunk=")[0]
        images.setdefault(name, set()).add(row["sha256"])
    if len(images) < len(settings.method):
        same = all(len(found) == 1 for found in images.values())
        output.say(f"Chunks of other sizes: {'the same bits' if same else 'OTHER BITS'}.")


if __name__ == "__main__":
    execute(Settings, run, __doc__)
