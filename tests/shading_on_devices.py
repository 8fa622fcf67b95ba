"""A program: methods' images by one device and by all. Prints what differs, as JSON.

XLA_FLAGS=--xla_force_host_platform_device_count=3 python -m tests.shading_on_devices
"""

import json
import sys
from collections import Counter

import jax
import numpy as np

import jaxvis
from jaxvis.methods import create
from jaxvis.scene import trace_surface
from tests.interaction import SMALLER, light
from tests.methods.known_scenes import MATERIALS, SCENES

SIZE = (112, 84)
POLYGONS = "vectors=16,resolution=16,shading=fragment"
PARAMETERS = {
    **{name: SMALLER[name] for name in ("reference", "distance-field", "hybrid-cones")},
    **{"mc-mis": "spp=64", "mc-ides": "spp=16", "mc-adaptive": "spp=16"},
    **{"vectorized": POLYGONS, "correspondence": POLYGONS, "visibility-field": "cell=2,spp=16"},
}


def main() -> None:
    default_device, blocks = jax.default_device, Counter()

    def counted(device):
        blocks[device.id] += 1
        return default_device(device)

    jax.default_device = counted
    found = {}
    for name in sys.argv[1:] or PARAMETERS:
        method = create(f"{name}:{PARAMETERS[name]}")
        material = "diffuse" if PARAMETERS[name] == POLYGONS else "phong"
        scene = SCENES[2].with_material(*MATERIALS[material])
        surface = trace_surface(scene, SCENES[2].camera, SIZE)
        visibility, lit = method.precompute(scene, progress=False), method.light(light(0))
        key = jax.random.key(3)
        alone = np.asarray(method.shade(visibility, lit, surface, key=key))
        assert not blocks
        with jaxvis.on_devices():
            together = np.asarray(method.shade(visibility, lit, surface, key=key))
        worst = float(np.abs(together - alone).max())
        found[name] = {"differ": int((together != alone).sum()), "worst": worst}
        found[name] |= {"blocks": dict(blocks), "mean": float(alone.mean())}
        blocks.clear()
    print(json.dumps({"devices": len(jax.devices()), "methods": found}))


if __name__ == "__main__":
    main()
