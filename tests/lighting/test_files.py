"""Pixels of .hdr, .exr and .pfm files: rows the right way up, colours in order, clear refusals."""

import numpy as np
import OpenImageIO as oiio
import pytest

from jaxvis.errors import InvalidEnvironment
from jaxvis.lighting.files import find_faces, read_pixels
from tests.lighting.probe_files import gradient, write_exr, write_hdr, write_pfm


@pytest.mark.parametrize("write", [write_pfm, write_hdr, write_exr])
def test_rows_and_colours_come_in_order(write, tmp_path):
    pixels = gradient(4, 8)
    suffix = {write_pfm: "pfm", write_hdr: "hdr", write_exr: "exr"}[write]
    path = write(tmp_path / f"probe.{suffix}", pixels)
    np.testing.assert_array_equal(read_pixels(path), pixels)


@pytest.mark.parametrize("grey", [False, True])
@pytest.mark.parametrize("big_endian", [False, True])
def test_pfm_of_either_byte_order(big_endian, grey, tmp_path):
    pixels = gradient(3, 5)
    stored = pixels[..., 0] if grey else pixels
    path = write_pfm(tmp_path / "probe.pfm", stored, big_endian=big_endian)
    expected = np.repeat(pixels[..., :1], 3, axis=-1) if grey else pixels
    np.testing.assert_array_equal(read_pixels(path), expected)


@pytest.mark.parametrize(("order", "stored"), [
    ("-Y {h} +X {w}", lambda p: p),
    ("+Y {h} +X {w}", lambda p: p[::-1]),
    ("-Y {h} -X {w}", lambda p: p[:, ::-1]),
    ("+Y {h} -X {w}", lambda p: p[::-1, ::-1]),
])  # fmt: skip
def test_hdr_scanline_orders(order, stored, tmp_path):
    pixels = gradient(4, 8)
    path = write_hdr(tmp_path / "probe.hdr", stored(pixels), order)
    np.testing.assert_array_equal(read_pixels(path), pixels)


@pytest.mark.parametrize(("names", "expected"), [
    (("R", "G", "B"), [0, 1, 2]),
    (("R", "G", "B", "A"), [0, 1, 2]),
    (("B", "G", "R"), [2, 1, 0]),
    (("A", "B", "G", "R"), [3, 2, 1]),
    (("light.R", "light.G", "light.B", "Z"), [0, 1, 2]),
    (("Y",), [0, 0, 0]),
    (("Y", "A"), [0, 0, 0]),
])  # fmt: skip
def test_exr_channels_go_by_their_names(names, expected, tmp_path):
    pixels = np.random.default_rng(0).random((4, 8, len(names))).astype(np.float32)
    path = write_exr(tmp_path / "probe.exr", pixels, names)
    np.testing.assert_array_equal(read_pixels(path), pixels[..., expected])


def test_missing_files_and_unknown_formats(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"absent\.hdr: no such file"):
        read_pixels(tmp_path / "absent.hdr")
    picture = tmp_path / "photo.png"
    picture.write_bytes(b"\x89PNG")
    with pytest.raises(InvalidEnvironment, match=r"photo\.png: not a light probe; give one of"):
        read_pixels(picture)


@pytest.mark.parametrize("write", [write_pfm, write_hdr, write_exr])
@pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 0.97])
def test_truncated_files_are_refused_in_one_line(write, share, tmp_path):
    suffix = {write_pfm: "pfm", write_hdr: "hdr", write_exr: "exr"}[write]
    path = write(tmp_path / f"cut.{suffix}", np.random.default_rng(1).random((32, 64, 3)))
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(InvalidEnvironment, match=r"cut\.\w+: (cannot be read|truncated)") as caught:
        read_pixels(path)
    assert "\n" not in str(caught.value)


def test_channels_that_are_no_colours_are_refused(tmp_path):
    pixels = np.ones((2, 4, 4))
    path = write_exr(tmp_path / "normals.exr", pixels, ("depth", "nx", "ny", "nz"))
    with pytest.raises(InvalidEnvironment, match=r"normals\.exr: channels depth, nx, ny, nz hold"):
        read_pixels(path)
    path = write_exr(tmp_path / "chroma.exr", pixels[..., :3], ("Y", "RY", "BY"))
    with pytest.raises(InvalidEnvironment, match=r"chroma\.exr: .* save it as RGB"):
        read_pixels(path)


def test_crops_are_refused(tmp_path):
    path = tmp_path / "crop.exr"
    spec = oiio.ImageSpec(8, 4, 3, oiio.FLOAT)
    spec.full_width, spec.full_height = 16, 8
    output = oiio.ImageOutput.create(str(path))
    output.open(str(path), spec)
    output.write_image(np.ones((4, 8, 3), np.float32))
    output.close()
    with pytest.raises(InvalidEnvironment, match=r"crop\.exr: holds 8 x 4 pixels of a 16 x 8"):
        read_pixels(path)


@pytest.mark.parametrize("names", [
    ("px", "nx", "py", "ny", "pz", "nz"),
    ("sky_posx", "sky_negx", "sky_posy", "sky_negy", "sky_posz", "sky_negz"),
    ("Right", "Left", "Top", "Bottom", "Front", "Back"),
    ("a-right", "a-left", "a-up", "a-down", "a-front", "a-back"),
])  # fmt: skip
def test_six_files_of_a_folder_come_in_order(names, tmp_path):
    for name in names:
        (tmp_path / f"{name}.hdr").touch()
    (tmp_path / "preview.jpg").touch()
    (tmp_path / "whole.exr").touch()
    assert [path.stem for path in find_faces(tmp_path)] == list(names)


def test_patterns_choose_among_sets_of_six(tmp_path):
    for sky in ("day", "night"):
        for name in ("px", "nx", "py", "ny", "pz", "nz"):
            (tmp_path / f"{sky}_{name}.exr").touch()
    for pattern in ("night_{}.exr", "night*", "night_??.exr*"):
        found = find_faces(tmp_path / pattern)
        assert found[0].name == "night_px.exr"
        assert len(found) == 6
    with pytest.raises(InvalidEnvironment, match="six faces cannot be told"):
        find_faces(tmp_path)
    with pytest.raises(FileNotFoundError, match=r"dusk_\{\}\.exr: no \.hdr, \.exr, \.pfm files"):
        find_faces(tmp_path / "dusk_{}.exr")
