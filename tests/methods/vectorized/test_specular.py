"""gamma: closed forms, sums over texels, and what the kernel's height is for."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.lighting import uniform, windows
from jaxvis.methods.vectorized import light as light_module
from jaxvis.methods.vectorized.light import PolygonLight
from jaxvis.methods.vectorized.lobes import PhongLobes
from jaxvis.methods.vectorized.specular import (
    Cap,
    cap_integral,
    circle_lookups,
    parts_in_cap,
    phong_cap,
    visible_ratio,
)
from jaxvis.sphere import latlong
from jaxvis.sphere.contours import integrate, trapezoid
from jaxvis.sphere.polygons import Directions, clamp_to_hemisphere, normalized
from tests.sphere.contour_oracle import circle, directions_of, star, unit, winding

HEIGHT = 128


def without_lobes(radiance):
    """The tables; blurring and lobes are not what is tested here."""
    tables = light_module._summed(radiance, radiance, times=1)
    return PolygonLight(*tables, PhongLobes(jnp.ones((8, 3)), (2,)), jnp.float32(0.0))


@pytest.fixture(scope="module")
def sky():
    return without_lobes(uniform(height=HEIGHT).radiance)


@pytest.fixture(scope="module")
def church():
    return without_lobes(windows(height=HEIGHT).radiance)


@partial(jax.jit, static_argnames="pieces")
def ratio_of(light, polygons, mirror, cap, pieces=2):
    part = trapezoid(HEIGHT, parts_in_cap(polygons, mirror, cap.rim, pieces), "bilinear")
    circles = circle_lookups(HEIGHT, mirror, cap.rim, "bilinear")
    visible, whole = (
        cap_integral(
            integrate(light.vector, lookups), integrate(light.scalar, lookups), mirror, cap.base
        )
        for lookups in (part, circles)
    )
    return visible_ratio(visible, whole, light)


def gamma(light, polygons: Directions, mirror, exponent=None, cap=None):
    """Always of sixteen polygons of 128 vectors, so that one program serves all tests."""
    count = polygons.x.shape[0]
    polygons = Directions(*(jnp.resize(axis, (16, 128)) for axis in polygons))
    mirror = np.resize(np.broadcast_to(mirror, (count, 3)), (16, 3))
    if cap is None:
        cap = phong_cap(jnp.full(16, exponent, jnp.float32))
    return ratio_of(light, polygons, jnp.asarray(mirror, jnp.float32), cap)[:count]


def test_the_kernel_has_the_lobe_s_mean():
    """By quadrature; below a = 1 the circle would be more than a hemisphere."""
    exponent = np.array([1.0, 2.0, 10.0, 40.0, 98.0, 120.0, 300.0, 3000.0, 19998.0])
    cap = phong_cap(jnp.asarray(exponent, jnp.float32))
    rim, base = np.asarray(cap.rim, np.float64), np.asarray(cap.base, np.float64)
    assert np.all(base <= rim + 1e-7)
    x = (1.0 - rim) * (np.arange(4000)[:, None] + 0.5) / 4000  # 1 - cos
    height = (1.0 - x) - base
    mean = (x * height).sum(axis=0) / height.sum(axis=0)
    np.testing.assert_allclose(mean, 1.0 / (exponent + 2.0), rtol=2e-3)
    np.testing.assert_allclose(rim[2:4], 1.0 - 3.0 / (exponent[2:4] + 2.0), rtol=1e-6)
    np.testing.assert_allclose(rim[:5], base[:5], atol=1e-7)  # the paper's Cap
    assert np.all(base[5:] < rim[5:])
    assert float(phong_cap(jnp.zeros(1)).rim[0]) == 0.0


def test_the_kernel_changes_smoothly_with_the_exponent():
    exponent = jnp.linspace(88.0, 108.0, 200)
    for values in phong_cap(exponent):
        assert np.abs(np.diff(values)).max() < 2.0 * np.abs(values[-1] - values[0]) / 50
    slopes = jax.vmap(jax.grad(lambda a: phong_cap(a[None]).rim[0]))
    assert np.all(np.isfinite(slopes(jnp.asarray([0.0, 1.0, 97.9, 98.0, 98.1, 2e4]))))


@pytest.mark.parametrize("exponent", [3.0, 40.0, 600.0])
def test_known_ratios_under_a_uniform_sky(sky, exponent):
    normal, mirror = unit([0.2, 0.9, -0.1]), unit([0.3, 0.9, 0.1])
    tangent = unit(np.cross(mirror, [0.3, 0.1, 0.9]))
    polygons = directions_of(
        circle(normal, np.pi / 2, 128),  # the whole hemisphere
        circle(tangent, np.pi / 2, 128),  # a half-space whose rim runs through the mirror direction
        circle(unit(normal - mirror * 0.99), 0.1, 128),  # wholly outside
        np.tile(normal, (128, 1)),  # nothing
    )
    # A rim that ran through the opposite direction, too, would be seen from both sides.
    ground = np.stack([normal, unit(mirror + 0.5 * tangent), normal, normal])
    above = normalized(clamp_to_hemisphere(polygons, jnp.float32(ground)))
    ratio = gamma(sky, above, mirror, exponent)
    expected = [1.0, 0.5, 0.0, 0.0]
    np.testing.assert_allclose(ratio[:, 0], expected, atol=0.012)


def test_one_bright_texel_decides():
    """gamma is 1 where it is visible and 0 where it is not, whatever else is."""
    texel = latlong.texel_directions(HEIGHT, 2 * HEIGHT)[40, 70]
    radiance = jnp.zeros((HEIGHT, 2 * HEIGHT, 3)).at[40, 70].set(1e4)
    mirror = unit(texel + [0.0, 0.05, 0.03])
    away = unit(mirror - texel)
    polygons = directions_of(circle(texel, 0.12, 128), circle(unit(mirror + 0.2 * away), 0.1, 128))
    ratio = gamma(without_lobes(radiance), polygons, mirror, 30.0)
    np.testing.assert_allclose(ratio[:, 0], [1.0, 0.0], atol=0.02)


def test_without_light_nothing_is_hidden():
    dark = without_lobes(jnp.zeros((HEIGHT, 2 * HEIGHT, 3)))
    ratio = gamma(dark, directions_of(circle([0, 1, 0], 0.5, 128)), unit([0.1, 1, 0]), 30.0)
    np.testing.assert_array_equal(ratio, 1.0)


def exact_gamma(radiance, polygon, mirror, exponent):
    """The lobe's visible share of luminance, by the winding of 4 places in each texel."""
    height = 2 * radiance.shape[0]
    light = np.asarray(radiance, np.float64) @ [0.2126, 0.7152, 0.0722]
    light = np.repeat(np.repeat(light, 2, 0), 2, 1)
    light *= latlong.row_solid_angles(height, 2 * height)[:, None]
    places = latlong.texel_directions(height, 2 * height).reshape(-1, 3)
    cosine = places @ mirror
    near = np.flatnonzero(cosine > 1e-4 ** (1.0 / exponent))
    weight = cosine[near] ** exponent * light.ravel()[near]
    # Most of the light lies in few places.
    order = np.argsort(weight)[::-1]
    order = order[: np.searchsorted(np.cumsum(weight[order]), 0.999 * weight.sum()) + 1]
    seen = winding(polygon, places[near[order]])
    return (weight[order] * seen).sum() / weight[order].sum()


