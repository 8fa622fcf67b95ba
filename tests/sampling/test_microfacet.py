"""Normalisations of GGX and Beckmann, the furnace of visible normals, and their samplers."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.sampling import microfacet

from .chi_square import SIGNIFICANCE, p_value, zone_counts, zone_probabilities

pytestmark = pytest.mark.usefixtures("optimised")

COUNT = 100_000
MODELS = ["ggx", "beckmann"]
sample_normal = jax.jit(microfacet.sample_normal, static_argnames="model")
sample_visible_normal = jax.jit(microfacet.sample_visible_normal)


@pytest.fixture(scope="module")
def uniforms():
    return jax.random.uniform(jax.random.key(13), (COUNT, 2))


def exact_distribution(cosine, width, model):
    """Walter et al. 2007, eqs. 25 and 33, float64."""
    tangent_square = (1.0 - cosine**2) / cosine**2
    if model == "ggx":
        return width**2 / (np.pi * cosine**4 * (width**2 + tangent_square) ** 2)
    return np.exp(-tangent_square / width**2) / (np.pi * width**2 * cosine**4)


def quantiles(width, model, zones=12):
    """Cosines between which equally many sampled normals lie, ascending."""
    u = np.linspace(1.0, 0.0, zones + 1)
    with np.errstate(divide="ignore"):
        tangent_square = width**2 * (u / (1.0 - u) if model == "ggx" else -np.log1p(-u))
    return 1.0 / np.sqrt(1.0 + tangent_square)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("width", [0.01, 0.2, 1.0])
def test_distribution_is_the_formula(model, width):
    cosine = quantiles(width, model, 40)[1:-1].astype(np.float32)
    got = microfacet.distribution(jnp.asarray(cosine), width, model)
    tolerance = 1e-3 if width < 0.1 else 1e-5
    exact = exact_distribution(cosine.astype(np.float64), width, model)
    np.testing.assert_allclose(got, exact, rtol=tolerance)
    below = microfacet.distribution(jnp.array([0.0, -0.3]), width, model)
    np.testing.assert_array_equal(below, 0.0)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("width", [0.03, 0.3, 1.0])
def test_normals_follow_their_density(model, width, uniforms):
    normals = sample_normal(uniforms, width, model=model)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, atol=1e-6)
    edges = quantiles(width, model)
    counts = zone_counts(normals, edges, 8)

    def probabilities(width):
        return zone_probabilities(
            lambda d: microfacet.pdf_normal(jnp.asarray(d[..., 2]), width, model), edges, 8
        )

    right = probabilities(width)
    assert abs(right.sum() - 1.0) < 2e-3  # also: D cos integrates to 1
    assert p_value(counts, COUNT * right / right.sum()) > SIGNIFICANCE
    wrong = probabilities(1.1 * width)
    assert p_value(counts, COUNT * wrong / wrong.sum()) < SIGNIFICANCE


VIEWS = {
    "normal": [0.0, 0.0, 1.0],
    "oblique": [0.6, 0.48, 0.64],
    "grazing": [0.40, -0.9151, 0.05],
}


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("width", [0.1, 0.7])
def test_visible_normals_follow_their_density(view, width, uniforms):
    v = jnp.array(VIEWS[view], jnp.float32)
    normals = sample_visible_normal(uniforms, jnp.broadcast_to(v, (COUNT, 3)), width)
    # Facets at the very rim come from vectors that cancel to nothing.
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, atol=2e-5)
    assert np.asarray(normals @ v).min() > -1e-6
    edges = quantiles(width, "ggx")

    def probabilities(v):
        return zone_probabilities(
            lambda d: microfacet.pdf_visible_normal(
                jnp.asarray(d), jnp.broadcast_to(v, d.shape), width
            ),
            edges,
            8,
        )

    right = probabilities(v)
    assert abs(right.sum() - 1.0) < 5e-3
    counts = zone_counts(normals, edges, 8)
    assert p_value(counts, COUNT * right / right.sum()) > SIGNIFICANCE
    turned = probabilities(jnp.array([VIEWS[view][2], 0.0, 1.0]) / np.hypot(VIEWS[view][2], 1.0))
    assert p_value(counts, COUNT * turned / turned.sum()) < SIGNIFICANCE


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("width", [0.2, 0.8])
def test_masking_makes_the_visible_area_the_projected_area(model, width):
    """Heitz 2014, eq. 14: the integral of G1 max(v.h, 0) D over normals is cos(v)."""
    edges = quantiles(width, model, 24)
    for cosine in (1.0, 0.7, 0.2):
        v = jnp.array([np.sqrt(1.0 - cosine**2), 0.0, cosine], jnp.float32)
        masked = float(microfacet.masking(v[2:], width, model)[0])

        def visible(d, v=v, masked=masked):
            towards = np.maximum(d @ np.asarray(v), 0.0)
            return masked * towards * microfacet.distribution(jnp.asarray(d[..., 2]), width, model)

        assert abs(zone_probabilities(visible, edges, 16).sum() / cosine - 1.0) < 5e-3


@pytest.mark.parametrize("model", MODELS)
def test_masking_and_shadowing_agree(model):
    width = 0.4
    light, view = (
        jnp.asarray(np.random.default_rng(k).uniform(0.01, 1.0, 100), jnp.float32) for k in (0, 1)
    )
    both = microfacet.masking_shadowing(light, view, width, model)
    one, other = microfacet.masking(light, width, model), microfacet.masking(view, width, model)
    swapped = microfacet.masking_shadowing(view, light, width, model)
    np.testing.assert_allclose(both, swapped, rtol=1e-5)
    assert np.all(np.asarray(both) <= np.minimum(one, other) * (1 + 1e-5))
    assert np.all(np.asarray(both) >= np.asarray(one * other) * (1 - 1e-5))
    np.testing.assert_allclose(1.0 / both, 1.0 / one + 1.0 / other - 1.0, rtol=1e-4)
    overhead = microfacet.masking_shadowing(jnp.ones(1), view[:1], width, model)
    np.testing.assert_allclose(overhead, other[:1], rtol=1e-5)
    below = microfacet.masking_shadowing(
        jnp.array([-0.1, 0.5]), jnp.array([0.5, 0.0]), width, model
    )
    np.testing.assert_array_equal(below, 0.0)


def test_beckmann_masking_is_the_published_value():
    """Lambda from its definition: the mean height of slopes beyond the view's, by quadrature."""
    cosine, width = 0.3, 0.6
    cotangent = cosine / np.sqrt(1.0 - cosine**2)
    slopes = np.linspace(cotangent, 8.0, 400_001)
    density = np.exp(-((slopes / width) ** 2)) / (width * np.sqrt(np.pi))
    step = slopes[1] - slopes[0]
    integral = np.sum((slopes - cotangent) * density) * step / cotangent
    got = microfacet.masking(jnp.array([cosine]), width, "beckmann")[0]
    np.testing.assert_allclose(got, 1.0 / (1.0 + integral), rtol=1e-4)


