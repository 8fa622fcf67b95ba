"""Inverse lighting: lobes are recovered from one rendered image."""

import numpy as np
import pytest

from experiments.inverse_lighting import comparison, from_energy, recover, renderer
from tests.methods.known_scenes import MATERIALS, SCENES

pytestmark = pytest.mark.usefixtures("own_caches")


def test_two_lobes_are_recovered_from_one_image():
    known = next(scene for scene in SCENES if scene.name == "sphere-on-plane")
    render, _ = renderer(known.with_material(*MATERIALS["phong"]), (24, 18), 32)
    axes = np.array([[0.6, 0.64, 0.48], [-0.6, 0.8, 0.0]])
    truth = from_energy(axes, np.array([60.0, 20.0]), np.array([[2.0, 1.0, 0.5], [0.5, 1.0, 1.5]]))
    recovery = recover(render, render(truth), 2, steps=150, candidates=48)
    assert recovery.error < 0.01
    assert recovery.first_error > 5.0 * recovery.error
    rows = comparison(truth, recovery.lobes)
    assert [row["lobe"] for row in rows] == [1, 2]
    for row, axis in zip(rows, axes, strict=True):
        np.testing.assert_allclose([row[name] for name in "xyz"], axis, atol=1e-6)
        assert row["degrees apart"] < 1.5
        assert row["recovered"] == pytest.approx(row["sharpness"], rel=0.3)
        energy, own = ([row[f"{of} {name}"] for name in "rgb"] for of in ("energy", "recovered"))
        np.testing.assert_allclose(own, energy, rtol=0.03, atol=0.02)
