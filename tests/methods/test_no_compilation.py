"""Another light, camera or seed compiles nothing: interaction waits for frames only."""

import contextlib
import logging
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.lighting import Environment
from jaxvis.methods import create, names
from jaxvis.scene import trace_surface
from tests.methods.known_scenes import MATERIALS, SCENES

BOX = SCENES[2]
CAMERAS = (BOX.camera, replace(BOX.camera, eye=(1.3, 2.6, 4.0)))
SMALLER = {
    "vectorized": "vectors=16,resolution=16,zeta=0",
    "correspondence": "vectors=16,resolution=16,zeta=0",
    "distance-field": "resolution=8,lights=8",
    "adaptive": "resolution=16,lights=8,budget=1",
    "shadow-map": "resolution=16,lights=8,budget=1",
    "visibility-field": "cell=2,spp=4",
    "unculled": "spp=4",
    "hybrid-cones": "",
    "voxel-cones": "",
    "reference": "error=0.3",
}


@contextlib.contextmanager
def compilations():
    """The names of the programs that are compiled inside."""
    found: list[str] = []

    class Listener(logging.Handler):
        def emit(self, record):
            message = record.getMessage()
            if message.startswith("Compiling"):
                found.append(message[:80])

    logger, listener = logging.getLogger("jax"), Listener()
    logger.addHandler(listener)
    try:
        with jax.log_compiles():
            yield found
    finally:
        logger.removeHandler(listener)


def light(seed):
    radiance = np.random.default_rng(seed).uniform(0.1, 3.0, (16, 32, 3))
    return Environment(jnp.asarray(radiance, jnp.float32), f"light {seed}")


def test_compilations_are_seen():
    with compilations() as found:
        jax.jit(lambda x: x * 3.0 + 1.0)(jnp.ones(17))
    assert found


@pytest.mark.parametrize("name", names())
def test_another_light_and_camera_compile_nothing(name, own_caches):
    """Of the same size, whatever the light's name is."""
    method = create(f"{name}:{SMALLER.get(name, 'spp=4')}")
    # How often images by polygons are evaluated depends on the light, unless they are diffuse and
    # zeta is 0: programs for another power of two may be compiled.
    material = "diffuse" if name in ("vectorized", "correspondence") else "phong"
    scene = BOX.with_material(*MATERIALS[material])
    visibility = method.precompute(scene, progress=False)

    def frame(camera, seed):
        surface = trace_surface(scene, CAMERAS[camera], (24, 18))
        key = jax.random.key(seed)
        return np.asarray(method.shade(visibility, method.light(light(seed)), surface, key=key))

    frames = [frame(0, 0)]
    with compilations() as found:
        frames += [frame(0, 1), frame(1, 1)]
    assert found == []
    assert not np.array_equal(frames[0], frames[1])
    assert not np.array_equal(frames[1], frames[2])
