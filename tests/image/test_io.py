"""Image files: round trips, and what is refused."""

import numpy as np
import pytest

from jaxvis.image import read_image, write_image


def _radiance(channels=3):
    random = np.random.default_rng(3)
    return random.gamma(0.5, 20.0, (5, 7, channels)).astype(np.float32)


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_exr_is_lossless(tmp_path, channels):
    write_image(tmp_path / "a.exr", _radiance(channels))
    assert np.array_equal(read_image(tmp_path / "a.exr"), _radiance(channels))


@pytest.mark.parametrize("channels", [1, 3])
def test_pfm_is_lossless_and_upright(tmp_path, channels):
    write_image(tmp_path / "a.pfm", _radiance(channels))
    assert np.array_equal(read_image(tmp_path / "a.pfm"), _radiance(channels))
    stored = (tmp_path / "a.pfm").read_bytes()[-5 * 7 * channels * 4 :]
    bottom_up = np.frombuffer(stored, "<f4").reshape(5, 7, channels)
    assert np.array_equal(bottom_up[::-1], _radiance(channels))


def test_hdr_keeps_a_shared_exponent(tmp_path):
    write_image(tmp_path / "a.hdr", _radiance())
    largest = _radiance().max(axis=-1, keepdims=True)
    assert np.all(np.abs(read_image(tmp_path / "a.hdr") - _radiance()) <= largest / 128.0)


def test_png_holds_display_values_in_8_bits(tmp_path):
    pixels = np.linspace(-0.2, 1.2, 5 * 7 * 3, dtype=np.float32).reshape(5, 7, 3)
    write_image(tmp_path / "a.png", pixels)
    expected = np.rint(np.clip(pixels, 0, 1) * 255) / 255
    assert np.allclose(read_image(tmp_path / "a.png"), expected, atol=1e-6)


def test_png_opacity_leaves_colour_alone(tmp_path):
    from PIL import Image

    pixels = np.full((2, 2, 4), 0.6, np.float32)
    pixels[0, :, 3] = 0.2
    write_image(tmp_path / "a.png", pixels)
    with Image.open(tmp_path / "a.png") as stored:
        assert stored.getpixel((0, 0)) == (153, 153, 153, 51)


def test_writing_replaces_the_file_and_leaves_nothing_else(tmp_path):
    write_image(tmp_path / "a.exr", _radiance())
    write_image(tmp_path / "a.exr", 2.0 * _radiance())
    assert np.array_equal(read_image(tmp_path / "a.exr"), 2.0 * _radiance())
    assert [path.name for path in tmp_path.iterdir()] == ["a.exr"]


def test_a_failed_write_keeps_the_old_file(tmp_path):
    write_image(tmp_path / "a.hdr", _radiance())
    before = (tmp_path / "a.hdr").read_bytes()
    with pytest.raises(ValueError, match="does not hold 4 channels"):
        write_image(tmp_path / "a.hdr", _radiance(4))
    assert (tmp_path / "a.hdr").read_bytes() == before
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize("name", ["a.jpg", "a", "a.exr.gz"])
def test_unknown_formats_are_refused_by_name(tmp_path, name):
    with pytest.raises(ValueError, match=f"{name}: unknown image format"):
        write_image(tmp_path / name, _radiance())
    with pytest.raises(ValueError, match=f"{name}: unknown image format"):
        read_image(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_missing_file(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"gone\.exr: no such file"):
        read_image(tmp_path / "gone.exr")


@pytest.mark.parametrize("suffix", [".exr", ".hdr", ".pfm", ".png"])
@pytest.mark.parametrize("keep", [0, 20, 0.6])
def test_truncated_files_are_refused_in_one_line(tmp_path, suffix, keep):
    path = tmp_path / f"cut{suffix}"
    pixels = np.random.default_rng(1).uniform(0.1, 1.0, (32, 40, 3)).astype(np.float32)
    write_image(path, pixels)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(keep * len(whole)) if isinstance(keep, float) else keep])
    with pytest.raises(ValueError, match=f"cut{suffix}: ") as caught:
        read_image(path)
    assert "\n" not in str(caught.value)
