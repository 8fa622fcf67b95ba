"""Files of corresponding polygons, and their sizes."""

import jax
import numpy as np
import pytest

from jaxvis.methods.vectorized import VisibilityPolygons
from jaxvis.methods.vectorized.correspondence import CorrespondingPolygons
from tests.methods.vectorized.analytic import random_polygons
from tests.methods.vectorized.correspondence.staircases import corresponding


@pytest.fixture(scope="module")
def pair():
    return corresponding(random_polygons(4, triangles=[[0, 1, 2], [2, 1, 3]]))


def test_files_hold_everything(pair, tmp_path):
    pair.save(tmp_path / "pair.npz")
    again = CorrespondingPolygons.load(tmp_path / "pair.npz")
    for a, b in zip(jax.tree.leaves(pair), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(a, b)
        assert a.dtype == b.dtype


def test_sizes(pair):
    count = len(pair.triples)
    assert pair.triple_bytes == 6 * count
    assert pair.paper_triple_bytes == 24 * count
    own = sum(leaf.nbytes for leaf in (pair.evaluated, pair.starts, pair.distances, pair.separate))
    assert pair.nbytes == pair.polygons.nbytes + pair.triple_bytes + own


def test_other_files_are_refused(pair, tmp_path):
    with pytest.raises(FileNotFoundError, match="no such file"):
        CorrespondingPolygons.load(tmp_path / "none.npz")
    pair.polygons.save(tmp_path / "polygons.npz")
    with pytest.raises(ValueError, match="not 'corresponding-polygons'"):
        CorrespondingPolygons.load(tmp_path / "polygons.npz")
    pair.save(tmp_path / "pair.npz")
    with pytest.raises(ValueError, match="not 'visibility-polygons'"):
        VisibilityPolygons.load(tmp_path / "pair.npz")
    whole = (tmp_path / "pair.npz").read_bytes()
    (tmp_path / "half.npz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match="damaged"):
        CorrespondingPolygons.load(tmp_path / "half.npz")
