"""What holds for every model: reciprocity, energy, samples that follow their density."""

from functools import lru_cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.stats import chi2

from jaxvis.reflectance import (
    BlinnPhong,
    CookTorrance,
    Lambert,
    MaterialValues,
    Phong,
    reflectance_by_name,
)

RECIPROCAL = [Lambert(), Phong(), BlinnPhong(), CookTorrance("ggx"), CookTorrance("beckmann")]
MODELS = [*RECIPROCAL, Phong(foreshortened=False)]
GLOSSY = MODELS[1:]
NORMAL = np.array([2.0, -1.0, 2.0], np.float32) / 3.0


def named(models):
    return {"argvalues": models, "ids": [str(model) for model in models]}


@partial(jax.jit, static_argnames="model")
def jitted_evaluate(model, material, normal, view, light):
    return model.evaluate_and_pdf(material, normal, view, light)


@partial(jax.jit, static_argnames="model")
def jitted_sample(model, material, normal, view, uniforms):
    return model.sample(material, normal, view, uniforms)


def evaluate(model, material, view, light):
    """Value and density about NORMAL, compiled for few shapes."""
    view, light = np.broadcast_arrays(view, light)
    return jitted_evaluate(model, material, NORMAL, view, light)


def sample(model, material, view, uniforms):
    return jitted_sample(model, material, NORMAL, np.broadcast_to(view, uniforms.shape), uniforms)


def material(base, specular, roughness):
    base, specular = (np.broadcast_to(np.float32(c), (3,)) for c in (base, specular))
    return MaterialValues(jnp.asarray(base), jnp.asarray(specular), jnp.float32(roughness))


def orthonormal(axis):
    """Two unit vectors that complete ``axis``."""
    first = np.cross(axis, [0.0, 0.0, 1.0] if abs(axis[2]) < 0.9 else [1.0, 0.0, 0.0])
    first /= np.linalg.norm(first)
    return first, np.cross(axis, first)


def view_at(cosine):
    """Direction at this cosine from the normal."""
    first, _ = orthonormal(NORMAL)
    return (cosine * NORMAL + np.sqrt(1.0 - cosine**2) * first).astype(np.float32)


def polar(axis, theta, phi):
    """Float32 directions at angles ``theta`` from ``axis`` and ``phi`` about it."""
    first, second = orthonormal(axis.astype(np.float64))
    local = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta) + 0.0 * phi
    world = sum(c[..., None] * e for c, e in zip(local, (first, second, axis), strict=True))
    return world.astype(np.float32)


def angles(axis, directions):
    """(theta, phi) of directions in :func:`polar`'s coordinates."""
    first, second = orthonormal(axis.astype(np.float64))
    x, y, z = (directions.astype(np.float64) @ e for e in (first, second, axis))
    return np.arctan2(np.hypot(x, y), z), np.mod(np.arctan2(y, x), 2.0 * np.pi)


@lru_cache
def sphere_quadrature(cosine):
    """Directions [200, 200, 3] and weights [200, 200] that add up to 4 pi.

    Dense about the mirror image of the view at ``cosine``, theta = pi t^3, in two panels that meet
    at pi / 2; 500 sectors, because lobes at grazing angles are narrow across.
    """
    node, weight = np.polynomial.legendre.leggauss(40)
    edges = np.array([0.0, 0.5 ** (1 / 3), 1.0])
    half = 0.5 * np.diff(edges)[:, None]
    t, weight = (edges[:-1, None] + half * (1.0 + node)).ravel(), (half * weight).ravel()
    phi = 2.0 * np.pi * (np.arange(500) + 0.5) / 500
    directions = polar(mirror(view_at(cosine)), np.pi * t[:, None] ** 3, phi[None, :])
    weight = weight * 3.0 * np.pi * t**2 * np.sin(np.pi * t**3) * 2.0 * np.pi / 500
    return directions.reshape(200, 200, 3), np.repeat(weight, 500).reshape(200, 200)


def mirror(view):
    """Mirror image of ``view`` about the normal."""
    return (2.0 * np.dot(NORMAL, view) * NORMAL - view).astype(np.float32)


def albedo(model, surface, cosine):
    """Share of the light from the direction at ``cosine`` that is reflected, by quadrature."""
    lights, weights = sphere_quadrature(cosine)
    value, _ = evaluate(model, surface, view_at(cosine), lights)
    return np.einsum("ij,ijc->c", weights, np.asarray(value, np.float64))


