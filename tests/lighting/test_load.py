"""Loading environments by name, from files in every layout, and from arrays."""

import numpy as np
import pytest

from jaxvis.errors import InvalidEnvironment, JaxvisWarning
from jaxvis.lighting import LAYOUTS, load_environment
from jaxvis.sphere import latlong
from tests.lighting.probe_files import gradient, write_exr, write_hdr, write_pfm


def faces(size=4, seed=0):
    return np.random.default_rng(seed).random((6, size, size, 3))


def as_layout(cube, layout):
    """The six faces drawn as a cross, by hand."""
    px, nx, py, ny, pz, nz = cube
    void = np.full_like(px, np.nan)  # nobody looks there
    rows = {
        "vertical-cross": [
            [void, py, void], [nx, pz, px], [void, ny, void], [void, nz[::-1, ::-1], void],
        ],
        "horizontal-cross": [
            [void, py, void, void], [nx, pz, px, nz], [void, ny, void, void],
        ],
        "faces": [list(cube)],
    }[layout]  # fmt: skip
    return np.concatenate([np.concatenate(row, axis=1) for row in rows], axis=0)


def energy(environment):
    weights = latlong.row_solid_angles(environment.height, environment.width)
    return np.einsum("h,hwc->c", weights, np.asarray(environment.radiance, np.float64))


def test_a_lat_long_array_is_taken_as_it_is():
    radiance = gradient(4, 8)
    environment = load_environment(radiance)
    np.testing.assert_array_equal(environment.radiance, radiance.astype(np.float32))
    assert environment.name == "array"
    again = load_environment(environment.radiance)  # a JAX array
    np.testing.assert_array_equal(again.radiance, environment.radiance)
    assert load_environment(radiance, name="mine").name == "mine"


@pytest.mark.parametrize("write", [write_pfm, write_hdr, write_exr])
def test_lat_long_files(write, tmp_path):
    suffix = {write_pfm: "pfm", write_hdr: "hdr", write_exr: "exr"}[write]
    path = write(tmp_path / f"panorama.{suffix}", gradient(8, 16))
    for source in (path, str(path)):
        environment = load_environment(source)
        np.testing.assert_array_equal(environment.radiance, gradient(8, 16).astype(np.float32))
        assert environment.name == "panorama"


def test_exposure_scales():
    one = load_environment(gradient(4, 8))
    other = load_environment(gradient(4, 8), exposure=0.25)
    np.testing.assert_allclose(other.radiance, 0.25 * one.radiance)
    for exposure in (-1.0, np.nan):
        with pytest.raises(ValueError, match="exposure must be"):
            load_environment(gradient(4, 8), exposure=exposure)


def test_all_layouts_of_a_cube_give_one_map(tmp_path):
    cube = faces()
    expected = load_environment(list(cube)).radiance
    assert expected.shape == (8, 16, 3)
    np.testing.assert_array_equal(load_environment(cube).radiance, expected)
    for layout in ("vertical-cross", "horizontal-cross", "faces"):
        path = write_exr(tmp_path / f"{layout}.exr", as_layout(cube, layout))
        np.testing.assert_allclose(load_environment(path).radiance, expected, rtol=1e-6)
        named = load_environment(path, layout=layout)
        np.testing.assert_allclose(named.radiance, expected, rtol=1e-6)
    for name, face in zip(("px", "nx", "py", "ny", "pz", "nz"), cube, strict=True):
        write_pfm(tmp_path / f"sky_{name}.pfm", face)
    for source in (tmp_path / "sky_{}.pfm", str(tmp_path / "sky_*.pfm")):
        np.testing.assert_allclose(load_environment(source).radiance, expected, rtol=1e-6)


@pytest.mark.parametrize(("face", "direction"), [
    ("px", (-1, 0, 0)), ("nx", (1, 0, 0)), ("py", (0, 1, 0)),
    ("ny", (0, -1, 0)), ("pz", (0, 0, 1)), ("nz", (0, 0, -1)),
])  # fmt: skip
def test_light_comes_from_the_side_of_its_face(face, direction):
    cube = np.zeros((6, 3, 3, 3))
    cube[("px", "nx", "py", "ny", "pz", "nz").index(face)] = 1.0
    environment = load_environment(cube)
    np.testing.assert_allclose(environment.towards(np.asarray(direction, np.float32)), 1.0)
    np.testing.assert_allclose(energy(environment), 4.0 * np.pi / 6.0, rtol=1e-5)


def test_an_angular_probe_has_its_front_in_the_middle_and_is_not_mirrored():
    size = 64
    place = 2.0 * (np.arange(size) + 0.5) / size - 1.0
    right, up = np.meshgrid(place, -place)
    probe = np.stack([right > 0.0, up > 0.0, np.hypot(right, up) < 0.5], axis=-1) * 1.0
    probe[np.hypot(right, up) > 1.1] = np.nan  # void
    environment = load_environment(probe)
    assert environment.height == 32
    directions = latlong.texel_directions(32, 64)
    x, y, z = np.moveaxis(directions, -1, 0)
    clear = (np.abs(directions) > 0.2).all(axis=-1)
    seen = np.asarray(environment.radiance)
    np.testing.assert_allclose(seen[clear, 0], (x < 0.0)[clear], atol=1e-6)
    np.testing.assert_allclose(seen[clear, 1], (y > 0.0)[clear], atol=1e-6)
    np.testing.assert_allclose(seen[clear, 2], (z > 0.0)[clear], atol=1e-6)
    # To the right of the middle of a panorama seen from inside is what was right of the front.
    assert seen[16, 34, 0] == pytest.approx(1.0)
    assert seen[16, 29, 0] == pytest.approx(0.0)


