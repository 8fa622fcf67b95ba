"""Fits, stopwatches, moving parts and rows of the tables of adaptive visibility."""

import gc
import math
import mmap
import types
from dataclasses import replace

import numpy as np
import pytest

import jaxvis
from experiments.adaptive_frames import frames_rows
from experiments.adaptive_runs import (
    Moving,
    Noise,
    Truth,
    angular_of,
    every_vertex_in_view,
    filled,
    placed,
    shaded,
)
from experiments.adaptive_table import PARTS, Settings
from experiments.measuring import resident_megabytes, stopwatch, write_strip
from experiments.output import Output
from experiments.settings import parse
from jaxvis.image import read_image
from jaxvis.methods import MonteCarlo, registry
from jaxvis.methods.distance_field import AdaptiveVisibility
from jaxvis.methods.distance_field.build import Vertices
from jaxvis.reflectance import Lambert
from tests.methods.known_scenes import contrasted

pytestmark = pytest.mark.usefixtures("own_caches")

SMALL = "adaptive:resolution=16,coarsest=8,lights=16,budget=0.1"
FRAME = 3


@pytest.fixture(scope="module")
def view():
    animation = jaxvis.load_animation("balls:detail=16")
    diffuse = animation.base.with_reflectance(Lambert())  # compiles soon
    return Moving(replace(animation, base=diffuse), contrasted(), (24, 18))


@pytest.fixture(scope="module")
def method():
    return registry.create(SMALL)


def settings_of(*arguments: str) -> Settings:
    usual = ["--frame", str(FRAME), "--error", "0.05", "--repeats", "1", "--spp", "4", "16"]
    return parse(Settings, [*usual, *arguments])


def rows_of(what, view, method, *arguments):
    settings = settings_of("--what", what, *arguments)
    output = Output(settings.out)
    return [list(part(view, method, settings, output)) for _, _, part in PARTS[what]]


def test_noise_is_fitted_exactly():
    spp = np.array([16, 64, 256])
    rmse, seconds = np.sqrt(0.8**2 / spp + 0.02**2), 0.3 + 0.01 * spp
    noise = Noise.fit(spp, rmse, seconds, floor=0.02)
    assert noise.spread == pytest.approx(0.8)
    assert (noise.start, noise.each) == (pytest.approx(0.3), pytest.approx(0.01))
    assert noise.rmse(100) == pytest.approx(math.hypot(0.08, 0.02))
    assert noise.seconds(100) == pytest.approx(1.3)
    assert noise.spp_at_rmse(noise.rmse(1000)) == pytest.approx(1000)
    assert noise.spp_at_seconds(1.3) == 100
    assert noise.spp_at_seconds(0.1) == 1
    assert noise.spp_at_rmse(0.02) == math.inf


def test_without_the_references_own_error_the_fit_would_be_off():
    spp = np.array([16, 4096])
    rmse = np.sqrt(0.8**2 / spp + 0.02**2)
    assert Noise.fit(spp, rmse, spp, floor=0.0).spread > 1.1 * 0.8


@pytest.mark.parametrize(
    ("spp", "rmse", "message"),
    [([16], [0.1], "at least two"), ([16, 64], [0.1, 0.02], "no larger than the reference")],
)
def test_what_cannot_be_fitted_is_refused(spp, rmse, message):
    with pytest.raises(ValueError, match=message):
        Noise.fit(spp, rmse, spp, floor=0.02)


def test_a_stopwatch_counts_only_inside_and_only_its_functions(monkeypatch):
    now = [0.0]
    monkeypatch.setattr("experiments.measuring.time.perf_counter", lambda: now[0])

    def slow(seconds):
        now[0] += seconds
        return seconds

    module = types.SimpleNamespace(slow=slow, other=slow, idle=slow)
    with stopwatch(module, "slow", "idle") as spent:
        assert module.slow(2.0) == 2.0
        module.slow(3.0)
        module.other(7.0)
    module.slow(100.0)
    assert spent == {"slow": 5.0, "idle": 0.0}
    assert module.slow is slow


