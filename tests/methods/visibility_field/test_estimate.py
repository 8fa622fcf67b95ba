"""Images from culled rays: the same as without a field where it is right, and right on average."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.lighting import Environment
from jaxvis.methods import Reference, Unculled, VisibilityField
from jaxvis.methods.traced import components, shading_points
from jaxvis.methods.visibility_field import estimate, stages
from jaxvis.methods.visibility_field.brdf_rays import brdf_directions
from jaxvis.methods.visibility_field.cull import TRACE, above_plane
from jaxvis.methods.visibility_field.estimate import Frame, cosine_rays
from jaxvis.methods.visibility_field.field import FieldVisibility, packed
from jaxvis.methods.visibility_field.grid import Grid
from jaxvis.methods.visibility_field.hemisphere import (
    local_directions,
    shifts,
    turns,
    world_directions,
)
from jaxvis.methods.visibility_field.left import Listed
from jaxvis.methods.visibility_field.stages import Rays
from jaxvis.scene import Camera
from jaxvis.scene.builtin import builtin_scene
from jaxvis.sphere import harmonics, latlong, octahedral
from tests.methods.known_scenes import MATERIALS, SCENES, KnownScene, contrasted, uniform_light
from tests.methods.visibility_field.made_fields import (
    LABELS,
    VO,
    O,
    V,
    cells_at,
    exact_for,
    filled,
    label_of,
    of_texels,
)

PLANE, WALL, BOX, BALL = SCENES
SPP = 16
RENDERS = 24
pytestmark = pytest.mark.usefixtures("own_caches")


@pytest.fixture(autouse=True)
def _small_blocks(monkeypatch):
    """Two blocks in an image, and no work for points that are not there."""
    monkeypatch.setattr(stages, "RAYS_PER_BLOCK", 128 * SPP)
    monkeypatch.setattr(estimate, "WEIGHED_AT_ONCE", 64 * SPP)
    monkeypatch.setattr(estimate, "WEIGHED_TOGETHER", 96 * SPP)


@cache
def surface_of(known, material="diffuse"):
    return known.surface(*MATERIALS[material])


def covered(image, surface):
    return np.asarray(image, np.float64)[np.asarray(surface.mask)]


def culled(stored, surface, seed=0, environment=None, spp=SPP, **options):
    """An image from a field, and how many rays it took."""
    method = VisibilityField(spp=spp, **options)
    before = stored.rays_traced
    light = method.light(environment or contrasted())
    image = method.shade(stored, light, surface, key=jax.random.key(seed))
    return np.asarray(image), stored.rays_traced - before


def unculled(stored, surface, seed=0, environment=None, spp=SPP, **options):
    """The same without the field."""
    method = Unculled(spp=spp, **options)
    before = stored.rays_traced
    light = method.light(environment or contrasted())
    image = method.shade(stored.rays, light, surface, key=jax.random.key(seed))
    return np.asarray(image), stored.rays_traced - before


def renders(shade, stored, surface, count=RENDERS, **options):
    """Independent images of the covered pixels [count, pixels, 3]."""
    images = [shade(stored, surface, seed, **options)[0] for seed in range(count)]
    return np.stack([covered(image, surface) for image in images])


def apart(samples, truth):
    """Standard errors between the mean over renders and pixels and the truth, per channel."""
    means = samples.mean(axis=1)
    error = means.std(axis=0, ddof=1) / np.sqrt(len(means))
    return (means.mean(axis=0) - np.mean(truth, axis=0)) / error


# Harmonic light takes the midpoints of strata: in a part of the radiance its means are off by this.
STRATA = 0.015


def agree(found, truth, slack=0.0):
    """Whether the mean over renders and pixels is the truth, but for noise and ``slack``."""
    means = found.mean(axis=1)
    error = means.std(axis=0, ddof=1) / np.sqrt(len(means))
    expected = np.mean(truth, axis=0)
    return np.all(np.abs(means.mean(axis=0) - expected) < 4.0 * error + slack * np.abs(expected))


def assert_agree(found, truth, slack=0.0):
    """On average within what the spread explains, and no pixel's light in another pixel."""
    assert np.all(np.isfinite(found))
    assert agree(found, truth, slack)
    assert not agree(found, 1.06 * truth, slack)  # negative control
    assert np.abs(found.mean(axis=0) - truth).mean() < 0.25 * truth.mean()


@cache
def exact(known, material, environment_of, subdivision):
    surface, method = surface_of(known, material), Reference(subdivision=subdivision)
    light = method.light(environment_of())
    return covered(method.shade(method.precompute(known.load()), light, surface), surface)


