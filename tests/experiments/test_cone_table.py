"""Bytes, shelters with known light, images from lit maps, and rows of the cone tracing tables."""

import math
import mmap
import time
from dataclasses import fields, replace
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

from experiments import cone_stages, cone_table
from experiments.cone_runs import (
    PAUSE,
    Lit,
    Truth,
    hybrid_of,
    isotropic_bytes,
    name_of,
    peak_memory,
    sparse_bytes,
    table_bytes,
    voxel_of,
)
from experiments.cone_scenes import room, share_of_sky, slab
from experiments.cone_table import Settings
from experiments.output import Output
from experiments.settings import parse
from jaxvis.compare.setting import prepare
from jaxvis.methods import Reference
from jaxvis.methods.cones.march import Lightmaps
from jaxvis.methods.cones.volume import Grid
from jaxvis.scene import Camera
from tests.methods.known_scenes import contrasted, uniform_light

pytestmark = pytest.mark.usefixtures("own_caches")

SMALL = [
    *("--hybrids", "16x32", "--voxel", "16", "--voxels", "16", "--texels", "32"),
    *("--error", "0.1", "--rays", "16", "--repeats", "1", "--leak-size", "8", "6"),
    *("--sizes", "16x9", "16x12"),
]


def settings_of(*arguments):
    return parse(Settings, [*SMALL, *arguments])


@pytest.fixture(scope="module")
def setting():
    """A block over ground, the one in voxels and the other a height field, in all pixels."""
    camera = Camera((14.0, 20.0, 14.0), (0.0, 0.0, 0.0))
    block = slab(width=8.0, length=8.0, height=3.0, thickness=8.0)
    return prepare(block.scene, contrasted(), (16, 12), camera=camera)


@pytest.fixture(scope="module")
def lit(setting):
    return Lit.of(hybrid_of("16x32"), setting)


def one_voxel(resolution=16):
    """Maps of four channels in which one voxel is opaque from one side, at every level."""
    cells = sum((resolution >> level) ** 3 for level in range(resolution.bit_length()))
    opacity = np.zeros((6, cells), np.float16)
    start = 0
    for level in range(resolution.bit_length()):
        opacity[2, start] = 1.0
        start += (resolution >> level) ** 3
    channels = (jnp.zeros(6 * cells, jnp.float16),) * 3 + (jnp.asarray(opacity.reshape(-1)),)
    grid = Grid(np.zeros(3, np.float32), np.asarray(1.0, np.float32), resolution)
    return Lightmaps(grid, channels, None, None, ())


def test_bytes_are_those_of_the_formats(lit):
    voxels = sum(8**level for level in range(5))
    texels = sum(4**level for level in range(6))
    parts = table_bytes(lit.maps)
    assert parts["3D"] == voxels * 6 * 4 * 2
    assert parts["2D"] == texels * (3 * 2 + 2)
    assert sum(parts.values()) == lit.maps.nbytes
    assert parts["rest"] < 100
    assert isotropic_bytes(lit.maps) == parts["3D"] // 6 + parts["2D"] + parts["rest"]


def test_a_sparse_volume_keeps_bricks_with_anything_in_them():
    maps = one_voxel()
    voxel = 6 * 4 * 2
    # Of 16^3 voxels one brick of eight; of 8^3 the only one; smaller levels whole.
    bricks = (512 * voxel + 8 * 4) + (512 * voxel + 4)
    small = (64 + 8 + 1) * voxel
    assert sparse_bytes(maps) == bricks + small + table_bytes(maps)["rest"]
    empty = replace(maps, volume=(*maps.volume[:3], jnp.zeros_like(maps.volume[3])))
    assert sparse_bytes(empty) == sparse_bytes(maps) - 2 * 512 * voxel
    full = replace(maps, volume=(*maps.volume[:3], jnp.ones_like(maps.volume[3])))
    assert sparse_bytes(full) == full.nbytes + 4 * 9


def test_without_voxels_nothing_is_sparse(lit):
    flat = replace(lit.maps, grid=None, volume=())
    assert sparse_bytes(flat) == isotropic_bytes(flat) == flat.nbytes


