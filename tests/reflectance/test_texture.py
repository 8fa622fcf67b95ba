"""Texture lookup: orientation, interpolation, repetition, decoding, refusals."""

import numpy as np
import pytest

from jaxvis.reflectance import Texture
from jaxvis.reflectance.texture import srgb_to_linear

# Top row 0.1 0.2 0.3, bottom row 0.4 0.5 0.6.
GREY = Texture(np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]], np.float32)[..., None])


def at(texture, *uv):
    return texture.sample(np.array([uv], np.float32))[0]


def test_origin_is_bottom_left_and_v_points_up():
    assert at(GREY, 1 / 6, 0.25) == pytest.approx(0.4)
    assert at(GREY, 1 / 6, 0.75) == pytest.approx(0.1)
    assert at(GREY, 5 / 6, 0.75) == pytest.approx(0.3)


def test_bilinear_between_texel_centres():
    assert at(GREY, 1 / 3, 0.75) == pytest.approx(0.15)
    assert at(GREY, 1 / 2, 0.5) == pytest.approx(0.35)
    assert at(GREY, 1 / 6 + 0.25 / 3, 0.25 + 0.5 * 0.25) == pytest.approx(
        0.75 * (0.75 * 0.4 + 0.25 * 0.5) + 0.25 * (0.75 * 0.1 + 0.25 * 0.2)
    )


def test_repeats_across_the_borders():
    assert at(GREY, 0.0, 0.75) == pytest.approx((0.1 + 0.3) / 2)
    assert at(GREY, 1 / 6, 0.0) == pytest.approx((0.1 + 0.4) / 2)
    uv = np.random.default_rng(1).uniform(0, 1, (50, 2))
    for shift in ([3, 0], [0, -2], [-1, 5]):
        np.testing.assert_allclose(
            GREY.sample(uv + np.array(shift)), GREY.sample(uv), atol=1e-6, rtol=0
        )


def test_lookup_matches_a_slow_oracle():
    generator = np.random.default_rng(2)
    texture = Texture(generator.uniform(0, 1, (5, 4, 3)).astype(np.float32))
    uv = generator.uniform(-2, 2, (40, 2))
    for (u, v), value in zip(uv, texture.sample(uv), strict=True):
        expected = np.zeros(3)
        for row in range(-15, 20):  # every repetition's texels, weighted by a tent
            for column in range(-12, 16):
                down = max(0.0, 1.0 - abs((1.0 - v) * 5 - (row + 0.5)))
                right = max(0.0, 1.0 - abs(u * 4 - (column + 0.5)))
                expected += down * right * texture.texels[row % 5, column % 4]
        np.testing.assert_allclose(value, expected, atol=1e-5)


def test_srgb_decoding_is_exact():
    # Computed from IEC 61966-2-1 by hand: the linear toe, the joint, the curve.
    codes = np.array([0.0, 0.04045, 0.5, 1.0])
    np.testing.assert_allclose(
        srgb_to_linear(codes), [0.0, 0.04045 / 12.92, 0.21404114048223255, 1.0], rtol=1e-12
    )


def test_from_image_scales_decodes_and_drops_alpha():
    image = np.zeros((2, 2, 4), np.uint8)
    image[0, 0] = [255, 188, 0, 7]
    texture = Texture.from_image(image, srgb=True)
    assert texture.channels == 3
    np.testing.assert_allclose(texture.texels[0, 0], [1.0, 0.5028865, 0.0], atol=1e-6)
    np.testing.assert_allclose(
        Texture.from_image(image, srgb=False).texels[0, 0], [1.0, 188 / 255, 0.0], atol=1e-7
    )
    deep = Texture.from_image(np.full((1, 1), 65535, np.uint16), srgb=False)
    assert deep.texels.shape == (1, 1, 1)
    assert deep.texels[0, 0, 0] == 1.0
    half = Texture.from_image(np.full((1, 1, 2), 0.5, np.float64), srgb=False)
    np.testing.assert_array_equal(half.texels, np.full((1, 1, 1), 0.5, np.float32))


def test_texels_are_a_read_only_copy():
    source = np.full((1, 1, 1), 0.5, np.float32)
    texture = Texture(source)
    source[:] = 0.25
    assert texture.texels[0, 0, 0] == 0.5
    with pytest.raises(ValueError, match="read-only"):
        texture.texels[0, 0, 0] = 0.0


@pytest.mark.parametrize("value", [-0.1, 1.1, np.nan, np.inf])
def test_values_outside_the_unit_interval_are_refused(value):
    with pytest.raises(ValueError, match=r"texture texels must lie in \[0, 1\]"):
        Texture(np.array([[[0.5], [value]]], np.float32))


@pytest.mark.parametrize("shape", [(4,), (2, 2, 5), (2, 2, 0), (0, 2, 3), (1, 2, 2, 3)])
def test_wrong_shapes_are_refused(shape):
    with pytest.raises(ValueError, match="texture"):
        Texture.from_image(np.zeros(shape, np.float32), srgb=False)
