"""Height fields and other meshes, and which of them one map of heights can hold."""

import numpy as np
import pytest
from scipy.spatial import KDTree

from jaxvis.methods.cones.classify import (
    THRESHOLD,
    height_field_distance,
    height_field_meshes,
    mesh_ids,
)
from jaxvis.reflectance import Material
from jaxvis.scene.build import build_scene


def join(*meshes):
    starts = np.cumsum([0, *(len(p) for p, _ in meshes)])
    return (
        np.concatenate([p for p, _ in meshes]),
        np.concatenate([t + start for (_, t), start in zip(meshes, starts, strict=False)]),
    )


def moved(mesh, offset=(0.0, 0.0, 0.0), scale=1.0):
    return mesh[0] * np.asarray(scale) + np.asarray(offset), mesh[1]


def flipped(mesh):
    return mesh[0], mesh[1][:, ::-1]


def swept(points):
    """Two triangles per quad of points [rows, columns, 3]."""
    rows, columns = points.shape[:2]
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b = number[:-1, :-1].ravel(), number[1:, :-1].ravel()
    c, d = number[1:, 1:].ravel(), number[:-1, 1:].ravel()
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])
    flat = points.reshape(-1, 3)
    area = np.linalg.norm(
        np.cross(flat[faces[:, 1]] - flat[faces[:, 0]], flat[faces[:, 2]] - flat[faces[:, 0]]),
        axis=-1,
    )
    return flat, faces[area > 1e-12]


def ground(height=lambda x, z: 0.0 * x, cells=32):
    """Heights over the unit square, front up."""
    x, z = np.meshgrid(np.linspace(0, 1, cells + 1), np.linspace(0, 1, cells + 1))
    return swept(np.stack([x, height(x, z), z], axis=-1))


def ball(lowest=np.pi, rows=48):
    """A unit sphere down to an angle from the top, welded where it closes."""
    theta, phi = np.meshgrid(
        np.linspace(0, lowest, rows), np.linspace(0, 2 * np.pi, 2 * rows), indexing="ij"
    )
    points = np.stack(
        [np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)], axis=-1
    )
    return swept(np.round(points, 12))


def box(low, high):
    corners = (
        np.array(np.meshgrid(*zip(low, high, strict=True), indexing="ij"))
        .reshape(3, 8)
        .T.astype(float)
    )
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def hills(x, z):
    return 0.1 * np.sin(9 * x) * np.cos(7 * z)


CUBE = box((0, 0, 0), (1, 1, 1))
OPEN_BOX = (CUBE[0], np.delete(CUBE[1], [4, 5], axis=0))
BRIDGE = join(
    box((0, 1, 0), (6, 1.2, 1)), box((0.5, 0, 0.2), (0.8, 1, 0.8)), box((5, 0, 0.2), (5.3, 1, 0.8))
)
TREE = join(box((-0.1, 0, -0.1), (0.1, 1.5, 0.1)), moved(ball(rows=16), (0, 2.3, 0)))

HEIGHT_FIELDS = {
    "terrain": ground(hills, 64),
    "plane": ground(cells=2),
    "tilted plane": ground(lambda x, z: 4.0 * x + 2.0 * z, 2),
    "dome": ball(np.pi / 2),
    "one triangle": (np.array([[0, 0, 0], [0, 0.1, 1], [1, 0.2, 0.0]]), np.array([[0, 1, 2]])),
}
OTHERS = {
    "closed sphere": ball(),
    "closed box": CUBE,
    "box without a floor": OPEN_BOX,
    "bridge": BRIDGE,
    "tree": TREE,
    "upright plane": (
        np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
    ),
}


@pytest.mark.parametrize("resolution", [32, 512])
@pytest.mark.parametrize("name", HEIGHT_FIELDS)
def test_height_fields_are_far_below_the_threshold(name, resolution):
    distance = height_field_distance(*HEIGHT_FIELDS[name], resolution)
    assert distance < 0.1 * THRESHOLD, f"{name}: {distance}"


