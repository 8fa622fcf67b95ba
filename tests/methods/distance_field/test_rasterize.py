"""Rasterised maps against rays, exact solid angles and closed forms."""

import inspect
from dataclasses import replace
from itertools import pairwise

import jax.numpy as jnp
import numpy as np
import pytest

from jaxvis.methods.distance_field.rasterize import hemicube_texels, rasterized_maps
from jaxvis.scene import build_scene
from jaxvis.scene.builtin import builtin_scene
from jaxvis.sphere.frames import frame
from jaxvis.sphere.hemisphere_grid import texel_directions, texel_solid_angles

UPRIGHT = np.eye(3, dtype=np.float32)[None]


def hemicube_directions(faces):
    """Unit directions of the texel centres of a hemicube, in the order in which it is kept."""
    across = (2 * np.arange(faces) + 1) / faces - 1.0
    rise = (2 * np.arange(faces // 2) + 1) / faces
    v, u = np.meshgrid(across, across, indexing="ij")
    parts = [np.stack([u, v, np.ones_like(u)], axis=-1)]
    v, u = np.meshgrid(rise, across, indexing="ij")
    one = np.ones_like(u)
    sides = [(one, u, v), (-one, u, v), (u, one, v), (u, -one, v)]
    parts += [np.stack(side, axis=-1) for side in sides]
    directions = np.concatenate([part.reshape(-1, 3) for part in parts])
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def vertex_samples(scene, count, seed=0):
    """Origins just off some vertices, and their frames."""
    rng = np.random.default_rng(seed)
    chosen = rng.choice(len(scene.positions), min(count, len(scene.positions)), replace=False)
    normals = scene.normals[chosen]
    origins = (scene.positions[chosen] + 1e-4 * scene.diagonal * normals).astype(np.float32)
    tangent, bitangent = frame(jnp.asarray(normals))
    return origins, np.stack([tangent, bitangent, normals], axis=1).astype(np.float32)


def traced(scene, origins, frames, local):
    """Which local directions see the sky from each origin, and how near the nearest hit is."""
    free, nearest = [], []
    for origin, axes in zip(origins, frames, strict=True):
        world = (local @ axes).astype(np.float32)
        distance = scene.tracer.closest_hit(np.tile(origin, (len(world), 1)), world).distance
        free.append(np.isinf(distance))
        nearest.append(distance.min())
    return np.array(free), np.array(nearest)


def random_frames(count, seed):
    """Right-handed orthonormal rows, in all directions."""
    matrices = np.random.default_rng(seed).normal(size=(count, 3, 3))
    rows = np.linalg.qr(matrices)[0]
    return (rows * np.sign(np.linalg.det(rows))[:, None, None]).astype(np.float32)


def solid_angle(a, b, c):
    """Of a triangle seen from 0 (Van Oosterom and Strackee 1983)."""
    x, y, z = (np.linalg.norm(v) for v in (a, b, c))
    below = x * y * z + (a @ b) * z + (b @ c) * x + (c @ a) * y
    return 2.0 * abs(np.arctan2(a @ np.cross(b, c), below))


def above_horizon(triangle):
    """Solid angle of what of a triangle is above z = 0: clipped, and cut into a fan."""
    kept = []
    for p, q in zip(triangle, np.roll(triangle, -1, axis=0), strict=True):
        if p[2] > 0.0:
            kept.append(p)
        if p[2] * q[2] < 0.0:
            kept.append(p + (q - p) * p[2] / (p[2] - q[2]))
    return sum(solid_angle(kept[0], b, c) for b, c in pairwise(kept[1:]))


def occluded_solid_angle(visible):
    """Of each map."""
    return ((~visible).sum(axis=2) * texel_solid_angles(visible.shape[1])).sum(axis=1)


def one_triangle(corners):
    """A scene of one triangle, and the sample's origin, which is the corners' 0."""
    scene = build_scene(corners, [[0, 1, 2]])
    return scene, np.asarray(-scene.origin, np.float32)[None]


@pytest.mark.parametrize(("resolution", "faces"), [(16, 16), (33, 34), (64, 128), (64, 24), (1, 2)])
def test_texels_look_up_the_hemicube_texel_that_their_centre_falls_into(resolution, faces):
    local = texel_directions(resolution).reshape(-1, 3).astype(np.float64)
    found = hemicube_directions(faces)[hemicube_texels(resolution, faces)]
    # In the plane of the face that the found texel is on.
    largest = np.argmax(np.abs(found), axis=1)[:, None]
    apart = local / np.take_along_axis(local, largest, 1) - found / np.take_along_axis(
        found, largest, 1
    )
    assert np.abs(apart).max() <= 1.0 / faces + 1e-6


@pytest.mark.parametrize("name", ["box-on-plane", "sphere-on-plane", "torus-on-plane", "teapot"])
def test_maps_agree_with_rays(name):
    scene = builtin_scene(name)
    origins, frames = vertex_samples(scene, 150)
    local = texel_directions(64).reshape(-1, 3)
    rays, nearest = traced(scene, origins, frames, local)
    # A sample with an interesting sky, and not in the plane of another triangle at its own place
    # (beside a crease), where rays start on what they meet.
    chosen = (nearest > 0.0) & (rays.mean(axis=1) > 0.05) & (rays.mean(axis=1) < 0.95)
    assert chosen.sum() >= 20
    origins, frames, rays = origins[chosen], frames[chosen], rays[chosen]
    for faces in (64, 128):
        maps = rasterized_maps(scene, origins, frames, 64, faces=faces).reshape(rays.shape)
        assert (maps == rays).mean() >= 0.99
        # They differ only because a hemicube texel stands for all directions that fall into it:
        # through its centre a ray gives the same answer, unless it grazes an edge.
        looked_up = hemicube_directions(faces)[hemicube_texels(64, faces)]
        exact, _ = traced(scene, origins, frames, looked_up)
        assert (maps == exact).mean() >= 0.99998
    # The check can fail: a coarse hemicube is not good enough.
    coarse = rasterized_maps(scene, origins, frames, 64, faces=4).reshape(rays.shape)
    assert (coarse == rays).mean() < 0.96


@pytest.mark.parametrize("seed", range(40))
def test_a_triangle_anywhere_takes_its_solid_angle(seed):
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1.0, 1.0, (3, 3))
    scene, origin = one_triangle(corners)
    frames = random_frames(6, seed)
    maps = rasterized_maps(scene, np.repeat(origin, 6, axis=0), frames, 96, faces=256)
    exact = [above_horizon(corners @ axes.T.astype(np.float64)) for axes in frames]
    np.testing.assert_allclose(occluded_solid_angle(maps), exact, atol=0.012)


def test_the_exact_solid_angles_are_right():
    octant = np.eye(3)
    assert solid_angle(*octant) == pytest.approx(np.pi / 2)
    assert above_horizon(octant @ np.diag([1, 1, -1])) == 0.0
    standing = np.array([[1.0, -1.0, -1.0], [1.0, 1.0, -1.0], [1.0, 0.0, 1.0]])
    part = np.array([[1.0, -0.5, 0.0], [1.0, 0.5, 0.0], [1.0, 0.0, 1.0]])
    assert above_horizon(standing) == pytest.approx(solid_angle(*part))


@pytest.mark.parametrize("height", [1e-5, 0.1, 10.0])
def test_a_triangle_over_the_sample_covers_the_zenith_and_what_it_spans(height):
    corners = np.array([[3.0, -1.0, height], [-1.0, 3.0, height], [-2.0, -2.0, height]])
    maps = rasterized_maps(*one_triangle(corners), UPRIGHT, 128)
    assert not maps[0, 63:65, 63:65].any()
    assert occluded_solid_angle(maps)[0] == pytest.approx(solid_angle(*corners), abs=0.02)


def test_a_triangle_that_passes_behind_the_sample_has_no_image_there():
    # It stands in x = 1 and leans back below the horizon to x = -50.
    corners = np.array([[1.0, -4.0, 2.0], [1.0, 4.0, 2.0], [-50.0, 0.0, -8.0]])
    maps = rasterized_maps(*one_triangle(corners), UPRIGHT, 128)
    assert occluded_solid_angle(maps)[0] == pytest.approx(above_horizon(corners), abs=0.01)
    scene, origin = one_triangle(corners)
    rays, _ = traced(scene, origin, UPRIGHT, texel_directions(128).reshape(-1, 3))
    assert (maps.reshape(1, -1) == rays).mean() > 0.99


def test_a_triangle_wholly_below_or_seen_from_its_edge_covers_nothing():
    below = np.array([[1.0, -1.0, -0.1], [1.0, 1.0, -0.1], [2.0, 0.0, -1e-6]])
    assert rasterized_maps(*one_triangle(below), UPRIGHT, 64).all()
    # Its plane goes through the sample, and through texel centres of the hemicube.
    edge_on = np.array([[1.0, 0.125, 0.1], [2.0, 0.25, 0.1], [8.0, 1.0, 4.0]])
    assert rasterized_maps(*one_triangle(edge_on), UPRIGHT, 64, faces=8).all()


def test_both_sides_cast_shadows():
    corners = np.array([[3.0, -1.0, 1.0], [-1.0, 3.0, 1.0], [-2.0, -2.0, 1.0]])
    scene, origin = one_triangle(corners)
    turned = replace(scene, triangles=scene.triangles[:, ::-1].copy())
    front, back = (rasterized_maps(s, origin, UPRIGHT, 64) for s in (scene, turned))
    np.testing.assert_array_equal(front, back)
    assert not front.all()


def test_no_texel_falls_between_the_triangles_of_a_closed_surface():
    from trimesh.creation import icosphere

    ball = icosphere(subdivisions=3)
    scene = build_scene(ball.vertices, ball.faces)
    origins = np.random.default_rng(0).uniform(-0.4, 0.4, (40, 3)).astype(np.float32)
    maps = rasterized_maps(scene, origins, random_frames(40, 1), 64, faces=256)
    assert not maps.any()
    # A hole would show.
    holed = replace(scene, triangles=scene.triangles[1:], material_ids=scene.material_ids[1:])
    assert rasterized_maps(holed, origins, random_frames(40, 1), 64, faces=256).any()


@pytest.mark.parametrize("height", [1.0, 0.3, 7.7])
@pytest.mark.parametrize("faces", [6, 8, 22])
def test_vertices_and_edges_in_texel_centres_leave_no_gap(faces, height):
    # Texel centres are odd multiples of 1 / faces, as every second vertex is, but for rounding.
    step = np.arange(-faces - 1, faces + 2) / faces
    y, x = np.meshgrid(step, step, indexing="ij")
    roof = height * np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)
    corner = np.arange(len(roof)).reshape(x.shape)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
    triangles = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    scene = build_scene(roof, triangles)
    origin = np.asarray(-scene.origin, np.float32)[None]
    visible = rasterized_maps(scene, origin, UPRIGHT, 64, faces=faces).reshape(-1)
    top = hemicube_texels(64, faces) < faces**2
    assert not visible[top].any()
    # The roof ends between the uppermost row of texel centres of the sides and their top.
    assert visible[~top].all()


