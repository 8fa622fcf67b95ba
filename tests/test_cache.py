"""Files are whole or absent; damaged cache entries are rebuilt, with a warning."""

import os
import threading
import time
import warnings

import numpy as np
import pytest

from jaxvis import cache
from jaxvis.errors import JaxvisWarning


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("JAXVIS_CACHE", str(tmp_path / "cache"))


def build(counter, value=1.0):
    def call():
        counter.append(1)
        return {"image": np.full((2, 3), value), "error": 0.5}

    return call


def test_an_entry_is_built_once():
    counter = []
    first, cached_first = cache.cached_arrays("reference", "key", build(counter))
    second, cached_second = cache.cached_arrays("reference", "key", build(counter))
    assert (len(counter), cached_first, cached_second) == (1, False, True)
    np.testing.assert_array_equal(first["image"], second["image"])
    assert float(second["error"]) == 0.5


def test_what_one_builds_others_wait_for():
    counter, found = [], []

    def slowly():
        time.sleep(0.2)
        return build(counter)()

    def ask():
        found.append(cache.cached_arrays("reference", "key", slowly)[1])

    threads = [threading.Thread(target=ask) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(counter) == 1
    assert sorted(found) == [False, True, True, True]
    assert [path.name for path in (cache.cache_folder() / "reference").iterdir()] == ["key.npz"]


def test_a_build_that_fails_keeps_nobody_out():
    with pytest.raises(ZeroDivisionError):
        cache.cached_arrays("reference", "key", lambda: {"x": 1 // 0})
    assert not cache.cached_arrays("reference", "key", build([]))[1]


@pytest.mark.parametrize("damage", ["truncated", "garbage", "empty", "kind"])
def test_a_bad_entry_is_rebuilt_with_a_warning(damage):
    counter = []
    cache.cached_arrays("reference", "key", build(counter))
    path = cache.cache_folder() / "reference" / "key.npz"
    if damage == "kind":
        cache.save_arrays(path, "another", {"x": 1})
    else:
        content = path.read_bytes()
        path.write_bytes(
            {"truncated": content[:-40], "garbage": b"not a file", "empty": b""}[damage]
        )
    with pytest.warns(JaxvisWarning, match=r"key\.npz.*rebuilt"):
        arrays, cached = cache.cached_arrays("reference", "key", build(counter, 2.0))
    assert not cached
    np.testing.assert_array_equal(arrays["image"], np.full((2, 3), 2.0))
    assert cache.cached_arrays("reference", "key", build(counter))[1]


def test_an_entry_of_another_version_is_rebuilt_silently(monkeypatch):
    counter = []
    with monkeypatch.context() as patch:
        patch.setattr(cache, "FORMAT", cache.FORMAT - 1)
        cache.cached_arrays("reference", "key", build(counter))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        arrays, cached = cache.cached_arrays("reference", "key", build(counter, 2.0))
    assert not cached
    np.testing.assert_array_equal(arrays["image"], np.full((2, 3), 2.0))
    assert cache.cached_arrays("reference", "key", build(counter))[1]


def test_nothing_half_written_is_left(tmp_path):
    target = tmp_path / "file.npz"
    target.write_text("before")

    def fail_halfway():
        with cache.whole_file(target) as temporary:
            temporary.write_text("half")
            raise RuntimeError("a full disk, say")

    with pytest.raises(RuntimeError, match="full disk"):
        fail_halfway()
    assert target.read_text() == "before"
    assert os.listdir(tmp_path) == ["file.npz"]


def test_loading_says_what_is_wrong(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such file"):
        cache.load_arrays(tmp_path / "absent.npz", "kind")
    np.savez(tmp_path / "foreign.npz", x=1)
    with pytest.raises(ValueError, match=r"foreign\.npz: damaged or not a jaxvis file"):
        cache.load_arrays(tmp_path / "foreign.npz", "kind")


def test_the_hash_tells_content_shape_and_type_apart():
    x = np.arange(6.0)
    different = [
        (x,),
        (x.reshape(2, 3),),
        (x.astype(np.float32),),
        (x + 1e-12,),
        ("x",),
        (("a", "b"),),
        ("ab",),
        (1,),
        (1.0,),
        (True,),
        (None,),
        ({"a": 1},),
    ]
    assert len({cache.content_hash(*parts) for parts in different}) == len(different)
    assert cache.content_hash(x) == cache.content_hash(x.copy())
    assert cache.content_hash({"a": 1, "b": 2}) == cache.content_hash({"b": 2, "a": 1})


def test_other_arrays_under_the_old_header_are_refused(tmp_path):
    """Who edits a file shall hear of it, and not of indices out of range."""
    path = tmp_path / "saved.npz"
    arrays = {"x": np.arange(6.0).reshape(2, 3).T, "n": np.array(3), "flags": np.ones(4, bool)}
    cache.save_arrays(path, "kind", arrays, error=np.float64(0.1), sizes=(1, 2), name=None)
    found, header = cache.load_arrays(path, "kind")
    np.testing.assert_array_equal(found["x"], arrays["x"])
    assert header == {"format": cache.FORMAT, "kind": "kind", "error": 0.1} | {
        "sizes": [1, 2],
        "name": None,
    }
    stored = dict(np.load(path))
    for change in ({"x": stored["x"] + 1.0}, {"n": np.array(4)}, {"more": np.ones(1)}):
        np.savez(path, **(stored | change))
        with pytest.raises(ValueError, match=r"saved\.npz: its arrays are not those"):
            cache.load_arrays(path, "kind")
    np.savez(path, **stored)
    cache.load_arrays(path, "kind")


def test_what_killed_processes_left_is_removed_and_what_others_write_is_not(tmp_path):
    old = time.time() - 2.0 * cache.LEFT_AFTER

    def temporary(name, folder):
        path = tmp_path / name
        if folder:
            path.mkdir()
            (path / "image.exr").write_bytes(b"half")
        held = path / cache.HELD if folder else path
        held.write_bytes(b"")
        return path, held

    for folder in (False, True):
        left, _ = temporary(f".out-left-{folder}", folder)
        others, held = temporary(f".out-others-{folder}", folder)
        fresh, _ = temporary(f".out-fresh-{folder}", folder)
        elsewhere, _ = temporary(f".other-{folder}", folder)
        for path in (left, others, elsewhere):
            os.utime(path, (old, old))
        with held.open("rb") as file:
            assert cache.lock(file, wait=False)
            cache.remove_leftovers(tmp_path, ".out-")
        assert not left.exists()
        assert others.exists()
        assert fresh.exists()
        assert elsewhere.exists()


def test_a_file_is_held_while_it_is_written(tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "LEFT_AFTER", -1.0)
    with cache.whole_file(tmp_path / "a.npz") as first:
        first.write_bytes(b"first")
        with cache.whole_file(tmp_path / "a.npz") as second:
            assert first.exists()
            second.write_bytes(b"second")
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]
    assert (tmp_path / "a.npz").read_bytes() == b"first"
