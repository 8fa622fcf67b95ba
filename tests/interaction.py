"""What tests of interaction share: which programs are compiled, methods made small, lights."""

import contextlib
import logging

import jax
import jax.numpy as jnp
import numpy as np

from jaxvis.lighting import Environment

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


def small(name):
    """The method with parameters that make it quick."""
    return f"{name}:{SMALLER.get(name, 'spp=4')}"


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