@pytest.mark.parametrize(("exponent", "mean"), [(10.0, 0.05), (100.0, 0.09), (1000.0, 0.07)])
def test_ratios_under_hard_light_are_near_the_lobe_s(church, exponent, mean):
    """Mirror directions beside silhouettes, the worst there are: a window just outside the circle
    is in the lobe but not in gamma. Always 1/2 would be twice as
    far off.
    """
    rng, radiance = np.random.default_rng(3), windows(height=HEIGHT).radiance
    centres = unit(rng.normal(size=(16, 3)) * [1, 0, 1] + [0, 1.2, 0])
    polygons = [star(rng, centre, 128, 0.2, 1.2) for centre in centres]
    rims = np.stack([polygon[rng.integers(128)] for polygon in polygons])
    mirror = unit(rims + 0.5 / np.sqrt(exponent) * rng.normal(size=rims.shape))
    ratio = np.asarray(gamma(church, directions_of(*polygons), mirror, exponent))
    ratio = ratio @ [0.2126, 0.7152, 0.0722]  # the windows' light is nearly grey
    pairs = zip(polygons, mirror, strict=True)
    expected = [exact_gamma(radiance, polygon, axis, exponent) for polygon, axis in pairs]
    error = np.abs(ratio - expected)
    assert 0.1 < np.mean(expected) < 0.9
    assert error.mean() < mean
    assert np.abs(0.5 - np.asarray(expected)).mean() > 2.0 * mean


def test_the_paper_s_cap_is_lost_in_rounding_where_the_frustum_is_not(church):
    """The whole circle as a polygon of other vectors must give 1."""
    exponent = 5000.0
    mirror = unit(np.random.default_rng(0).normal(size=(16, 3)))
    polygons = directions_of(*(circle(axis, 0.3, 128) for axis in mirror))
    rim = jnp.full(16, 1.0 - 3.0 / (exponent + 2.0))
    paper = np.asarray(gamma(church, polygons, mirror, cap=Cap(rim, rim)))
    ours = np.asarray(gamma(church, polygons, mirror, exponent))
    assert np.abs(paper - 1.0).mean() > 0.1
    assert np.abs(ours - 1.0).mean() < 0.02


def test_gradients_in_light_and_exponent(sky):
    polygons = directions_of(circle([0.3, 1, 0.2], 0.6, 48))
    mirror = jnp.asarray(unit([[0.5, 0.7, 0.1]]), jnp.float32)

    def value(light, exponent):
        return ratio_of(light, polygons, mirror, phong_cap(exponent), pieces=1).mean()

    exponent, step = jnp.asarray([20.0]), 0.5
    dark = jax.tree.map(jnp.zeros_like, sky)
    _, slope = jax.jvp(value, (sky, exponent), (dark, jnp.ones(1)))
    rise = value(sky, exponent + step) - value(sky, exponent - step)
    np.testing.assert_allclose(slope, rise / (2.0 * step), rtol=0.05)
    _, brighter = jax.jvp(value, (sky, exponent), (sky, jnp.zeros(1)))
    np.testing.assert_allclose(brighter, 0.0, atol=1e-3)  # twice the light, the same ratio
