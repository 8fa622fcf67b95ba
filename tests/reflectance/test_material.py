"""Materials: their values at points, and what they refuse."""

import numpy as np
import pytest

from jaxvis.reflectance import Material, Texture, evaluate_materials

CHECKS = Texture(np.array([[[1.0, 0, 0], [0, 1.0, 0]], [[0, 0, 1.0], [1.0, 1.0, 1.0]]], np.float32))
GREY = Texture(np.array([[[0.25], [0.75]]], np.float32))


def test_constants_are_grouped_by_material():
    materials = (
        Material((0.1, 0.2, 0.3), (0.4, 0.5, 0.6), 0.7),
        Material(),
        Material((1, 1, 1), roughness=0),
    )
    values = evaluate_materials(materials, np.array([2, 0, 1, 0]), None, None)
    np.testing.assert_allclose(
        values.base_colour, [[1, 1, 1], [0.1, 0.2, 0.3], [0.8, 0.8, 0.8], [0.1, 0.2, 0.3]]
    )
    np.testing.assert_allclose(values.specular[1:3], [[0.4, 0.5, 0.6], [0, 0, 0]])
    np.testing.assert_allclose(values.roughness, [0.0, 0.7, 1.0, 0.7])
    assert values.base_colour.dtype == values.specular.dtype == values.roughness.dtype == np.float32


def test_textures_and_vertex_colours_multiply_the_constants():
    material = Material((0.5, 0.5, 0.8), (0.2, 0.4, 0.6), 0.5, CHECKS, GREY, GREY)
    uv = np.array([[0.25, 0.75], [0.75, 0.75], [0.25, 0.25]])
    colours = np.array([[1.0, 1, 1], [0.5, 0.5, 0.5], [0.1, 0.2, 0.3]])
    values = evaluate_materials((Material(), material), np.array([1, 1, 1]), uv, colours)
    np.testing.assert_allclose(
        values.base_colour, [[0.5, 0, 0], [0, 0.25, 0], [0, 0, 0.24]], atol=1e-6
    )
    np.testing.assert_allclose(values.specular[0], [0.05, 0.1, 0.15], atol=1e-6)
    np.testing.assert_allclose(values.specular[1], [0.15, 0.3, 0.45], atol=1e-6)
    np.testing.assert_allclose(values.roughness, [0.125, 0.375, 0.125], atol=1e-6)


def test_each_material_reads_its_own_texture():
    dark = Texture(np.full((1, 1, 3), 0.1, np.float32))
    materials = (
        Material((1, 1, 1), base_colour_texture=CHECKS),
        Material((1, 1, 1), base_colour_texture=dark),
    )
    uv = np.full((4, 2), 0.75)
    values = evaluate_materials(materials, np.array([0, 1, 1, 0]), uv, None)
    np.testing.assert_allclose(np.asarray(values.base_colour)[[0, 3]], [[0, 1, 0]] * 2, atol=1e-6)
    np.testing.assert_allclose(
        np.asarray(values.base_colour)[[1, 2]], np.full((2, 3), 0.1), atol=1e-6
    )


def test_no_points_and_no_uv():
    empty = evaluate_materials((Material(),), np.zeros(0, np.int32), None, None)
    assert empty.base_colour.shape == (0, 3)
    textured = Material(base_colour_texture=CHECKS, name="tiles")
    with pytest.raises(ValueError, match="'tiles' is textured: texture coordinates are needed"):
        evaluate_materials((textured,), np.array([0]), None, None)
    # A textured material that no point has asks for nothing.
    evaluate_materials((Material(), textured), np.array([0]), None, None)


@pytest.mark.parametrize("ids", [[0, 2], [-1, 0]])
def test_unknown_ids_are_refused(ids):
    with pytest.raises(ValueError, match=r"material ids must lie in \[0, 1\]"):
        evaluate_materials((Material(), Material()), np.array(ids), None, None)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"base_colour": (0.5, 0.5, 1.5)}, "'m': base_colour must be three numbers in"),
        ({"base_colour": (0.5, 0.5)}, "'m': base_colour must be three numbers in"),
        ({"specular": (0.5, -0.1, float("nan"))}, "'m': specular must be three numbers in"),
        ({"roughness": 1.01}, "'m': roughness must lie in"),
        ({"roughness": float("nan")}, "'m': roughness must lie in"),
        ({"roughness_texture": CHECKS}, "'m': roughness_texture must have 1 channels, got 3"),
        (
            {"specular_texture": Texture(np.zeros((1, 1, 2), np.float32))},
            "'m': specular_texture must have 1 or 3 channels, got 2",
        ),
    ],
)
def test_values_out_of_range_are_refused_in_one_line(arguments, message):
    with pytest.raises(ValueError, match=message) as caught:
        Material(name="m", **arguments)
    assert "\n" not in str(caught.value)


def test_materials_are_hashable_and_compare_by_value():
    assert Material([0, 1, 0]) == Material((0.0, 1.0, 0.0))
    assert hash(Material()) == hash(Material())
    assert Material(base_colour_texture=CHECKS) != Material(base_colour_texture=GREY)
