"""Scenes whose lighting is known in closed form, for tests and for getting to know a method.

The answers are irradiances E under a uniform sphere of radiance L: E = pi L (1 - F), where F is the
cosine-weighted share of the hemisphere about the normal (the form factor) that is occluded. Those
for points of the plane hold whatever its size; those for points above it are for an infinite plane,
and at a height h over one of edge s the band of sky below the horizon adds some h / s.

Materials are white and diffuse (albedo 0.8) except where said.
"""

from collections.abc import Sequence

import numpy as np

from jaxvis.reflectance import Material
from jaxvis.scene.build import build_scene
from jaxvis.scene.builtin import shapes
from jaxvis.scene.builtin.mesh import Mesh, fan, join, weld
from jaxvis.scene.builtin.parameters import Number, length, whole
from jaxvis.scene.camera import Camera
from jaxvis.scene.scene import Scene

WHITE = Material(name="white")


def plane(size: Number = 10.0, cells: Number = 8) -> Scene:
    """The plane y = 0 under the open sky: E = pi L everywhere.

    Args:
        size: edge of the square.
        cells: quads along each edge, 1 to 512.
    """
    size = length("size", size)
    return _scene("plane", [_ground(size, cells)], size)


def wall(
    height: Number = 4.0, width: Number = 8.0, size: Number = 16.0, cells: Number = 16
) -> Scene:
    """A wall on a plane, its front in the plane x = 0 and facing +x: half of the sky at its foot.

    At a distance d in front of the middle, a rectangle of height h and half width a takes

        F = (atan(a/d) - d/r atan(a/r)) / pi,  r = sqrt(d^2 + h^2),

    so that E = pi L / 2 at its foot (d -> 0), whatever its size. The wall itself faces half of the
    sky: E = pi L / 2 everywhere on its front. (Siegel and Howell, Thermal Radiation Heat Transfer,
    configuration factor of a plane element and a rectangle at right angles.)

    Args:
        height: of the wall.
        width: of the wall, along z.
        size: edge of the plane, more than twice the width and the height.
        cells: quads along each edge of the plane, 1 to 512.
    """
    size = length("size", size)
    height = length("height", height, high=0.5 * size)
    width = length("width", width, high=0.9 * size)
    thickness = 0.05 * size
    standing = shapes.box((thickness, height + 0.01 * size, width), height / 8.0)
    standing = standing.moved((-0.5 * thickness, -0.01 * size, 0.0))
    return _scene("wall", [_ground(size, cells), standing], size)


def box_on_plane(
    width: Number = 2.0, height: Number = 2.0, size: Number = 12.0, cells: Number = 16
) -> Scene:
    """A box with a square floor plan on a plane.

    A point of the plane at a distance d before the middle of a face sees nothing of the box but
    that face, so that F is that of :func:`wall` with a = width / 2. On the box's top E = pi L.

    Args:
        width: edge of the floor plan, centred on the origin.
        height: of the box.
        size: edge of the plane, more than the box' width.
        cells: quads along each edge of the plane, 1 to 512.
    """
    size = length("size", size)
    width = length("width", width, high=0.9 * size)
    height = length("height", height, high=size)
    buried = 0.01 * size
    solid = shapes.box((width, height + buried, width), width / 8.0).moved((0.0, -buried, 0.0))
    return _scene("box-on-plane", [_ground(size, cells), solid], size)


def sphere(radius: Number = 1.0, rows: Number = 24, albedo: Number = 0.8) -> Scene:
    """A sphere alone: nothing hides the sky from a convex body, E = pi L everywhere.

    With albedo 1 it sends out the radiance L that falls on it, and cannot be seen before the sky.

    Args:
        radius: of the sphere, on which the vertices lie.
        rows: bands of latitude, 3 to 512; there are twice as many of longitude.
        albedo: diffuse reflectance, at most 1.
    """
    radius = length("radius", radius)
    ball = shapes.sphere(radius, whole("rows", rows, 3, 512))
    grey = length("albedo", albedo, high=1.0, zero=True)
    material = Material(base_colour=(grey, grey, grey), name="grey")
    return _scene("sphere", [ball], 2.6 * radius, material)


def sphere_on_plane(
    radius: Number = 1.0,
    clearance: Number = 0.0,
    size: Number = 12.0,
    cells: Number = 16,
    rows: Number = 24,
) -> Scene:
    """A sphere on a plane, or floating above it.

    With its centre c = radius + clearance above the plane, at a distance D from a point of the
    plane, the sphere takes F = (radius / D)^2 (c / D) of the point's sky. A point of the sphere
    whose normal rises by sin(e) = n_y sees the sky above the horizon alone: E = pi L (1 + n_y) / 2.

    Args:
        radius: of the sphere, on which the vertices lie.
        clearance: between the sphere's lowest point and the plane, 0 or more.
        size: edge of the plane.
        cells: quads along each edge of the plane, 1 to 512.
        rows: bands of latitude, 3 to 512.
    """
    size = length("size", size)
    radius = length("radius", radius, high=0.45 * size)
    lift = radius + max(length("clearance", clearance, zero=True), _contact(radius))
    ball = shapes.sphere(radius, whole("rows", rows, 3, 512)).moved((0.0, lift, 0.0))
    return _scene("sphere-on-plane", [_ground(size, cells), ball], size)


