"""A large Monte Carlo frame in bounded memory: time, peak memory, and the same bits for any chunk.

Renders one frame for each chunk size, each in a process of its own, so that peaks do not mix.
"""

import argparse
import hashlib
import json
import resource
import subprocess
import sys
import time

import jax
import numpy as np
import pandas as pd

import jaxvis


def render(options: argparse.Namespace, chunk: int) -> dict[str, object]:
    """One frame: its time, its hash, and the peak memory of this process so far."""
    scene = jaxvis.load_scene(options.scene)
    environment = jaxvis.load_environment(options.environment)
    width, height = options.size
    camera = jaxvis.default_camera(scene, aspect=width / height)
    surface = jaxvis.trace_surface(scene, camera, (width, height))
    method = jaxvis.MonteCarlo("mis", options.spp, rays_per_chunk=chunk)
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", default="courtyard:triangles=200000")
    parser.add_argument("--environment", default="windows")
    parser.add_argument("--size", nargs=2, type=int, default=[1920, 1080], metavar=("W", "H"))
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--chunks", nargs="+", type=int, default=[1 << 17, 1 << 20])
    parser.add_argument("--only", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.only is not None:
        print(json.dumps(render(options, options.only)))
        return
    rows = []
    for chunk in options.chunks:
        command = [sys.executable, "-m", "experiments.large_frame", *sys.argv[1:]]
        output = subprocess.run(
            [*command, "--only", str(chunk)], check=True, capture_output=True, text=True
        ).stdout
        rows.append(json.loads(output.splitlines()[-1]))
    print(pd.DataFrame(rows).to_string(index=False, float_format="{:.3g}".format))
    same = len({row["sha256"] for row in rows}) == 1
    print("the images are", "bit-identical" if same else "DIFFERENT")


if __name__ == "__main__":
    main()
