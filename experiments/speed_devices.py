"""Frames shaded by one JAX device and by several: seconds, and whether the images are the same.

On whatever devices JAX finds: those of a machine with GPUs, or simulated ones, which share its
cores and so tell that nothing breaks, not how fast it would be:

    XLA_FLAGS=--xla_force_host_platform_device_count=4 python -m experiments speed_devices
    JAX_PLATFORMS=cuda python -m experiments speed_devices
"""

import statistics
import time
from dataclasses import dataclass

import jax
import numpy as np

import jaxvis
from experiments.output import Output
from experiments.settings import Common, execute, setting
from jaxvis.compare import prepare
from jaxvis.methods import create

METHODS = (
    *("mc-mis:spp=16", "visibility-field:spp=16", "correspondence:shading=fragment"),
    *("distance-field", "adaptive", "hybrid-cones"),
)


@dataclass(frozen=True)
class Settings(Common):
    scene: str = setting("duck", "what is shaded")
    environment: str = setting("stpeters", "what lights it")
    size: tuple[int, int] = setting((1280, 720), "of the frames", metavar=("W", "H"))
    method: tuple[str, ...] = setting(METHODS, "methods")
    frames: int = setting(5, "that are timed")


def counts(available: int) -> list[int]:
    """1, 2, 4, ... and all."""
    return sorted({min(1 << k, available) for k in range(available.bit_length() + 1)})


def run(settings: Settings, output: Output) -> None:
    """All methods on one scene, on more and more devices."""
    found = prepare(settings.scene, settings.environment, settings.size)
    devices = jax.devices()
    rows = []
    for name in settings.method:
        method = create(name)
        light = method.light(found.environment)
        visibility = method.precompute_for(found.scene, found.surface, progress=False)

        def frame(method=method, visibility=visibility, light=light) -> np.ndarray:
            key = jax.random.key(0)
            return np.asarray(method.shade(visibility, light, found.surface, key=key))

        alone = frame()
        for count in counts(len(devices)):
            with jaxvis.on_devices(devices[:count]):
                image, times = frame(), []
                for _ in range(settings.frames):
                    start = time.perf_counter()
                    frame()
                    times.append(time.perf_counter() - start)
            rows.append(
                {
                    "method": name,
                    "device": devices[0].device_kind,
                    "devices": count,
                    "ms": 1e3 * statistics.median(times),
                    "pixels that differ": int((image != alone).any(axis=-1).sum()),
                }
            )
    output.table("devices", "Frames by devices", rows)


if __name__ == "__main__":
    execute(Settings, run, __doc__)
