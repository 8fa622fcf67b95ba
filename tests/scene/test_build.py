"""build_scene: what it checks, mends, welds, centres and freezes."""

import warnings

import numpy as np
import pytest
import trimesh

from jaxvis.errors import InvalidScene, JaxvisWarning
from jaxvis.reflectance import Lambert, Material, Phong, Texture
from jaxvis.scene import build_scene

QUAD = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def test_cube_has_three_normals_at_each_corner():
    cube = trimesh.creation.box()
    scene = build_scene(cube.vertices, cube.faces)
    assert len(scene.positions) == 24
    assert len(scene.triangles) == 12
    np.testing.assert_allclose(np.abs(scene.normals).max(axis=1), 1.0)
    np.testing.assert_array_equal(
        scene.normals[scene.triangles], np.repeat(scene.geometric_normals[:, None], 3, axis=1)
    )


def test_sphere_is_smooth():
    sphere = trimesh.creation.icosphere(3)
    scene = build_scene(sphere.vertices, sphere.faces)
    assert len(scene.positions) == 642
    assert np.abs(scene.normals - scene.positions).max() < 0.02


def test_unwelded_triangles_are_joined_again():
    sphere = trimesh.creation.icosphere(2)
    soup = sphere.vertices[sphere.faces].reshape(-1, 3)
    scene = build_scene(soup, np.arange(len(soup)).reshape(-1, 3))
    joined = build_scene(sphere.vertices, sphere.faces)
    assert len(scene.positions) == len(joined.positions) == 162
    np.testing.assert_allclose(
        scene.normals[scene.triangles], joined.normals[joined.triangles], atol=1e-6
    )


def test_no_two_vertices_share_position_and_normal():
    cube = trimesh.creation.box().subdivide()
    scene = build_scene(cube.vertices, cube.faces)
    rows = np.concatenate([scene.positions, np.round(scene.normals, 3)], axis=1) + 0.0
    assert len(np.unique(rows, axis=0)) == len(rows)


def test_unused_vertices_go_and_do_not_move_the_centre():
    points = np.concatenate([QUAD, [[1e9, 0, 0], [np.nan, 0, 0]]])
    scene = build_scene(points, FACES)
    assert len(scene.positions) == 4
    np.testing.assert_array_equal(scene.origin, [0.5, 0.5, 0.0])
    assert scene.diagonal == pytest.approx(np.sqrt(2.0))


def test_triangles_without_area_are_dropped_and_counted():
    faces = np.concatenate([FACES, [[0, 1, 1], [0, 4, 1]]])
    points = np.concatenate([QUAD, [[0.5, 0, 0]]])
    with pytest.warns(JaxvisWarning, match="dropped 2 of 4 triangles without area"):
        scene = build_scene(points, faces, material_ids=[0, 1, 0, 0], materials=(Material(),) * 2)
    assert len(scene.triangles) == 2
    np.testing.assert_array_equal(scene.material_ids, [0, 1])
    assert scene.notes == ("dropped 2 of 4 triangles without area",)


def test_far_away_scene_keeps_its_shape():
    sphere = trimesh.creation.icosphere(2)
    near = build_scene(sphere.vertices, sphere.faces)
    far = build_scene(sphere.vertices + np.array([1e6, -2e6, 3e6]), sphere.faces)
    np.testing.assert_allclose(far.positions, near.positions, atol=1e-7)
    np.testing.assert_allclose(far.origin, near.origin + [1e6, -2e6, 3e6])
    np.testing.assert_allclose(far.bounds, near.bounds + [1e6, -2e6, 3e6], rtol=1e-12)


