"""RESULTS.md from what is stored."""

import json

import pytest

from experiments import results
from experiments.results import number, page, value_of, verdict

CLAIMS = """
[[claim]]
what = "margin on Duck"
paper = "000"
item = "fig. 16"
theirs = "14.24"
aim = ">= 14.24"
unit = "dB"
run = "race"
table = "best"
where = {scene = "duck"}
column = "margin"

[[claim]]
what = "build"
ours = "3.5 ms"
aim = "<= 10"
command = "python -m experiments.x"
date = "2026-11-01"
machine = "an old one"
"""


@pytest.fixture
def store(tmp_path):
    """A store of one run with two rows."""
    (tmp_path / "race").mkdir()
    (tmp_path / "race" / "best.csv").write_text("scene,margin\nduck,≥ 15.5\npot,12.25\n")
    record = {"command": "python -m experiments.race", "date": "2026-11-02", "machine": "this one"}
    (tmp_path / "race" / "run.json").write_text(json.dumps(record))
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "10-race.md").write_text("## The race\n\nIt was run.\n")
    (tmp_path / "claims.toml").write_text(CLAIMS)
    return tmp_path


def test_the_page_has_numbers_machines_dates_commands_and_notes(store):
    text = page(store)
    assert (
        "| fig. 16: margin on Duck | 14.24 | ≥ 15.5 dB | ≥ 14.24 | reached | 1 | A | 2026-11-02 |"
        in text
    )
    assert "| build |  | 3.5 ms | ≤ 10 | reached | 2 | B | 2026-11-01 |" in text
    assert "- **A**: this one\n- **B**: an old one" in text
    assert "| 1 | `python -m experiments.race` | 2026-11-02 | A |" in text
    assert "| 2 | `python -m experiments.x` | 2026-11-01 | B |" in text
    assert text.endswith("## The race\n\nIt was run.\n")


def missed(store, why=""):
    text = CLAIMS.replace('where = {scene = "duck"}', 'where = {scene = "pot"}')
    (store / "claims.toml").write_text(text.replace("theirs", f'why = "{why}"\ntheirs'))


def test_a_miss_without_a_reason_is_refused(store):
    missed(store)
    with pytest.raises(ValueError, match=r"'margin on Duck' is missed \(12.25\) and has no why"):
        page(store)


def test_a_miss_stands_out_with_its_reason(store):
    missed(store, "the pot is easy")
    text = page(store)
    assert "**12.25 dB** | ≥ 14.24 | missed" in text
    assert "- **paper 000, fig. 16, margin on Duck**: the pot is easy" in text


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"race"', '"rac"', "no table 'best' of a run 'rac'"),
        ('scene = "duck"', 'scene = "goose"', "0 rows of 'best' fit, not one"),
        ('where = {scene = "duck"}', "", "2 rows of 'best' fit, not one"),
        ('item = "fig. 16"', 'itme = "fig. 16"', "has itme"),
    ],
)
def test_what_is_not_stored_is_said(store, old, new, said):
    (store / "claims.toml").write_text(CLAIMS.replace(old, new))
    with pytest.raises(ValueError, match=said):
        page(store)


def test_several_rows_give_their_least_or_mean(store):
    (claim, _), runs = results.read_claims(store), results.read_runs(store)
    several = {**vars(claim), "where": {}}
    assert value_of(results.Claim(**{**several, "pick": "min"}), runs) == "12.25"
    assert value_of(results.Claim(**{**several, "pick": "mean"}), runs) == "13.88"


@pytest.mark.parametrize(
    ("value", "aim", "said"),
    [
        ("15", ">= 14.24", "reached"),
        ("14.2", ">= 14.24", "missed"),
        ("≥ 15", ">= 14.24", "reached"),
        ("≤ 15", ">= 14.24", "missed"),
        ("≥ 3", "<= 4", "missed"),
        ("3.5 ms", "<= 4", "reached"),
        ("1,234", "<= 999", "missed"),
        ("5", "", ""),
    ],
)
def test_verdicts(value, aim, said):
    assert verdict(value, aim) == said


def test_notes_show_stored_tables(store):
    (store / "notes" / "20-more.md").write_text("Before:\n\n{race/best}\n\n{race/best: margin}\n")
    text = page(store)
    both = "| scene | margin |\n| --- | --- |\n| duck | ≥ 15.5 |\n| pot | 12.25 |"
    assert f"Before:\n\n{both}\n\n| margin |" in text


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("{rac/best}", "no such table"),
        ("{race/worst}", "no such table"),
        ("{race/best: length}", "has no length"),
    ],
)
def test_notes_of_what_is_not_stored_are_refused(store, line, said):
    (store / "notes" / "20-more.md").write_text(f"{line}\n")
    with pytest.raises(ValueError, match=said):
        page(store)


def test_a_value_needs_a_number():
    with pytest.raises(ValueError, match="no number in 'none'"):
        number("none")


def test_what_is_committed_is_what_the_script_writes():
    assert results.PAGE.read_text(encoding="utf-8") == page()