def brightening_sky(rows=16):
    """L = 1 + 0.8 y: two bands and nowhere negative."""
    up = latlong.texel_directions(rows, 2 * rows)[..., 1:2]
    radiance = (1.0 + 0.8 * up) * np.array([1.0, 0.8, 0.5])
    return Environment(jnp.asarray(radiance, jnp.float32), "brightening")


# What carries nine harmonics and what carries all of the light, diffuse and glossy.
CASES = [("diffuse", "harmonics"), ("ggx", "harmonics"), ("phong", "environment")]
cases = pytest.mark.parametrize(("material", "lighting"), CASES)


@cases
@pytest.mark.parametrize("labels", LABELS)
def test_a_field_that_knows_nothing_gives_the_image_without_it(labels, material, lighting):
    """Bit for bit, whichever label; only the control variate is another estimator."""
    stored, surface = filled(BOX.load(), VO), surface_of(BOX, material)
    label = label_of(stored.texels()[0], labels)
    assert label == (0 if labels == "balanced" else 1)
    for conservative in (False, True):
        options = {"labels": labels, "conservative": conservative, "control_variate": False}
        image, traced = culled(stored, surface, lighting=lighting, **options)
        expected, every = unculled(stored, surface, lighting=lighting)
        np.testing.assert_array_equal(image, expected)
        assert traced == every > 0
    if (labels, material) != ("balanced", "diffuse"):
        image, _ = culled(stored, surface, lighting=lighting, labels=labels)
        np.testing.assert_array_equal(image, expected)


@cases
@pytest.mark.parametrize("labels", LABELS)
def test_an_open_plane_known_to_be_open(labels, material, lighting):
    stored, surface = filled(PLANE.load(), V), surface_of(PLANE, material)
    options = {"labels": labels, "control_variate": False, "lighting": lighting}
    image, traced = culled(stored, surface, **options)
    expected, every = unculled(stored, surface, lighting=lighting)
    np.testing.assert_array_equal(image, expected)
    diffuse = (material, lighting) == ("diffuse", "harmonics")
    free = labels == "four-state" or (diffuse and labels != "visible")  # label 0 accepts
    assert traced == (0 if free else every)


@cases
@pytest.mark.parametrize("labels", LABELS)
def test_a_closed_room_known_to_be_closed_is_black_and_traces_nothing(labels, material, lighting):
    scene = builtin_scene("furnace")
    room = KnownScene("furnace", Camera((-1.3, 0.4, 1.3), (1.3, -0.6, -1.3)), (9, 7))
    surface = surface_of(room, material)
    assert np.asarray(surface.mask).all()
    stored = filled(scene, O)
    image, traced = culled(stored, surface, labels=labels, lighting=lighting)
    assert traced == 0
    assert np.all(image == 0.0)
    assert np.all(unculled(stored, surface, lighting=lighting)[0] == 0.0)


def rays_of(known, material, seed=0):
    """(points, directions [points, rays, 3], how each ray ends) of harmonic light's rays."""
    surface = surface_of(known, material)
    points, columns = shading_points(surface), jnp.int32(surface.mask.shape[1])
    moved = shifts(jax.random.key(seed))
    local = local_directions(SPP)

    def draw(points):
        if material == "diffuse":
            return cosine_rays(None, local, columns, moved, points)
        directions = brdf_directions(
            points,
            turns(points.pixel, columns, moved),
            samples=SPP,
            reflectance=surface.reflectance,
        )
        above = above_plane(points, directions)
        return Rays(Listed(directions), jnp.where(above, TRACE, 0).astype(jnp.uint8))

    decided, directions = [], []
    for block, decision in Frame(known.load().tracer, points, columns).blocks(draw, SPP):
        rays = block.rays.directions
        axes = rays.directions if isinstance(rays, Listed) else world_directions(*rays)
        directions.append(np.stack(axes, axis=-1)[: block.inside])
        decided.append(decision[: block.inside])
    return points, np.concatenate(directions), np.concatenate(decided)


