"""Visibility-aware sampling: blocks, what they count, what is drawn by it, and no bias."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.methods import AdaptiveEnvironment, MonteCarlo, create, traced
from jaxvis.methods.monte_carlo import adaptive, block_light
from jaxvis.methods.monte_carlo import path_map as path_maps
from jaxvis.methods.monte_carlo.adaptive import Shares
from jaxvis.methods.monte_carlo.block_light import (
    LEAST_COSINE,
    PRIOR,
    BlockLight,
    Tally,
    blocks_of,
    cumulative_distributions,
)
from jaxvis.methods.monte_carlo.cell_light import CellLight
from jaxvis.methods.traced import shading_points
from jaxvis.scene import Camera, trace_surface
from jaxvis.sphere import latlong
from tests.methods.drawn_lights import assert_draws_follow_the_density
from tests.methods.known_scenes import MATERIALS, SCENES, contrasted, lamps, uniform_light
from tests.methods.test_importance_driven import mostly_hidden
from tests.methods.test_monte_carlo import exact, renders, standard_errors_apart

PLANE, WALL, BOX, BALL = SCENES
ESTIMATORS = {
    "many": AdaptiveEnvironment(16, tile=4),
    "odd": AdaptiveEnvironment(5, tile=2),
    "two": AdaptiveEnvironment(2, tile=4),
    "one": AdaptiveEnvironment(1),
}


def surface_of(known, material="diffuse"):
    return known.surface(*MATERIALS[material])


@pytest.mark.parametrize("spp", [2, 3, 4, 5, 8, 9, 64])
def test_every_sample_has_its_purpose(spp):
    shares = AdaptiveEnvironment(spp).shares
    assert sum(shares) == spp
    assert min(shares.brdf, shares.adapted) >= 1
    assert shares.adapted == max(shares)
    assert AdaptiveEnvironment(16).shares == Shares(environment=2, brdf=2, adapted=12)


def test_blocks_are_tiles_of_one_dominant_axis_in_two_halves():
    surface = surface_of(BOX)
    points = shading_points(surface)
    blocks = blocks_of(surface, points, 4, 32)
    pixel = np.asarray(points.pixel)
    table = blocks.table_of_pixel[pixel]
    row, column = np.divmod(pixel, 18)
    normal = np.asarray(points.normal)
    axis = np.argmax(np.abs(normal), axis=1)
    for one in range(0, len(pixel), 7):
        for other in range(0, len(pixel), 5):
            together = (
                row[one] // 4 == row[other] // 4
                and column[one] // 4 == column[other] // 4
                and axis[one] == axis[other]
                and normal[one, axis[one]] * normal[other, axis[one]] > 0.0
            )
            assert (table[one] // 2 == table[other] // 2) == together
    np.testing.assert_array_equal(table % 2, (row + column) % 2)
    for block in np.unique(table // 2):
        mean = normal[table // 2 == block].mean(axis=0)
        np.testing.assert_allclose(blocks.normals[block], mean / np.linalg.norm(mean), atol=1e-5)


def test_tiles_double_until_their_tables_fit(monkeypatch):
    surface = surface_of(PLANE)
    points = shading_points(surface)
    small = len(np.unique(blocks_of(surface, points, 2, 512).table_of_pixel))
    monkeypatch.setattr(block_light, "MOST_ENTRIES", 512 * 40)
    large = len(np.unique(blocks_of(surface, points, 2, 512).table_of_pixel))
    assert small > 80
    assert large <= 40
    monkeypatch.setattr(block_light, "MOST_ENTRIES", 1)  # one tile cannot double
    assert blocks_of(surface, points, 2, 512).tables == 2


def test_there_is_room_for_as_many_tables_in_every_view():
    """The programs that read them are compiled for it."""
    found = []
    for eye in ((2.5, 2.0, 3.0), (0.5, 6.0, 0.5), (9.0, 7.0, 9.0)):
        surface = trace_surface(BALL.load(), Camera(eye, (0.0, 0.5, 0.0)), (48, 36))
        found.append(blocks_of(surface, shading_points(surface), 6, 32))
    assert len({blocks.tables for blocks in found}) == 3
    assert len({blocks.room for blocks in found}) == 1
    assert all(blocks.room >= blocks.tables for blocks in found)
    packed = blocks_of(surface, shading_points(surface), 1, 1)
    assert packed.room >= packed.tables


def counted():
    """Blocks of a scene with made up counts."""
    surface = surface_of(BALL)
    points = shading_points(surface)
    light = CellLight.of(contrasted(12), 6, 9)
    blocks = blocks_of(surface, points, 6, light.cells.cells)
    tally = Tally.empty(blocks.tables, light.cells.cells)
    rng = np.random.default_rng(0)
    tally.sent[:] = rng.integers(0, 6, tally.sent.shape)
    tally.free[:] = np.minimum(rng.integers(0, 6, tally.sent.shape), tally.sent)
    return surface, light, blocks, tally


def test_counts_are_of_active_rays():
    tally = Tally.empty(4, 3)
    active = np.array([[True, False], [True, True]])
    visible = np.array([[True, False], [False, True]])
    tally.add(np.array([1, 3]), np.array([[2, 0], [1, 1]]), active, visible)
    np.testing.assert_array_equal(tally.sent, [[0, 0, 0], [0, 0, 1], [0, 0, 0], [0, 2, 0]])
    np.testing.assert_array_equal(tally.free, [[0, 0, 0], [0, 0, 1], [0, 0, 0], [0, 1, 0]])


def test_distributions_are_those_of_the_formula():
    _, light, blocks, tally = counted()
    cdfs = np.asarray(cumulative_distributions(tally, blocks, light.cells, 0.1), np.float64)
    power = light.cells.power.reshape(-1)
    centres = latlong.texel_directions(6, 9).reshape(-1, 3)
    for table in range(0, blocks.tables, 3):
        other = table ^ 1
        sums = [counts[other % 2 :: 2].sum(axis=0) for counts in tally]
        everywhere = (sums[1] + 0.5) / (sums[0] + 1.0)
        seen = (tally.free[other] + PRIOR * everywhere) / (tally.sent[other] + PRIOR)
        cosine = np.maximum(centres @ blocks.normals[table // 2], LEAST_COSINE)
        weights = power * cosine * np.sqrt(np.maximum(seen, 0.1))
        np.testing.assert_allclose(np.diff(cdfs[table]), weights / weights.sum(), atol=2e-7)


def test_a_half_never_feels_what_it_saw_itself():
    _, light, blocks, tally = counted()
    before = np.asarray(cumulative_distributions(tally, blocks, light.cells, 0.1))
    tally.free[0::2] = 0
    after = np.asarray(cumulative_distributions(tally, blocks, light.cells, 0.1))
    np.testing.assert_array_equal(after[0::2], before[0::2])
    used = slice(1, blocks.tables, 2)
    assert not np.any(np.all(after[used] == before[used], axis=1))


@pytest.mark.parametrize("share", [1.0, 0.6])
def test_directions_follow_their_density(share):
    """Alone; the mixture with the luminance integrates to one as well."""
    surface, light, blocks, tally = counted()
    cdfs = cumulative_distributions(tally, blocks, light.cells, 0.1)
    table = jnp.asarray(blocks.table_of_pixel)
    adapted = BlockLight(light, cdfs, table, jnp.float32(share))
    if share == 1.0:
        assert_draws_follow_the_density(adapted, surface, samples=1)
        assert_draws_follow_the_density(adapted, surface, samples=3)  # stratified
    else:  # three rays in five are adapted
        with pytest.raises(AssertionError):
            assert_draws_follow_the_density(adapted, surface, samples=1)


@pytest.mark.parametrize(
    ("name", "hidden"), [*((name, True) for name in ESTIMATORS), ("many", False), ("two", False)]
)
def test_means_agree_with_the_reference(name, hidden, truths):
    """Diffuse under light that is mostly hidden; glossy under light that is not."""
    known, material = (WALL, "diffuse") if hidden else (BALL, "ggx")
    light = mostly_hidden() if hidden else contrasted()
    scene, surface = known.load(), surface_of(known, material)
    samples = renders(ESTIMATORS[name], scene, light, surface, 12)
    assert np.all(np.isfinite(samples))
    apart = standard_errors_apart(samples, truths[known.name])
    assert np.all(np.abs(apart) < 4.0), f"{apart} standard errors"


@pytest.fixture(scope="module")
def truths():
    return {
        WALL.name: exact(WALL.load(), mostly_hidden(), surface_of(WALL)),
        BALL.name: exact(BALL.load(), contrasted(), surface_of(BALL, "ggx")),
    }


def test_pixels_that_learn_from_their_own_rays_are_biased(monkeypatch):
    """Negative control: the halves of blocks swapped, so that each shapes its own density.

    Under eight large texels rays to the same cell meet now the wall, now the sky.
    """
    light, surface = uniform_light(height=2), surface_of(WALL)
    truth = exact(WALL.load(), light, surface, subdivision=64)
    method = AdaptiveEnvironment(4, tile=2, least=0.001)
    honest = renders(method, WALL.load(), light, surface, 100)
    assert np.all(np.abs(standard_errors_apart(honest, truth)) < 4.0)

    class Swapped(Tally):
        def add(self, table, cell, active, visible):
            super().add(table ^ 1, cell, active, visible)

    monkeypatch.setattr(adaptive, "Tally", Swapped)
    selfish = renders(method, WALL.load(), light, surface, 100)
    assert np.all(standard_errors_apart(selfish, truth) < -4.0)


def test_hidden_light_is_drawn_less_and_the_noise_is_lower():
    scene, surface = WALL.load(), surface_of(WALL)
    noise = {
        name: renders(create(f"{name}:spp=8"), scene, mostly_hidden(), surface, 4).var(axis=0)
        for name in ("mc-environment", "mc-mis", "mc-adaptive")
    }
    best = min(noise["mc-environment"].mean(), noise["mc-mis"].mean())
    assert noise["mc-adaptive"].mean() < 0.3 * best


def test_the_same_key_gives_the_same_bits_for_any_chunk(monkeypatch):
    monkeypatch.setattr(traced, "RAYS_PER_BLOCK", 1 << 12)
    monkeypatch.setattr(path_maps, "RAYS_PER_BLOCK", 1 << 8)
    scene, surface = BALL.load(), surface_of(BALL, "ggx")
    images = []
    for chunk in (1, 1 << 14, 1 << 20):
        method = replace(ESTIMATORS["many"], rays_per_chunk=chunk)
        visibility, light = method.precompute(scene), method.light(contrasted())
        images.append(method.shade(visibility, light, surface, key=jax.random.key(7)))
        other = method.shade(visibility, light, surface, key=jax.random.key(8))
        assert not np.array_equal(images[-1], other)
    for image in images[1:]:
        np.testing.assert_array_equal(image, images[0])


def test_pilots_are_traced_once():
    """On an open plane under light from above all but the BRDF's rays below it are traced."""
    scene, surface = PLANE.load(), surface_of(PLANE)
    pixels = int(np.sum(surface.mask))
    method = AdaptiveEnvironment(8)
    visibility, light = method.precompute(scene), method.light(uniform_light())
    before = visibility.rays_traced
    method.shade(visibility, light, surface, key=jax.random.key(0))
    assert visibility.rays_traced - before <= 8 * pixels
    assert method.evaluations(visibility, light, surface) == 8 * pixels


