"""The example of docs/your_own_method.md: registered, compared, and held to known answers."""

import importlib.util
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

import jaxvis
from jaxvis.cache import load_arrays
from jaxvis.lighting import Environment
from jaxvis.methods import registry
from jaxvis.methods.vertices import vertex_samples
from jaxvis.scene import Camera, trace_surface

DOCS = Path(__file__).parents[1] / "docs"
SOURCE = DOCS / "examples" / "own_method.py"
SIZE = (16, 12)


@pytest.fixture(scope="module")
def example():
    """The example's module. Its method is forgotten afterwards: other tests list the methods."""
    before = dict(registry._ENTRIES)
    spec = importlib.util.spec_from_file_location("own_method", SOURCE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    yield module
    registry._ENTRIES.clear()
    registry._ENTRIES.update(before)


def uniform(value: float = 1.0) -> Environment:
    return Environment(jnp.full((8, 16, 3), value, jnp.float32), "uniform")


def image(method, scene, environment, camera=None, size=SIZE):
    surface = trace_surface(scene, camera or jaxvis.default_camera(scene), size)
    visibility, light = method.precompute(scene), method.light(environment)
    return np.asarray(method.shade(visibility, light, surface)), surface


def test_the_page_shows_the_file_as_it_is_and_it_is_short():
    source = SOURCE.read_text()
    assert f"```python\n{source}```" in (DOCS / "your_own_method.md").read_text()
    assert len(source.splitlines()) <= 60


def test_it_is_registered_and_takes_parameters_in_its_name(example):
    method = registry.create("bent-normals:rays=64")
    assert method == example.BentNormals(rays=64)
    with pytest.raises(ValueError, match="has no parameter"):
        registry.create("bent-normals:ray=64")


def test_an_open_plane_under_a_uniform_sky_shows_its_albedo(example):
    """Nothing is hidden, so that E = pi L and radiance is the base colour times L."""
    scene = jaxvis.load_scene("plane")
    found, surface = image(example.BentNormals(rays=64), scene, uniform(3.0))
    covered = np.asarray(surface.mask)
    assert covered.sum() > 50
    expected = 3.0 * np.asarray(surface.material.base_colour)[covered]
    np.testing.assert_allclose(found[covered], expected, rtol=1e-5)
    assert (found[~covered] == 0.0).all()


def test_a_box_darkens_its_foot_as_half_the_sky_does(example):
    """Before a face of half-width a and height h the hidden share at a distance d is known:
    1/pi (atan(a/d) - d / sqrt(d^2 + h^2) atan(a / sqrt(d^2 + h^2))); far away it vanishes."""
    scene = jaxvis.load_scene("box-on-plane:size=12,cells=96")
    a, h = 1.0, 2.0
    for d in (0.25, 0.5, 1.0, 3.0):  # vertices of the plane, whose cells are 1/8 wide
        camera = Camera(
            (0.0, 0.5, 1.0 + d), (0.0, 0.0, 1.0 + d), up=(0.0, 0.0, -1.0), field_of_view=0.01
        )
        found, surface = image(example.BentNormals(rays=1024), scene, uniform(), camera, (1, 1))
        slant = np.hypot(d, h)
        hidden = (np.arctan(a / d) - d / slant * np.arctan(a / slant)) / np.pi
        expected = np.asarray(surface.material.base_colour).reshape(3) * (1.0 - hidden)
        assert hidden > 0.02
        np.testing.assert_allclose(found[0, 0], expected, atol=0.01)


def test_bent_normals_turn_away_from_a_box(example):
    """Against a grid of directions, each tested against the face that is seen by formula."""
    scene = jaxvis.load_scene("box-on-plane:size=12,cells=96")
    a, h, d = 1.0, 2.0, 0.25
    u, v = (np.arange(400) + 0.5) / 400, 2.0 * np.pi * (np.arange(800) + 0.5) / 800
    sine, phi = np.sqrt(u)[:, None], v[None, :]  # spread like the cosine, about +Y
    x, y, z = np.broadcast_arrays(sine * np.cos(phi), np.sqrt(1.0 - sine**2), sine * np.sin(phi))
    length = np.where(z < 0.0, d / np.maximum(-z, 1e-12), np.inf)  # to the plane of the face
    with np.errstate(invalid="ignore"):
        free = ~((z < 0.0) & (np.abs(x * length) < a) & (y * length < h))
    mean = np.array([(axis * free).mean() for axis in (x, y, z)])
    expected = mean / np.linalg.norm(mean) * free.mean()
    assert expected[2] > 0.15

    found = example.BentNormals(rays=4096).precompute(scene)
    at = vertex_samples(scene).positions + scene.origin
    foot = np.argmin(np.linalg.norm(at - np.array([0.0, 0.0, 1.0 + d]), axis=1))
    np.testing.assert_allclose(np.asarray(found.bent)[foot], expected, atol=3e-3)


def test_compare_measures_it_beside_a_registered_method(example):
    comparison = jaxvis.compare(
        "box-on-plane",
        uniform(),
        "bent-normals,bent-normals:rays=4",
        SIZE,
        reference="reference:error=0.02",
        progress=False,
        stop_on_error=True,
    )
    many, few = comparison["results"]
    assert many["method"] == "bent-normals"
    assert many["visibility_bytes"] > 0
    assert many["evaluations"] > 0
    assert many["psnr_db"] > 27.0
    assert few["psnr_db"] < many["psnr_db"]  # four rays a vertex must show


def test_its_visibility_can_be_written(example, tmp_path):
    found = example.BentNormals(rays=4).precompute(jaxvis.load_scene("plane"))
    found.save(tmp_path / "plane.npz")
    arrays, _ = load_arrays(tmp_path / "plane.npz", "bent-normal")
    np.testing.assert_array_equal(arrays["bent"], np.asarray(found.bent))
    assert found.nbytes == sum(array.nbytes for array in arrays.values())