@pytest.mark.parametrize("height", [3, 8, 20])
def test_height_resizes_and_keeps_energy(height):
    for source in (gradient(8, 16), faces()):
        environment = load_environment(source, height=height)
        assert environment.radiance.shape == (height, 2 * height, 3)
        np.testing.assert_allclose(energy(environment), energy(load_environment(source)), rtol=1e-3)


def test_grey_and_alpha():
    grey = gradient(4, 8)[..., 0]
    expected = np.repeat(grey[..., None], 3, axis=-1)
    alpha = np.zeros((4, 8, 1))
    for array in (grey, grey[..., None], np.concatenate([grey[..., None], alpha], axis=-1)):
        np.testing.assert_array_equal(load_environment(array).radiance, expected)
    rgba = np.concatenate([gradient(4, 8), alpha], axis=-1)
    np.testing.assert_array_equal(load_environment(rgba).radiance, gradient(4, 8))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e39])
def test_nan_and_infinite_radiance_is_refused(bad, tmp_path):
    radiance = gradient(4, 8)
    radiance[1, 2, 0] = bad
    with pytest.raises(InvalidEnvironment, match="array: 1 of 32 texels are NaN or infinite"):
        load_environment(radiance)
    cube = faces()
    cube[2, 1, 1] = bad
    with pytest.raises(InvalidEnvironment, match="faces: 1 of 96 texels are NaN or infinite"):
        load_environment(list(cube))


def test_negative_radiance_is_refused_unless_it_weighs_nothing():
    radiance = gradient(4, 8)
    radiance[0, 0, 0], radiance[2, 3, 1] = -1e-4, -1e-4
    with pytest.warns(JaxvisWarning, match="array: 2 of 32 texels are negative .*count as 0"):
        environment = load_environment(radiance)
    np.testing.assert_array_equal(environment.radiance, np.maximum(radiance, 0.0, dtype=np.float32))
    radiance[2, 3, 1] = -50.0
    with pytest.raises(InvalidEnvironment, match=r"array: 2 of 32 texels are negative .*energy"):
        load_environment(radiance)
    with pytest.raises(InvalidEnvironment, match="no light at all"):
        load_environment(-np.ones((4, 8, 3)))


def test_a_black_environment_is_light_too():
    assert not load_environment(np.zeros((2, 4, 3))).radiance.any()


@pytest.mark.parametrize(("source", "message"), [
    (np.zeros((4, 7, 3)), "array: 7 x 4 has the shape of no layout"),
    (np.zeros((4, 8, 5)), "array: shape .* is not a picture"),
    (np.zeros((0, 0, 3)), "array: shape .* is not a picture"),
    (np.zeros((2, 4, 3), complex), "holds complex128, not numbers"),
    (np.zeros((2, 2, 3)), "2 texels across are too few for angular"),
    (np.zeros((5, 4, 4, 3)), "six faces .* got 5"),
    ([np.zeros((4, 4, 3))] * 5 + [np.zeros((4, 5, 3))], "face nz: 5 x 4; the six faces must be"),
    ([np.zeros((4, 4, 3))] * 5 + [np.zeros((8, 8, 3))], "face nz: 8 x 8; the six faces must be"),
])  # fmt: skip
def test_shapes_that_are_no_probe_are_refused(source, message):
    with pytest.raises(InvalidEnvironment, match=message):
        load_environment(source)


def test_wrong_layouts_name_the_file(tmp_path):
    path = write_pfm(tmp_path / "cross.pfm", np.ones((8, 6, 3)))
    with pytest.raises(InvalidEnvironment, match=r"cross\.pfm: 6 x 8 cannot be latlong"):
        load_environment(path, layout="latlong")
    with pytest.raises(ValueError, match=f"no layout 'cube': use auto, {', '.join(LAYOUTS)}"):
        load_environment(path, layout="cube")
    with pytest.raises(ValueError, match="built in and has no layout"):
        load_environment("sky", layout="latlong")


def test_unknown_names_list_the_choices(tmp_path):
    with pytest.raises(ValueError, match=r"unknown environment 'uffici': did you mean uffizi.*sky"):
        load_environment("uffici")
    with pytest.raises(ValueError, match=r"unknown environment 'skyy.*did you mean sky\?"):
        load_environment("skyy:turbidity=3")
    (tmp_path / "panorama.hdr").touch()
    with pytest.raises(FileNotFoundError, match=r"panorma\.hdr: no such file; did you mean panora"):
        load_environment(str(tmp_path / "panorma.hdr"))
    with pytest.raises(FileNotFoundError, match="no such file"):
        load_environment(str(tmp_path / "nowhere" / "panorama.hdr"))


def test_parameters_in_names():
    environment = load_environment("uniform:radiance=2.5,height=3")
    assert environment.name == "uniform:radiance=2.5,height=3"
    np.testing.assert_array_equal(environment.radiance, np.full((3, 6, 3), 2.5, np.float32))
    assert load_environment("uniform", height=5).height == 5
    assert load_environment("uniform:height=3", height=5).height == 3


@pytest.mark.parametrize(("source", "message"), [
    ("sky:haze=3", "'sky' has no parameter 'haze'; it has turbidity, elevation"),
    ("sky:turbidity", "'turbidity' is not parameter=value"),
    ("sky:turbidity=much", "turbidity must be float, got 'much'"),
    ("windows:seed=1.5", "seed must be int, got '1.5'"),
    ("sky:turbidity=40", r"turbidity must be in \[2, 10\], got 40"),
    ("uniform:radiance=-1", "radiance must be finite and non-negative"),
])  # fmt: skip
def test_parameters_that_do_not_fit(source, message):
    with pytest.raises(ValueError, match=message):
        load_environment(source)