def random_directions(generator):
    """Unit vectors [200, 200, 3]."""
    directions = generator.normal(size=(200, 200, 3))
    return (directions / np.linalg.norm(directions, axis=-1, keepdims=True)).astype(np.float32)


def test_the_quadrature_integrates_the_sphere():
    directions, weights = sphere_quadrature(0.4)
    assert weights.sum() == pytest.approx(4.0 * np.pi, rel=1e-6)
    cosines = np.maximum(directions @ NORMAL, 0.0)
    assert (weights * cosines).sum() == pytest.approx(np.pi, rel=1e-3)


@pytest.mark.parametrize("model", **named(RECIPROCAL))
@pytest.mark.parametrize("roughness", [0.15, 0.5, 1.0])
def test_reciprocity(model, roughness):
    generator = np.random.default_rng(3)
    view, light = (random_directions(generator) for _ in range(2))
    cos_view, cos_light = view @ NORMAL, light @ NORMAL
    surface = material([0.3, 0.5, 0.1], [0.2, 0.04, 0.5], roughness)
    forward = np.asarray(evaluate(model, surface, view, light)[0])
    backward = np.asarray(evaluate(model, surface, light, view)[0])
    up = (cos_view > 0.02) & (cos_light > 0.02)
    assert up.sum() > 50
    np.testing.assert_allclose(
        forward[up] / cos_light[up, None], backward[up] / cos_view[up, None], rtol=1e-3, atol=1e-6
    )


def test_the_form_without_foreshortening_is_not_reciprocal():
    surface, model = material(0.0, 0.5, 0.5), Phong(foreshortened=False)
    view, light = view_at(0.9), view_at(0.5)
    forward = evaluate(model, surface, view, light)[0][0] / 0.5
    backward = evaluate(model, surface, light, view)[0][0] / 0.9
    assert abs(forward / backward - 1.0) > 0.5


@pytest.mark.parametrize("model", **named(MODELS))
@pytest.mark.parametrize("cosine", [1.0, 0.8, 0.6, 0.4, 0.2, 0.05])
def test_energy_is_conserved(model, cosine):
    # Facets take their share from the base themselves, up to 0.5 % (they turn towards the view,
    # and reflect more there than the mean surface); elsewhere the colours must add up to 1.
    whole = isinstance(model, CookTorrance)
    limit = 1.0 + (5e-3 if whole else 1e-3)
    for specular in (0.01, 0.04, 0.5, 1.0):
        for roughness in (0.1, 0.3, 0.5, 0.7, 1.0):
            surface = material(1.0 if whole else 1.0 - specular, specular, roughness)
            assert albedo(model, surface, cosine).max() <= limit, (specular, roughness)


@pytest.mark.parametrize("model", **named(MODELS))
def test_nothing_below_the_horizon(model):
    generator = np.random.default_rng(10)
    view, light = (random_directions(generator) for _ in range(2))
    surface = material(0.5, 0.5, 0.6)
    value, _ = evaluate(model, surface, view, light)
    above = (view @ NORMAL > 1e-6) & (light @ NORMAL > 1e-6)
    below = (view @ NORMAL < -1e-6) | (light @ NORMAL < -1e-6)
    assert np.all(np.asarray(value)[above] > 0.0)
    np.testing.assert_array_equal(np.asarray(value)[below], 0.0)

    up = np.array([0.0, 0.0, 1.0], np.float32)
    level, oblique = (
        np.broadcast_to(np.float32(x), light.shape) for x in ([1, 0, 0], [0.6, 0, 0.8])
    )
    for view, light in ((level, oblique), (oblique, level)):
        np.testing.assert_array_equal(jitted_evaluate(model, surface, up, view, light)[0], 0.0)


@pytest.mark.parametrize("model", **named(GLOSSY))
def test_black_specular_is_exactly_lambert(model):
    generator = np.random.default_rng(4)
    view, light = (random_directions(generator) for _ in range(2))
    uniforms = generator.uniform(size=(200, 200, 3)).astype(np.float32)
    surface = material([0.3, 0.9, 0.0], 0.0, 0.4)
    value, pdf = evaluate(model, surface, view, light)
    expected, expected_pdf = evaluate(Lambert(), surface, view, light)
    np.testing.assert_allclose(value, expected, rtol=1e-6)
    np.testing.assert_allclose(pdf, expected_pdf, rtol=1e-6)
    np.testing.assert_allclose(
        sample(model, surface, view, uniforms),
        sample(Lambert(), surface, view, uniforms),
        atol=3e-7,  # compiled on its own, the same sum may round differently
    )


