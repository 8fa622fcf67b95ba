"""Files changed at random end in use or in one line (``python -m tests.fuzzing`` tries more)."""

import os
import subprocess
import sys

import pytest

from tests import fuzzing

SEED = os.environ.get("JAXVIS_SEED", "0")
FILES = os.environ.get("JAXVIS_FUZZ_FILES", "250")
FORMATS = ("glb", "gltf", "obj", "ply", "stl", "terrain", "hdr", "exr", "pfm", "results")
FORMATS += ("grid", "rows")


@pytest.mark.parametrize("kinds", [FORMATS, ("polygons", "distances")], ids=["formats", "saved"])
def test_no_file_does_harm(kinds):
    """In a process of their own, since a reader in C++ may take it down."""
    command = [sys.executable, "-m", "tests.fuzzing", *kinds, "--seed", SEED, "--files", FILES]
    done = subprocess.run(command, capture_output=True, text=True, timeout=500)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    assert done.stdout.count(f"{FILES} files, 0 bad") == len(kinds)


def refuse(*lines):
    def use(path):
        raise ValueError("\n".join(lines).format(path))

    return use


def warn(path):
    import warnings

    warnings.warn("overflow", RuntimeWarning, stacklevel=1)


def wait(path):
    while True:
        pass


@pytest.mark.parametrize(
    ("use", "says"),
    [
        (lambda path: None, None),
        (refuse("{}: damaged"), None),
        (refuse("{}: damaged", "and more"), "not one line"),
        (refuse("damaged"), "does not name the file"),
        (lambda path: {}["x"], "KeyError"),
        (lambda path: sys.exit(3), "SystemExit"),
        (warn, "RuntimeWarning: overflow"),
        (wait, "not done in 0.5 s"),
    ],
)
def test_harm_is_seen(use, says, tmp_path, monkeypatch):
    monkeypatch.setattr(fuzzing, "SECONDS", 0.5)
    found = fuzzing.tried(use, tmp_path / "file")
    assert found is None if says is None else says in found


def test_memory_that_grows_is_seen(tmp_path):
    """In a process that never had so much."""
    code = "import pathlib, tests.fuzzing as f; "
    code += "print(f.tried(lambda path: len(b'x' * 700_000_000), pathlib.Path('x')))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=100)
    assert done.stdout.startswith("took "), done.stdout + done.stderr


def test_files_are_changed_and_seeds_tell_them_apart():
    import numpy as np

    data = bytes(range(200)) * 5
    one, again, other = (
        [fuzzing.mutated(data, rng) for _ in range(50)]
        for rng in map(np.random.default_rng, (0, 0, 1))
    )
    assert one == again != other
    assert sum(changed != data for changed in one) > 40
    assert len({len(changed) for changed in one}) > 10