def test_arrays_are_read_only_and_fields_fixed():
    scene = build_scene(QUAD, FACES, uvs=np.zeros((2, 3, 2)), colours=np.ones((2, 3, 3)))
    for name in ("positions", "normals", "triangles", "material_ids", "uvs", "colours", "origin"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(scene, name)[:] = 0
    with pytest.raises(AttributeError):
        scene.name = "other"


def test_the_callers_arrays_stay_writable_and_apart():
    points, faces = QUAD.copy(), FACES.astype(np.int32)
    uvs = np.zeros((2, 3, 2), np.float32)
    scene = build_scene(points, faces, uvs=uvs)
    points += 1.0
    faces[:] = 0
    uvs += 1.0
    assert scene.bounds[0, 0] == 0.0
    assert scene.triangles.max() == 3
    assert scene.uvs is not None
    assert scene.uvs.max() == 0.0


def test_given_normals_are_kept_at_unit_length():
    tilted = np.broadcast_to([0.6, 0.0, 0.8], (2, 3, 3))
    scene = build_scene(QUAD, FACES, normals=5.0 * tilted)
    np.testing.assert_allclose(scene.normals, np.broadcast_to([0.6, 0, 0.8], (4, 3)), atol=1e-7)
    assert scene.notes == ()


def test_normals_against_the_winding_are_turned():
    down = np.broadcast_to([0.0, 0.0, -1.0], (2, 3, 3))
    scene = build_scene(QUAD, FACES, normals=down)
    np.testing.assert_array_equal(scene.normals, np.broadcast_to([0.0, 0, 1], (4, 3)))
    assert scene.notes == ("turned the normals of 2 triangles to the front of their winding",)


def test_one_normal_behind_its_triangle_is_replaced():
    normals = np.tile([0.0, 0.0, 1.0], (2, 3, 1))
    normals[1, 1] = [0.8, 0.0, -0.6]
    scene = build_scene(QUAD, FACES, normals=normals)
    np.testing.assert_array_equal(scene.normals, np.broadcast_to([0.0, 0, 1], (4, 3)))
    assert scene.notes == ("replaced 1 corner normals that pointed behind their triangle",)


def test_zero_and_nan_normals_are_computed():
    normals = np.tile([0.0, 0.0, 1.0], (2, 3, 1))
    normals[0, 0], normals[1, 2] = 0.0, np.nan
    scene = build_scene(QUAD, FACES, normals=normals)
    np.testing.assert_array_equal(scene.normals, np.broadcast_to([0.0, 0, 1], (4, 3)))
    assert scene.notes == ("computed 2 corner normals that were zero or not finite",)


def test_uvs_do_not_split_vertices():
    uvs = np.random.default_rng(0).random((2, 3, 2))
    scene = build_scene(QUAD, FACES, uvs=uvs)
    assert len(scene.positions) == 4
    assert scene.uvs is not None
    np.testing.assert_allclose(scene.uvs, uvs, atol=1e-7)


def test_good_input_does_not_warn():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        build_scene(QUAD.astype(np.float32), FACES.astype(np.uint32))
        build_scene(QUAD.tolist(), FACES.tolist())


TEXTURED = Material(base_colour_texture=Texture(np.full((1, 1, 3), 0.5, np.float32)), name="bricks")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"positions": np.zeros((0, 3))}, "the mesh is empty"),
        ({"triangles": np.zeros((0, 3), int)}, "the mesh is empty"),
        ({"positions": np.zeros((4, 2))}, r"positions must be \[vertices, 3\], got \[4, 2\]"),
        ({"positions": "nonsense"}, "not numeric arrays"),
        ({"positions": [1.0, 2.0]}, r"positions must be \[vertices, 3\]"),
        ({"positions": [[0, 0, 0], [1, 0]]}, "not numeric arrays"),
        ({"positions": np.where(QUAD == 1, np.nan, QUAD)}, "3 of 4 vertices are NaN or infinite"),
        ({"positions": np.where(QUAD == 1, np.inf, QUAD)}, "3 of 4 vertices are NaN or infinite"),
        ({"positions": QUAD * [1.0, 0.0, 1.0]}, "none of the 2 triangles has an area"),
        ({"positions": QUAD * 1e60}, "larger than float32"),
        ({"triangles": [[0, 1, 4]]}, "vertex index 4 is out of range; there are 4 vertices"),
        ({"triangles": [[0, 1, -1]]}, "vertex index -1 is out of range"),
        ({"triangles": FACES.astype(float)}, "triangles must be integers"),
        ({"triangles": [[0, 1, 2, 3]]}, r"triangles must be integers \[triangles, 3\]"),
        ({"normals": np.ones((4, 3))}, r"normals must be per corner, \[2, 3, 3\], got \[4, 3\]"),
        ({"normals": [["a"]]}, "normals is not a numeric array"),
        ({"uvs": np.zeros((2, 3, 3))}, r"uvs must be per corner, \[2, 3, 2\]"),
        ({"uvs": np.full((2, 3, 2), np.nan)}, "texture coordinates are NaN"),
        ({"colours": np.full((2, 3, 3), 1.5)}, r"colours must be in \[0, 1\]"),
        ({"colours": np.full((2, 3, 3), np.nan)}, r"colours must be in \[0, 1\]"),
        ({"materials": ()}, "at least one material"),
        ({"materials": (TEXTURED,)}, "material 'bricks' has a texture but uvs are None"),
        ({"material_ids": [0, 1]}, r"material_ids must be in 0\.\.0"),
        ({"material_ids": [0]}, r"material_ids must be integers \[2\]"),
        ({"material_ids": [0.0, 0.0]}, r"material_ids must be integers \[2\]"),
        ({"crease_angle": 4.0}, r"crease_angle must be in \[0, pi\]"),
    ],
)
def test_bad_input_is_refused_in_one_line(changes, message):
    arguments = {"positions": QUAD, "triangles": FACES, "name": "broken", **changes}
    with pytest.raises(InvalidScene, match=message) as caught:
        build_scene(**arguments)
    assert str(caught.value).startswith("broken: ")
    assert "\n" not in str(caught.value)


def test_changed_copies_share_the_tracer():
    scene = build_scene(QUAD, FACES, reflectance=Lambert())
    tracer = scene.tracer
    other = scene.with_materials((Material(two_sided=True),))
    assert other.tracer is tracer
    assert other.materials[0].two_sided
    assert not scene.materials[0].two_sided
    assert other.geometry_hash == scene.geometry_hash
    with pytest.raises(ValueError, match="needs 1 materials, got 2"):
        scene.with_materials((Material(), Material()))


def test_one_grey_for_all_materials():
    colours = np.random.default_rng(0).random((len(FACES), 3, 3), np.float32)
    materials = [Material((1, 0, 0), two_sided=True)]
    scene = build_scene(
        QUAD, FACES, materials=materials, colours=colours, reflectance=Phong(), name="quad"
    )
    grey = scene.with_albedo(0.5)
    assert grey.materials == (Material((0.5, 0.5, 0.5), two_sided=True),)
    assert grey.colours is None
    assert grey.reflectance == Lambert()
    assert grey.notes == (*scene.notes, "all materials are one diffuse grey of albedo 0.5")
    assert grey.geometry_hash == scene.geometry_hash
    assert scene.materials == tuple(materials)
    for wrong in (-0.1, 1.5, float("nan")):
        with pytest.raises(ValueError, match=r"albedo must lie in \[0, 1\], got"):
            scene.with_albedo(wrong)


def test_geometry_hash_tells_scenes_apart():
    scene = build_scene(QUAD, FACES)
    assert scene.geometry_hash == build_scene(QUAD + 5.0, FACES).geometry_hash
    assert scene.geometry_hash != build_scene(QUAD * 2.0, FACES).geometry_hash
