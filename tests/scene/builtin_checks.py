"""What the tests of the built-in scenes share: shares of the sky by rays, sound meshes."""

import numpy as np

from jaxvis.scene.rays import offset_origins
from jaxvis.scene.weld import edge_sides, equal_rows


def cosine_directions(normal, count):
    """Directions about a normal, of density cos / pi: a spiral over Lambert's equal-area disc."""
    normal = np.asarray(normal, float) / np.linalg.norm(normal)
    radius2 = (np.arange(count) + 0.5) / count
    angle = 2.0 * np.pi * np.arange(count) * 0.6180339887498949
    tangent = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    tangent /= np.linalg.norm(tangent)
    radius = np.sqrt(radius2)[:, None]
    return (
        radius * np.cos(angle)[:, None] * tangent
        + radius * np.sin(angle)[:, None] * np.cross(normal, tangent)
        + np.sqrt(1.0 - radius2)[:, None] * normal
    )


def occluded_share(scene, point, normal=(0.0, 1.0, 0.0), count=20_000):
    """Form factor of what a point of the scene (world coordinates) sees, by rays."""
    normal = np.asarray(normal, float) / np.linalg.norm(normal)
    origin = offset_origins(np.asarray(point, float)[None] - scene.origin, normal[None])
    directions = cosine_directions(normal, count)
    return scene.tracer.occluded(np.repeat(origin, count, axis=0), directions).mean()


def sphere_directions(count):
    """Directions evenly spread over the sphere."""
    height = 1.0 - 2.0 * (np.arange(count) + 0.5) / count
    angle = 2.0 * np.pi * np.arange(count) * 0.6180339887498949
    radius = np.sqrt(1.0 - height**2)
    return np.stack([radius * np.cos(angle), height, radius * np.sin(angle)], axis=-1)


def sees_backs(scene, origins, directions):
    """How many rays (centred coordinates) meet the back of a one-sided face first."""
    hits = scene.tracer.closest_hit(origins, directions)
    hit = hits.triangle >= 0
    behind = np.sum(scene.geometric_normals[hits.triangle] * directions, axis=-1) > 0.0
    two_sided = np.array([material.two_sided for material in scene.materials])
    return int(np.sum(hit & behind & ~two_sided[scene.material_ids[hits.triangle]]))


def camera_rays(scene, width, height):
    directions = scene.camera.directions(width, height).reshape(-1, 3)
    eye = np.asarray(scene.camera.eye) - scene.origin
    return np.broadcast_to(eye, directions.shape), directions


def least_alignment(mesh):
    """The smallest cosine between a corner's normal and its triangle's."""
    corners = mesh.positions[mesh.triangles].astype(float)
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(area, axis=-1)
    assert length.min() > 0.0
    unit = area / length[:, None]
    return np.einsum("tkx,tx->tk", mesh.normals[mesh.triangles], unit).min()


def is_closed(mesh):
    """Whether every edge has two triangles, which run along it in opposite directions."""
    _, place = equal_rows(*mesh.positions.T)
    triangles = place[mesh.triangles]
    sides = edge_sides(triangles)
    if set(sides.count) != {2}:
        return False
    start = triangles.reshape(-1)[sides.side].reshape(-1, 2)
    return bool(np.all(start[:, 0] != start[:, 1]))


def volume(mesh):
    """Signed volume: positive if the mesh faces outwards."""
    a, b, c = np.moveaxis(mesh.positions[mesh.triangles].astype(float), 1, 0)
    return float(np.sum(a * np.cross(b, c)) / 6.0)