def cap(
    radius: Number = 1.0,
    height: Number = 1.0,
    size: Number = 8.0,
    cells: Number = 16,
    around: Number = 96,
) -> Scene:
    """A horizontal disc above a plane, two-sided: it hides a spherical cap from the point below.

    Below its middle the disc takes F = radius^2 / (radius^2 + height^2), the cap of half angle
    atan(radius / height) about the zenith. The polygon has the disc's area.

    Args:
        radius: of the disc.
        height: of the disc above the plane.
        size: edge of the plane.
        cells: quads along each edge of the plane, 1 to 512.
        around: segments of the disc's edge, 8 to 4096.
    """
    size = length("size", size)
    radius, height = length("radius", radius, high=size), length("height", height, high=size)
    segments = whole("around", around, 8, 4096)
    turn = 2.0 * np.pi / segments
    edge = radius * np.sqrt(turn / np.sin(turn))
    angle = turn * (np.arange(segments + 1) % segments)
    ring = np.stack([edge * np.cos(angle), np.full_like(angle, height), edge * np.sin(angle)], -1)
    disc = fan((0.0, height, 0.0), ring, (0.0, -1.0, 0.0))
    material = Material(two_sided=True, name="white, two-sided")
    return _scene("cap", [_ground(size, cells), disc], size, material)


def furnace(size: Number = 4.0, cells: Number = 8) -> Scene:
    """A closed room about the origin, seen from inside: no sky at all, E = 0 everywhere.

    Args:
        size: edge of the cube, whose faces are its inside.
        cells: quads along each edge, 1 to 512.
    """
    size = length("size", size)
    spacing = size / whole("cells", cells, 1, 512)
    outside = shapes.box((size, size, size), spacing).moved((0.0, -0.5 * size, 0.0))
    room = Mesh(outside.positions, -outside.normals, outside.triangles[:, ::-1])
    third = size / 3.0
    camera = Camera(eye=(-third, 0.3 * third, third), target=(third, -0.5 * third, -third))
    return _scene("furnace", [room], size, camera=camera)


def torus_on_plane(
    ring_radius: Number = 2.0,
    tube_radius: Number = 0.6,
    sphere_radius: Number = 0.9,
    size: Number = 14.0,
    cells: Number = 24,
    around: Number = 48,
) -> Scene:
    """A torus lying on a plane, with a sphere in its middle (or none).

    Without the sphere, the torus hides from the middle of the plane the sky up to the elevation
    2 atan(tube_radius / ring_radius) =: 2 b all around, so that E = pi L cos(2 b)^2 there. With it,
    E = pi L at the sphere's highest point if that is above the torus.

    Args:
        ring_radius: from the axis to the middle of the tube.
        tube_radius: of the tube, less than ``ring_radius``.
        sphere_radius: of the sphere, which must fit into the hole; 0 leaves it out.
        size: edge of the plane.
        cells: quads along each edge of the plane, 1 to 512.
        around: segments of the ring, 8 to 1024; half as many go around the tube.
    """
    size = length("size", size)
    ring = length("ring_radius", ring_radius, high=0.45 * size)
    tube = length("tube_radius", tube_radius, high=0.99 * ring)
    segments = whole("around", around, 8, 1024)
    meshes = [_ground(size, cells)]
    lying = shapes.torus(ring, tube, segments, max(6, segments // 2))
    meshes.append(lying.moved((0.0, tube + _contact(tube), 0.0)))
    # The sphere touches the tube if their centres, both at rest, are the radii apart.
    largest = 0.999 * ring**2 / (4.0 * tube)
    radius = length("sphere_radius", sphere_radius, high=largest, zero=True)
    if radius > 0.0:
        ball = shapes.sphere(radius, max(4, segments // 2))
        meshes.append(ball.moved((0.0, radius + _contact(radius), 0.0)))
    return _scene("torus-on-plane", meshes, size)


def _contact(radius: float) -> float:
    """A gap that keeps a round body, at rest, from sharing a point with the plane."""
    return 1e-3 * radius


def _ground(size: float, cells: Number) -> Mesh:
    return shapes.ground(size, whole("cells", cells, 1, 512))


def _scene(
    name: str,
    meshes: Sequence[Mesh],
    size: float,
    last: Material = WHITE,
    camera: Camera | None = None,
) -> Scene:
    """White meshes, the last one of another material if given, seen from the front and above."""
    mesh = weld(join(meshes))
    materials = (last,) if len(meshes) == 1 or last == WHITE else (WHITE, last)
    part = np.repeat(np.arange(len(meshes)), [len(piece.triangles) for piece in meshes])
    view = Camera(eye=(0.42 * size, 0.42 * size, 0.75 * size), target=(0.0, 0.05 * size, 0.0))
    return build_scene(
        mesh.positions,
        mesh.triangles,
        normals=mesh.normals[mesh.triangles],
        materials=materials,
        material_ids=np.where(part == len(meshes) - 1, len(materials) - 1, 0),
        camera=camera or view,
        name=name,
    )
