"""Importance driven sampling: path maps, what is drawn by them, and that no light is missed."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.lighting import Environment
from jaxvis.methods import ImportanceDriven, LocalImportanceDriven, MonteCarlo, create, traced
from jaxvis.methods.estimators import Counts, proposals
from jaxvis.methods.monte_carlo import path_map as path_maps
from jaxvis.methods.monte_carlo.cell_light import CellLight
from jaxvis.methods.monte_carlo.local_light import NORMALS, LocalLight, around
from jaxvis.methods.monte_carlo.path_map import directional_distribution, path_map
from jaxvis.methods.traced import RayVisibility, shading_points, to_image, trace_and_sum
from jaxvis.sampling.random import key_words
from jaxvis.sphere import latlong
from tests.methods.drawn_lights import assert_draws_follow_the_density, probabilities
from tests.methods.known_scenes import MATERIALS, SCENES, contrasted, lamps, uniform_light
from tests.methods.test_monte_carlo import exact, renders, standard_errors_apart

PLANE, WALL, BOX, BALL = SCENES
ESTIMATORS = {
    "ides": ImportanceDriven(16, paths=2048),
    "ides-acdf": LocalImportanceDriven(16, paths=2048),
    "ides-distribution": ImportanceDriven(16, brdf=0.0, paths=64),
    "ides-acdf-distribution": LocalImportanceDriven(16, brdf=0.0, paths=64),
    "ides-one": ImportanceDriven(1, paths=512),
    "ides-acdf-odd": LocalImportanceDriven(3, paths=512, tolerance=0.02),
}


def mostly_hidden():
    """Contrasted light, and much more of it from below, where a plane hides it, and behind the
    wall."""
    radiance = np.array(contrasted().radiance)
    radiance[5:, :] = (60.0, 50.0, 40.0)
    radiance[2:4, 11:13] = 30.0  # -x, behind the wall
    return Environment(jnp.asarray(radiance), "mostly hidden")


def paths_of(known, paths=200_000, shape=(8, 16), seed=0):
    surface = known.surface(*MATERIALS["diffuse"])
    points = shading_points(surface)
    tracer = RayVisibility.of(known.load()).tracer
    words = key_words(jax.random.key(seed))
    return path_map(tracer, points, words, paths, shape, reflectance=surface.reflectance)


def test_the_path_map_of_an_open_plane_is_the_cosine():
    carried = paths_of(PLANE)
    edges = np.cos(np.pi * np.arange(9) / 8.0)
    ring = np.maximum(edges[:-1], 0.0) ** 2 - np.maximum(edges[1:], 0.0) ** 2
    albedo = 0.2126 * 0.8 + 0.7152 * 0.6 + 0.0722 * 0.4
    paths = carried.sum() / albedo
    np.testing.assert_allclose(paths, 200_000, rtol=1e-3)  # as many as were asked for
    expected = np.repeat(ring[:, None], 16, axis=1) / 16.0
    np.testing.assert_allclose(carried / carried.sum(), expected, atol=4.0 * np.sqrt(0.01 / 2e5))
    assert np.all(carried[4:] == 0.0)


def test_what_the_scene_hides_carries_nothing():
    """In front of a wall nothing leaves towards -x; a ray's end counts, not its start."""
    carried = paths_of(WALL)
    behind = carried[:, 9:15].sum()  # u around 3/4 is -x
    before = carried[:, 1:7].sum()
    assert behind < 0.1 * before


def test_few_paths_start_from_points_all_over():
    few = paths_of(PLANE, paths=100)
    assert 0.0 < few.sum() <= 100.0
    assert paths_of(PLANE, paths=1).sum() <= 1.0


def test_a_path_map_becomes_a_density_of_mean_one_with_its_floor():
    carried = np.zeros((8, 16))
    carried[0, 0] = carried[3, 15] = 5.0
    angles = latlong.row_solid_angles(8, 16)[:, None]
    for floor in (0.0, 0.08, 1.0):
        density = directional_distribution(carried, floor)
        assert abs(np.sum(density * angles) / (4.0 * np.pi) - 1.0) < 1e-12
        assert density.min() == pytest.approx(floor, abs=1e-12)
    spread = directional_distribution(carried, 0.0)
    assert spread[3, 0] > 0.3 * spread[3, 15]  # across the seam
    assert spread[0, 8] > 0.0  # across the pole
    np.testing.assert_array_equal(directional_distribution(np.zeros((2, 4)), 0.1), np.ones((2, 4)))
    # A sphere that sends as much everywhere stays even.
    even = directional_distribution(np.broadcast_to(angles, (8, 16)), 0.0)
    np.testing.assert_allclose(even, 1.0, rtol=1e-12)


def lights(tolerance=0.002):
    """What is drawn from, made from a random factor for each cell."""
    environment = contrasted(12)
    rng = np.random.default_rng(0)
    fine = CellLight.of(environment, 6, 12)
    coarse = CellLight.of(environment, 4, 7)
    useful = rng.random((4, 7)) + 0.05
    return {
        "cells": fine.in_proportion(rng.random((6, 12))),
        "cells of other sizes": coarse.in_proportion(useful),
        "normals": LocalLight.of(fine, rng.random((6, 12)) + 0.05, tolerance),
        "normals, cells of other sizes": LocalLight.of(coarse, useful, 0.01),
    }


