"""Interpolated outlines: closed forms, a slow oracle, corners, edges and separate faces."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.methods.vectorized import evaluation
from jaxvis.methods.vectorized.correspondence import interpolated as module
from jaxvis.methods.vectorized.correspondence.interpolated import Outlines, interpolated
from jaxvis.methods.vectorized.evaluation import References
from jaxvis.methods.vectorized.irradiance import Quadrature, irradiance
from jaxvis.methods.vectorized.mesh import Mesh
from jaxvis.methods.vectorized.plan import sites_in_faces
from tests.methods.vectorized.analytic import (
    UP,
    horizon,
    polygons,
    random_map,
    random_polygons,
    table_light,
    uniform,
    window,
)
from tests.methods.vectorized.correspondence.staircases import corresponding, joined

BILINEAR = Quadrature("split", 2, "bilinear")
WHOLE = Quadrature("split", 1, "bilinear")
CORNERS = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
MODES = ("position", "direction")


@pytest.fixture(autouse=True)
def _one_size(monkeypatch):
    """All outlines take as long as the longest: fewer programs to compile."""
    monkeypatch.setattr(evaluation, "SIZES", 1)
    monkeypatch.setattr(module, "SIZES", 1)


def sites_at(visibility, faces, weights, normals=None):
    """Sites in faces, with the polygons' interpolated positions."""
    mesh, shape = Mesh.of(visibility.polygons), visibility.polygons
    faces, weights = np.asarray(faces, np.int32), np.asarray(weights, np.float32)
    corners = np.asarray(shape.positions)[mesh.faces[faces]]
    position = np.einsum("sk,skc->sc", weights, corners).astype(np.float32)
    if normals is None:
        normals = np.einsum("sk,skc->sc", weights, np.asarray(shape.normals)[mesh.faces[faces]])
    normals = np.asarray(normals / np.linalg.norm(normals, axis=-1, keepdims=True), np.float32)
    return sites_in_faces(visibility, mesh, faces, weights, position, normals, normals)


def seen(visibility, sites, interpolation):
    """Directions of the sites' joint outlines, [sites, vectors, 3], up to the longest list."""
    outlines = Outlines.of(visibility)
    references = References(sites.outline, *sites[:3], (), sites.weight)
    directions = jax.jit(interpolated, static_argnums=(2, 3))
    return np.stack(
        directions(outlines.lists, references, int(outlines.sizes[-1]), interpolation), axis=-1
    )


def round_windows(radii, height=1.0, count=60):
    """One triangle; above each corner, a round hole in a ceiling."""
    rings = [
        window(at + [0.0, height, 0.0], UP, r, count) for at, r in zip(CORNERS, radii, strict=True)
    ]
    shape = polygons(rings, CORNERS, [UP] * 3, [[0, 1, 2]])
    every = np.arange(count, dtype=np.int16)[:, None].repeat(3, axis=1)
    return joined(shape, [every])


def at_corners():
    """Four triangles; sites at their corners that have the triangles' outlines all the same."""
    triangles = np.arange(12).reshape(4, 3)
    visibility = corresponding(random_polygons(12, seed=5, triangles=triangles))
    weights = np.tile(np.maximum(np.eye(3), 1e-20), (4, 1))
    sites = sites_at(visibility, np.repeat(np.arange(4), 3), weights)
    assert np.all(sites.outline >= 0)
    return visibility, sites


WEIGHTS = np.array([[0.2, 0.3, 0.5], [0.6, 0.1, 0.3], [0.5, 0.5, 0.0], [0.0, 0.25, 0.75]])


def test_holes_above_the_corners_become_the_hole_above_the_place():
    """Positions of circles are circles: E = pi R^2 / (R^2 + h^2) with the mean radius.

    Negative control: directions are not those of a circle in the ceiling's plane.
    """
    visibility = round_windows((0.5, 1.0, 2.0))
    sites = sites_at(visibility, [0] * 4, WEIGHTS)
    radius = WEIGHTS @ [0.5, 1.0, 2.0]
    found = seen(visibility, sites, "position")[:, :60]
    ring = radius[:, None, None] * horizon(UP, 60)[None, :, :3] + UP
    np.testing.assert_allclose(found, ring, atol=1e-6)
    light = table_light(uniform(1.0, 64))
    value = irradiance(visibility, light, sites, BILINEAR, light.vector)[:, 0]
    np.testing.assert_allclose(value, np.pi * radius**2 / (radius**2 + 1.0), rtol=8e-3)
    other = seen(visibility, sites, "direction")[0, 0]
    assert abs(np.hypot(other[0], other[2]) / other[1] - radius[0]) > 0.05


