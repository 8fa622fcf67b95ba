"""Settings of experiments from the command line."""

from dataclasses import FrozenInstanceError, dataclass
from pathlib import Path
from typing import Literal

import pytest

from experiments.settings import Common, execute, parse, setting


@dataclass(frozen=True)
class Settings(Common):
    scene: tuple[str, ...] = setting(("duck", "teapot"), "what is lit")
    size: tuple[int, int] = setting((256, 192), "of the images", metavar=("W", "H"))
    error: float = setting(0.01, "5 % is too much")
    seams: bool = setting(False, "measure them")
    scaling: bool = setting(True, "measure it")
    peer_spp: int | None = setting(None, "of the peer")
    rule: Literal["paper", "visible"] = setting("visible", "of labels")
    seed: int = setting(0, "of everything")
    denoised: tuple[str, ...] = setting(("mc-mis",), "methods", empty=True)


def test_without_arguments_there_are_the_defaults():
    assert parse(Settings, []) == Settings()


def test_every_kind_of_option():
    given = "--scene a b c --size 8 4 --error 0.5 --seams --no-scaling --peer-spp 3 --rule paper"
    assert parse(Settings, [*given.split(), "--out", "somewhere"]) == Settings(
        scene=("a", "b", "c"),
        size=(8, 4),
        error=0.5,
        seams=True,
        scaling=False,
        peer_spp=3,
        rule="paper",
        out=Path("somewhere"),
    )
    assert parse(Settings, ["--denoised"]).denoised == ()


def test_settings_do_not_change():
    with pytest.raises(FrozenInstanceError):
        parse(Settings, []).error = 1.0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--siz", "1", "2"], "unrecognized arguments"),
        (["--size", "1"], "expected 2 arguments"),
        (["--scene"], "expected at least one argument"),
        (["--error", "much"], "invalid float value"),
        (["--rule", "no"], "invalid choice"),
    ],
)
def test_wrong_usage_is_one_line(capsys, arguments, said):
    with pytest.raises(SystemExit) as stop:
        parse(Settings, arguments)
    assert stop.value.code == 2
    error = capsys.readouterr().err
    assert said in error
    assert len(error.splitlines()) == 1


def test_help_has_every_option_and_its_default(capsys):
    with pytest.raises(SystemExit) as stop:
        parse(Settings, ["--help"], "What it shows, at 100 %.")
    assert stop.value.code == 0
    text = capsys.readouterr().out
    assert "What it shows, at 100 %." in text
    assert "5 % is too much (default: 0.01)" in text
    assert "(default: duck teapot)" in text
    assert "of everything (default: 0)" in text
    assert "--no-scaling" in text
    assert "--out DIR" in text


def test_input_that_cannot_be_used_is_one_line(capsys):
    def run(settings, output):
        raise ValueError("unknown scene\n'ducky'")

    with pytest.raises(SystemExit) as stop:
        execute(Settings, run, None, [])
    assert stop.value.code == 2
    assert capsys.readouterr().err.endswith(": unknown scene 'ducky'\n")
    with pytest.raises(ValueError, match="unknown scene"):
        execute(Settings, run, None, ["--debug"])


def test_a_mistake_of_the_program_keeps_its_traceback():
    def run(settings, output):
        raise KeyError("x")

    with pytest.raises(KeyError):
        execute(Settings, run, None, [])
