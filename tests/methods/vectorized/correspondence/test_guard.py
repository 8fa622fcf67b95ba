"""What the guard sees: closed forms of the traced sky, right and wrong lists, buried samples."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.methods.vectorized import precompute_polygons
from jaxvis.methods.vectorized.correspondence.build import Settings, build_correspondence
from jaxvis.methods.vectorized.correspondence.guard import excess_error, traced_irradiance
from jaxvis.methods.vectorized.precompute import Settings as Precision
from jaxvis.scene import RayTracer
from jaxvis.scene.builtin import builtin_scene

UP = np.array([[0.0, 1.0, 0.0]], np.float32)
FLOOR = np.array([[0.0, 0.0, 0.0]], np.float32)


def wall(x: float) -> RayTracer:
    """A huge quad across +x."""
    far = 1e4
    corners = [[x, -far, -far], [x, far, -far], [x, far, far], [x, -far, far]]
    return RayTracer(np.array(corners, np.float32), np.array([[0, 1, 2], [0, 2, 3]], np.int32))


def build(name, **options):
    """A correspondence of few vectors in a built-in scene, and the scene."""
    scene = builtin_scene(name)
    precision = Precision(vectors=32, resolution=32, coarsest=16)
    polygons = precompute_polygons(scene, precision, progress=False)
    return build_correspondence(polygons, None, Settings(**options)), scene


def test_the_open_sky_is_its_normal():
    found = traced_irradiance(wall(-1e6), FLOOR, UP, UP)
    np.testing.assert_allclose(found, UP, atol=2e-3)


def test_a_wall_takes_half_the_sky():
    """Of the quarter sphere x < 0: half along the normal, and half away from the wall."""
    found = traced_irradiance(wall(1e-3), FLOOR, UP, UP)
    np.testing.assert_allclose(found, [[-0.5, 0.5, 0.0]], atol=1.5e-2)


def test_nothing_is_seen_below_the_plane():
    """Shading normal and plane at a right angle: a quarter of the sphere is above both."""
    plane = np.array([[1.0, 0.0, 0.0]], np.float32)
    found = traced_irradiance(wall(-1e6), FLOOR, UP, plane)
    np.testing.assert_allclose(found, [[0.5, 0.5, 0.0]], atol=1.5e-2)


@pytest.mark.parametrize("interpolation", ["position", "direction"])
def test_right_lists_pass_and_wrong_ones_do_not(interpolation):
    """Lists whose second corner is half a turn behind are far worse than three integrals."""
    right, scene = build("box-on-plane")
    # Turning the bare horizon changes nothing: faces that see something finite.
    some = np.diff(np.asarray(right.starts)) > 0
    faces = np.flatnonzero(some & (np.asarray(right.distances) != 1.0))
    excess = excess_error(right, scene.tracer, interpolation, faces)
    assert np.median(excess[faces]) < 0.005
    triples, starts = np.asarray(right.triples).copy(), np.asarray(right.starts)
    counts = np.asarray(right.polygons.counts)[np.asarray(right.polygons.triangles)[:, 1]]
    for face in faces:
        own = triples[starts[face] : starts[face + 1]]
        own[:, 1] = (own[:, 1] + counts[face] // 2) % counts[face]
    wrong = excess_error(
        replace(right, triples=jnp.asarray(triples)), scene.tracer, interpolation, faces
    )
    assert np.mean(wrong[faces] > excess[faces] + 0.05) > 0.5
    rest = np.delete(wrong, faces)
    assert (rest == 0.0).all()


def test_flagged_faces_are_those_that_stay_worse():
    """With the guard at -1, all faces keep three evaluations; at 2, none does."""
    plain, scene = build("sphere")
    for guard, expected in ((-1.0, True), (2.0, False)):
        settings = Settings(guard=guard)
        found = build_correspondence(plain.polygons, scene.tracer, settings)
        faces = np.diff(np.asarray(plain.starts)) > 0
        assert (np.asarray(found.separate)[faces] == expected).all()
        assert len(found.triples) == (0 if expected else len(plain.triples))