@pytest.mark.parametrize("distance", [0.5, 2.0, 6.0])
def test_a_wall_takes_its_share_of_the_sky(distance):
    # Form factor of a rectangle at right angles to the sample's plane: see the scene `wall`.
    height, half_width = 4.0, 4.0
    scene = builtin_scene("wall", height=height, width=2.0 * half_width)
    world = np.array([[distance, 1e-3, 0.0]]) - scene.origin
    axes = np.array([[[1, 0, 0], [0, 0, -1], [0, 1, 0]]], np.float32)
    visible = rasterized_maps(scene, world.astype(np.float32), axes, 128)[0]
    cosine = texel_directions(128)[..., 2]
    weight = cosine * texel_solid_angles(128)[:, None] / np.pi
    away = np.hypot(distance, height)
    taken = np.arctan(half_width / distance) - distance / away * np.arctan(half_width / away)
    assert (weight * ~visible).sum() == pytest.approx(taken / np.pi, abs=1.5e-3)


def test_threads_and_the_order_of_triangles_do_not_matter():
    scene = builtin_scene("torus-on-plane")
    origins, frames = vertex_samples(scene, 50)
    maps = rasterized_maps(scene, origins, frames, 48, threads=1)
    for threads in (2, 5):
        np.testing.assert_array_equal(
            maps, rasterized_maps(scene, origins, frames, 48, threads=threads)
        )
    order = np.random.default_rng(0).permutation(len(scene.triangles))
    shuffled = replace(
        scene, triangles=scene.triangles[order], material_ids=scene.material_ids[order]
    )
    np.testing.assert_array_equal(maps, rasterized_maps(shuffled, origins, frames, 48))