def test_memory_grows_with_what_is_held():
    gc.collect()
    before = resident_megabytes()
    if math.isnan(before):
        pytest.skip("this system does not tell")
    # Pages of its own: malloc may serve an array from what earlier tests gave back to it.
    with mmap.mmap(-1, 400_000_000) as held:
        held[:: mmap.PAGESIZE] = b"1" * len(range(0, len(held), mmap.PAGESIZE))
        assert 360.0 < resident_megabytes() - before < 440.0


def test_one_part_moves_alone(view):
    here, there = view.animation.scene(FRAME), view.animation.scene(FRAME + 1)
    still = view.with_part(-1, FRAME, FRAME + 1)
    np.testing.assert_array_equal(still.positions, here.positions)
    parts = view.animation.parts
    moving = np.unique(parts[view.animation.moved(FRAME, FRAME + 1)])
    assert len(moving) == 2  # both balls, not the dish
    one = view.with_part(int(moving[0]), FRAME, FRAME + 1)
    of_it = parts == moving[0]
    np.testing.assert_array_equal(one.positions[of_it], there.positions[of_it])
    np.testing.assert_array_equal(one.positions[~of_it], here.positions[~of_it])
    assert not np.array_equal(one.positions, here.positions)


def test_filled_maps_do_not_depend_on_blocks(view, method, monkeypatch):
    vertices, ids = Vertices.of(view.at(FRAME).scene), np.arange(0, 60)
    dense = angular_of(method)._replace(fill="dense")
    whole, seconds = filled(vertices, dense, ids, None)
    monkeypatch.setattr("jaxvis.methods.distance_field.build.AT_ONCE", 7)
    parts, _ = filled(vertices, dense, ids, None)
    np.testing.assert_array_equal(parts.maps, whole.maps)
    assert parts.rays == whole.rays == 60 * 16**2
    assert seconds > 0.0


def test_every_vertex_in_view_is_what_sampling_all_gives(view, method):
    setting = view.at(FRAME)
    method = replace(method, fill="dense")
    some = every_vertex_in_view(setting, angular_of(method))
    every = registry.create("distance-field:resolution=16,lights=16,fill=dense")
    everything = every.precompute(setting.scene, progress=False)
    light = every.light(setting.environment)
    np.testing.assert_allclose(
        every.shade(some, light, setting.surface),
        every.shade(everything, light, setting.surface),
        rtol=2e-3,
        atol=2e-3,
    )
    assert len(some.samples) < 0.8 * len(everything.samples)
    assert len(some.samples) > 2 * len(placed(method, setting).samples)


def test_all_three_verbs_are_timed(view):
    setting = view.at(FRAME)
    one = shaded(MonteCarlo(spp=4), setting, repeats=2)
    assert one.seconds == pytest.approx(one.precompute + one.light + one.shade)
    truth = Truth.of(setting, error=0.05)
    assert 0.0 < truth.error <= 0.05
    more = shaded(MonteCarlo(spp=256), setting)
    assert truth.relative_rmse(more.image) < 0.5 * truth.relative_rmse(one.image)
    assert truth.psnr(more.image) > truth.psnr(one.image) + 6.0
    assert truth.psnr(truth.image) == math.inf


def test_strips_are_side_by_side(view, tmp_path):
    setting = view.at(FRAME)
    bright, dark = np.ones((18, 24, 3), np.float32), np.zeros((18, 24, 3), np.float32)
    write_strip(tmp_path / "strip.png", setting, [bright, dark, dark], bright)
    strip = read_image(tmp_path / "strip.png")
    assert strip.shape[:2] == (18, 3 * 24 + 2 * 4)
    left, right = strip[:, :24][setting.coverage == 1], strip[:, 28:52][setting.coverage == 1]
    assert left.min() > 0.9
    assert right.max() == 0.0


def test_maps(view, method):
    (rows,) = rows_of("maps", view, method)
    assert [row["filled"] for row in rows] == ["as placed", "at once", "no hints"]
    assert rows[2]["rays %"] < rows[1]["rays %"] < 100.0
    for row in rows:
        assert 80.0 < row["worst map %"] <= row["equal %"] <= 100.0
    everywhere = AdaptiveVisibility(resolution=16, coarsest=16, lights=16)
    (rows,) = rows_of("maps", view, everywhere)
    assert rows[1]["equal %"] == rows[1]["rays %"] == rows[0]["equal %"] == 100.0


