"""What cone tracing stores of a scene, on disk and off."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.lighting import uniform
from jaxvis.methods.cones.method import HybridCones, VoxelCones
from jaxvis.methods.cones.visibility import ConeVisibility
from tests.methods.cones.made_scenes import ball, box, flat_ground, scene

MADE = scene(flat_ground(4.0, 4), box((-0.5, 0.1, -0.5), (0.5, 1.0, 0.5)))
GROUND = scene(flat_ground(4.0, 4))
BALL = scene(ball(rows=12))
SMALL = {"voxels": 16, "texels": 64}


@pytest.mark.parametrize("bounces", [0, 1])
@pytest.mark.parametrize("made", [MADE, GROUND, BALL], ids=["mixed", "2D", "3D"])
def test_saving_and_loading_keep_every_bit(made, bounces, tmp_path):
    saved = HybridCones(bounces=bounces, **SMALL).precompute(made)
    saved.save(tmp_path / "v.npz")
    loaded = ConeVisibility.load(tmp_path / "v.npz")
    one, other = jax.tree.flatten(saved), jax.tree.flatten(loaded)
    assert len(one[0]) == len(other[0])
    for a, b in zip(one[0], other[0], strict=True):
        np.testing.assert_array_equal(np.asarray(a), np.asarray(b))
        assert np.asarray(a).dtype == np.asarray(b).dtype
    assert loaded.nbytes == saved.nbytes
    assert (loaded.maps.grid is None) == (saved.maps.grid is None)
    assert (loaded.maps.plan is None) == (saved.maps.plan is None)
    start, down = np.float32([[0.0, 5.0, 0.0]]), np.float32([[0.0, -1.0, 0.0]])
    assert loaded.tracer.occluded(start, down) == saved.tracer.occluded(start, down)


def test_files_of_other_kinds_are_refused(tmp_path):
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    with pytest.raises(ValueError, match=r"other\.npz"):
        ConeVisibility.load(tmp_path / "other.npz")
    with pytest.raises(FileNotFoundError):
        ConeVisibility.load(tmp_path / "none.npz")


def test_ground_is_2d_and_a_box_3d():
    mixed = HybridCones(**SMALL).precompute(MADE)
    upward = (MADE.geometric_normals[:, 1] > 0.9) & (
        MADE.positions[MADE.triangles][..., 1].max(axis=1) < MADE.positions[:, 1].min() + 0.01
    )
    np.testing.assert_array_equal(mixed.flat, upward)
    assert mixed.maps.grid is not None
    assert mixed.maps.plan is not None
    # The grid holds the box alone: 14 voxels across a unit.
    np.testing.assert_allclose(float(mixed.maps.grid.voxel), 1.0 / 14, rtol=1e-5)
    assert HybridCones(**SMALL).precompute(BALL).maps.plan is None
    assert HybridCones(**SMALL).precompute(GROUND).maps.grid is None
    assert VoxelCones(voxels=16).precompute(GROUND).maps.plan is None


def test_bytes_are_those_of_the_tables():
    found = HybridCones(**SMALL).precompute(MADE)
    voxels = 6 * 2 * (16**3 + 8**3 + 4**3 + 2**3 + 1)
    texels = 2 * sum((64 >> k) ** 2 for k in range(7))
    small = 200  # corners and sizes, and which triangles are flat
    assert voxels + texels <= found.nbytes <= voxels + texels + small
    lit = HybridCones(bounces=1, **SMALL)
    light_free = lit.precompute(MADE)
    assert light_free.nbytes > found.nbytes + 64**2 * 36


def test_voxels_of_a_closed_box_are_opaque_from_six_sides():
    made = scene(box((0, 0, 0), (1, 1, 1)))
    maps = VoxelCones(voxels=16).precompute(made).maps
    opacity = np.asarray(maps.volume[0], np.float64).reshape(6, -1)
    top = opacity[:, -1]
    # At the coarsest level 14 of 16 voxels along each side are covered.
    np.testing.assert_allclose(top, (14 / 16) ** 2, rtol=0.03)


def test_a_visibility_without_receivers_cannot_bounce():
    method = HybridCones(bounces=1, **SMALL)
    without = HybridCones(**SMALL).precompute(MADE)
    with pytest.raises(ValueError, match="precomputed with bounces=0"):
        method.lightmaps(without, method.light(uniform(1.0)))
    maps = method.lightmaps(method.precompute(MADE), method.light(uniform(1.0)))
    assert len(maps.volume) == 4
    assert len(maps.colours) == 3
    assert float(jnp.max(maps.colours[0])) > 0.5
