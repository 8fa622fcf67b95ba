"""Fitting the sharpness of vsat: star polygons under light through windows, and known answers."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.lighting.builtin import windows
from jaxvis.methods.vectorized import tuning
from jaxvis.methods.vectorized.light import PAPER_SHARPNESS, PolygonLight, texel_moments
from jaxvis.methods.vectorized.lobes import PhongLobes
from jaxvis.methods.vectorized.polygons import VisibilityPolygons
from jaxvis.sphere import latlong
from jaxvis.sphere.contours import ContourTable
from jaxvis.sphere.frames import frame
from jaxvis.sphere.polygons import Directions, uniform_irradiance

ROWS = 128
CAPACITY = 64


@pytest.fixture(scope="module")
def light():
    return light_of(windows(height=ROWS).radiance)


def light_of(radiance):
    """The tables that the fit reads; the others are empty, which saves ten seconds."""
    moments = jnp.asarray(texel_moments(ROWS, 2 * ROWS), jnp.float32)
    texels = moments[..., :, None] * jnp.broadcast_to(radiance, (ROWS, 2 * ROWS, 3))[..., None, :]
    vector = ContourTable.build(texels.reshape(ROWS, 2 * ROWS, 9))
    luminous = ContourTable.build(texels @ jnp.asarray([0.2126, 0.7152, 0.0722]))
    empty = ContourTable(jnp.zeros((2, 5, 3)))
    lobes = PhongLobes(jnp.zeros((2, 3)), (1,))
    return PolygonLight(vector, empty, luminous, empty, lobes, jnp.float32(5.0), True)


def stars(edges, count=96, seed=0):
    """Wavy polygons about random normals, above their horizon: (directions, normals)."""
    random = np.random.default_rng(seed)
    normals = random.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    turn = 2.0 * np.pi * np.arange(edges) / edges
    radius = 0.7 + sum(
        random.normal(size=(count, 1))
        * (0.35 / k)
        * np.cos(k * turn + random.uniform(0.0, 2.0 * np.pi, (count, 1)))
        for k in range(1, 6)
    )
    directions, normals = polygons_of(np.clip(radius, 0.1, 1.5), normals)
    return padded(directions), normals


def padded(directions, capacity=CAPACITY):
    """The last direction repeated: one shape for all, so that little is compiled."""
    missing = max(capacity - directions.x.shape[1], 0)
    return Directions(*(jnp.pad(axis, ((0, 0), (0, missing)), mode="edge") for axis in directions))


def polygons_of(radius, normals):
    """Directions at angles ``radius`` [polygons, edges] from the normals, counter-clockwise."""
    turn = 2.0 * np.pi * np.arange(radius.shape[1]) / radius.shape[1]
    normals = jnp.asarray(normals, jnp.float32)
    tangent, bitangent = (np.asarray(axis)[:, None] for axis in frame(normals))
    ring = np.cos(turn)[:, None] * tangent + np.sin(turn)[:, None] * bitangent
    points = (
        np.cos(radius)[..., None] * np.asarray(normals)[:, None] + np.sin(radius)[..., None] * ring
    )
    return Directions(*(jnp.asarray(points[..., i], jnp.float32) for i in range(3))), normals


def as_visibility(directions, normals, counts=None):
    """Polygons at infinity, seen the same from everywhere."""
    count, edges = directions.x.shape
    return VisibilityPolygons(
        vectors=jnp.stack([*directions, jnp.zeros((count, edges))], axis=1),
        counts=jnp.full(count, edges, jnp.int32) if counts is None else counts,
        positions=jnp.zeros((count, 3)),
        normals=normals,
        triangles=jnp.zeros((1, 3), jnp.int32),
        backs=jnp.full((1, 3), -1, jnp.int32),
        buried=jnp.zeros(count, bool),
    )


def test_cut_edges_are_short_and_lie_on_the_polygon():
    directions, normals = stars(8)
    fine = tuning.cut(directions, 0.05)
    lengths = np.linalg.norm(np.diff(np.stack(fine, axis=-1), axis=1), axis=-1)
    assert lengths.max() <= 0.05 + 1e-6
    np.testing.assert_allclose(
        uniform_irradiance(fine, normals), uniform_irradiance(directions, normals), atol=2e-6
    )
    corners = np.stack(directions, axis=-1)[:, :, None]
    points = np.stack(fine, axis=-1)[:, None]
    nearest = np.linalg.norm(corners - points, axis=-1).min(axis=2)
    assert nearest.max() < 1e-6  # the polygon's own corners are kept


def test_cutting_keeps_a_polygon_that_sees_nothing():
    point = Directions(*(jnp.full((1, 5), c) for c in (0.0, 1.0, 0.0)))
    fine = tuning.cut(point, 0.01)
    assert fine.x.shape == (1, tuning.CUT_MULTIPLE)
    np.testing.assert_array_equal(np.stack(fine, axis=-1)[0, 0], [0.0, 1.0, 0.0])


def test_oracle_under_a_uniform_sky_is_lamberts_formula():
    table = light_of(jnp.float32(2.0)).vector
    directions, normals = stars(32)
    expected = 2.0 * uniform_irradiance(directions, normals)
    irradiance = tuning.oracle_irradiance(directions, normals, table)
    np.testing.assert_allclose(irradiance, np.tile(expected[:, None], 3), atol=2e-3)
    whole = tuning.oracle_irradiance(tuning.horizon(normals), normals, table)
    np.testing.assert_allclose(whole, 2.0 * np.pi, atol=2e-3)


def test_oracle_is_the_sum_over_the_texels_inside(light):
    """Caps of half angle 0.8 about random axes, every texel in 4 x 4 parts."""
    normals = np.asarray(stars(3, count=32)[1])
    directions, normals = polygons_of(np.full((32, 512), 0.8), normals)
    irradiance = tuning.oracle_irradiance(directions, normals, light.vector)
    height = 4 * ROWS
    radiance = np.asarray(windows(height=ROWS).radiance).repeat(4, axis=0).repeat(4, axis=1)
    flux = radiance * latlong.row_solid_angles(height, 2 * height)[:, None, None]
    cosine = latlong.texel_directions(height, 2 * height) @ np.asarray(normals, np.float64).T
    seen = np.where(cosine > np.cos(0.8), cosine, 0.0)
    expected = np.einsum("rcn,rcx->nx", seen, flux)
    np.testing.assert_allclose(irradiance, expected, rtol=0.005)


@pytest.mark.parametrize(("scaled", "truth"), [(False, 23.0), (False, 3.0), (True, 7.5)])
def test_the_sharpness_that_made_the_targets_is_found(light, scaled, truth):
    directions, normals = stars(32)
    samples = tuning.with_oracle(directions, normals, light)
    made = tuning.vsat_irradiance(
        directions, normals, light, truth, scaled=scaled, lookup="bilinear"
    )
    fit = tuning.fit_to_samples(
        samples._replace(irradiance=made), light, scaled=scaled, lookup="bilinear"
    )
    assert fit.sharpness == pytest.approx(truth, rel=0.01)
    assert fit.error_after < 0.01 * fit.error_before


@pytest.mark.parametrize("edges", [16, 64])
def test_the_fit_beats_the_papers_constant_and_one_half(light, edges):
    directions, normals = stars(edges)
    samples = tuning.with_oracle(directions, normals, light)
    fit = tuning.fit_to_samples(samples, light, lookup="bilinear", steps=15)
    assert fit.error_after < 0.75 * fit.error_before < 0.75 * fit.error_half
    assert fit.error_after == pytest.approx(fit.history[:, 1].min(), rel=1e-6)
    found = tuning.relative_error(samples, light, fit.sharpness, lookup="bilinear")
    assert float(found) == pytest.approx(fit.error_after, rel=1e-4)
    at_paper = tuning.relative_error(samples, light, PAPER_SHARPNESS, lookup="bilinear")
    assert float(at_paper) == pytest.approx(fit.error_before, rel=1e-5)


def test_the_fitted_sharpness_goes_as_one_over_the_edges_length(light):
    """One constant for all edges grows with the vectors; over the edges' length it need not."""
    fits = {}
    for edges in (16, 64):
        samples = tuning.with_oracle(*stars(edges), light)
        for scaled in (False, True):
            fits[edges, scaled] = tuning.fit_to_samples(
                samples, light, scaled=scaled, lookup="bilinear", steps=15
            )
    assert fits[64, False].sharpness > 1.4 * fits[16, False].sharpness
    for edges in (16, 64):
        assert 3.0 < fits[edges, True].sharpness < 12.0


