"""Another light, camera or seed compiles nothing: interaction waits for frames only."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from jaxvis.methods import create, names
from jaxvis.scene import trace_surface
from tests.interaction import compilations, light, small
from tests.methods.known_scenes import MATERIALS, SCENES

BOX = SCENES[2]
CAMERAS = (BOX.camera, replace(BOX.camera, eye=(1.3, 2.6, 4.0)))


def test_compilations_are_seen():
    with compilations() as found:
        jax.jit(lambda x: x * 3.0 + 1.0)(np.ones(17, np.float32))
    assert found


@pytest.mark.parametrize("name", names())
def test_another_light_and_camera_compile_nothing(name, own_caches):
    """Of the same size, whatever the light's name is."""
    method = create(small(name))
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
