"""The log of finished rows: nothing that was finished is lost, nothing half-written is read."""

import csv
import json

import pytest

from jaxvis.sweep import Grid
from jaxvis.sweep.store import LOG, TABLE, TIMES, Store

JOBS = Grid(("mc-mis", "mc-mis:spp=2"), seed=(0, 1)).jobs()


def row(number):
    return {"psnr_db": 30.0 + number, "frame_s": 0.5, "error": None}


def test_rows_come_back(tmp_path):
    with Store(tmp_path) as store:
        for number, job in enumerate(JOBS[:3]):
            store.append(job, row(number))
    with Store(tmp_path) as store:
        assert set(store.rows) == {job.key for job in JOBS[:3]}
        assert store.rows[JOBS[2].key]["psnr_db"] == 32.0


def test_each_row_is_on_the_disk_before_the_next(tmp_path):
    with Store(tmp_path) as store:
        store.append(JOBS[0], row(0))
        assert json.loads((tmp_path / LOG).read_text())["psnr_db"] == 30.0


@pytest.mark.parametrize("kept", range(1, 40, 7))
def test_a_line_cut_off_by_a_kill_is_dropped_and_written_anew(tmp_path, kept):
    with Store(tmp_path) as store:
        store.append(JOBS[0], row(0))
        store.append(JOBS[1], row(1))
    first, second = (tmp_path / LOG).read_bytes().splitlines(keepends=True)
    (tmp_path / LOG).write_bytes(first + second[:kept])
    with Store(tmp_path) as store:
        assert set(store.rows) == {JOBS[0].key}
        store.append(JOBS[1], row(1))
    assert (tmp_path / LOG).read_bytes() == first + second


@pytest.mark.parametrize("line", ["{", "3", "{}", '{"key": []}', "\x00\x00"])
def test_damage_is_named_and_nothing_is_overwritten(tmp_path, line):
    with Store(tmp_path) as store:
        store.append(JOBS[0], row(0))
    content = (tmp_path / LOG).read_text() + line + "\n"
    (tmp_path / LOG).write_text(content)
    with pytest.raises(ValueError, match=r"rows\.jsonl: line 2 is damaged; remove it"):
        Store(tmp_path)
    assert (tmp_path / LOG).read_text() == content


def test_two_sweeps_do_not_share_a_folder(tmp_path):
    with Store(tmp_path), pytest.raises(ValueError, match="another sweep is writing here"):
        Store(tmp_path)
    Store(tmp_path).__exit__()


def test_tables_are_in_the_grids_order_and_times_apart(tmp_path):
    with Store(tmp_path) as store:
        for number in (3, 0, 2):
            store.append(JOBS[number], row(number))
        store.write_tables(JOBS)
    with (tmp_path / TABLE).open(newline="") as file:
        values = list(csv.DictReader(file))
    assert [(r["method"], r["seed"], r["psnr_db"]) for r in values] == [
        ("mc-mis", "0", "30.0"),
        ("mc-mis:spp=2", "0", "32.0"),
        ("mc-mis:spp=2", "1", "33.0"),
    ]
    assert values[0]["size"] == "256x192"
    assert not any(name.endswith("_s") for name in values[0])
    with (tmp_path / TIMES).open(newline="") as file:
        assert [r["frame_s"] for r in csv.DictReader(file)] == ["0.5"] * 3