@pytest.mark.parametrize("model", MODELS)
def test_gradients_are_finite_at_the_ends(model):
    light, view = jnp.meshgrid(*[jnp.array([-1.0, 0.0, 1e-30, 1e-8, 1e-6, 1e-5, 1e-3, 1.0])] * 2)

    def total(light, view, width):
        return sum(
            jnp.sum(values)
            for values in (
                microfacet.distribution(light, width, model),
                microfacet.masking(light, width, model),
                microfacet.pdf_normal(light, width, model),
                microfacet.masking_shadowing(light, view, width, model),
            )
        )

    gradients = jax.jit(jax.grad(total, (0, 1, 2)))
    for width in (0.01, 1.0):
        assert all(np.all(np.isfinite(g)) for g in gradients(light, view, width))


@pytest.mark.parametrize("model", MODELS)
def test_gradients_are_those_of_finite_differences(model):
    def total(p):
        return microfacet.distribution(p[0], p[1], model) + microfacet.masking_shadowing(
            p[0], p[2], p[1], model
        )

    point, step = np.array([0.8, 0.4, 0.3]), 1e-2
    got = jax.jit(jax.grad(total))(jnp.asarray(point, jnp.float32))

    def value(p):
        return total(jnp.asarray(p, jnp.float32))

    for k in range(3):
        ahead, behind = (point + s * step * np.eye(3)[k] for s in (1, -1))
        slope = (float(value(ahead)) - float(value(behind))) / (2 * step)
        np.testing.assert_allclose(got[k], slope, rtol=5e-3, atol=1e-3)


def test_visible_normals_of_views_at_the_horizon_are_finite(uniforms):
    views = jnp.array([[1.0, 0.0, 0.0], [0.0, 1.0, 1e-20], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    ends = jnp.array([[0.0, 0.0], [1.0 - 2.0**-24, 0.3], [0.5, 0.5], [2.0**-24, 0.9]])
    for width in (0.01, 1.0):
        normals = sample_visible_normal(ends[:, None, :], views[None], width)
        np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, atol=1e-6)
        assert np.all(np.asarray(normals[..., 2]) >= 0.0)
        density = microfacet.pdf_visible_normal(normals, views[None], width)
        assert np.all(np.isfinite(density))


def test_an_unknown_distribution_is_named():
    with pytest.raises((ValueError, TypeError), match="phong"):
        microfacet.distribution(jnp.ones(1), 0.5, "phong")
