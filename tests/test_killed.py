"""Commands killed at random moments: what they leave is whole or absent, and they can run again.

``JAXVIS_KILLS`` says how often each is killed, ``JAXVIS_SEED`` when.
"""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from jaxvis.cache import load_arrays
from jaxvis.image import read_image

KILLS = int(os.environ.get("JAXVIS_KILLS", "1"))
SEED = int(os.environ.get("JAXVIS_SEED", "0"))
SMALL = ["--scene", "box-on-plane", "--environment", "uniform", "--size", "16", "12"]
METHOD = "vectorized:vectors=16,resolution=16"


def started(arguments, cache, out):
    command = [sys.executable, "-m", "jaxvis.cli", *arguments, "--out", str(out)]
    environment = os.environ | {"JAXVIS_CACHE": str(cache), "JAX_DISABLE_MOST_OPTIMIZATIONS": "1"}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(command, env=environment, **quiet)


def names(folder):
    """What a user sees in a folder: hidden files are what a kill may leave behind."""
    return (
        {p.name for p in folder.iterdir() if not p.name.startswith(".")}
        if folder.exists()
        else set()
    )


def assert_visibility_is_whole(out):
    for name in names(out):
        load_arrays(out / name, "visibility-polygons")


def assert_report_is_whole(out):
    found = names(out)
    for name in found:
        content = (out / name).read_bytes()
        assert content
        if name.endswith((".exr", ".png")):
            assert np.isfinite(read_image(out / name)).all()
    if "results.json" in found:  # written last: what it names is there
        results = json.loads((out / "results.json").read_text())
        assert {row["image"] for row in results["results"]} <= found


GRID = """
scene = "box-on-plane"
environment = ["uniform", "windows"]
size = [16, 12]
seed = [0, 1]
methods = ["mc-mis:spp=1", "mc-brdf:spp=1"]
reference = "reference"
"""
ROWS = 8


def assert_sweep_is_whole(out):
    """Every row that is there is so once, with its images; the tables come last, with all."""
    log = out / "rows.jsonl"
    content = log.read_bytes() if log.exists() else b""
    rows = [json.loads(line) for line in content[: content.rfind(b"\n") + 1].splitlines()]
    assert len({row["key"] for row in rows}) == len(rows)
    for row in rows:
        for name in (row["image"], row["reference_image"]):
            assert np.isfinite(read_image(out / name)).all()
    for name in names(out) & {"table.csv", "times.csv"}:
        assert len((out / name).read_text().splitlines()) == 1 + ROWS == 1 + len(rows)


COMMANDS = {
    "sweep": (["sweep", "GRID", "--images"], assert_sweep_is_whole),
    "precompute": (["precompute", METHOD, "--scene", "box-on-plane"], assert_visibility_is_whole),
    "compare": (
        ["compare", *SMALL, "--methods", f"{METHOD},mc-mis:spp=1", "--reference", "reference"],
        assert_report_is_whole,
    ),
}


@pytest.mark.parametrize("name", COMMANDS)
def test_a_kill_leaves_nothing_half_written(name, tmp_path):
    arguments, assert_whole = COMMANDS[name]
    grid = tmp_path / "grid.toml"
    grid.write_text(GRID)
    arguments = [str(grid) if each == "GRID" else each for each in arguments]
    cache, out = tmp_path / "cache", tmp_path / "out"
    start = time.monotonic()
    process = started(arguments, cache, out)
    assert process.wait() == 0, process.stderr.read()
    seconds, complete = time.monotonic() - start, names(out)
    assert complete
    assert_whole(out)
    rng = np.random.default_rng([SEED, *name.encode()])
    for kill in range(KILLS):
        # Half of them with what was computed before, half without.
        cache, out = tmp_path / f"cache-{kill // 2}", tmp_path / f"out-{kill}"
        process = started(arguments, cache, out)
        time.sleep(float(rng.uniform(0.1, 1.0)) * seconds)
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert_whole(out)
        process = started(arguments, cache, out)
        _, errors = process.communicate()
        assert process.returncode == 0, errors
        assert names(out) == complete
        assert_whole(out)