def test_placement(view, method):
    (rows,) = rows_of("placement", view, method)
    assert [row["lobes"] for row in rows] == ["512 cells", "32 fitted"]
    for row in rows:
        assert row["samples"] < row["in view"] < row["vertices"]
        assert row["less dB"] == pytest.approx(row["dB of all"] - row["dB"])
        assert row["% of vertices"] < row["% of those in view"] < 100.0


def test_thresholds(view, method):
    arguments = ["--budget", "0.9", "--resolutions", "8", "16"]
    (rows,) = rows_of("thresholds", view, replace(method, budget=0.06), *arguments)
    assert [(row["E_max %"], row["texels a side"]) for row in rows] == [
        (largest, size) for largest in (20, 10, 5) for size in (8, 16)
    ]
    samples = [row["samples"] for row in rows[1::2]]
    assert samples[0] < samples[1] < samples[2]


def test_resolution(view, method):
    (rows,) = rows_of("resolution", view, method, "--resolutions", "32", "64", "--maps", "20")
    assert [row["texels a side"] for row in rows] == [32, 64]
    for row, size in zip(rows, (32, 64), strict=True):
        assert row["dense M rays"] == pytest.approx(row["maps"] * size**2 / 1e6)
        assert row["adaptive M rays"] < row["dense M rays"]
        assert row["rasterized / adaptive"] == pytest.approx(
            row["rasterized s"] / row["adaptive s"]
        )


def test_equal(view, method, tmp_path):
    (rows,) = rows_of("equal", view, method, "--error", "0.02", "--out", str(tmp_path))
    assert [row["counted"] for row in rows] == ["anew", "carried", "shading"]
    for row in rows:
        assert row["confirmed RMSE %"] == pytest.approx(rows[0]["RMSE %"], rel=0.5)
        assert row["times as fast"] == pytest.approx(row["mc s"] / row["s"])
    assert rows[0]["s"] > rows[2]["s"]
    assert (tmp_path / "balls.png").is_file()
    assert (tmp_path / "balls" / "index.html").is_file()


def test_frames(view, method):
    frames, parts = rows_of("frames", view, method, "--frames", "5", "--every", "2")
    assert [row["frame"] for row in frames] == [FRAME + 2, FRAME + 4, FRAME + 5]
    for row in frames:
        assert 0.0 < row["moved %"] < 100.0
        assert row["images differ %"] < 20.0
        assert 0.0 < row["rays %"] < 100.0
    assert [row["what moves"] for row in parts][::3] == ["nothing", "all"]
    nothing, *alone, everything = parts
    assert nothing["moved %"] == nothing["M rays"] == 0.0
    for row in alone:
        assert 0.0 < row["M rays"] < everything["M rays"]
    assert sum(row["moved %"] for row in alone) == pytest.approx(everything["moved %"])


def test_frames_alone(view, method, monkeypatch):
    settings = settings_of("--frames", "3", "--every", "2", "--carried-only")
    first = method.precompute_for(view.at(FRAME).scene, view.at(FRAME).surface, progress=False)
    started = []
    monkeypatch.setattr(
        "experiments.adaptive_frames.placed", lambda *_: started.append(first) or first
    )
    rows = list(frames_rows(view, method, settings, Output()))
    assert [row["frame"] for row in rows] == [FRAME + 2, FRAME + 3]
    assert len(started) == 1
    for row in rows:
        assert row["MB held"] > 0.0
        assert "anew s" not in row


def test_table_1(view, method):
    (rows,) = rows_of("table1", view, method, "--mean", "2")
    assert [row["samples were"] for row in rows] == ["carried", "anew", "paper's"]
    for row in rows[:2]:
        parts = sum(row[name] for name in ("t_I ms", "t_V ms", "t_S ms", "other ms"))
        assert row["frame s"] == pytest.approx(1e-3 * parts)
        assert row["FPS"] == pytest.approx(1.0 / row["frame s"])
        assert row["t_V ms"] > 0.0
        assert row["t_S ms"] > 0.0
        assert row["MB by the paper"] == pytest.approx(row["samples"] * 34 * 1024 / 1e6)
    assert rows[2]["samples"] == 1824