@pytest.mark.parametrize("name", lights())
def test_directions_follow_their_density(name):
    assert_draws_follow_the_density(lights()[name], BALL.surface(*MATERIALS["diffuse"]), samples=4)


def test_normals_draw_what_is_before_them():
    """Almost all of it, and more than without normals; on the axes of the table exactly its own."""
    light = CellLight.of(uniform_light(height=32), 32, 64)
    local = LocalLight.of(light, np.ones((32, 64)), 1e-4)
    points = shading_points(PLANE.surface(*MATERIALS["diffuse"]))
    above = latlong.texel_directions(32, 64)[..., 1].reshape(-1) > 0.0
    assert probabilities(light, points)[0, above].sum() == pytest.approx(0.5, abs=1e-5)
    assert probabilities(local, points)[0, above].sum() > 0.85
    normals = latlong.texel_directions(*NORMALS).reshape(-1, 3)
    tables, shares = around(jnp.asarray(normals, jnp.float32))
    np.testing.assert_allclose(np.asarray(shares).max(axis=1), 1.0, atol=1e-5)
    own = np.take_along_axis(np.asarray(tables), np.asarray(shares).argmax(axis=1)[:, None], 1)
    np.testing.assert_array_equal(own[:, 0], np.arange(len(normals)))


def test_the_tables_around_a_normal_interpolate():
    """Bilinear weights of a smooth function, poles and seam included, are near the function."""
    rng = np.random.default_rng(1)
    normals = rng.normal(size=(500, 3))
    normals[:4] = [[0, 1, 0], [0, -1, 0], [1e-4, 0, -1], [-1e-4, 0, -1]]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    tables, shares = around(jnp.asarray(normals, jnp.float32))
    np.testing.assert_allclose(np.asarray(shares).sum(axis=1), 1.0, atol=1e-6)
    assert np.asarray(shares).min() >= 0.0
    centres = latlong.texel_directions(*NORMALS).reshape(-1, 3)
    mean = np.einsum("pk,pkc->pc", np.asarray(shares, float), centres[np.asarray(tables)])
    assert np.linalg.norm(mean - normals, axis=1).max() < 0.06


@pytest.mark.parametrize(
    ("name", "hidden"),
    [*((name, True) for name in ESTIMATORS), ("ides", False), ("ides-acdf", False)],
)
def test_means_agree_with_the_reference(name, hidden, truths):
    """Diffuse under light that is mostly hidden; glossy under light that is not."""
    known, material = (WALL, "diffuse") if hidden else (BALL, "ggx")
    light = mostly_hidden() if hidden else contrasted()
    scene, surface = known.load(), known.surface(*MATERIALS[material])
    samples = renders(ESTIMATORS[name], scene, light, surface, 12)
    assert np.all(np.isfinite(samples))
    apart = standard_errors_apart(samples, truths[known.name])
    assert np.all(np.abs(apart) < 4.0), f"{apart} standard errors"


@pytest.fixture(scope="module")
def truths():
    wall, ball = WALL.surface(*MATERIALS["diffuse"]), BALL.surface(*MATERIALS["ggx"])
    return {
        WALL.name: exact(WALL.load(), mostly_hidden(), wall),
        BALL.name: exact(BALL.load(), contrasted(), ball),
    }


def from_the_map_alone(floor, paths, renders=8, samples=64):
    """Images of a wall's scene by the directional distribution without the BRDF's help."""
    scene, surface = WALL.load(), WALL.surface(*MATERIALS["diffuse"])
    visibility, light = RayVisibility.of(scene), CellLight.of(contrasted(24), 64, 128)
    points, images = shading_points(surface), []
    for seed in range(renders):
        carried = path_map(
            *(visibility.tracer, points, key_words(jax.random.key(1000 + seed)), paths),
            light.cells.shape,
            reflectance=surface.reflectance,
        )
        guided = light.in_proportion(directional_distribution(carried, floor))
        words = key_words(jax.random.key(seed))
        proposed = proposals(Counts(environment=samples), guided, words, surface.reflectance)
        radiance = trace_and_sum(visibility.tracer, points, proposed, samples)
        images.append(to_image(surface, points, radiance))
    return np.stack(images)[:, np.asarray(surface.mask)].astype(np.float64)


def test_without_a_floor_light_is_missed():
    """Negative control: few paths miss cells that light comes from."""
    truth = exact(WALL.load(), contrasted(24), WALL.surface(*MATERIALS["diffuse"]), 4)
    with_floor = standard_errors_apart(from_the_map_alone(0.08, paths=8), truth)
    assert np.all(np.abs(with_floor) < 4.0)
    without = standard_errors_apart(from_the_map_alone(0.0, paths=8), truth)
    assert np.all(without < -4.0)