def samples(model, surface, view, batches):
    """Light directions [40000 batches, 3]."""
    generator = np.random.default_rng(6)
    uniforms = generator.uniform(size=(batches, 200, 200, 3)).astype(np.float32)
    drawn = [sample(model, surface, view, batch) for batch in uniforms]
    return np.stack(drawn).reshape(-1, 3)


@pytest.mark.parametrize("model", **named(GLOSSY))
def test_black_base_samples_the_lobe_alone(model):
    surface, view = material(0.0, 0.5, 0.1), view_at(0.7)
    lights = samples(model, surface, view, 1)
    assert np.median(lights @ mirror(view)) > 0.999
    assert evaluate(model, surface, view, view_at(0.9))[1] < 1e-2 / np.pi


def test_lobes_are_chosen_by_luminance():
    surface = material([0.6, 0.3, 0.4], [0.1, 0.5, 0.2], 0.5)
    specular, base = (
        0.2126 * r + 0.7152 * g + 0.0722 * b for r, g, b in ((0.1, 0.5, 0.2), (0.6, 0.3, 0.4))
    )
    share = specular / (specular + base)
    for model in (Phong(), BlinnPhong()):
        assert model.specular_share(surface, jnp.float32(0.3)) == pytest.approx(share, rel=1e-5)
    # Facets reflect more at grazing angles: there nearly all samples are theirs.
    assert CookTorrance().specular_share(surface, jnp.float32(0.01)) > 0.9


@pytest.mark.parametrize("model", **named(MODELS))
def test_an_all_black_material_samples_the_cosine(model):
    lights, _ = sphere_quadrature(0.6)
    density = evaluate(model, material(0.0, 0.0, 0.5), view_at(0.6), lights)[1]
    np.testing.assert_allclose(density, np.maximum(lights @ NORMAL, 0.0) / np.pi, atol=1e-6)


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


@partial(jax.jit, static_argnames="model")
def gradients(model, *arguments):
    """Of the sum of all values and densities, by material, normal, view and light."""

    def total(*arguments):
        value, pdf = model.evaluate_and_pdf(*arguments)
        return value.sum() + pdf.sum()

    return jax.grad(total, argnums=(0, 1, 2, 3))(*arguments)


@pytest.mark.parametrize("model", **named(RECIPROCAL))
def test_gradients_match_finite_differences(model):
    generator = np.random.default_rng(11)
    view = np.array([view_at(cosine) for cosine in np.linspace(0.4, 0.9, 8)])
    light = (2.0 * (view @ NORMAL)[:, None] * NORMAL - view) + 0.15 * generator.normal(size=(8, 3))
    light /= np.linalg.norm(light, axis=-1, keepdims=True)
    assert np.all(light @ NORMAL > 0.05)
    colours = generator.uniform(0.1, 0.5, (2, 8, 3))
    surface = MaterialValues(*jnp.asarray(colours, jnp.float32), jnp.linspace(0.4, 0.9, 8))
    at = surface, *(jnp.asarray(x, jnp.float32) for x in (np.tile(NORMAL, (8, 1)), view, light))
    leaves, structure = jax.tree.flatten(at)
    step = 4e-3

    def points(leaves):
        value, pdf = jitted_evaluate(model, *jax.tree.unflatten(structure, leaves))
        return np.asarray(value).sum(axis=-1) + np.asarray(pdf)

    for k, gradient in enumerate(jax.tree.leaves(gradients(model, *at))):
        for component in [...] if gradient.ndim == 1 else [(..., c) for c in range(3)]:
            moved = [leaves[k].at[component].add(sign * step) for sign in (1.0, -1.0)]
            up, down = (points([*leaves[:k], leaf, *leaves[k + 1 :]]) for leaf in moved)
            np.testing.assert_allclose(
                gradient[component], (up - down) / (2.0 * step), rtol=3e-2, atol=1e-2
            )


def unit(vectors):
    """Eight unit vectors, exactly along an axis or nearly so, or anywhere."""
    vectors = np.where(np.linalg.norm(vectors, axis=1, keepdims=True) < 1e-6, [0, 0, 1], vectors)
    return (vectors / np.linalg.norm(vectors, axis=1, keepdims=True)).astype(np.float32)