def test_samples_are_drawn_each_alone():
    scene = builtin_scene("box-on-plane")
    origins, frames = vertex_samples(scene, 21)
    maps = rasterized_maps(scene, origins, frames, 32)
    alone = [rasterized_maps(scene, origins[[i]], frames[[i]], 32)[0] for i in (0, 8, 20)]
    np.testing.assert_array_equal(maps[[0, 8, 20]], alone)
    assert rasterized_maps(scene, origins[:0], frames[:0], 32).shape == (0, 32, 32)


def test_bad_arguments():
    scene = builtin_scene("plane")
    origins, frames = vertex_samples(scene, 3)
    with pytest.raises(ValueError, match="resolution must be at least 1, got 0"):
        rasterized_maps(scene, origins, frames, 0)
    for faces in (0, 7):
        with pytest.raises(ValueError, match=f"even number of texels, at least 2, got {faces}"):
            rasterized_maps(scene, origins, frames, 8, faces=faces)
    with pytest.raises(ValueError, match="threads must be at least 1, got 0"):
        rasterized_maps(scene, origins, frames, 8, threads=0)
    # Without the type checks that tests wrap around it.
    with pytest.raises(ValueError, match="a frame for each origin, got 2 for 3"):
        inspect.unwrap(rasterized_maps)(scene, origins, frames[:2], 8)
    frames[1, 2] = np.nan
    with pytest.raises(ValueError, match="leave out sample 1"):
        rasterized_maps(scene, origins, frames, 8)