@pytest.mark.parametrize(("known", "material"), [(BALL, "diffuse"), (BOX, "ggx")])
def test_a_field_that_knows_how_the_rays_end_changes_nothing(known, material):
    """By brute force from the very rays; each rule then traces what it says that it does."""
    surface = surface_of(known, material)
    points, directions, decided = rays_of(known, material)
    stored = exact_for(known.load(), points.origin, directions, decided, edge=0.7)
    expected, every = unculled(stored, surface)
    above = np.asarray(above_plane(points, components(jnp.asarray(directions))))
    assert every == above.sum()

    row = np.searchsorted(np.asarray(stored.keys), cells_at(stored.grid, points.origin))
    texels = stored.texels()
    i, j = octahedral.texel(jnp.asarray(directions), stored.size)
    state = texels[row[:, None], np.asarray(i), np.asarray(j)]
    for labels in LABELS:
        rule = "visible" if material != "diffuse" and labels != "four-state" else labels
        one = np.array([label_of(cell, rule) for cell in texels])[row][:, None] == 1
        left = state == VO if labels == "four-state" else np.where(one, state & V, state & O) > 0
        image, traced = culled(stored, surface, labels=labels, control_variate=False)
        np.testing.assert_array_equal(image, expected)
        assert abs(traced - np.sum(left & above)) <= 2  # rays on the edge of a texel
        assert traced < 0.95 * every
    if material == "diffuse":
        both = {label_of(cell, "balanced") for cell in texels}
        assert both == {0, 1}
    swapped = of_texels(known.load(), stored.grid, stored.keys, [0, O, V, VO][1] * (texels == V))
    wrong, _ = culled(swapped, surface)
    assert np.abs(wrong - expected).max() > 1e-2  # negative control


def label_0(scene):
    """A field of nothing but doubt, which the balanced rule gives label 0 everywhere."""
    return filled(scene, VO)


def test_where_nothing_is_in_the_way_the_control_variate_is_exact():
    """Under any light: what is subtracted from the irradiance is zero (eq. 11)."""
    stored, surface = label_0(PLANE.load()), surface_of(PLANE)
    normals = jnp.asarray(np.asarray(surface.normal)[np.asarray(surface.mask)])
    coefficients = harmonics.project(contrasted().radiance, 3)
    irradiance = np.asarray(harmonics.irradiance(coefficients, normals)) / np.pi
    expected = irradiance * np.array([0.8, 0.6, 0.4])
    spread = []
    for seed in range(3):
        image, _ = culled(stored, surface, seed, labels="balanced")
        np.testing.assert_allclose(covered(image, surface), expected, rtol=3e-6)
        spread.append(unculled(stored, surface, seed)[0])
    assert np.std(spread, axis=0).max() > 1e-2 * expected.mean()


def test_under_uniform_light_both_labels_give_the_same_image():
    """All unshadowed estimates are exact there, and so their difference."""
    stored, surface = label_0(BOX.load()), surface_of(BOX)
    light = uniform_light(2.0)
    image, _ = culled(stored, surface, 1, light, labels="balanced")
    expected, _ = unculled(stored, surface, 1, light)
    np.testing.assert_allclose(image, expected, atol=1e-5)
    assert expected.std() > 0.1


def two_labels(known, size=18):
    """Label 0 in every other cell. The others know that downward rays are blocked, as they are."""
    grid = Grid.covering(known.load().positions, 1.0)
    texels = np.full((grid.cells, size, size), VO)
    i, j = octahedral.texel(jnp.array([0.0, -1.0, 0.0]), size)
    x, y, z = np.unravel_index(np.arange(grid.cells), grid.shape)
    texels[(x + y + z) % 2 == 1, int(i), int(j)] = O
    return of_texels(known.load(), grid, np.arange(grid.cells), texels)


def test_cells_of_both_labels_meet_without_a_seam():
    """In label 1 the very image without a field; in label 0 its expected value (eq. 11)."""
    stored, surface = two_labels(BALL), surface_of(BALL)
    points = shading_points(surface)
    label = np.array([label_of(cell, "balanced") for cell in stored.texels()])
    zero = label[cells_at(stored.grid, points.origin)] == 0
    assert 0.2 < zero.mean() < 0.8
    found = renders(culled, stored, surface, labels="balanced")
    plain = renders(unculled, stored, surface)
    np.testing.assert_array_equal(found[:, ~zero], plain[:, ~zero])
    difference = (found - plain)[:, zero]
    assert np.abs(difference).max() > 1e-3
    assert np.all(np.abs(apart(difference, np.zeros((1, 3)))) < 4.0)
    off = renders(culled, stored, surface, 1, labels="balanced", control_variate=False)
    np.testing.assert_array_equal(off, plain[:1])


def test_the_comparison_of_labels_would_see_a_factor():
    """Negative control: an unshadowed irradiance 1 % too large leaves a seam."""
    stored, surface = label_0(BOX.load()), surface_of(BOX)
    found = renders(culled, stored, surface, labels="balanced")
    plain = renders(unculled, stored, surface)
    coefficients = harmonics.project(contrasted().radiance, 3)
    normals = jnp.asarray(np.asarray(surface.normal)[np.asarray(surface.mask)])
    open_sky = np.asarray(harmonics.irradiance(coefficients, normals)) / np.pi * [0.8, 0.6, 0.4]
    assert np.abs(apart(found - plain, -0.01 * open_sky)).max() > 4.0


