"""Small meshes (positions, triangles) and scenes of them, for the tests of cone tracing."""

import numpy as np

from jaxvis.reflectance import Material
from jaxvis.scene import build_scene


def box(low, high, inward=False):
    """A closed box of 12 triangles that faces outwards, or inwards as a room."""
    corners = np.array(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    return corners.reshape(3, 8).T, faces[:, ::-1] if inward else faces


def heights(function, xs, zs):
    """The front of y = function(x, z) over a rectangular grid, upwards."""
    x, z = np.meshgrid(xs, zs, indexing="ij")
    points = np.stack([x, function(x, z) + 0.0 * x, z], axis=-1).reshape(-1, 3)
    number = np.arange(len(points)).reshape(len(xs), len(zs))
    a, b = number[:-1, :-1].ravel(), number[:-1, 1:].ravel()
    c, d = number[1:, 1:].ravel(), number[1:, :-1].ravel()
    return points, np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])


def flat_ground(size=4.0, cells=2, y=0.0):
    line = np.linspace(-0.5 * size, 0.5 * size, cells + 1)
    return heights(lambda x, z: y + 0.0 * x, line, line)


def ball(radius=1.0, rows=16, centre=(0.0, 0.0, 0.0)):
    """A closed sphere, outwards."""
    theta, phi = np.linspace(0, np.pi, rows + 1), np.linspace(0, 2 * np.pi, 2 * rows + 1)
    t, p = np.meshgrid(theta, phi, indexing="ij")
    points = np.stack([np.sin(t) * np.sin(p), np.cos(t), np.sin(t) * np.cos(p)], axis=-1)
    number = np.arange(points[..., 0].size).reshape(t.shape)
    a, b = number[:-1, :-1].ravel(), number[1:, :-1].ravel()
    c, d = number[1:, 1:].ravel(), number[:-1, 1:].ravel()
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])
    points = radius * np.round(points.reshape(-1, 3), 12)
    corners = points[faces]
    kept = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=-1
    )
    return points + np.asarray(centre), faces[kept > 1e-9 * radius]


WHITE = Material()


def scene(*meshes, materials=(WHITE,), kinds=None):
    """A scene of meshes; ``kinds`` says which material each is of."""
    starts = np.cumsum([0, *(len(points) for points, _ in meshes)])[:-1]
    kinds = [0] * len(meshes) if kinds is None else kinds
    return build_scene(
        np.concatenate([points for points, _ in meshes]),
        np.concatenate([faces + start for (_, faces), start in zip(meshes, starts, strict=True)]),
        materials=materials,
        material_ids=np.concatenate(
            [np.full(len(faces), kind) for (_, faces), kind in zip(meshes, kinds, strict=True)]
        ),
        crease_angle=0.0,
    )


def paint(*colour, two_sided=False):
    return Material(base_colour=colour or (0.8, 0.8, 0.8), two_sided=two_sided)