COMPONENTS = st.one_of(
    st.sampled_from([0.0, 1.0, -1.0, 1e-7, -1e-7, 1e-20, 0.5]), st.floats(-1.0, 1.0)
)
DIRECTIONS = arrays(np.float64, (8, 3), elements=COMPONENTS).map(unit)
NUMBERS = st.one_of(st.sampled_from([0.0, 1.0, 1e-20, 1e-6]), st.floats(0.0, 1.0, width=32))


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    normal=DIRECTIONS,
    view=DIRECTIONS,
    light=DIRECTIONS,
    numbers=arrays(np.float32, (8, 4), elements=NUMBERS),
    view_is=st.sampled_from(["anywhere", "normal", "below"]),
    light_is=st.sampled_from(["anywhere", "view", "opposite", "upright facet"]),
)
def test_everything_is_finite_everywhere(normal, view, light, numbers, view_is, light_is):
    view = {"anywhere": view, "normal": normal, "below": -normal}[view_is]
    upright = view - 2.0 * np.sum(normal * view, axis=-1, keepdims=True) * normal
    light = {"anywhere": light, "view": view, "opposite": -view, "upright facet": upright}[light_is]
    surface = MaterialValues(
        jnp.asarray(numbers[:, :1] * np.ones(3, np.float32)),
        jnp.asarray(numbers[:, 1:2] * np.float32([1, 0.5, 0])),
        jnp.asarray(numbers[:, 2]),
    )
    below_one = np.nextafter(np.float32(1.0), np.float32(0.0))
    uniforms = np.minimum(numbers[:, [3, 0, 1]], below_one)
    for model in RECIPROCAL:
        lights = jitted_sample(model, surface, normal, view, uniforms)
        np.testing.assert_allclose(np.linalg.norm(lights, axis=-1), 1.0, atol=1e-4)
        for result in jitted_evaluate(model, surface, normal, view, light):
            assert np.all(np.isfinite(result)), model
            assert np.all(result >= 0.0), model
        for gradient in jax.tree.leaves(gradients(model, surface, normal, view, light)):
            assert np.all(np.isfinite(gradient)), model


@pytest.mark.parametrize("model", **named([Lambert(), BlinnPhong(), CookTorrance("ggx")]))
def test_arguments_broadcast_and_vmap(model):
    generator = np.random.default_rng(8)
    view = np.stack([view_at(0.9), view_at(0.4)])[:, None]
    light = random_directions(generator)[:2, :3]
    colours = jnp.asarray(generator.uniform(0.0, 0.5, (2, 2, 1, 3)), jnp.float32)
    surface = MaterialValues(*colours, jnp.float32([[0.3], [0.8]]))
    value, pdf = jitted_evaluate(model, surface, NORMAL, view, light)
    assert value.shape == (2, 3, 3)
    assert pdf.shape == (2, 3)
    assert jitted_sample(model, surface, NORMAL, view, light * 0.0 + 0.5).shape == (2, 3, 3)

    def one(surface, view, light):
        return model.evaluate_and_pdf(surface, jnp.asarray(NORMAL), view, light)

    # A material without points, one view and three lights, mapped over the two points.
    squeezed = MaterialValues(*colours[:, :, 0], surface.roughness[:, 0])
    mapped, mapped_pdf = jax.jit(jax.vmap(one))(squeezed, view[:, 0], light)
    np.testing.assert_allclose(mapped, value, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(mapped_pdf, pdf, rtol=1e-4, atol=1e-6)


def test_evaluate_and_pdf_are_the_parts_of_evaluate_and_pdf():
    arguments = material(0.3, 0.5, 0.6), *map(jnp.asarray, (NORMAL, view_at(0.4), view_at(0.8)))

    def parts(*arguments):
        model = BlinnPhong()
        both = model.evaluate_and_pdf(*arguments)
        return both, (model.evaluate(*arguments), model.pdf(*arguments))

    (value, pdf), (evaluated, density) = jax.jit(parts)(*arguments)
    np.testing.assert_array_equal(evaluated, value)
    np.testing.assert_array_equal(density, pdf)
    assert value.shape == (3,)
    assert pdf.shape == ()


@pytest.mark.parametrize(
    ("name", "model"),
    list(zip(["lambert", "phong", "blinn-phong", "ggx", "beckmann"], RECIPROCAL, strict=True)),
)
def test_models_by_name(name, model):
    assert reflectance_by_name(name) == model
    assert hash(reflectance_by_name(name)) == hash(model)


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(ValueError, match="no reflectance 'mirror': use one of lambert, phong, bl"):
        reflectance_by_name("mirror")
