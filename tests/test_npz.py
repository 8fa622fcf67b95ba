"""Damaged .npz files are one kind of error, whatever is wrong with them."""

import io
import struct
import zipfile

import numpy as np
import pytest

from jaxvis.npz import read_npz

VALUES = np.linspace(0.0, 1.0, 300).reshape(20, 15)


@pytest.fixture
def whole(tmp_path):
    path = tmp_path / "whole.npz"
    np.savez_compressed(path, x=VALUES, y=np.array(2.0))
    return path


def test_arrays_come_back(whole):
    arrays = read_npz(whole)
    assert list(arrays) == ["x", "y"]
    np.testing.assert_array_equal(arrays["x"], VALUES)


def with_flag(content, bit):
    """The general-purpose flag of the first member's two headers."""
    changed = bytearray(content)
    for signature, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        changed[content.index(signature) + offset + bit // 8] |= 1 << (bit % 8)
    return bytes(changed)


def with_method(content, method):
    changed = bytearray(content)
    for signature, offset in ((b"PK\x03\x04", 8), (b"PK\x01\x02", 10)):
        struct.pack_into("<H", changed, content.index(signature) + offset, method)
    return bytes(changed)


def garbled(content):
    """The compressed stream."""
    changed = bytearray(content)
    changed[80:140] = bytes(60)
    return bytes(changed)


def enormous(content):
    """One array that says it has 10^15 numbers."""
    member, archive = io.BytesIO(), io.BytesIO()
    shape = {"descr": "<f8", "fortran_order": False, "shape": (10**15,)}
    np.lib.format.write_array_header_1_0(member, shape)
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("x.npy", member.getvalue())
    return archive.getvalue()


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: content[:200],
        lambda content: b"",
        lambda content: b"solid s\nendsolid s\n",
        lambda content: with_flag(content, 0),  # encrypted
        lambda content: with_flag(content, 5),  # patched
        lambda content: with_flag(content, 6),  # strongly encrypted
        lambda content: with_method(content, 0),
        lambda content: with_method(content, 12),
        lambda content: with_method(content, 14),
        lambda content: with_method(content, 77),
        garbled,
        enormous,
    ],
)
def test_whatever_is_wrong_is_one_line_with_the_file(whole, damage):
    content = whole.read_bytes()
    changed = damage(content)
    assert changed != content
    whole.write_bytes(changed)
    with pytest.raises(ValueError, match=r"whole\.npz: damaged or not a NumPy \.npz file$"):
        read_npz(whole)


def test_what_is_no_archive_or_not_there(tmp_path):
    np.save(tmp_path / "alone.npy", VALUES)
    for name in ("alone.npy", "absent.npz"):
        with pytest.raises(ValueError, match="damaged or not"):
            read_npz(tmp_path / name)
