"""Output folders and file names."""

import os

import pytest

from jaxvis.compare import file_stem, output_folder


def test_file_stem_is_a_safe_name():
    assert file_stem("correspondence:vectors=96,shading=fragment") == (
        "correspondence-vectors-96-shading-fragment"
    )
    assert file_stem("mc-ides+denoise") == "mc-ides+denoise"
    assert file_stem("../../x y") == "x-y"


def test_output_folder_keeps_what_was_there_when_the_block_fails(tmp_path):
    (tmp_path / "results.json").write_text("old")

    def fail_halfway() -> None:
        with output_folder(tmp_path) as folder:
            (folder / "results.json").write_text("new")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail_halfway()
    assert (tmp_path / "results.json").read_text() == "old"
    assert len(list(tmp_path.iterdir())) == 1
    with output_folder(tmp_path) as folder:
        (folder / "results.json").write_text("new")
    assert (tmp_path / "results.json").read_text() == "new"
    assert len(list(tmp_path.iterdir())) == 1


def test_output_folder_below_a_file(tmp_path):
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(OSError, match="cannot write to this folder"),
        output_folder(tmp_path / "file"),
    ):
        pytest.fail("the block must not run")


def test_what_a_killed_process_left_is_removed(tmp_path):
    with output_folder(tmp_path) as folder:
        (folder / "results.json").write_text("{}")
        left = tmp_path / ".unfinished-of-a-killed-one"
        left.mkdir()
        (left / "image.exr").write_bytes(b"half")
        os.utime(left, (0.0, 0.0))
        os.utime(folder, (0.0, 0.0))
        with output_folder(tmp_path) as other:
            (other / "table.csv").write_text("")
            assert folder.exists()  # whose process lives
        assert not left.exists()
    assert {path.name for path in tmp_path.iterdir()} == {"results.json", "table.csv"}