def test_hidden_light_is_drawn_less_and_the_noise_is_lower():
    scene, surface = WALL.load(), WALL.surface(*MATERIALS["diffuse"])
    noise = {
        name: renders(create(f"mc-{name}:spp=8"), scene, mostly_hidden(), surface, 4).var(axis=0)
        for name in ("environment", "mis", "ides", "ides-acdf")
    }
    noise = {name: variance.mean() for name, variance in noise.items()}
    assert noise["ides"] < 0.4 * min(noise["mis"], noise["environment"])
    assert noise["ides-acdf"] < noise["ides"]


@pytest.mark.parametrize("name", ["ides", "ides-acdf"])
def test_the_same_key_gives_the_same_bits_for_any_chunk(name, monkeypatch):
    monkeypatch.setattr(traced, "RAYS_PER_BLOCK", 1 << 12)
    monkeypatch.setattr(path_maps, "RAYS_PER_BLOCK", 1 << 8)  # several blocks of paths
    scene, surface = BALL.load(), BALL.surface(*MATERIALS["ggx"])
    images = []
    for chunk in (1, 1 << 14, 1 << 20):
        method = replace(ESTIMATORS[name], rays_per_chunk=chunk)
        visibility, light = method.precompute(scene), method.light(contrasted())
        images.append(method.shade(visibility, light, surface, key=jax.random.key(7)))
        other = method.shade(visibility, light, surface, key=jax.random.key(8))
        assert not np.array_equal(images[-1], other)
    for image in images[1:]:
        np.testing.assert_array_equal(image, images[0])


def test_the_paths_of_the_pre_pass_are_counted_as_rays():
    scene, surface = PLANE.load(), PLANE.surface(*MATERIALS["diffuse"])
    pixels = int(np.sum(surface.mask))
    traced_rays = {}
    for paths in (pixels, 10 * pixels):
        method = ImportanceDriven(4, paths=paths)
        visibility, light = method.precompute(scene), method.light(uniform_light())
        before = visibility.rays_traced
        method.shade(visibility, light, surface, key=jax.random.key(0))
        traced_rays[paths] = visibility.rays_traced - before
        assert method.evaluations(visibility, light, surface) == 4 * pixels
    # On an open plane every path leaves its triangle.
    assert traced_rays[10 * pixels] - traced_rays[pixels] == pytest.approx(9 * pixels, rel=0.02)


def test_lamps_and_darkness_and_an_empty_view():
    scene, surface = BOX.load(), BOX.surface(*MATERIALS["diffuse"])
    lit = lamps(((2.5, 1.5, 2.0), 0.4, 10.0))
    for method in (ImportanceDriven(4, paths=256), LocalImportanceDriven(4, paths=256)):
        plain = MonteCarlo("mis", 4)
        images = [
            one.shade(one.precompute(scene), one.light(lit), surface, key=jax.random.key(0))
            for one in (method, plain)
        ]
        np.testing.assert_array_equal(*images)  # the same rays to the lamp, black sky
        nothing = replace(surface, mask=jnp.zeros_like(surface.mask))
        black = method.shade(
            method.precompute(scene), method.light(lit), nothing, key=jax.random.key(0)
        )
        np.testing.assert_array_equal(black, 0.0)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("mc-ides:spp=0", "spp must be at least 1, got 0"),
        ("mc-ides:brdf=1.5", "brdf must be a share from 0 to 1, got 1.5"),
        ("mc-ides:paths=0", "paths must be at least 1, got 0"),
        ("mc-ides:floor=0", "floor must be above 0"),
        ("mc-ides:floor=1.5", "floor must be above 0 .* at most 1, got 1.5"),
        ("mc-ides:rays_per_chunk=0", "rays_per_chunk must be at least 1"),
        ("mc-ides-acdf:tolerance=-1", "tolerance must be at least 0 and below 0.5, got -1"),
        ("mc-ides:tolerance=0.1", "has no parameter 'tolerance'"),
    ],
)
def test_a_wrong_parameter_is_named(spec, message):
    with pytest.raises(ValueError, match=message):
        create(spec)


@pytest.mark.parametrize(
    ("method", "counts"),
    [
        (ImportanceDriven(8), (7, 1)),
        (ImportanceDriven(64), (56, 8)),
        (ImportanceDriven(2), (1, 1)),
        (ImportanceDriven(1), (1, 0)),
        (ImportanceDriven(8, brdf=0.5), (4, 4)),
        (ImportanceDriven(8, brdf=0.99), (1, 7)),
        (ImportanceDriven(8, brdf=0.0), (8, 0)),
        (LocalImportanceDriven(8, brdf=1.0), (0, 8)),
    ],
)
def test_samples_are_shared_out(method, counts):
    assert (method.counts.environment, method.counts.brdf) == counts


def test_a_key_is_required():
    surface = PLANE.surface(*MATERIALS["diffuse"])
    method = ImportanceDriven()
    with pytest.raises(ValueError, match="needs key="):
        method.shade(method.precompute(PLANE.load()), method.light(contrasted()), surface)
