"""The suffix +denoise: a method's own verbs, less noise, and names."""

import sys
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis import cli, methods
from jaxvis.compare import compare
from jaxvis.image.denoise import denoise
from jaxvis.methods import Denoised, ImportanceDriven, MonteCarlo, Reference
from jaxvis.methods.denoised import continued
from jaxvis.scene import trace_surface
from tests.methods.known_scenes import MATERIALS, SCENES, KnownScene, contrasted, uniform_light

BALL = KnownScene("sphere-on-plane", SCENES[3].camera, (48, 40))


def images(*made, environment=None, seed=0):
    """One image by each method."""
    environment = contrasted() if environment is None else environment
    scene, surface = BALL.load(), BALL.surface(*MATERIALS["diffuse"])
    return [
        np.asarray(
            method.shade(
                method.precompute(scene),
                method.light(environment),
                surface,
                key=jax.random.key(seed),
            )
        )
        for method in made
    ]


def test_the_suffix_makes_a_denoised_method():
    assert methods.create("mc-mis+denoise") == Denoised(MonteCarlo("mis"))
    assert methods.create("mc-mis+denoise:spp=8") == Denoised(MonteCarlo("mis", 8))
    assert methods.create("mc-brdf+denoise", spp=4) == Denoised(MonteCarlo("brdf", 4))
    made = methods.create("mc-ides+denoise:spp=2,paths=64")
    assert made == Denoised(ImportanceDriven(2, paths=64))
    assert made.parameters() == {**ImportanceDriven(2, paths=64).parameters(), "denoise": True}
    for name in methods.names():
        if name.startswith("mc-"):
            assert methods.create(f"{name}+denoise").stochastic
    assert methods.parse_list("mc-mis+denoise:spp=4,compensation=true,mc-ides+denoise") == [
        "mc-mis+denoise:spp=4,compensation=true",
        "mc-ides+denoise",
    ]


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("mc-mi+denoise", r"unknown method 'mc-mi': did you mean mc-mis"),
        ("mc-mis+denoise:ssp=3", "method 'mc-mis' has no parameter 'ssp'"),
        ("mc-mis+denoise:spp=0", "spp must be at least 1, got 0"),
        ("mc-mis+denoised", r"unknown method 'mc-mis\+denoised'"),
        ("mc-mis+denoise+denoise", "denoised already"),
        ("reference+denoise", r"Reference has no noise to remove: \+denoise is for methods that"),
        ("vectorized+denoise", "has no noise to remove"),
    ],
)
def test_a_wrong_spec_says_what_is_wrong(spec, message):
    with pytest.raises(ValueError, match=message):
        methods.create(spec)


@pytest.mark.parametrize("inner", [MonteCarlo("mis", 8), ImportanceDriven(8, paths=2048)], ids=str)
def test_noise_goes(inner):
    truth, noisy, clean = images(Reference(subdivision=8), inner, Denoised(inner))
    mask = np.asarray(BALL.surface(*MATERIALS["diffuse"]).mask)
    error = [np.sqrt(np.mean(np.square(image - truth)[mask])) for image in (noisy, clean)]
    assert error[1] < 0.5 * error[0]
    assert clean.shape == truth.shape
    assert np.all(np.isfinite(clean))
    np.testing.assert_array_equal(clean[~mask], 0.0)


def test_the_same_key_gives_the_same_bits():
    method = Denoised(MonteCarlo("mis", 2))
    first, again = images(method, method)
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, images(method, seed=1)[0])


def test_an_even_plane_stays_even():
    """Uniform light on an open diffuse plane: no noise, and the denoiser adds none."""
    plane, method = SCENES[0], Denoised(MonteCarlo("brdf", 2))
    surface = plane.surface(*MATERIALS["diffuse"])
    visibility, light = method.precompute(plane.load()), method.light(uniform_light())
    image = method.shade(visibility, light, surface, key=jax.random.key(0))
    found = np.asarray(image)[np.asarray(surface.mask)]
    np.testing.assert_allclose(found, np.broadcast_to([0.8, 0.6, 0.4], found.shape), rtol=0.02)


def test_supersampled_views_and_empty_ones():
    scene = BALL.with_material(*MATERIALS["diffuse"])
    method = Denoised(MonteCarlo("mis", 2))
    visibility, light = method.precompute(scene), method.light(contrasted())
    fine = trace_surface(scene, BALL.camera, (18, 14), supersampling=2)
    image = method.shade(visibility, light, fine, key=jax.random.key(0))
    assert image.shape == (14, 18, 3)
    assert method.evaluations(visibility, light, fine) == 2 * int(fine.mask.sum())
    nothing = replace(fine, mask=jnp.zeros_like(fine.mask))
    empty = method.shade(visibility, light, nothing, key=jax.random.key(0))
    np.testing.assert_array_equal(empty, 0.0)


def test_compare_runs_it_with_its_curve(own_caches):
    outcome = compare(
        "sphere-on-plane",
        "windows",
        ["mc-mis:spp=4", "mc-mis+denoise:spp=4", Denoised(MonteCarlo("brdf", 2))],
        (32, 24),
        stop_on_error=True,
        progress=False,
    )
    plain, denoised, other = outcome["results"]
    assert denoised["method"] == "mc-mis+denoise"
    assert other["label"] == "mc-brdf+denoise:spp=2"
    assert denoised["parameters"] == {**plain["parameters"], "denoise": True}
    assert denoised["psnr_db"] > plain["psnr_db"] + 1.0
    assert [point["spp"] for point in denoised["curve"]] == [1, 4]
    assert denoised["rays_traced"] == plain["rays_traced"] > 0


def test_without_the_extra_one_line_says_how_to_get_it(monkeypatch, capsys, tmp_path):
    monkeypatch.setitem(sys.modules, "pyoidn", None)
    with pytest.raises(ValueError, match=r'pip install "jaxvis\[denoise\]"$'):
        methods.create("mc-mis+denoise")
    assert methods.create("mc-mis")
    assert cli.main(["render", "mc-mis+denoise", "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert 'pip install "jaxvis[denoise]"' in said


def test_the_listing_tells_of_the_suffix(capsys):
    assert cli.main(["methods"]) == 0
    assert "+denoise" in capsys.readouterr().out


def test_continued_images_are_those_of_the_nearest_pixel_that_sees_the_scene():
    image = np.arange(12.0, dtype=np.float32).reshape(1, 4, 3)
    covered = np.array([[False, True, False, False]])
    np.testing.assert_array_equal(continued(image, covered), np.tile(image[:, 1:2], (1, 4, 1)))
    np.testing.assert_array_equal(continued(image, np.ones((1, 4), bool)), image)


def test_the_black_beside_an_outline_does_not_darken_it():
    y, x = np.mgrid[:64, :64] - 31.5
    covered = x * x + y * y < 24.0**2
    rng = np.random.default_rng(0)
    noise = rng.exponential(0.8, (64, 64, 1)) * np.ones(3)
    flat = [noise, np.full((64, 64, 3), 0.8), np.broadcast_to([0.0, 0.0, 1.0], (64, 64, 3))]
    plain = [np.where(covered[..., None], image, 0.0).astype(np.float32) for image in flat]
    rim = covered & (x * x + y * y > 22.0**2)

    def at_rim(images):
        return float(denoise(*images)[rim].mean())

    assert at_rim(continued(image, covered) for image in plain) == pytest.approx(0.8, rel=0.1)
    assert at_rim(plain) < 0.7  # negative control
