"""Frames of one scene: the same vertices elsewhere, and everything that follows from it."""

import numpy as np
import pytest

from jaxvis.errors import InvalidScene
from jaxvis.scene import Animation, Camera, build_scene, load_animation, load_scene, moved_vertices
from jaxvis.scene.animation import still


@pytest.fixture(scope="module")
def animation():
    """Two unit squares at y = 0 and y = 1; the upper one rises by a quarter a frame."""
    square = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 1], [1, 0, 0]], float)
    positions = np.concatenate([square, square + [0, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    camera = Camera((0.5, 5.0, 4.0), (0.5, 0.5, 0.5))
    base = build_scene(positions, np.concatenate([faces, faces + 4]), camera=camera, name="lift")
    upper = base.positions[:, 1] + base.origin[1] > 0.5

    def pose(frame):
        rise = np.where(upper, 0.25 * frame, 0.0)[:, None] * [0.0, 1.0, 0.0]
        return base.positions + base.origin + rise, base.normals

    return Animation(base, pose, upper.astype(np.int32), frames=5, frames_per_second=10.0)


def down(scene, x=0.5, z=0.25):
    """Height, in the world, at which a ray from above meets the scene."""
    origin = np.array([[x, 9.0, z]]) - scene.origin
    hit = scene.tracer.closest_hit(origin, np.array([[0.0, -1.0, 0.0]]))
    corners = scene.positions[scene.triangles[hit.triangle[0]]]
    return float(hit.barycentrics[0] @ corners[:, 1] + scene.origin[1])


def test_frame_0_is_the_base(animation):
    assert animation.scene(0) is animation.base


@pytest.mark.parametrize("frame", [1, 4])
def test_frames_move_and_keep_their_numbers(animation, frame):
    base, scene = animation.base, animation.scene(frame)
    assert np.array_equal(scene.triangles, base.triangles)
    assert np.array_equal(scene.material_ids, base.material_ids)
    assert scene.camera == base.camera
    assert scene.materials == base.materials
    assert np.array_equal(scene.origin, base.origin)
    assert not scene.positions.flags.writeable
    # Nothing computed from the triangles is the base's.
    assert down(base) == pytest.approx(1.0)
    assert down(scene) == pytest.approx(1.0 + 0.25 * frame)
    assert scene.bounds[1, 1] == pytest.approx(1.0 + 0.25 * frame)
    assert base.bounds[1, 1] == pytest.approx(1.0)
    assert scene.geometry_hash != base.geometry_hash


def test_moved_vertices(animation):
    assert np.array_equal(animation.moved(0, 3), animation.parts == 1)
    assert np.array_equal(animation.moved(3, 1), animation.parts == 1)
    assert not animation.moved(2, 2).any()
    base = animation.base
    turned = base.normals.copy()
    turned[0] = [1.0, 0.0, 0.0]
    tilted = base.with_positions(base.positions, turned)
    assert moved_vertices(base, tilted).sum() == 1
    with pytest.raises(ValueError, match=r"'lift' and 'plane' have 8 and .* no frames of one"):
        moved_vertices(base, load_scene("plane"))


@pytest.mark.parametrize("frame", [-1, 5, 1.5, True, None])
def test_frames_that_are_not(animation, frame):
    with pytest.raises(ValueError, match=r"^scene 'lift' has frames 0 to 4, got [^\n]*$"):
        animation.checked(frame)


def test_still_scenes_have_one_frame(animation):
    one = still(animation.base)
    assert one.scene(0) is animation.base
    assert (one.frames, len(one.parts)) == (1, 8)
    with pytest.raises(ValueError, match="'lift' does not move: only frame 0, got 1"):
        one.scene(1)


def test_positions_and_normals_are_checked(animation):
    base = animation.base
    places, normals = base.positions, base.normals
    flat = places.copy()
    flat[base.triangles[0]] = flat[base.triangles[0, 0]]
    wrong = places.copy()
    wrong[3, 1] = np.nan
    for bad_places, bad_normals, message in (
        (places[:-1], normals[:-1], r"positions must be \[8, 3\] as before, got \[7, 3\]"),
        (wrong, normals, "positions are NaN or infinite"),
        (places, 2.0 * normals, "normals must be unit"),
        (flat, normals, "triangles have no area"),
    ):
        with pytest.raises(InvalidScene, match=f"^lift: .*{message}"):
            base.with_positions(bad_places, bad_normals)


def test_load_animation_of_names():
    moving = load_animation("hat:detail=16", two_sided=True)
    assert moving.frames > 1
    assert all(m.two_sided for m in moving.scene(3).materials)
    assert not any(m.two_sided for m in load_animation("hat:detail=16").base.materials)
    same = load_scene("hat:detail=16,frame=3")
    assert same.geometry_hash == moving.scene(3).geometry_hash
    assert load_animation("plane:cells=2").frames == 1
    with pytest.raises(ValueError, match="'hat:frame=3' is a single frame; leave out frame="):
        load_animation("hat:frame=3")
    with pytest.raises(ValueError, match="'hat' has no parameter 'size'; it has detail"):
        load_animation("hat:size=3")
    with pytest.raises(ValueError, match="scene 'hat': frame must be a whole number"):
        load_scene("hat:frame=100000")
    with pytest.raises(ValueError, match="unknown scene 'hats'"):
        load_animation("hats")