def test_position_weights_by_distance_and_direction_does_not():
    """Two corners see a point ahead, at distances 1 and 3; two see points at infinity."""
    ahead = np.array([[1.0, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1]])
    aside = np.array([[0.0, 3, 0, 1], [0, 0, 3, 1], [3, 0, 0, 1]])
    far = np.array([[0.0, 1, 0, 0], [0, 0, 1, 0], [1, 0, 0, 0]])
    every = [np.arange(3)[:, None].repeat(3, axis=1)]
    for other, distance, expected in (
        (aside, 1.0, ([1.0, 3, 0], [1.0, 1, 0])),
        (far, 2.0, ([1.0, 2, 0], [1.0, 1, 0])),
        (far, 5.0, ([1.0, 5, 0], [1.0, 1, 0])),
    ):
        shape = polygons([ahead, other, other], np.zeros((3, 3)), [UP] * 3, [[0, 1, 2]])
        visibility = joined(shape, every, distances=[distance])
        sites = sites_at(visibility, [0], [[0.5, 0.3, 0.2]], [UP])
        for mode, wanted in zip(MODES, expected, strict=True):
            found = seen(visibility, sites, mode)[0, 0]
            unit = found / np.linalg.norm(found)
            np.testing.assert_allclose(unit, wanted / np.linalg.norm(wanted), atol=1e-6)


