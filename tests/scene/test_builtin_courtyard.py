"""The courtyard: its size, no gaps, no flipped faces, no faces in each other."""

import numpy as np
import pytest

from jaxvis.scene.builtin import builtin_scene
from jaxvis.scene.builtin.courtyard import HALF_X, HALF_Z, MATERIALS, WALL_TOP
from jaxvis.scene.builtin.courtyard_parts import arch, banner, column, curtain, vase
from jaxvis.scene.rays import RayTracer
from tests.scene.builtin_checks import least_alignment, sees_backs, sphere_directions

OPENING = np.array([HALF_X - 0.6, HALF_Z - 0.6])
"""Half the edges of the hole in the roof, between the cornices."""

# In the court, in all galleries, on both floors: none within a column or a cloth.
STANDPOINTS = [
    (x, y, z)
    for y in (1.7, 4.9, 7.7, 9.5)
    for x, z in ((-9.0, 0.0), (0.3, 5.4), (6.0, -5.4), (12.6, 0.4), (-12.6, -6.0), (5.1, 1.3))
]


@pytest.fixture(scope="module")
def scene():
    return builtin_scene("courtyard", triangles=40_000)


@pytest.mark.parametrize("triangles", [20_000, 60_000, 300_000])
def test_size_parameter(triangles):
    scene = builtin_scene("courtyard", triangles=triangles)
    assert len(scene.triangles) == pytest.approx(triangles, rel=0.1)
    assert scene.notes == ()
    assert np.allclose(scene.bounds, [[-15.0, -0.02, -7.75], [15.0, WALL_TOP, 7.75]], atol=1e-5)
    assert len(scene.positions) < len(scene.triangles)


def test_sizes_out_of_range():
    for triangles in (19_999, 300_001):
        with pytest.raises(
            ValueError, match="triangles must be a whole number from 20000 to 300000"
        ):
            builtin_scene("courtyard", triangles=triangles)


def test_materials(scene):
    assert set(np.unique(scene.material_ids)) == set(range(len(MATERIALS)))
    for material in scene.materials:
        assert material.two_sided == material.name.endswith("cloth")
        assert min(material.base_colour) > 0.02
        assert max(material.base_colour) < 0.85


def test_everywhere_fronts_are_seen(scene):
    directions = sphere_directions(4000)
    for point in STANDPOINTS:
        origins = np.broadcast_to(np.asarray(point) - scene.origin, directions.shape)
        # A ray through an edge of a silhouette may report the back of the edge's other triangle.
        assert sees_backs(scene, origins, directions) <= 1, point


def sky_through_roof_and_elsewhere(tracer, point):
    """Shares of the directions in which a point of the (centred) scene sees the sky."""
    directions = sphere_directions(20_000)
    free = ~tracer.occluded(np.broadcast_to(point, directions.shape), directions)
    rising = np.maximum(directions[:, 1:2], 1e-9)
    through = point[[0, 2]] + (10.9 - point[1]) / rising * directions[:, [0, 2]]
    inside = np.all(np.abs(through) < OPENING + 1e-4, axis=-1) & (directions[:, 1] > 0.0)
    return np.mean(free & inside), np.mean(free & ~inside)


def test_the_sky_comes_in_through_the_roof_alone(scene):
    centre = scene.origin * [1.0, 0.0, 1.0]
    # Tracing in world heights, for the opening's is known there.
    tracer = RayTracer(scene.positions + [0.0, scene.origin[1], 0.0], scene.triangles)
    shares = np.array(
        [sky_through_roof_and_elsewhere(tracer, point - centre) for point in STANDPOINTS]
    )
    assert np.all(shares[:, 1] == 0.0)
    assert shares[:, 0].max() > 0.2
    assert np.median(shares[:, 0]) > 0.005


def test_a_missing_wall_would_be_found(scene):
    names = np.array([material.name for material in scene.materials])[scene.material_ids]
    standing = scene.triangles[~np.isin(names, ["plaster", "stone"])]
    tracer = RayTracer(scene.positions + [0.0, scene.origin[1], 0.0], standing)
    assert sky_through_roof_and_elsewhere(tracer, np.array([0.3, 1.7, 5.4]))[1] > 0.01


def test_no_face_lies_in_another(scene):
    corners = scene.positions[scene.triangles].astype(float)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = 0.5 * np.linalg.norm(cross, axis=-1)
    assert areas.min() > 1e-5
    random = np.random.default_rng(5)
    chosen = random.choice(len(areas), 100_000, p=areas / areas.sum())
    weights = random.dirichlet([1.0, 1.0, 1.0], len(chosen))
    normals = scene.geometric_normals[chosen]
    above = np.einsum("ik,ikx->ix", weights, corners[chosen]) + 0.003 * normals
    hits = scene.tracer.closest_hit(above, -normals)
    near = (hits.triangle != chosen) & (hits.triangle >= 0) & (hits.distance < 0.006)
    parallel = np.abs(np.sum(normals * scene.geometric_normals[hits.triangle], axis=-1)) > 0.99
    # What is left are points on the edge between two triangles of one face.
    own_edge = weights.min(axis=-1) < 1e-4
    assert not np.any(near & parallel & ~own_edge)
    assert np.mean(hits.triangle == chosen) > 0.99


def test_floors_are_where_people_stand(scene):
    down = np.array([[0.0, -1.0, 0.0]])
    for x, y, z, floor in ((-9, 2, 0, 0.0), (0.3, 2, 5.4, 0.15), (0.3, 7.7, 5.4, 6.0)):
        hit = scene.tracer.closest_hit(np.array([[x, y, z]]) - scene.origin, down)
        assert y - hit.distance[0] == pytest.approx(floor, abs=1e-4)


@pytest.mark.parametrize("spacing", [0.1, 0.4])
@pytest.mark.parametrize(
    ("part", "size"),
    [
        (lambda spacing: column(3.0, 0.25, spacing), (0.75, 3.04, 0.75)),
        (lambda spacing: arch(2.75, 1.9, 1.0, 0.5, spacing), (2.75, 1.9, 0.5)),
        (lambda spacing: curtain(1.8, 3.0, 1, spacing), (1.8, 3.0, 0.3)),
        (lambda spacing: banner(1.4, 2.7, 0.34, spacing), (1.4, 3.0, 0.8)),
        (lambda spacing: vase(1.0, spacing), (0.68, 1.02, 0.68)),
    ],
    ids=["column", "arch", "curtain", "banner", "vase"],
)
def test_parts(part, size, spacing):
    mesh = part(spacing)
    assert least_alignment(mesh) > 0.0
    assert np.allclose(np.linalg.norm(mesh.normals[mesh.triangles], axis=-1), 1.0)
    assert np.allclose(np.ptp(mesh.positions, axis=0), size, rtol=0.05, atol=0.1)


def test_arch_has_the_area_of_a_wall_less_a_half_disc():
    mesh = arch(2.75, 1.9, 1.0, 0.5, 0.05)
    corners = mesh.positions[mesh.triangles]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2.0
    front = areas[areas[:, 2] > 1e-9].sum(axis=0)
    assert front == pytest.approx([0.0, 0.0, 2.75 * 1.9 - 0.5 * np.pi], abs=2e-3)
    under = np.linalg.norm(areas[np.abs(areas[:, 2]) < 1e-9], axis=-1).sum()
    assert under == pytest.approx(0.5 * np.pi, rel=2e-3)