@pytest.mark.parametrize("scaled", [False, True])
def test_gradient_against_finite_differences(light, scaled):
    samples = tuning.with_oracle(*stars(32), light)

    def error(log):
        return tuning.relative_error(samples, light, jnp.exp(log), scaled=scaled, lookup="bilinear")

    for value in (2.0, 15.0):
        at, step = jnp.log(jnp.float32(value)), 0.05
        numeric = (error(at + step) - error(at - step)) / (2.0 * step)
        np.testing.assert_allclose(jax.grad(error)(at), numeric, rtol=0.02, atol=1e-5)


def test_polygons_of_a_scene_are_chosen_by_the_key_among_those_that_see(light):
    directions, normals = stars(24, count=106)
    counts = jnp.where(jnp.arange(106) < 10, 1, CAPACITY).astype(jnp.int32)
    visibility = as_visibility(directions, normals, counts)
    samples = tuning.sample_polygons(visibility, light, jax.random.key(3), 64)
    again = tuning.sample_polygons(visibility, light, jax.random.key(3), 64)
    other = tuning.sample_polygons(visibility, light, jax.random.key(4), 64)
    np.testing.assert_array_equal(samples.irradiance, again.irradiance)
    assert not np.array_equal(samples.normals, other.normals)
    rows = [int(np.flatnonzero((normals == n).all(axis=1))[0]) for n in samples.normals]
    assert min(rows) >= 10
    assert len(set(rows)) == 64
    everything = tuning.sample_polygons(visibility, light, jax.random.key(3), 1000)
    assert everything.normals.shape == (96, 3)