def test_lamps_and_darkness_and_an_empty_view():
    """Black sky: the same rays to the lamp as mc-mis, bit for bit; black where nothing is seen."""
    scene, surface = BOX.load(), surface_of(BOX)
    lit = lamps(((2.5, 1.5, 2.0), 0.4, 10.0))
    one, plain = AdaptiveEnvironment(4), MonteCarlo("mis", 4)
    images = [
        method.shade(method.precompute(scene), method.light(lit), surface, key=jax.random.key(0))
        for method in (one, plain)
    ]
    np.testing.assert_array_equal(*images)
    nothing = replace(surface, mask=jnp.zeros_like(surface.mask))
    black = one.shade(one.precompute(scene), one.light(lit), nothing, key=jax.random.key(0))
    np.testing.assert_array_equal(black, 0.0)


def test_supersampling():
    scene = BALL.with_material(*MATERIALS["diffuse"])
    fine = trace_surface(scene, BALL.camera, BALL.size, supersampling=2)
    method = AdaptiveEnvironment(8, tile=4)
    visibility, light = method.precompute(scene), method.light(contrasted())
    image = method.shade(visibility, light, fine, key=jax.random.key(0))
    truth = exact(scene, contrasted(), surface_of(BALL))
    found = np.asarray(image)[np.asarray(surface_of(BALL).mask)]
    assert image.shape == (BALL.size[1], BALL.size[0], 3)
    assert abs(found.mean() / truth.mean() - 1.0) < 0.1


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("mc-adaptive:spp=0", "spp must be at least 1, got 0"),
        ("mc-adaptive:tile=1", "tile must be at least 2 pixels, got 1"),
        ("mc-adaptive:least=0", "least must be above 0 and at most 1, got 0"),
        ("mc-adaptive:rays_per_chunk=0", "rays_per_chunk must be at least 1"),
    ],
)
def test_a_wrong_parameter_is_named(spec, message):
    with pytest.raises(ValueError, match=message):
        create(spec)
