"""Comparisons: metrics and files agree, failures are rows, references are cached."""

import dataclasses
import json
import warnings

import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis import methods
from jaxvis.compare import (
    choose_methods,
    compare,
    prepare,
    render,
)
from jaxvis.compare.run import one_line, without_folders
from jaxvis.errors import JaxvisWarning
from jaxvis.image import psnr, read_image, rmse, write_image
from jaxvis.lighting import SphereLights
from jaxvis.methods import Method, Reference
from jaxvis.scene import Camera

SIZE = (20, 14)


@dataclasses.dataclass(frozen=True)
class Stored:
    """A Visibility of nothing, whose rays are counted."""

    rays: list
    nbytes: int = 96

    @property
    def rays_traced(self) -> int:
        return sum(self.rays)


@dataclasses.dataclass(frozen=True)
class Grey(Method):
    """Every covered pixel has the same radiance; ``trouble`` says what goes wrong instead."""

    level: float = 1.0
    spp: int = 5
    trouble: str = ""

    def precompute(self, scene, progress=True):
        if self.trouble == "refuses":
            raise ValueError("the mesh\nis not manifold")
        if self.trouble == "warns":
            warnings.warn("3 faces were ignored", JaxvisWarning, stacklevel=1)
        return Stored([])

    def light(self, environment):
        return jnp.zeros(3)

    def shade(self, visibility, light, surface, *, key=None, progress=False):
        visibility.rays.append(100)
        if self.trouble == "crashes":
            raise IndexError("list index out of range")
        level = jnp.nan if self.trouble == "nan" else self.level
        return surface.to_image(jnp.full((*surface.mask.shape, 3), level))

    def evaluations(self, visibility, light, surface):
        return 7


@pytest.fixture(scope="module")
def comparison(scene, sky, tmp_path_factory):
    out = tmp_path_factory.mktemp("compare") / "out"
    chosen = ["mc-mis:spp=4", Grey(2.0), "mc-mis:spp=4"]
    found = compare(scene, sky, chosen, SIZE, out=out, seed=3, reference="reference")
    return found, out


def test_results_follow_the_schema(comparison):
    found, _ = comparison
    for key in ("schema", "scene", "environment", "size", "seed", "versions", "machine", "metric"):
        assert key in found, key
    assert found["schema"] == 1
    assert (found["scene"], found["environment"]) == ("floor", "two halves")
    assert found["size"] == [20, 14]
    assert found["seed"] == 3
    assert {"jaxvis", "jax", "numpy", "embreex", "python"} <= set(found["versions"])
    assert {"cpu", "cores", "memory_gib", "platform"} <= set(found["machine"])
    assert found["metric"]["peak"] == 1.0
    assert found["metric"]["transfer"] == "sRGB"
    row = found["results"][0]
    for key in (
        *("method", "parameters", "shading", "psnr_db", "rmse", "relmse", "flip", "precompute_s"),
        *("light_s", "compile_s", "frame_s", "frames_timed", "visibility_bytes", "rays_traced"),
        *("evaluations", "image"),
    ):
        assert key in row, key
    assert row["method"] == "mc-mis"
    assert row["parameters"]["spp"] == 4
    assert 1 <= row["frames_timed"] <= 5
    assert all(row[key] >= 0.0 for key in row if key.endswith("_s"))


def test_json_is_strict_and_equals_what_is_returned(comparison):
    found, out = comparison
    stored = json.loads((out / "results.json").read_text(), parse_constant=pytest.fail)
    assert stored == found
    assert json.loads(json.dumps(found)) == found


def test_no_path_or_host_name_is_written(comparison):
    import platform

    _, out = comparison
    text = (out / "results.json").read_text()
    assert str(out) not in text
    assert str(out.parent) not in text
    assert f'"{platform.node()}"' not in text


def test_metrics_can_be_computed_again_from_the_files(comparison):
    found, out = comparison
    covered = read_image(out / "coverage.exr")[..., 0] > 0.0
    reference = read_image(out / found["reference"]["image"])
    assert 0 < covered.sum() < covered.size
    for row in found["results"]:
        image = read_image(out / row["image"])
        assert np.all(image[~covered] == 0.0)
        assert psnr(image, reference, covered) == pytest.approx(row["psnr_db"])
        assert rmse(image, reference, covered) == pytest.approx(row["rmse"])


def test_exposure_is_that_of_the_reference(comparison, scene, sky):
    found, _ = comparison
    # The floor is white diffuse 0.8 and sees the whole upper hemisphere: L = 0.8 (4 + 1) / 2.
    reference = found.images["reference"][found.covered]
    assert np.allclose(reference, [0.8 * 2.5, 0.8 * 2.0, 0.8 * 1.5], rtol=0.02)
    white = 0.8 * (0.2126 * 2.5 + 0.7152 * 2.0 + 0.0722 * 1.5)
    assert 1.0 / found["metric"]["exposure"] == pytest.approx(white, rel=0.02)


