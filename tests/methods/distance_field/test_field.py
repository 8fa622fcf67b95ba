"""Stored distance fields: files, bits, sizes, and the corners of the sides that pixels see."""

from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.methods.distance_field.build import (
    Angular,
    Spatial,
    Vertices,
    place_samples,
    sample_every_vertex,
)
from jaxvis.methods.distance_field.field import (
    ARRAYS,
    DistanceFields,
    corners_seen,
    packed,
    unpacked,
)
from jaxvis.methods.distance_field.maps import dense_maps
from jaxvis.scene import trace_surface
from jaxvis.scene.builtin import builtin_scene
from jaxvis.sphere.distance_host import signed_distances

ANGULAR = Angular(16, "adaptive", 8)
SPATIAL = Spatial(5.0, 0.5, 0.10, 0.05, 1, 0.12, 8, "linear", "distances")


@cache
def fields_of(name, **parameters):
    return sample_every_vertex(builtin_scene(name, **parameters), ANGULAR)


def same(one, other):
    return all(
        np.array_equal(np.asarray(getattr(one, name)), np.asarray(getattr(other, name)))
        for name in ARRAYS
    )


def test_a_saved_field_is_the_same(tmp_path):
    fields = fields_of("box-on-plane")
    fields.save(tmp_path / "field.npz")
    loaded = DistanceFields.load(tmp_path / "field.npz")
    assert same(fields, loaded)
    assert all(isinstance(getattr(loaded, name), jax.Array) for name in ARRAYS)
    assert loaded.rays_traced == fields.rays_traced > 0
    assert loaded.signed_distance.dtype == jnp.float16
    other = replace(fields, signed_distance=np.zeros_like(fields.signed_distance))
    assert not same(other, loaded)


def test_other_files_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such file"):
        DistanceFields.load(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("no arrays")
    with pytest.raises(ValueError, match="damaged or not a jaxvis file"):
        DistanceFields.load(tmp_path / "text.npz")


@pytest.mark.parametrize("size", [4, 5, 16, 33])
def test_bits_are_the_maps(size):
    maps = np.random.default_rng(size).random((7, size, size)) < 0.4
    bits = packed(maps)
    assert bits.shape == (7, -(-(size**2) // 8))
    np.testing.assert_array_equal(unpacked(bits, size), maps)


def test_a_field_holds_its_maps_and_their_distances():
    fields = fields_of("box-on-plane")
    assert fields.resolution == 16
    maps = fields.maps()
    assert maps.shape == fields.signed_distance.shape
    np.testing.assert_array_equal(np.asarray(fields.signed_distance) > 0.0, maps)
    np.testing.assert_array_equal(fields.signed_distance, signed_distances(maps))


def test_bytes_are_those_of_the_arrays():
    fields = fields_of("box-on-plane")
    count = len(fields.samples)
    # Two bytes a distance and a bit a texel, as in the paper.
    assert fields.signed_distance.nbytes == count * 16**2 * 2
    assert fields.bits.nbytes == count * 16**2 // 8
    assert fields.nbytes == sum(np.asarray(getattr(fields, name)).nbytes for name in ARRAYS)


def test_fields_are_pytrees_whose_count_of_rays_is_static():
    fields = fields_of("box-on-plane")
    assert len(jax.tree.leaves(fields)) == len(ARRAYS)
    assert jax.tree.map(lambda leaf: leaf, fields).rays_traced == fields.rays_traced


def test_each_vertex_that_is_not_buried_has_its_own_map():
    scene = builtin_scene("box-on-plane")
    fields = fields_of("box-on-plane")
    vertices = Vertices.of(scene)
    dense = dense_maps(scene.tracer, vertices.views(np.asarray(fields.samples)), 16)
    assert (fields.maps() == dense.maps).mean() > 0.99
    count = len(vertices.samples.positions)
    buried = np.setdiff1d(np.arange(count), fields.samples)
    assert 0 < len(buried) < 0.2 * count
    # A vertex with a sample has that sample's distances alone; a buried one those of others.
    own = np.asarray(fields.weights)[fields.samples]
    np.testing.assert_array_equal(own.max(axis=1), 1.0)
    np.testing.assert_array_equal(
        np.asarray(fields.near)[fields.samples, own.argmax(axis=1)], np.arange(len(fields.samples))
    )
    np.testing.assert_allclose(np.asarray(fields.weights)[buried].sum(axis=1), 1.0, atol=1e-5)


def of_pixels(name, size=(24, 18), **parameters):
    scene = builtin_scene(name, **parameters)
    surface = trace_surface(scene, scene.camera, size)
    mask = np.asarray(surface.mask)
    arrays = (surface.triangle, surface.geometric_normal, surface.barycentrics, surface.position)
    return scene, surface, *(np.asarray(leaf)[mask] for leaf in arrays)


@pytest.mark.parametrize("name", ["box-on-plane", "cap"])
def test_corners_and_barycentrics_give_the_pixels_place_on_the_side_seen(name):
    _, _, triangle, normal, barycentrics, position = of_pixels(name)
    fields = fields_of(name)
    corners = corners_seen(fields, triangle, normal)
    found = np.einsum("pk,pkc->pc", barycentrics, np.asarray(fields.positions)[corners])
    np.testing.assert_allclose(found, position, atol=1e-4)
    facing = np.einsum("pkc,pc->pk", np.asarray(fields.normals)[corners], normal)
    assert facing.min() > 0.99
    # Turned over, the cap's pixels see other vertices at the same places; a box has none.
    if name == "cap":
        both = np.asarray(fields.backs)[triangle, 0] >= 0
        assert both.any()
        other = corners_seen(fields, triangle[both], -normal[both])
        assert not np.isin(other, corners[both]).any()
        np.testing.assert_array_equal(
            np.asarray(fields.positions)[other], np.asarray(fields.positions)[corners[both]]
        )
    else:
        with pytest.raises(ValueError, match="two-sided before precomputing"):
            corners_seen(fields, triangle, -normal)


def test_backs_of_one_sided_triangles_beside_two_sided_ones_are_refused():
    _, _, triangle, normal, _, _ = of_pixels("cap")
    fields = fields_of("cap")
    one_sided = np.asarray(fields.backs)[triangle, 0] < 0
    assert one_sided.any()
    with pytest.raises(ValueError, match="backs of triangles without samples"):
        corners_seen(fields, triangle[one_sided], -normal[one_sided])


def test_surfaces_of_other_scenes_are_refused():
    _, _, triangle, normal, _, _ = of_pixels("box-on-plane")
    assert triangle.max() >= len(builtin_scene("plane").triangles)
    with pytest.raises(ValueError, match="another scene than the visibility's"):
        corners_seen(fields_of("plane"), triangle, normal)
    none = corners_seen(fields_of("plane"), triangle[:0], normal[:0])
    assert none.shape == (0, 3)


def test_vertices_out_of_view_have_no_weights():
    scene, surface, triangle, normal, _, _ = of_pixels("box-on-plane")
    fields = place_samples(scene, ANGULAR, SPATIAL, surface)
    seen = np.unique(corners_seen(fields, triangle, normal))
    weighed = np.flatnonzero(np.any(np.asarray(fields.weights) != 0.0, axis=1))
    np.testing.assert_array_equal(weighed, seen)
    assert np.isin(fields.samples, seen).all()
    assert len(seen) < len(fields.positions)
