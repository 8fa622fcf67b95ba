"""The table as Markdown, CSV and plain text."""

import csv as csv_reader
import io
import re

import pytest

from jaxvis.report import csv, markdown, plain


def test_markdown_has_a_row_per_method_and_marks_the_best(comparison):
    text = markdown(comparison)
    table = [line for line in text.splitlines() if line.startswith("|")]
    assert len(table) == 2 + 3
    cells = [re.split(r"(?<!\\)\|", line) for line in table]
    assert {len(line) for line in cells} == {len(cells[0])}
    assert cells[2][1].strip() == "exact"
    assert cells[2][2].strip() == "**∞**"
    assert "**20.0 ms**" in table[3]
    assert "**250 ms**" not in text
    assert "- shadow-map failed: 12 edges <have> more than two faces" in text


def test_csv_reads_back(comparison, nasty):
    rows = list(csv_reader.DictReader(io.StringIO(csv(comparison))))
    assert [row["label"] for row in rows] == ["exact", nasty, "shadow-map"]
    assert rows[0]["psnr_db"] == "inf"
    assert float(rows[1]["rmse"]) == pytest.approx(comparison["results"][1]["rmse"])
    assert rows[2]["error"].startswith("12 edges")
    assert "curve" not in rows[0]


def test_plain_table_is_aligned(comparison):
    lines = plain(comparison).splitlines()
    assert len(lines) == 4
    assert len({len(line) for line in lines[:3]}) == 1
    assert lines[3].endswith("12 edges <have> more than two faces")
