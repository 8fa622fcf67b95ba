"""jaxvis against Mitsuba 3 (scalar variant): the same scene gives the same image, by pixel."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.mitsuba_bridge import (
    MITSUBA_BSDFS,
    direct_integrator,
    load_mitsuba,
    mitsuba_environment,
    mitsuba_scene,
    rough_metal,
    white_diffuse,
)
from experiments.peer_mitsuba import comparable
from jaxvis.lighting import Environment
from jaxvis.methods import MonteCarlo, Reference
from jaxvis.scene import trace_surface
from tests.methods.known_scenes import SCENES, contrasted

pytest.importorskip("mitsuba", reason="Mitsuba 3 is not installed (the [peers] extra)")

SIZE = (20, 16)
SUPERSAMPLING = 4


@pytest.fixture(scope="module")
def mi():
    return load_mitsuba("scalar_rgb")


def theirs(mi, scene, camera, environment, material, renders=8, spp=128):
    peer = mitsuba_scene(mi, scene, camera, environment, SIZE, MITSUBA_BSDFS[material])
    integrator = direct_integrator(mi)
    images = [
        np.array(mi.render(peer, integrator=integrator, spp=spp, seed=i)) for i in range(renders)
    ]
    return np.mean(images, axis=0), np.std(images, axis=0, ddof=1) / np.sqrt(renders)


def ours(scene, camera, environment):
    surface = trace_surface(scene, camera, SIZE, supersampling=SUPERSAMPLING)
    method = Reference(subdivision=6)
    image = method.shade(method.precompute(scene), method.light(environment), surface)
    inside = (np.asarray(surface.coverage) == 1.0) & comparable(scene, surface)
    return np.asarray(image, np.float64), inside


@pytest.mark.parametrize("material", ["diffuse", "metal"])
def test_the_same_scene_gives_the_same_image(mi, material):
    known = SCENES[3]
    scene = {"diffuse": white_diffuse, "metal": rough_metal}[material](known.load())
    environment = contrasted(seed=2)
    image, inside = ours(scene, known.camera, environment)
    expected, error = theirs(mi, scene, known.camera, environment, material)
    assert inside.sum() > 100
    ratio = image[inside].mean(axis=0) / expected[inside].mean(axis=0)
    noise = np.sqrt(np.mean(error[inside] ** 2)) / expected[inside].mean() / np.sqrt(inside.sum())
    np.testing.assert_allclose(ratio, 1.0, atol=0.003 + 4.0 * noise)
    apart = (image - expected)[inside] / np.maximum(error[inside], 1e-3 * expected[inside].mean())
    assert np.mean(np.abs(apart) < 5.0) > 0.97
    mirrored = Environment(environment.radiance[:, ::-1])
    wrong, _ = ours(scene, known.camera, mirrored)
    assert np.abs(wrong[inside].mean(axis=0) / expected[inside].mean(axis=0) - 1.0).max() > 0.02


def test_resampling_keeps_the_light():
    """The resampled map, interpolated as Mitsuba does, has the flux of the piecewise-constant."""
    environment = contrasted()
    nodes = mitsuba_environment(environment).astype(np.float64)
    rows, columns = nodes.shape[:2]
    theta = np.pi * np.arange(rows) / (rows - 1)
    # Integral of the row-wise linear interpolation times sin(theta), by fine steps.
    fine = np.linspace(0.0, np.pi, 20001)
    profile = np.stack(
        [np.interp(fine, theta, nodes[..., c].sum(axis=1)) for c in range(3)], axis=-1
    )
    flux = np.trapezoid(profile * np.sin(fine)[:, None], fine, axis=0) * 2.0 * np.pi / columns
    exact = np.asarray(environment.radiance, np.float64).sum(axis=1)
    edges = np.cos(np.pi * np.arange(environment.height + 1) / environment.height)
    expected = (exact * (edges[:-1] - edges[1:])[:, None]).sum(axis=0)
    expected *= 2.0 * np.pi / environment.width
    np.testing.assert_allclose(flux, expected, rtol=0.01)


def test_monte_carlo_agrees_too(mi):
    known = SCENES[2]
    scene = white_diffuse(known.load())
    environment = contrasted(seed=3)
    surface = trace_surface(scene, known.camera, SIZE, supersampling=SUPERSAMPLING)
    method = MonteCarlo("mis", 64)
    image = method.shade(
        method.precompute(scene), method.light(environment), surface, key=jax.random.key(0)
    )
    expected, _ = theirs(mi, scene, known.camera, environment, "diffuse")
    inside = np.asarray(surface.coverage) == 1.0
    ratio = float(jnp.mean(image[inside])) / expected[inside].mean()
    assert ratio == pytest.approx(1.0, abs=0.01)