def test_pictures_show_the_sky_behind(comparison, scene, sky):
    found, out = comparison
    picture = read_image(out / "reference.png")
    assert np.allclose(picture, found.shown("reference"), atol=0.5 / 255 + 1e-6)
    setting = prepare(scene, sky, SIZE)
    rows = np.flatnonzero(~found.covered.any(axis=1))
    assert len(rows) > 0
    expected = sky.towards(jnp.asarray(setting.camera.directions(*SIZE)[rows], jnp.float32))
    exposed = np.clip(found["display"]["exposure"] * np.asarray(expected), 0, 1)
    linear = ((picture[rows] + 0.055) / 1.055) ** 2.4
    assert np.allclose(linear, exposed, atol=0.02)


def test_the_same_method_twice_gets_two_names(comparison):
    found, out = comparison
    labels = [row["label"] for row in found["results"]]
    assert labels == ["mc-mis:spp=4", "Grey", "mc-mis:spp=4 (2)"]
    images = [row["image"] for row in found["results"]]
    assert len(set(images)) == 3
    assert all((out / image).is_file() for image in images)
    first, second = found.images["mc-mis:spp=4"], found.images["mc-mis:spp=4 (2)"]
    assert np.array_equal(first, second)


def test_samples_have_a_curve_that_ends_at_the_row(comparison):
    found, _ = comparison
    curve = found["results"][0]["curve"]
    assert [point["spp"] for point in curve] == [1, 4]
    assert curve[-1]["psnr_db"] == found["results"][0]["psnr_db"]
    assert curve[-1]["frame_s"] == found["results"][0]["frame_s"]
    assert [p["spp"] for p in found["results"][1]["curve"]] == [1, 4, 5]


def test_counts_are_of_one_frame(comparison):
    row = comparison[0]["results"][1]
    assert row["rays_traced"] == 100
    assert row["evaluations"] == 7
    assert row["visibility_bytes"] == 96


def test_the_package_is_callable_as_the_function_that_it_is_named_after():
    import sys

    with pytest.raises(ValueError, match="seed"):
        sys.modules["jaxvis.compare"](seed=-1)


def test_frame(comparison):
    frame = comparison[0].to_frame()
    assert list(frame["label"]) == ["mc-mis:spp=4", "Grey", "mc-mis:spp=4 (2)"]
    assert "spp=4" in frame["parameters"][0]
    assert frame["psnr_db"].dtype == float


def test_an_exact_method_has_null_psnr_and_infinite_in_the_frame(scene, sky):
    found = compare(scene, sky, [Reference()], SIZE, reference=Reference())
    assert found["results"][0]["psnr_db"] is None
    assert found["results"][0]["rmse"] == 0.0
    assert found["results"][0]["label"] == "reference (2)"
    assert found.to_frame()["psnr_db"][0] == float("inf")
    json.dumps(found, allow_nan=False)


def test_the_seed_changes_noise_and_nothing_else(scene, sky, comparison):
    exact = {"reference": "reference"}
    again = compare(scene, sky, ["mc-mis:spp=4"], SIZE, seed=3, **exact)
    other = compare(scene, sky, ["mc-mis:spp=4"], SIZE, seed=4, **exact)
    image = comparison[0].images["mc-mis:spp=4"]
    assert np.array_equal(again.images["mc-mis:spp=4"], image)
    assert not np.array_equal(other.images["mc-mis:spp=4"], image)
    assert np.array_equal(other.images["reference"], again.images["reference"])


def test_the_reference_is_cached_until_something_it_shows_changes(scene, sky):
    def cached(*args, **settings) -> bool:
        settings = {"reference": "reference", **settings}
        return compare(*args, [Grey(spp=1)], SIZE, **settings)["reference"]["from_cache"]

    brighter = sky.scale(1.5)
    assert not cached(scene, brighter)
    assert cached(scene, brighter)
    assert not cached(scene, brighter.scale(2.0))
    assert not cached(scene, brighter, reflectance="phong")
    assert not cached(scene, brighter, supersampling=2)
    assert not cached(scene, brighter, camera=Camera((0.0, 2.0, 4.0), (0.0, 0.0, 0.0)))
    assert not cached(scene, brighter, reference="reference:subdivision=2")
    lamps = [SphereLights.of([(0.0, y, 0.0)], [0.1], [(9.0,) * 3]) for y in (1.0, 2.0)]
    assert not cached(scene, brighter, spheres=lamps[0])
    assert not cached(scene, brighter, spheres=lamps[1])
    assert cached(scene, brighter.with_spheres(lamps[0]))
    assert cached(scene, brighter)


