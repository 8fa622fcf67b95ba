"""Frames of an animation as files: numbers, pictures, rates, carried visibility."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
import pytest
from PIL import Image

from jaxvis.compare import frame_range, prepare, render, render_frames
from jaxvis.compare.frames import write_animation
from jaxvis.image import read_image, write_image
from jaxvis.lighting import SphereLights
from jaxvis.methods import create
from jaxvis.methods.base import Method
from jaxvis.scene import load_animation

SIZE = (24, 18)


@dataclass(frozen=True)
class Counting(Method):
    """Radiance that says how visibility came about: 1 precomputed, plus 1 per frame."""

    log: tuple = ()

    def precompute(self, scene, progress=True):
        return 1.0

    def precompute_for(self, scene, surface, previous=None, progress=True):
        if previous is None:
            return self.precompute(scene)
        self.log[0].append(scene)
        return previous + 1.0

    def light(self, environment):
        return environment

    def shade(self, visibility, light, surface, *, key=None, progress=False):
        return jnp.full((surface.height, surface.width, 3), visibility)

    def evaluations(self, visibility, light, surface):
        return 0


@pytest.fixture(scope="module")
def animation():
    return load_animation("balls:detail=16")


def test_frame_range():
    assert list(frame_range("0:4")) == [0, 1, 2, 3]
    assert list(frame_range(" 10 : 20 ", 4)) == [10, 14, 18]
    for wrong in ("", "4", "a:b", "-1:3", "1:2:3", "1.5:3"):
        with pytest.raises(ValueError, match=r"^frames must be A:B, .* as in 0:60, got"):
            frame_range(wrong)
    for none in ("5:5", "7:2"):
        with pytest.raises(ValueError, match="are none: the end must be larger"):
            frame_range(none)
    with pytest.raises(ValueError, match="frame step must be at least 1, got 0"):
        frame_range("0:4", 0)


def test_frames_are_the_pictures_of_their_scenes(animation, sky, tmp_path):
    method = create("mc-mis:spp=2")
    names = render_frames(
        method, animation, [3, 7], tmp_path, "m", sky, SIZE, seed=5, exposure=0.7, rotate=0.4
    )
    assert names == ["m_0003.png", "m_0007.png", "m.webp"]
    assert sorted(names) == sorted(path.name for path in tmp_path.iterdir())
    pictures = [read_image(tmp_path / name) for name in names[:2]]
    for frame, picture in zip((3, 7), pictures, strict=True):
        setting = prepare(animation.scene(frame), sky, SIZE, rotate=0.4)
        expected = render(method, setting, seed=5, exposure=0.7).shown
        np.testing.assert_allclose(picture, expected, atol=0.51 / 255)
    assert np.abs(pictures[0] - pictures[1]).max() > 0.1


def test_lamps_light_all_frames(animation, sky, tmp_path):
    method = create("mc-mis:spp=2")
    lamp = SphereLights.of([(0.0, 3.0, 0.0)], [0.3], [(50.0, 20.0, 0.0)])
    options = {"exposure": 0.7, "rotate": 0.4}
    names = render_frames(
        method, animation, [3, 7], tmp_path, "l", sky, SIZE, spheres=lamp, **options
    )
    for frame, name in zip((3, 7), names, strict=False):
        plain = prepare(animation.scene(frame), sky, SIZE, rotate=0.4)
        lit = prepare(animation.scene(frame), sky, SIZE, rotate=0.4, spheres=lamp)
        expected = render(method, lit, exposure=0.7).shown
        np.testing.assert_allclose(read_image(tmp_path / name), expected, atol=0.51 / 255)
        assert np.abs(expected - render(method, plain, exposure=0.7).shown).max() > 0.1


def test_visibility_is_carried_over(animation, sky, tmp_path):
    log: list = []
    method = Counting((log,))
    render_frames(method, animation, range(3), tmp_path, "c", sky, SIZE, exposure=0.1)
    assert len(log) == 2
    for frame, scene in zip((1, 2), log, strict=True):
        np.testing.assert_array_equal(scene.positions, animation.scene(frame).positions)
    inside = prepare(animation.base, sky, SIZE).coverage == 1.0
    levels = [read_image(tmp_path / f"c_000{k}.png")[inside].mean() for k in range(3)]
    assert levels[0] < levels[1] < levels[2]


def test_one_exposure_for_all(animation, sky, tmp_path):
    # The second frame is twice as bright. Exposed alone both would look the same.
    render_frames(Counting(([],)), animation, range(2), tmp_path, "c", sky, SIZE)
    inside = prepare(animation.base, sky, SIZE).coverage == 1.0
    for k in (0, 1):
        assert read_image(tmp_path / f"c_000{k}.png")[inside].mean() == pytest.approx(1.0)
    render_frames(Counting(([],)), animation, range(2), tmp_path, "c", sky, SIZE, exposure=0.25)
    low, high = (read_image(tmp_path / f"c_000{k}.png")[inside].mean() for k in (0, 1))
    assert low == pytest.approx(0.5371, abs=0.005)  # sRGB of 0.25
    assert high == pytest.approx(0.7354, abs=0.005)  # sRGB of 0.5


def test_bad_frames_stop_before_anything_is_rendered(animation, sky, tmp_path):
    log: list = []
    with pytest.raises(ValueError, match="'balls' has frames 0 to 239, got 240"):
        render_frames(Counting((log,)), animation, range(238, 241), tmp_path, "c", sky, SIZE)
    with pytest.raises(ValueError, match="no frames"):
        render_frames(Counting((log,)), animation, [], tmp_path, "c", sky, SIZE)
    assert not list(tmp_path.iterdir())
    assert log == []


@pytest.mark.parametrize("rate", [24.0, 10.0])
def test_the_animation_keeps_its_rate(tmp_path, rate):
    paths = []
    for k in range(25):
        paths.append(tmp_path / f"{k}.png")
        write_image(paths[-1], np.full((8, 8, 3), k / 25.0, np.float32))
    write_animation(tmp_path / "a.webp", paths, rate)
    with Image.open(tmp_path / "a.webp") as moving:
        assert moving.n_frames == 25
        durations = []
        for k in range(moving.n_frames):
            moving.seek(k)
            moving.load()
            durations.append(moving.info["duration"])
            shade = np.asarray(moving.convert("RGB"), float).mean() / 255.0
            assert shade == pytest.approx(k / 25.0, abs=0.02)
    assert sum(durations) == pytest.approx(25_000.0 / rate, abs=1.0)
    assert max(durations) - min(durations) <= 1


def test_a_single_frame_is_an_animation_too(tmp_path):
    write_image(tmp_path / "a.png", np.ones((8, 8, 3), np.float32))
    write_animation(tmp_path / "a.webp", [tmp_path / "a.png"], 24.0)
    with Image.open(tmp_path / "a.webp") as picture:
        assert picture.size == (8, 8)
