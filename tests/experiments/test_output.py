"""Tables of experiments: Markdown and CSV."""

import csv

import numpy as np
import pytest

from experiments.output import Output, markdown, text

ROWS = [
    {"scene": "duck", "dB": 44.123456, "evaluations": 207621},
    {"scene": "a|b", "dB": float("nan"), "seconds": np.float32(0.25)},
]


def test_markdown_has_every_column_and_four_digits():
    assert markdown(ROWS).splitlines() == [
        "| scene | dB | evaluations | seconds |",
        "| --- | ---: | ---: | ---: |",
        "| duck | 44.12 | 207,621 |  |",
        "| a/b |  |  | 0.25 |",
    ]
    assert markdown([]) == "(no rows)"


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0.000123456, "0.0001235"),
        (1234567.8, "1,234,568"),
        (3.2e12, "3.2e+12"),
        (np.int64(12), "12"),
        (True, "True"),
        (None, ""),
        (-45678.9, "-45,679"),
    ],
)
def test_cells(value, shown):
    assert text(value) == shown


def test_csv_keeps_every_digit(tmp_path, capsys):
    output = Output(tmp_path / "new")
    output.table("errors", "How far off", ROWS)
    assert capsys.readouterr().out == f"## How far off\n\n{markdown(ROWS)}\n\n"
    with (tmp_path / "new" / "errors.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert float(rows[0]["dB"]) == 44.123456
    assert rows[0]["seconds"] == ""
    assert rows[1]["seconds"] == "0.25"
    assert rows[1]["scene"] == "a|b"


def test_without_a_folder_nothing_is_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    output = Output()
    output.table("errors", "How far off", ROWS)
    assert output.path("duck/image.png") is None
    assert not list(tmp_path.iterdir())


def test_pictures_have_a_folder(tmp_path):
    path = Output(tmp_path).path("duck/image.png")
    assert path == tmp_path / "duck" / "image.png"
    assert path.parent.is_dir()


def test_two_tables_of_one_name_are_refused(tmp_path):
    output = Output(tmp_path)
    output.table("errors", "One", ROWS)
    with pytest.raises(ValueError, match="two tables are named 'errors'"):
        output.table("errors", "Two", ROWS)
