import jax
import numpy as np
import pytest

from jaxvis.methods.vectorized import VisibilityPolygons, precompute_polygons
from jaxvis.methods.vectorized.precompute import Settings
from jaxvis.scene.builtin import builtin_scene


@pytest.fixture(scope="module")
def polygons():
    settings = Settings(vectors=32, resolution=16, coarsest=16)
    return precompute_polygons(builtin_scene("plane", cells=2), settings, progress=False)


def test_files_hold_everything(polygons, tmp_path):
    polygons.save(tmp_path / "polygons.npz")
    again = VisibilityPolygons.load(tmp_path / "polygons.npz")
    for here, there in zip(jax.tree.leaves(polygons), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(here, there)


def test_damaged_and_missing_files_are_refused(polygons, tmp_path):
    path = tmp_path / "polygons.npz"
    with pytest.raises(FileNotFoundError):
        VisibilityPolygons.load(path)
    polygons.save(path)
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(ValueError, match="damaged"):
        VisibilityPolygons.load(path)


def test_the_size_is_that_of_the_arrays(polygons):
    vectors = polygons.vectors
    assert polygons.capacity == vectors.shape[2] == 32
    assert vectors.nbytes < polygons.nbytes < 1.5 * vectors.nbytes


def test_they_pass_through_jit(polygons):
    total = jax.jit(lambda p: p.vectors.sum() + p.counts.sum())(polygons)
    assert np.isfinite(total)