@pytest.mark.parametrize(("spp", "slack"), [(16, 1e-3), (256, 2e-5)])
def test_an_open_plane_has_the_irradiance_of_nine_harmonics(spp, slack):
    stored, surface = filled(PLANE.load(), V), surface_of(PLANE)
    normals = jnp.asarray(np.asarray(surface.normal)[np.asarray(surface.mask)])
    coefficients = harmonics.project(contrasted().radiance, 3)
    expected = np.asarray(harmonics.irradiance(coefficients, normals), np.float64) / np.pi
    expected = expected * [0.8, 0.6, 0.4]
    found = renders(unculled, stored, surface, spp=spp)
    assert agree(found, expected, slack)
    assert not agree(found, 1.01 * expected, slack)
    if spp == 256:
        np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), rtol=1e-2)


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("known", [WALL, BALL], ids=lambda known: known.name)
def test_harmonic_light_agrees_with_the_reference(known, material):
    surface, truth = surface_of(known, material), exact(known, material, brightening_sky, 4)
    stored = filled(known.load(), VO)
    found = renders(unculled, stored, surface, environment=brightening_sky())
    assert_agree(found, truth, STRATA)


@cache
def sampled_field(known):
    """A conservative field by the precompute, enough samples for these small scenes."""
    method = VisibilityField(cell=0.5, masks=12, samples=40_000, rays=64)
    return method.precompute(known.load(), progress=False)


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("known", [WALL, BOX], ids=lambda known: known.name)
def test_all_of_the_light_agrees_with_the_reference(known, material):
    surface, stored = surface_of(known, material), sampled_field(known)
    truth = exact(known, material, contrasted, 8)
    found = renders(culled, stored, surface, lighting="environment")
    assert_agree(found, truth)


def test_the_comparison_would_see_wrong_masks():
    """Negative control: where samples disagree, the visible bit is wiped."""
    surface, stored = surface_of(BOX), sampled_field(BOX)
    texels = stored.texels()
    texels[texels == VO] = O
    wiped = FieldVisibility(
        stored.grid,
        stored.keys,
        packed(texels),
        np.count_nonzero(texels & V, axis=(1, 2)).astype(np.int32),
        stored.occluded,
        stored.rays,
        stored.size,
    )
    truth = exact(BOX, "diffuse", contrasted, 8)
    found = renders(culled, wiped, surface, lighting="environment")
    assert np.abs(apart(found, truth)).max() > 4.0


@pytest.mark.parametrize("spp", [1, 3])
def test_odd_numbers_of_rays_are_shared_out(spp):
    """Half of them, rounded up, by the environment; one alone is not biased either."""
    surface = surface_of(PLANE)
    truth = exact(PLANE, "diffuse", contrasted, 8)
    stored = filled(PLANE.load(), VO)
    found = renders(unculled, stored, surface, 40, lighting="environment", spp=spp)
    assert np.all(np.abs(apart(found, truth)) < 4.0)


def test_a_field_saves_rays_and_keeps_the_image():
    surface, stored = surface_of(BOX), sampled_field(BOX)
    expected, every = unculled(stored, surface)
    image, traced = culled(stored, surface)
    assert 0 < traced < 0.8 * every
    assert np.sqrt(np.mean((image - expected) ** 2)) < 2e-2 * expected.mean()
    assert stored.rays_traced == stored.tracer.rays_traced


def test_a_view_without_surface_is_black():
    away = KnownScene("plane", Camera((0.0, 1.0, 0.0), (0.0, 5.0, 0.1)), (4, 3))
    surface, stored = surface_of(away), filled(PLANE.load(), VO)
    assert not np.asarray(surface.mask).any()
    for lighting in ("harmonics", "environment"):
        image, traced = culled(stored, surface, lighting=lighting)
        assert image.shape == (3, 4, 3)
        assert traced == 0
        assert not image.any()


def test_light_of_the_other_kind_is_refused():
    stored, surface = filled(PLANE.load(), VO), surface_of(PLANE)
    light = Unculled(lighting="harmonics").light(contrasted())
    for method in (Unculled(lighting="environment"), VisibilityField(lighting="environment")):
        visibility = stored.rays if isinstance(method, Unculled) else stored
        with pytest.raises(ValueError, match="needs the light of the same method"):
            method.shade(visibility, light, surface, key=jax.random.key(0))