def test_an_image_from_lit_maps_is_the_methods_own(setting, lit):
    whole = lit.whole(setting)
    own = lit.method.shade(lit.visibility, lit.light, setting.surface)
    np.testing.assert_array_equal(whole, own)
    direct = replace(lit.method, bounces=0)
    without = direct.shade(lit.visibility, lit.light, setting.surface)
    indirect = lit.indirect(setting)
    np.testing.assert_allclose(without + indirect, whole, rtol=1e-4, atol=1e-5)
    assert indirect[setting.covered].mean() > 0.005 * whole[setting.covered].mean()


def test_errors_vanish_for_the_truth_alone(setting):
    truth = Truth.of(setting, 0.1, 16)
    assert 0.0 < truth.error <= 0.1
    assert truth.indirect_error > truth.error
    exact = SimpleNamespace(whole=lambda _: truth.image, indirect=lambda _: truth.indirect)
    found = truth.errors(exact)
    assert found["RMSE %"] == found["indirect RMSE %"] == 0.0
    assert found["dB"] == math.inf
    brighter = SimpleNamespace(whole=lambda _: truth.image, indirect=lambda _: 2.0 * truth.indirect)
    assert truth.errors(brighter)["indirect RMSE %"] > 50.0
    assert truth.errors(brighter)["RMSE %"] == 0.0


def test_a_room_is_dark_and_its_outside_is_not():
    method = Reference(error=0.05, bounces=1, bounce_rays=16)
    shelter = room()
    means = []
    for camera in (shelter.inside, shelter.outside):
        view = prepare(shelter.scene, uniform_light(), (8, 6), camera=camera)
        solution = method.solve(
            method.precompute(view.scene), method.light(view.environment), view.surface
        )
        means.append(np.asarray(solution.image)[view.covered].mean())
    assert means[0] == 0.0
    assert means[1] == pytest.approx(0.8, rel=0.01)  # convex: all of the sky, and no bounce


def test_below_a_slab_is_the_sky_that_its_view_factor_leaves():
    assert share_of_sky(2.0, 2.0, 1.0) == pytest.approx(0.4459, abs=1e-4)
    assert share_of_sky(1e-6, 5.0, 1.0) == pytest.approx(1.0, abs=1e-5)
    assert share_of_sky(1e6, 1e6, 1.0) == pytest.approx(0.0, abs=1e-5)
    shelter = slab(width=6.0, length=4.0, height=2.0, thickness=0.02)
    camera = Camera((0.0, 0.8, 0.1), (0.0, 0.0, 0.0), (0, 1, 0), 0.02)
    view = prepare(shelter.scene, uniform_light(), (1, 1), camera=camera)
    method = Reference(error=0.005)
    image = method.shade(
        method.precompute(view.scene), method.light(view.environment), view.surface
    )
    assert float(image[0, 0, 0]) / 0.8 == pytest.approx(share_of_sky(6.0, 4.0, 2.0), abs=0.01)


def test_cameras_see_what_is_hidden_and_what_is_not():
    shelter = slab(width=6.0, length=4.0)
    for camera, hidden in ((shelter.inside, True), (shelter.outside, False)):
        view = prepare(shelter.scene, uniform_light(), (8, 6), camera=camera)
        assert view.covered.all()
        seen = np.asarray(view.surface.position).reshape(-1, 3) + shelter.scene.origin
        below = (np.abs(seen[:, 0]) < 3.0) & (np.abs(seen[:, 2]) < 2.0) & (seen[:, 1] < 0.1)
        assert below.all() == hidden
        assert below.any() == hidden


def test_leaks_are_told_apart_from_light_that_belongs(monkeypatch):
    monkeypatch.setattr(cone_stages, "shelters", lambda wall: [room(wall=wall)])
    truth, *cones = cone_stages.leak_rows(settings_of("--wall", "0.1"))
    assert [row["method"] for row in cones] == ["hybrid 16³ + 32²", "voxel 16³"]
    assert truth["inside"] == truth["inside / outside %"] == 0.0
    assert truth["outside"] == pytest.approx(0.8, rel=0.05)
    for row in cones:
        assert row["voxel m"] == pytest.approx(4.2 / 14)  # one to spare on either side
        assert row["outside"] == pytest.approx(0.8, rel=0.1)
        assert row["inside / outside %"] == pytest.approx(100.0 * row["inside"] / row["outside"])
        leaked = 100.0 * row["inside"] / truth["outside"]
        assert row["too much inside, % of outside"] == pytest.approx(leaked)


