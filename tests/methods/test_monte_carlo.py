"""Every estimator is unbiased, reproducible, and better where theory says that it is."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.methods import MonteCarlo, Reference, traced
from jaxvis.methods.monte_carlo.method import compensated
from jaxvis.scene import trace_surface
from tests.methods.known_scenes import MATERIALS, SCENES, contrasted, uniform_light

ESTIMATORS = {
    "uniform": MonteCarlo("uniform"),
    "environment": MonteCarlo("environment"),
    "brdf": MonteCarlo("brdf"),
    "mis": MonteCarlo("mis"),
    "mis-odd": MonteCarlo("mis", spp=33),
    "mis-one": MonteCarlo("mis", spp=1),
    "mis-compensated": MonteCarlo("mis", compensation=True),
}
RENDERS = 16


def renders(method, scene, environment, surface, count=RENDERS):
    """``count`` independent images of the covered pixels [count, pixels, 3]."""
    visibility, light = method.precompute(scene), method.light(environment)
    images = [method.shade(visibility, light, surface, key=jax.random.key(i)) for i in range(count)]
    return np.stack(images)[:, np.asarray(surface.mask)].astype(np.float64)


def exact(scene, environment, surface, subdivision=12):
    method = Reference(subdivision=subdivision)
    image = method.shade(method.precompute(scene), method.light(environment), surface)
    return np.asarray(image, np.float64)[np.asarray(surface.mask)]


def standard_errors_apart(samples, truth):
    """How many standard errors the mean over renders and pixels is from the truth, per channel."""
    means = samples.mean(axis=1)
    return (means.mean(axis=0) - truth.mean(axis=0)) / (
        means.std(axis=0, ddof=1) / np.sqrt(len(means))
    )


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("known", SCENES, ids=lambda known: known.name)
def test_means_agree_with_the_reference(known, material):
    scene, surface = known.load(), known.surface(*MATERIALS[material])
    truth = exact(scene, contrasted(), surface, subdivision=8)
    for name, method in ESTIMATORS.items():
        samples = renders(method, scene, contrasted(), surface, count=10)
        assert np.all(np.isfinite(samples))
        apart = standard_errors_apart(samples, truth)
        assert np.all(np.abs(apart) < 4.0), f"{name}: {apart} standard errors"


def test_the_comparison_would_see_a_bias():
    """Negative control: light turned by one texel, or 3 % too bright, is told apart."""
    known = SCENES[2]
    scene, surface = known.load(), known.surface(*MATERIALS["diffuse"])
    samples = renders(ESTIMATORS["mis"], scene, contrasted(), surface)
    truth = exact(scene, contrasted(), surface)
    assert np.abs(standard_errors_apart(samples, 1.03 * truth)).max() > 4.0
    turned = exact(scene, contrasted().rotate(2.0 * np.pi / 16.0), surface)
    assert np.abs(standard_errors_apart(samples, turned)).max() > 4.0


@pytest.mark.parametrize("name", ESTIMATORS)
def test_the_same_key_gives_the_same_bits_for_any_chunk(name, monkeypatch):
    monkeypatch.setattr(traced, "RAYS_PER_BLOCK", 1 << 12)  # several blocks in a small image
    known = SCENES[3]
    scene, surface = known.load(), known.surface(*MATERIALS["ggx"])
    images = []
    for chunk in (1, 1 << 14, 1 << 20):
        method = MonteCarlo(
            ESTIMATORS[name].strategy,
            ESTIMATORS[name].spp,
            ESTIMATORS[name].compensation,
            rays_per_chunk=chunk,
        )
        visibility, light = method.precompute(scene), method.light(contrasted())
        images.append(method.shade(visibility, light, surface, key=jax.random.key(7)))
        other = method.shade(visibility, light, surface, key=jax.random.key(8))
        assert not np.array_equal(images[-1], other)
    for image in images[1:]:
        np.testing.assert_array_equal(image, images[0])


def test_a_key_is_required():
    known, method = SCENES[0], MonteCarlo()
    surface = known.surface(*MATERIALS["diffuse"])
    visibility, light = method.precompute(known.load()), method.light(contrasted())
    with pytest.raises(ValueError, match="needs key="):
        method.shade(visibility, light, surface)


def test_each_strategy_is_good_where_it_should_be():
    """Diffuse under a few bright texels: environment sampling beats BRDF sampling, MIS is close.
    Under uniform light cosine sampling of an open diffuse plane has no variance at all.
    """
    known = SCENES[2]
    scene, surface = known.load(), known.surface(*MATERIALS["diffuse"])
    deviation = {
        name: renders(ESTIMATORS[name], scene, contrasted(), surface, 8).std(axis=0).mean()
        for name in ("uniform", "environment", "brdf", "mis")
    }
    assert deviation["environment"] < 0.6 * deviation["brdf"]
    assert deviation["brdf"] < deviation["uniform"]
    assert deviation["mis"] < deviation["brdf"]
    plane = SCENES[0]
    flat = plane.surface(*MATERIALS["diffuse"])
    constant = renders(ESTIMATORS["brdf"], plane.load(), uniform_light(), flat, 2)
    np.testing.assert_allclose(
        constant, np.broadcast_to([0.8, 0.6, 0.4], constant.shape), rtol=1e-5
    )
    spread = renders(ESTIMATORS["uniform"], plane.load(), uniform_light(), flat, 4)
    assert spread.std() > 1e-2


def test_compensation_takes_the_mean_away_and_lowers_the_variance():
    luminance = np.asarray(contrasted().radiance, np.float64).mean(axis=-1)
    sharp = compensated(luminance)
    assert np.count_nonzero(sharp) < 8
    assert np.all(sharp <= luminance)
    flat = np.ones((4, 8))
    np.testing.assert_array_equal(compensated(flat), flat)
    known = SCENES[2]
    scene, surface = known.load(), known.surface(*MATERIALS["diffuse"])
    plain, better = (
        renders(ESTIMATORS[name], scene, contrasted(), surface, 12).var(axis=0).mean()
        for name in ("mis", "mis-compensated")
    )
    assert better < plain


def test_supersampling_averages_independent_rays():
    known = SCENES[2]
    scene = known.with_material(*MATERIALS["diffuse"])
    method = MonteCarlo(spp=4)
    visibility, light = method.precompute(scene), method.light(contrasted())
    fine = trace_surface(scene, known.camera, known.size, supersampling=3)
    image = method.shade(visibility, light, fine, key=jax.random.key(0))
    assert image.shape == (known.size[1], known.size[0], 3)
    truth = Reference(subdivision=8)
    expected = truth.shade(visibility, truth.light(contrasted()), fine)
    coarse = known.surface(*MATERIALS["diffuse"])
    noisy = method.shade(visibility, light, coarse, key=jax.random.key(0))
    flat = truth.shade(visibility, truth.light(contrasted()), coarse)
    assert float(jnp.std(image - expected)) < 0.5 * float(jnp.std(noisy - flat))
    assert method.evaluations(visibility, light, fine) == 4 * int(fine.mask.sum())
