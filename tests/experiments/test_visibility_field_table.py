"""Rows, caches, views and pictures of the tables of visibility fields."""

import os

import numpy as np
import pytest

import jaxvis
from experiments.output import Output
from experiments.settings import parse
from experiments.visibility_field_runs import (
    PAPER,
    compare,
    empty_cache,
    exact_in_places,
    pixels_that_differ,
    precomputed,
    seconds_alone,
    settings_of,
    views_of,
)
from experiments.visibility_field_table import PARTS, Settings, base_method, row_of, wanted
from tests.methods.known_scenes import contrasted

pytestmark = pytest.mark.usefixtures("own_caches")

TINY = jaxvis.VisibilityField(cell=1.0, masks=8, samples=2000, rays=32, spp=8)


@pytest.fixture(scope="module")
def view():
    scene = jaxvis.load_scene("box-on-plane")
    return views_of(scene, contrasted(), (24, 18), ["upper"])[0].diffuse()


def test_other_scenes_have_the_default_view_alone(view):
    assert view.name == "default"
    assert view.covered.any()


def test_a_row_compares_the_same_rays(view, tmp_path):
    row = compare(view, TINY, repeats=1, picture=tmp_path / "tiny")
    assert 0.0 < row["% traced"] < 100.0
    assert row["RMSE %"] == row["culls %"] < 1.0
    assert row["ratio"] == pytest.approx(row["unculled s"] / row["field s"])
    stored, _ = precomputed(view.scene, TINY)
    assert row["dense KB"] == round(stored.grid.cells * 10 * 10 / 1024)
    assert row["% of dense"] == pytest.approx(100.0 * stored.nbytes / stored.dense_bytes)
    assert len(list(tmp_path.glob("tiny-*.png"))) == 3


def test_exact_irradiance_is_no_wrong_cull(view):
    method = jaxvis.VisibilityField(
        **{**PAPER, "cell": 1.0, "masks": 8, "samples": 20_000, "spp": 8}
    )
    assert exact_in_places(method, view.surface)
    assert not exact_in_places(TINY, view.surface)
    row = compare(view, method, repeats=1)
    assert row["culls %"] < 0.1 * row["RMSE %"]


def test_precomputation_is_timed_in_an_empty_cache(view):
    before = os.environ["JAXVIS_CACHE"]
    precomputed(view.scene, TINY)
    assert precomputed(view.scene, TINY)[1]["precompute s"] == "cached"
    with empty_cache():
        _, cost = precomputed(view.scene, TINY)
    assert os.environ["JAXVIS_CACHE"] == before
    assert cost["precompute s"] > cost["Embree s"] > 0.0


@pytest.mark.parametrize("sampling", ["random", "stratified"])
def test_the_same_rays_are_traced_alone(view, sampling):
    tracer, method = (
        view.scene.tracer,
        jaxvis.VisibilityField(cell=1.0, samples=5000, rays=32, sampling=sampling),
    )
    before = tracer.rays_traced
    assert seconds_alone(view.scene, settings_of(method)) > 0.0
    assert tracer.rays_traced - before == 5000 * 32


def test_differing_pixels_are_counted_by_their_worst_channel():
    image = np.ones((10, 10, 3), np.float32)
    other = image.copy()
    other[3, 4, 1] += 2e-5
    other[5, 5] += 5e-6
    other[9, 9] += 1.0
    covered = np.ones((10, 10), bool)
    covered[9] = False
    assert pixels_that_differ(other, image, covered) == pytest.approx(1e4 / 90)


TABLES = {
    "spp_sweep": (["--spp-sweep", "4"], 1),
    "samples_sweep": (["--samples-sweep", "1e3"], 2),
    "cell_sweep": (["--cell-sweep"], 4),
    "labels": (["--labels"], 8),
    "glossy": (["--glossy"], 2),
    "finer": (["--finer", "--finer-masks", "12"], 2),
}


@pytest.mark.parametrize("part", TABLES)
def test_tables(view, part):
    arguments, count = TABLES[part]
    usual = ["--cell", "1", "--masks", "8", "--samples", "1e3", "--spp", "4", "--repeats", "1"]
    settings = parse(Settings, [*usual, *arguments])
    assert [name for name in PARTS if wanted(settings, name)] == [part]
    rows = list(PARTS[part][1](view, base_method(view.scene, settings), settings, Output()))
    assert len(rows) == count
    for row in rows:
        assert 0.0 < row["% traced"] <= 100.0
        assert row["KB"] < row["dense KB"]


def test_means_of_all_frequencies_are_compared_in_standard_errors(view, monkeypatch):
    monkeypatch.setattr(jaxvis, "load_environment", lambda name: view.environment)
    settings = parse(Settings, ["--keys", "3", "--error", "0.05", "--repeats", "1"])
    rows = list(PARTS["all_frequency"][1](view, TINY, settings, Output()))
    assert [row["light"] for row in rows] == ["windows", "stpeters"]
    for row in rows:
        assert abs(row["standard errors"]) < 5.0
        assert abs(row["field - unculled %"]) < 0.5


def test_rows_start_with_what_they_are_of_and_pictures_are_named_after_it(view, tmp_path):
    settings = parse(Settings, ["--repeats", "1"])
    of = {"cell": 1.0, "masks": 8, "sampling": "all of it"}
    row = row_of(view, TINY, settings, Output(tmp_path), of)
    assert list(row)[:5] == ["scene", "cell", "masks", "sampling", "view"]
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        f"box-on-plane-default-cell-1-8-all-of-it-{which}.png"
        for which in ("culled", "difference", "unculled")
    ]