def test_memory_rises_while_something_is_held():
    with peak_memory() as memory:
        if math.isnan(memory.before):
            pytest.skip("this system does not tell")
        before = memory.before
    assert memory.most >= before
    # Pages of its own: what the process has freed before may serve as an array.
    with peak_memory() as memory, mmap.mmap(-1, 80_000_000) as held:
        held.write(b"1" * len(held))
        time.sleep(4.0 * PAUSE)
    assert memory.most - memory.before > 60.0


def test_methods_have_names_by_which_they_are_made():
    assert name_of(hybrid_of("32x64")) == "hybrid 32³ + 64²"
    assert name_of(voxel_of(32)) == "voxel 32³"
    assert hybrid_of("32x64").bounces == voxel_of(32).bounces == 1
    with pytest.raises(ValueError, match="128x2048; got '32'"):
        hybrid_of("32")


def test_sizes_are_words():
    assert cone_stages.size_of("640x360") == (640, 360)
    with pytest.raises(ValueError, match="640x360; got '640'"):
        cone_stages.size_of("640")


def test_memory_is_compared_with_the_first_voxels(setting):
    rows = list(cone_table.memory_rows(setting, settings_of(), Output()))
    voxel, hybrid = (row for row in rows if row["kept"].startswith("all"))
    assert voxel["of voxel %"] == 100.0
    assert hybrid["of voxel %"] == pytest.approx(100.0 * hybrid["MB"] / voxel["MB"])
    assert hybrid["3D MB"] + hybrid["2D MB"] == pytest.approx(hybrid["MB"], rel=0.01)
    assert voxel["2D MB"] == 0.0
    assert hybrid["with receivers MB"] > hybrid["MB"]
    assert rows[-2]["of voxel %"] == pytest.approx(13.06, abs=0.01)  # the paper's 117 / 896


def test_quality_has_ratios_and_pictures(setting, tmp_path):
    rows = list(cone_table.quality_rows(setting, settings_of(), Output(tmp_path)))
    noise, hybrid, voxel = rows
    assert noise["RMSE %"] <= 10.0
    assert voxel["hybrid's / its RMSE"] == pytest.approx(hybrid["RMSE %"] / voxel["RMSE %"])
    assert "hybrid's / its RMSE" not in hybrid
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["slab-contrasted-indirect.png", "slab-contrasted.png"]


def test_the_march_is_swept_one_parameter_at_a_time(setting, monkeypatch):
    seen = []
    monkeypatch.setattr(Truth, "errors", lambda self, lit: seen.append(lit) or {})
    monkeypatch.setattr(Lit, "gather", lambda self, setting: jnp.zeros(1))
    rows = list(cone_table.march_rows(setting, settings_of(), Output()))
    assert len(rows) == len(seen)
    for row, lit in zip(rows, seen, strict=True):
        usual = hybrid_of("16x32") if row["maps"].startswith("hybrid") else voxel_of(16)
        changed = {f.name for f in fields(usual) if vars(lit.method)[f.name] != vars(usual)[f.name]}
        assert all(name in row["changed"] for name in changed)
        assert (lit.maps.ranges is not None) == (lit.method.search == "cells")
        assert row["maps"].startswith("hybrid") or "search" not in row["changed"]
    names = ["cones", "aperture", "stepping", "search", "fit", "accumulation", "ranges"]
    assert all(any(name in row["changed"] for row in rows) for name in names)
    assert len({row["changed"] for row in rows}) == len(rows) / 2 + len(cone_table.SEARCHES) / 2


def test_stages_end_with_a_ratio(setting):
    hybrid, voxel, ratio = cone_stages.stage_rows(setting, settings_of(), Output())
    assert ratio["shade s"] == pytest.approx(hybrid["shade s"] / voxel["shade s"])
    for row in (hybrid, voxel):
        parts = row["classify s"] + row["voxelize s"] + row["heights s"]
        assert 0.0 < parts < row["precompute s"]
        assert row["gather s"] > 0.0
    assert voxel["classify s"] == voxel["heights s"] == 0.0
    assert "classify s" not in ratio