@pytest.mark.parametrize("mode", MODES)
def test_at_corners_the_outline_is_the_corner_s_polygon(mode):
    """All of its vectors, in their order, and nothing else."""
    visibility, sites = at_corners()
    shape, found = visibility.polygons, seen(visibility, sites, mode)
    for s in range(12):
        vectors = np.asarray(shape.vectors[s, :, : int(shape.counts[s])]).T
        exact = vectors[:, :3] - vectors[:, 3:] * np.asarray(shape.positions[s])
        start, stop = np.asarray(visibility.starts)[s // 3 : s // 3 + 2]
        order = np.asarray(visibility.triples)[start:stop, s % 3]
        assert set(order) == set(range(len(exact)))
        wanted = exact[order]
        if mode == "direction":
            wanted = wanted / np.linalg.norm(wanted, axis=-1, keepdims=True)
        np.testing.assert_allclose(found[s, : len(order)], wanted, atol=1e-6)
        assert np.all(found[s, len(order) :] == found[s, 0])


@pytest.mark.parametrize("mode", MODES)
def test_at_corners_the_irradiance_is_that_of_the_corner_s_polygon(mode):
    visibility, sites = at_corners()
    light = table_light(random_map())
    rule = replace(WHOLE, interpolation=mode)
    found = irradiance(visibility, light, sites, rule, light.vector)
    apart = sites._replace(outline=np.full_like(sites.outline, -1))
    expected = irradiance(visibility, light, apart, rule, light.vector)
    np.testing.assert_allclose(found, expected, atol=1e-5 * float(light.scalar.total.max()))


@pytest.mark.parametrize(
    ("rule", "mode"),
    [(WHOLE, "position"), (WHOLE, "direction"), (Quadrature("vsat", 1, "nearest"), "direction")],
    ids=str,
)
def test_irradiance_is_that_of_polygons_interpolated_one_by_one(rule, mode):
    """Each site's polygon, made in float64 of the triples' definition, as a polygon of its own."""
    rng = np.random.default_rng(2)
    triangles = np.stack([rng.permutation(20)[:3] for _ in range(15)])
    shape = random_polygons(20, seed=1, triangles=triangles)
    visibility = corresponding(shape, distances=rng.uniform(0.5, 3.0, 15))
    faces = rng.integers(0, 15, 30)
    sites = sites_at(visibility, faces, rng.dirichlet([1.0, 1.0, 1.0], 30))
    rings = []
    for s, face in enumerate(faces):
        span = slice(*np.asarray(visibility.starts)[face : face + 2])
        triples, corners = np.asarray(visibility.triples)[span], np.asarray(shape.triangles)[face]
        total = 0.0
        for k in range(3):
            q = np.asarray(shape.vectors, np.float64)[corners[k]][:, triples[:, k]].T
            d = q[:, :3] - q[:, 3:] * sites.position[s]
            if mode == "direction":
                d /= np.linalg.norm(d, axis=-1, keepdims=True)
            else:
                d = np.where(q[:, 3:] > 0, d, float(visibility.distances[face]) * d)
            total = total + sites.weight[s, k] * d
        rings.append(np.concatenate([total, np.zeros((len(total), 1))], axis=1))
    alone = polygons(rings, sites.position, sites.normal, np.zeros((0, 3)), capacity=80)
    own = np.stack([np.arange(30), *[np.full(30, -1)] * 2], axis=-1).astype(np.int32)
    first = np.tile(np.float32([1.0, 0.0, 0.0]), (30, 1))
    single = sites._replace(polygon=own, weight=first, outline=np.full(30, -1, np.int32))
    light = table_light(random_map())
    rule = replace(rule, interpolation=mode)
    found = irradiance(visibility, light, sites, rule, light.vector)
    expected = irradiance(alone, light, single, rule, light.vector)
    np.testing.assert_allclose(found, expected, atol=1e-5 * float(light.scalar.total.max()))


def square():
    """Two triangles that share an edge, whose corners come in different orders."""
    return random_polygons(4, seed=9, triangles=[[0, 1, 2], [3, 2, 1]])


def test_faces_that_share_an_edge_have_one_outline_there():
    """That of the first face with triples: shorter than the face's, blind to its third corner."""
    visibility = corresponding(square())
    a = sites_at(visibility, [0], [[0.0, 0.25, 0.75]])
    b = sites_at(visibility, [1], [[0.0, 0.75, 0.25]])
    for one, other in zip(a, b, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-7)
    outlines, length = Outlines.of(visibility), int(np.diff(visibility.starts)[0])
    assert outlines.counts[a.outline[0]] <= length
    triples = np.asarray(visibility.triples)[:length, 1:]
    kept = len(np.unique(triples, axis=0))
    assert outlines.counts[a.outline[0]] == kept
    moved = replace(
        visibility,
        polygons=replace(
            visibility.polygons,
            vectors=visibility.polygons.vectors.at[0, :3].add(7.0),
        ),
    )
    for mode in MODES:
        np.testing.assert_array_equal(seen(moved, a, mode), seen(visibility, a, mode))
        inside = sites_at(visibility, [0], [[0.2, 0.2, 0.6]])
        assert np.abs(seen(moved, inside, mode) - seen(visibility, inside, mode)).max() > 0.1
    # The other face's, where the first is separate.
    half = corresponding(square(), separate=[True, False])
    edge = sites_at(half, [0, 1], [[0.0, 0.25, 0.75], [0.0, 0.75, 0.25]])
    assert edge.outline[0] == edge.outline[1] >= 0
    assert sites_at(half, [0], [[0.2, 0.2, 0.6]]).outline[0] == -1


def test_edges_lose_only_repeated_vectors():
    """With the face's list instead, the irradiance on the edge is the same."""
    visibility = corresponding(square())
    edge = sites_at(visibility, [0], [[0.0, 0.4, 0.6]])
    whole = edge._replace(outline=np.zeros(1, np.int32))
    assert Outlines.of(visibility).counts[0] > Outlines.of(visibility).counts[edge.outline[0]]
    light = table_light(random_map())
    found, expected = (
        irradiance(visibility, light, each, WHOLE, light.vector) for each in (edge, whole)
    )
    np.testing.assert_allclose(found, expected, atol=1e-5 * float(light.scalar.total.max()))


def test_separate_faces_have_three_integrals_bit_for_bit():
    shape = random_polygons(30, triangles=np.arange(30).reshape(10, 3))
    rng = np.random.default_rng(0)
    faces, weights = rng.integers(0, 10, 40), rng.dirichlet([1.0, 1.0, 1.0], 40)
    visibility = corresponding(shape, separate=np.ones(10, bool))
    sites = sites_at(visibility, faces, weights)
    light = table_light(random_map())
    expected = irradiance(shape, light, sites, WHOLE, light.vector)
    found = irradiance(visibility, light, sites, WHOLE, light.vector)
    np.testing.assert_array_equal(found, expected)
    assert sites.references == 120
    # And beside others.
    some = np.arange(10) % 2 == 0
    mixed = corresponding(shape, separate=some)
    sites = sites_at(mixed, faces, weights)
    np.testing.assert_array_equal(sites.outline < 0, some[faces])
    assert sites.references == 3 * some[faces].sum() + (~some[faces]).sum()
    found = irradiance(mixed, light, sites, WHOLE, light.vector)
    rounding = 1e-5 * float(light.scalar.total.max())
    np.testing.assert_allclose(found[some[faces]], expected[some[faces]], atol=rounding)
    assert np.abs(found - expected)[~some[faces]].max() > 100.0 * rounding


def test_buried_corners_do_not_count():
    shape = replace(square(), buried=jnp.array([True, False, False, False]))
    visibility = corresponding(shape)
    sites = sites_at(visibility, [0, 0], [[0.5, 0.1, 0.4], [0.3, 0.7, 0.0]])
    np.testing.assert_allclose(sites.weight.sum(axis=1), 1.0, atol=1e-6)
    # Inside the face the other two corners' list, on its edge the other corner's polygon.
    assert sites.outline[0] == Outlines.of(visibility).of_edge[Mesh.of(shape).edges[0, 0]]
    assert sites.outline[1] == -1
    np.testing.assert_array_equal(np.sort(sites.polygon[1]), [-1, -1, 1])


def test_triples_that_are_not_evaluated_are_left_out():
    visibility = round_windows((1.0, 1.0, 1.0))
    thinned = replace(visibility, evaluated=jnp.arange(60) % 2 == 0)
    sites = sites_at(thinned, [0], [[0.2, 0.3, 0.5]])
    assert Outlines.of(thinned).counts[0] == 30
    found, whole = (seen(each, sites, "position")[0] for each in (thinned, visibility))
    np.testing.assert_allclose(found[:30], whole[:60:2], atol=1e-6)
    np.testing.assert_array_equal(found[30:], np.broadcast_to(found[:1], found[30:].shape))