@pytest.mark.parametrize(
    ("trouble", "error"),
    [
        ("refuses", "the mesh is not manifold"),
        ("crashes", "IndexError: list index out of range"),
        ("nan", "the radiance of 120 pixels is not finite"),
    ],
)
def test_a_method_that_fails_is_a_row(scene, sky, trouble, error):
    found = compare(scene, sky, [Grey(trouble=trouble), Grey()], SIZE, reference="reference")
    failed, good = found["results"]
    assert failed["error"] == error
    assert failed["psnr_db"] is None
    assert failed["image"] is None
    assert "error" not in good
    assert found.failed == [failed]
    json.dumps(found, allow_nan=False)
    with pytest.raises((ValueError, IndexError), match=error.rpartition(": ")[2].split()[0]):
        compare(
            scene, sky, [Grey(trouble=trouble)], SIZE, reference="reference", stop_on_error=True
        )


def test_warnings_become_notes_and_are_still_raised(scene, sky):
    with pytest.warns(JaxvisWarning, match="3 faces were ignored"):
        found = compare(scene, sky, [Grey(trouble="warns")], SIZE, reference="reference")
    assert found["results"][0]["notes"] == ["3 faces were ignored"]


@pytest.mark.parametrize(
    ("settings", "match"),
    [
        ({"size": (0, 4)}, "size: width must be at least 1, got 0"),
        ({"size": (4,)}, "size must be width and height"),
        ({"seed": -1}, "seed must be at least 0"),
        ({"spp": 0}, "spp must be at least 1"),
        ({"supersampling": 0}, "supersampling must be at least 1"),
        ({"rotate": float("nan")}, "rotate must be finite"),
        ({"exposure": -1.0}, "exposure must be positive"),
        ({"methods": "mc-miss"}, "mc-mis"),
        ({"methods": []}, "no methods given"),
        ({"reflectance": "velvet"}, "velvet"),
        ({"camera": Camera((0.0, 1.0, 4.0), (0.0, 9.0, 4.1))}, "no pixel sees the scene 'floor'"),
    ],
)
def test_bad_settings_are_refused_and_leave_no_folder(scene, sky, tmp_path, settings, match):
    out = tmp_path / "deep" / "out"
    with pytest.raises((ValueError, TypeError), match=match):
        compare(scene, sky, **{"methods": [Grey()], "size": SIZE, "out": out, **settings})
    assert not list(tmp_path.iterdir())


def test_spp_sets_what_the_name_leaves_open():
    chosen = choose_methods("mc-mis,mc-brdf:spp=3", 7)
    assert {label: method.spp for label, method in chosen.items()} == {
        "mc-mis": 7,
        "mc-brdf:spp=3": 3,
    }


def test_default_methods_are_the_representatives():
    assert list(choose_methods(None, None)) == list(methods.representatives())


def test_labels_of_objects_say_what_differs_from_the_defaults():
    made = methods.create("mc-mis:spp=3")
    assert list(choose_methods([made, methods.create("mc-brdf")], None)) == [
        "mc-mis:spp=3",
        "mc-brdf",
    ]


def test_one_line():
    assert one_line(ValueError("a\n  b")) == "a b"
    assert one_line(KeyError("x")) == "KeyError: 'x'"
    assert one_line(MemoryError()) == "MemoryError"


def test_folders_are_cut_from_what_is_published():
    text = "/home/me/.cache/x-1.npz: damaged, 3/4 of a/b at 2 W/m2 ('/a/b.obj')"
    assert without_folders(text) == "x-1.npz: damaged, 3/4 of a/b at 2 W/m2 ('b.obj')"


def test_a_mended_light_is_noted_without_its_folder(scene, tmp_path):
    pixels = np.ones((8, 16, 3), np.float32)
    pixels[0, 0] = -1e-7
    write_image(tmp_path / "light.exr", pixels)
    with pytest.warns(JaxvisWarning, match="negative"):
        found = compare(scene, tmp_path / "light.exr", [Grey()], SIZE, reference="reference")
    (note,) = found["notes"]
    assert note.startswith("light.exr: ")


def test_render_exposes_its_own_image(scene, sky):
    setting = prepare(scene, sky, SIZE)
    picture = render(Grey(0.25), setting)
    covered = setting.covered
    assert np.allclose(picture.radiance[covered], 0.25)
    assert np.allclose(picture.shown[setting.coverage == 1.0], 1.0, atol=1e-5)
    given = render(Grey(0.25), setting, exposure=2.0)
    assert np.allclose(given.shown[setting.coverage == 1.0], 0.7353569, atol=1e-5)
