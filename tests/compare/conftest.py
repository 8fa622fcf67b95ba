"""One small scene and light, and caches that stay out of the user's."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.lighting import Environment
from jaxvis.scene import Camera, build_scene


@pytest.fixture(scope="module", autouse=True)
def apart(own_caches):
    """All these tests use the caches."""


@pytest.fixture(scope="session")
def scene():
    """A floor that the camera sees in the lower part of the picture."""
    positions = np.array([[-9, 0, -9], [9, 0, -9], [9, 0, 9], [-9, 0, 9]], np.float32)
    triangles = np.array([[0, 2, 1], [0, 3, 2]])
    camera = Camera((0.0, 1.0, 4.0), (0.0, 0.9, 0.0), field_of_view=0.7)
    return build_scene(positions, triangles, camera=camera, name="floor")


@pytest.fixture(scope="session")
def sky():
    """A small sky, brighter on one side."""
    radiance = np.ones((8, 16, 3), np.float32)
    radiance[:4, :8] = [4.0, 3.0, 2.0]
    return Environment(jnp.asarray(radiance), "two halves")