@pytest.mark.parametrize("resolution", [32, 512])
@pytest.mark.parametrize("name", OTHERS)
def test_other_meshes_are_far_above_the_threshold(name, resolution):
    distance = height_field_distance(*OTHERS[name], resolution)
    assert distance > 30 * THRESHOLD, f"{name}: {distance}"


def test_distances_of_a_box_and_a_sphere_are_the_closed_forms():
    # The floor (1/6 of the area) is 1 from the roof, the walls (4/6) are 1/2 on average.
    expected = (1 / 6 + 4 / 6 / 2) / np.sqrt(3)
    assert height_field_distance(*OTHERS["closed box"]) == pytest.approx(expected, rel=0.05)
    # Below the equator, at latitude -a: 2 sin(a/2) from the rim; its mean over the half sphere is
    # int_0^(pi/2) 2 sin(a/2) cos(a) da = 0.55228.
    expected = 0.5 * 0.55228 / np.sqrt(12)
    # Samples a cell apart stop a little above the rim.
    assert height_field_distance(*OTHERS["closed sphere"]) == pytest.approx(expected, rel=0.08)


def test_a_sheet_beneath_counts_by_its_distance():
    """A second floor of half the area at depth d is d/2 away on average, whatever the cells."""
    floor = ground(cells=4)
    for depth in (0.001, 0.01, 0.1):
        both = join(floor, moved(floor, (0, -depth, 0)))
        expected = 0.5 * depth / np.sqrt(2 + depth**2)
        assert height_field_distance(*both, 64) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize(("resolution", "expected"), [(64, 0.0042), (128, 0.0021), (512, 0.0005)])
def test_distances_between_vertices_fail_a_plane(resolution, expected):
    """Negative control, spec 4.2: 0.38 spacings between vertices, even for a flat square."""
    centre = (np.arange(resolution) + 0.5) / resolution
    samples = np.stack(np.meshgrid(centre, centre), axis=-1).reshape(-1, 2)
    points = np.random.default_rng(0).random((20_000, 2))
    between = KDTree(samples).query(points)[0].mean() / np.sqrt(2)
    assert between == pytest.approx(expected, rel=0.06)
    assert (between > THRESHOLD) == (resolution < 256)
    assert height_field_distance(*HEIGHT_FIELDS["plane"], resolution) < 0.1 * THRESHOLD


@pytest.mark.parametrize("name", ["tree", "bridge", "terrain", "closed sphere"])
def test_the_distance_does_not_depend_on_place_size_or_heading(name):
    positions, triangles = (HEIGHT_FIELDS | OTHERS)[name]
    before = height_field_distance(positions, triangles, 128)
    turned = np.stack([positions[:, 2], positions[:, 1], -positions[:, 0]], axis=-1)
    for other in (positions + [300.0, -70.0, 20.0], 250.0 * positions, 1e-3 * positions, turned):
        after = height_field_distance(other, triangles, 128)
        assert after == pytest.approx(before, rel=0.03, abs=0.05 * THRESHOLD)


def test_meshes_of_no_use_are_refused():
    plane = HEIGHT_FIELDS["plane"]
    with pytest.raises(ValueError, match="resolution"):
        height_field_distance(*plane, 1)
    with pytest.raises(ValueError, match="no triangles"):
        height_field_distance(plane[0], plane[1][:0])
    with pytest.raises(ValueError, match="area"):
        height_field_distance(np.zeros((3, 3)), np.array([[0, 1, 2]]))
    with pytest.raises(ValueError, match="threshold"):
        height_field_meshes(scene(plane), threshold=0.0)


def scene(*meshes, two_sided=False):
    material = Material(two_sided=two_sided)
    return build_scene(*join(*meshes), materials=[material], crease_angle=0.0)


