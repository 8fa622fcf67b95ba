"""Data sets by name: the local folder first, then a pinned download (never in tests)."""

import hashlib
import os
from pathlib import Path

import pytest

from jaxvis import datasets


@pytest.fixture(autouse=True)
def _no_network(monkeypatch):
    def refuse(*args, **kwargs):
        raise AssertionError("tests must not download")

    monkeypatch.setattr(datasets.pooch, "retrieve", refuse)


@pytest.fixture
def _empty_cache(monkeypatch, tmp_path):
    monkeypatch.delenv("JAXVIS_DATA", raising=False)
    monkeypatch.setenv("JAXVIS_CACHE", str(tmp_path / "cache"))


def test_names_by_kind():
    assert {"duck", "sponza", "bunny", "bistro"} <= set(datasets.names("scene"))
    assert {"uffizi", "stpeters"} <= set(datasets.names("probe"))
    assert set(datasets.names()) == set(datasets.names("scene")) | set(datasets.names("probe"))
    assert len(set(datasets.names())) == len(datasets.names())


def test_local_folder_comes_first(monkeypatch, tmp_path):
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "duck.glb").write_bytes(b"any bytes: local files are trusted")
    monkeypatch.setenv("JAXVIS_DATA", str(tmp_path))
    assert datasets.find("duck") == tmp_path / "models" / "duck.glb"


def test_unknown_name_suggests():
    with pytest.raises(ValueError, match=r"unknown data set 'dukc': did you mean duck\?"):
        datasets.find("dukc")


@pytest.mark.usefixtures("_empty_cache")
def test_converted_file_needs_the_folder():
    with pytest.raises(FileNotFoundError, match=r"sponza.*set JAXVIS_DATA.*scenes/sponza\.glb"):
        datasets.find("sponza")


@pytest.mark.usefixtures("_empty_cache")
def test_download_is_pinned(monkeypatch, tmp_path):
    calls = []

    def retrieve(url, known_hash, path, fname):
        calls.append((url, known_hash, Path(path) / fname))
        return str(Path(path) / fname)

    monkeypatch.setattr(datasets.pooch, "retrieve", retrieve)
    found = datasets.find("duck")
    entry = datasets.describe("duck")
    assert found == tmp_path / "cache" / "datasets" / "models" / "duck.glb"
    assert calls == [(entry.url, f"sha256:{entry.sha256}", found)]
    assert entry.url == (
        "https://raw.githubusercontent.com/sbtron/glTF-Sample-Models/"
        "54e8526ddf5f0bd1b075fadb7f42b63ce88c3da1/2.0/Duck/glTF-Binary/Duck.glb"
    )


@pytest.mark.usefixtures("_empty_cache")
@pytest.mark.parametrize(
    ("raised", "expected", "words"),
    [
        (ValueError("SHA256 hash differs"), ValueError, "does not have the known SHA-256"),
        (ConnectionError("no route"), FileNotFoundError, "cannot be downloaded"),
    ],
)
def test_failed_download_is_one_line(monkeypatch, raised, expected, words):
    def fail(*args, **kwargs):
        raise raised

    monkeypatch.setattr(datasets.pooch, "retrieve", fail)
    with pytest.raises(expected, match=words) as caught:
        datasets.find("duck")
    assert "\n" not in str(caught.value)
    assert "JAXVIS_DATA" in str(caught.value)


def _data_folder() -> Path:
    folder = os.environ.get("JAXVIS_DATA")
    if not folder:
        pytest.skip("JAXVIS_DATA is not set: the data folder is not checked")
    return Path(folder)


def test_hashes_are_those_of_the_data_folder():
    lines = (_data_folder() / "SHA256SUMS").read_text().split("\n")
    known = {file: digest for digest, file in (line.split() for line in lines if line)}
    table = {name: datasets.describe(name) for name in datasets.names()}
    assert {entry.file: entry.sha256 for entry in table.values()} == known


def test_small_files_have_their_hash():
    folder = _data_folder()
    for name in ("duck", "bunny", "city"):
        entry = datasets.describe(name)
        digest = hashlib.sha256((folder / entry.file).read_bytes()).hexdigest()
        assert digest == entry.sha256
