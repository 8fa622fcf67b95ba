"""The race at equal time: who is best, what is printed, and one small race."""

import csv

import numpy as np
import pytest

from experiments.contenders import of_method, with_samples
from experiments.curves import Curve, Frame
from experiments.equal_time import Settings, compared, race, summary
from experiments.output import Output
from jaxvis.compare import prepare
from jaxvis.methods import create


def straight(name: str, first: float) -> Curve:
    """4 times the seconds for 6 dB, from ``first`` at 0.01 s on."""
    return Curve(name, tuple(Frame(f"{4**k} spp", 0.01 * 4**k, first + 6.0 * k) for k in range(5)))


OURS = Curve("stored", (Frame("zeta 0", 0.02, 30.0), Frame("zeta 4", 1.28, 36.0)))
OTHERS = [straight("mc-ides", 10.0), straight("Mitsuba direct", 4.0), straight("x+denoise", 20.0)]


def test_the_best_frame_is_the_one_furthest_above_ides_and_mitsuba():
    margins, ratios, (name, frame) = compared([OURS], OTHERS)
    assert (name, frame.setting) == ("stored", "zeta 0")
    # 0.02 s is half of the way from 0.01 to 0.04: 13 dB of 30.
    assert margins[0]["mc-ides"] == "17"
    assert margins[0]["Mitsuba direct"] == "23"
    # 30 dB are 1 2/3 steps of 4 above 20: 0.01 x 4^(5/3) s.
    assert float(ratios[0]["x+denoise"]) == pytest.approx(0.01 * 4 ** (5 / 3) / 0.02, rel=0.01)
    assert ratios[0]["Mitsuba direct"] == "≥ 128"  # 28 dB are the most, in 2.56 s


def test_the_summary_names_the_closest_of_each_kind():
    _, _, best = compared([OURS], OTHERS)
    row = summary(best, OTHERS)
    assert row["best"] == "stored zeta 0"
    assert (row["dB over mc-ides"], row["dB over Mitsuba"]) == ("17", "23")
    assert row["dB over the best denoised"] == "7"
    assert row["which is"] == "x+denoise"


def test_without_peers_all_count_and_cells_stay_empty():
    _, _, best = compared([OURS], [OTHERS[2]])
    assert best[1].setting == "zeta 0"
    assert summary(best, [OTHERS[2]])["dB over Mitsuba"] == ""


def test_methods_vary_by_what_they_have():
    stage = prepare("plane", "uniform", (4, 4))
    truth = np.ones((4, 4, 3), np.float32)

    def settings(spec):
        found = of_method(spec, stage, truth, zeta=(0.0, 1.5), most=5)
        return [variant.setting for variant in found.variants()]

    assert settings("vectorized:vectors=16,resolution=16") == ["zeta 0", "zeta 1.5", "fragment"]
    assert settings("mc-ides+denoise") == ["1 spp", "2 spp", "4 spp"]
    assert settings("distance-field:resolution=16,lights=8") == [""]


def test_samples_go_through_the_denoiser():
    assert with_samples(create("mc-ides:brdf=0.5"), 3) == create("mc-ides:brdf=0.5,spp=3")
    assert with_samples(create("mc-mis+denoise"), 3) == create("mc-mis+denoise:spp=3")


def test_a_small_race(tmp_path, capsys):
    settings = Settings(
        out=tmp_path,
        scene=("sphere-on-plane",),
        environment=("windows",),
        size=(24, 24),
        methods=("distance-field:resolution=32,lights=256",),
        estimators=("mc-ides",),
        denoised=(),
        mitsuba=False,
        samples=4,
        error=0.05,
        repeats=2,
    )
    race(settings, Output(tmp_path))
    assert "24 x 24, one seed" in capsys.readouterr().out
    with (tmp_path / "frames.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    found = [(row["method"], row["setting"]) for row in rows]
    samples = ["1 spp", "2 spp", "4 spp"]
    assert found == [
        ("distance-field:resolution=32,lights=256", ""),
        *(("mc-ides", setting) for setting in samples),
    ]
    quality = {key: float(row["PSNR dB"]) for key, row in zip(found, rows, strict=True)}
    assert quality["mc-ides", "4 spp"] > quality["mc-ides", "1 spp"] + 2.0
    assert all(float(row["seconds"]) > 0.0 for row in rows)
    drawn = sorted(path.name for path in tmp_path.glob("*.png"))
    assert [name.rpartition("windows-")[2] for name in drawn] == [
        "curves.png",
        "equal-time.png",
        "mc-ides.png",
    ]