def test_fit_of_a_scenes_polygons_and_the_tuned_light(light):
    directions, normals = stars(48)
    visibility = as_visibility(directions, normals)
    fit = tuning.fit_sharpness(
        visibility, light, jax.random.key(0), scaled=True, steps=5, lookup="bilinear"
    )
    assert fit.history.shape == (tuning.SCANNED + 5, 2)
    new = tuning.tuned(light, fit)
    assert (float(new.sharpness), new.scaled) == (pytest.approx(fit.sharpness), True)
    assert new.vector is light.vector


def test_seen_from_its_own_place_a_polygon_is_cut_at_its_horizon(light):
    """Circles below the horizon of the normal: all of the hemisphere is left."""
    directions, normals = polygons_of(np.full((96, CAPACITY), 2.2), stars(3)[1])
    samples = tuning.sample_polygons(
        as_visibility(directions, normals), light, jax.random.key(0), 2
    )
    np.testing.assert_allclose(samples.irradiance.mean(axis=0), samples.unoccluded, rtol=1e-3)


def test_without_any_visibility_there_is_nothing_to_fit(light):
    directions, normals = stars(8, count=4)
    visibility = as_visibility(directions, normals, jnp.ones(4, jnp.int32))
    with pytest.raises(ValueError, match="no polygon sees anything"):
        tuning.fit_sharpness(visibility, light, jax.random.key(0))


def test_repeated_directions_change_nothing(light):
    """Padding: edges without length have a scaled sharpness that is not infinite."""
    directions, normals = polygons_of(np.full((96, CAPACITY // 2), 0.9), stars(3)[1])
    twice = Directions(*(jnp.repeat(axis, 2, axis=1) for axis in directions))
    for scaled in (False, True):
        at_end, everywhere = (
            tuning.vsat_irradiance(d, normals, light, 6.0, scaled=scaled, lookup="bilinear")
            for d in (padded(directions), twice)
        )
        assert np.all(np.isfinite(at_end))
        np.testing.assert_allclose(at_end, everywhere, rtol=1e-3)
