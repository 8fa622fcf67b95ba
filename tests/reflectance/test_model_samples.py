"""Samples of every model follow their density."""

import numpy as np
import pytest
from scipy.stats import chi2

from tests.reflectance.model_cases import (
    GLOSSY,
    MODELS,
    NORMAL,
    albedo,
    angles,
    evaluate,
    material,
    mirror,
    named,
    polar,
    samples,
    view_at,
)

pytestmark = pytest.mark.usefixtures("optimised")


def bin_masses(model, surface, view, axis, theta, phi, order):
    """The density's integral over each bin between the edges ``theta``, ``phi`` about ``axis``.

    Gauss-Legendre of ``order`` in phi and in the cube root of theta.
    """
    node, weight = np.polynomial.legendre.leggauss(order)

    def nodes(edges):
        half = 0.5 * np.diff(edges)[:, None]
        return (edges[:-1, None] + half * (1.0 + node)).ravel(), (half * weight).ravel()

    (root, root_weight), (phi, phi_weight) = nodes(np.cbrt(theta)), nodes(phi)
    directions = polar(axis, root[:, None] ** 3, phi[None, :])
    density = np.asarray(evaluate(model, surface, view, directions)[1], np.float64)
    mass = density * (root_weight * 3.0 * root**2 * np.sin(root**3))[:, None] * phi_weight
    return mass.reshape(len(root) // order, order, -1, order).sum(axis=(1, 3))


@pytest.mark.parametrize("model", **named(MODELS))
@pytest.mark.parametrize(
    ("roughness", "cosine", "about"),
    [
        (0.1, 0.8, "mirror"),
        (0.35, 0.9, "mirror"),
        (0.35, 0.1, "normal"),
        (0.7, 0.6, "normal"),
        (0.8, 0.03, "normal"),
    ],
)
def test_samples_follow_their_density(model, roughness, cosine, about):
    count, bins = 40_000, 20
    surface, view = material([0.6, 0.3, 0.4], [0.5, 0.2, 0.1], roughness), view_at(cosine)
    lights = samples(model, surface, view, 2)
    np.testing.assert_allclose(np.linalg.norm(lights, axis=1), 1.0, atol=1e-5)

    # Half of the samples place the bins, so that they are fine where the density is; the other
    # half fills them. About the normal, the horizon is an edge and all below it is one more bin;
    # narrow lobes are binned about their axis, over the whole sphere.
    axis, last = (mirror(view), np.pi) if about == "mirror" else (NORMAL, 0.5 * np.pi)
    theta, phi = angles(axis, lights)
    quantiles = np.linspace(0.0, 1.0, bins + 1)[1:-1]
    inner = np.quantile(theta[:count][theta[:count] < last], quantiles)
    theta_edges = np.concatenate([[0.0], inner, [last]])
    phi_edges = np.concatenate([[0.0], np.quantile(phi[:count], quantiles), [2.0 * np.pi]])
    observed, _, _ = np.histogram2d(theta[count:], phi[count:], (theta_edges, phi_edges))
    masses = bin_masses(model, surface, view, axis, theta_edges, phi_edges, order=10)
    assert masses.sum() < 1.0 + 2e-3

    observed, expected = observed.ravel(), count * masses.ravel()
    full = expected >= 10.0
    observed = np.append(observed[full], count - observed[full].sum())
    expected = np.append(expected[full], count - expected[full].sum())
    kept = expected >= 10.0
    observed, expected = observed[kept], expected[kept]
    statistic = ((observed - expected) ** 2 / expected).sum()
    p = chi2.sf(statistic, len(expected) - 1)
    assert p > 1e-3 / (len(MODELS) * 5), (p, statistic, len(expected))


@pytest.mark.parametrize("model", **named(GLOSSY))
def test_the_density_integrates_to_one_over_the_sphere(model):
    # About -view: there lobes of facets have an integrable pole, and sin theta cancels it.
    surface, view = material(0.0, 0.5, 0.6), view_at(0.2)
    edges = np.linspace(0.0, 1.0, 41) * np.pi, np.linspace(0.0, 2.0, 41) * np.pi
    masses = bin_masses(model, surface, view, -view, *edges, order=5)
    assert masses.sum() == pytest.approx(1.0, abs=5e-3)


@pytest.mark.parametrize("model", **named(MODELS))
@pytest.mark.parametrize(("roughness", "cosine"), [(0.2, 0.9), (0.6, 0.3)])
def test_a_sampled_furnace_agrees_with_quadrature(model, roughness, cosine):
    surface, view = material([0.5, 0.2, 0.1], [0.1, 0.2, 0.5], roughness), view_at(cosine)
    lights = samples(model, surface, view, 1).reshape(200, 200, 3)
    value, pdf = (np.asarray(x, np.float64) for x in evaluate(model, surface, view, lights))
    estimates = (value / pdf[..., None]).reshape(-1, 3)
    spread = estimates.std(axis=0) / np.sqrt(len(estimates))
    expected = albedo(model, surface, cosine)
    assert np.all(np.abs(estimates.mean(axis=0) - expected) < 4.5 * spread + 2e-3)
    assert estimates.max() < 10.0  # no fireflies