def kept(*meshes, **options):
    """Which of the meshes go to 2D, each as a whole."""
    marked = height_field_meshes(scene(*meshes, **options))
    parts = np.split(marked, np.cumsum([len(t) for _, t in meshes])[:-1])
    assert all(part.all() or not part.any() for part in parts)
    return [bool(part.all()) for part in parts]


def test_meshes_are_connected_through_equal_positions():
    """Flat shaded boxes share positions but no vertices; touching at one corner is enough."""
    made = scene(CUBE, moved(CUBE, (5, 0, 0)), moved(CUBE, (1, 1, 1)))
    assert len(made.positions) > 8 * 3
    np.testing.assert_array_equal(mesh_ids(made), np.repeat([0, 1, 0], 12))


def test_mesh_numbers_are_those_of_a_search_through_neighbours():
    rng = np.random.default_rng(2)
    triangles = np.array([rng.choice(150, 3, replace=False) for _ in range(50)])
    made = build_scene(rng.random((150, 3)), triangles)
    corners = [{tuple(p) for p in made.positions[t]} for t in made.triangles]
    ids = -np.ones(len(corners), int)
    for first in range(len(corners)):
        if ids[first] >= 0:
            continue
        found, number = [first], ids.max() + 1
        while found:
            one = found.pop()
            ids[one] = number
            near = [k for k in range(len(corners)) if ids[k] < 0 and corners[k] & corners[one]]
            found += near
    assert ids.max() > 2
    np.testing.assert_array_equal(mesh_ids(made), ids)


def test_ground_is_2d_and_what_stands_on_it_is_not():
    world = moved(ground(hills, 64), scale=(20, 20, 20))
    house = box((4, -1, 4), (6, 4, 7))
    bridge = moved(BRIDGE, (8, 1, 12))
    tree = moved(TREE, (15, 1, 5))
    # The parts of the bridge and of the tree only touch, or do not even.
    assert kept(world, house) == [True, False]
    marked = height_field_meshes(scene(world, house, bridge, tree))
    assert marked[: len(world[1])].all()
    assert not marked[len(world[1]) :].any()


def test_of_height_fields_above_each_other_the_widest_stays():
    floor = moved(ground(hills, 16), scale=(10, 1, 10))
    roof = moved(ground(cells=4), (3, 5, 3), (2, 1, 2))
    beneath = moved(roof, (0, -20, 0))
    assert kept(roof, floor, beneath) == [False, True, False]
    assert kept(floor, moved(roof, (20, 0, 0)), beneath) == [True, True, False]
    assert kept(roof) == [True]


def test_neighbouring_tiles_share_the_map():
    tile = ground(hills, 16)
    gap = 1e-4  # less than a cell
    beside = [moved(tile, (offset, 0, 0)) for offset in (0, 1 + gap, 2 + 2 * gap)]
    assert kept(*beside) == [True, True, True]
    assert kept(tile, moved(tile, (0.9, 0.3, 0))) == [True, False]


def test_ceilings_go_to_3d():
    floor = ground(hills, 16)
    assert kept(flipped(floor)) == [False]
    assert kept(flipped(floor), two_sided=True) == [True]


def test_specks_go_to_3d_and_a_triangle_alone_does_not():
    floor = moved(ground(hills, 16), scale=1000.0)
    speck = moved(ground(cells=1), (2000.2, 0, 10.1), 0.01)
    assert kept(floor, speck) == [True, False]
    assert kept(HEIGHT_FIELDS["one triangle"]) == [True]


def test_many_meshes_are_judged_as_each_alone():
    rng = np.random.default_rng(5)
    shapes = [*HEIGHT_FIELDS.values(), *(OTHERS[n] for n in ("closed box", "closed sphere"))]
    right = [True] * len(HEIGHT_FIELDS) + [False] * 2
    which = rng.integers(len(shapes), size=60)
    meshes = [
        moved(shapes[k], (6.0 * (n % 8), rng.normal(), 6.0 * (n // 8)), rng.uniform(0.5, 2.0))
        for n, k in enumerate(which)
    ]
    assert kept(*meshes) == [right[k] for k in which]
