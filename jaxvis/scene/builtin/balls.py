"""Two balls that roll in a shallow dish (paper 002, Fig. 9 a-c)."""

from functools import cache, lru_cache

import numpy as np
import scipy
from jaxtyping import Float, Float64

from jaxvis.reflectance import Material, Mixed
from jaxvis.scene.animation import Animation, Pose
from jaxvis.scene.builtin.mesh import unit
from jaxvis.scene.builtin.moving import Grid, animate, body
from jaxvis.scene.builtin.noise import noise, smoothstep
from jaxvis.scene.builtin.parameters import Number, whole
from jaxvis.scene.builtin.textures import blend, texel_places, textured
from jaxvis.scene.camera import Camera
from jaxvis.scene.scene import Scene

FRAMES = 240
PERIOD = 96
"""Frames in which the balls go around once."""
BOWL = 2.4
"""Radius of the sphere that the dish's inside is part of; its own radius is 1."""
RADII = (0.24, 0.19)
ORBITS = ((0.60, 0.40, 0.3), (0.52, 0.44, 3.3))
"""Half axes of each ball's ellipse, and its phase."""
STEPS = 16
"""Turns that make up the rolling of a frame."""
CONTACT = 1e-3
"""Gap between a ball and the dish, as a share of the ball's radius."""
TEXELS = 640


def balls(frame: Number = 0, detail: Number = 120) -> Scene:
    """Two balls roll in a shallow dish without slipping.

    The balls have Blinn's model, the dish Cook and Torrance's (Beckmann); base colours, and the
    dish's specular colour and roughness, come from textures. 30,000 vertices.

    Args:
        frame: of the animation, 0 to 239, at 24 a second.
        detail: quads across the dish, 16 to 400; the balls' are as large.
    """
    frame = whole("frame", frame, 0, FRAMES - 1)
    return balls_animation(detail).scene(frame)


def balls_animation(detail: Number = 120) -> Animation:
    """All frames of :func:`balls`."""
    detail = whole("detail", detail, 16, 400)
    detail += detail % 2
    inside, outside = _dish(detail)
    dish = body([Grid(points, _from_above(points)) for points in (inside, outside)], 0)
    rest = np.concatenate([inside.reshape(-1, 3), outside.reshape(-1, 3)])
    still = dish.posed(rest)
    spheres = [_cube_sphere(round(0.19 * detail * radius / RADII[0])) for radius in RADII]
    rolling = [body(sphere, number + 1, lambda p: p) for number, sphere in enumerate(spheres)]
    directions = [
        np.concatenate([face.points.reshape(-1, 3) for face in sphere]) for sphere in spheres
    ]

    def pose(frame: int) -> list[Pose]:
        poses = [still]
        for number, direction in enumerate(directions):
            normals = direction @ _turn(number, frame).T
            centre = _centre(number, np.array(float(frame)))
            poses.append((centre + RADII[number] * normals, normals))
        return poses

    return animate(
        "balls",
        [dish, *rolling],
        pose,
        materials=(_glaze(), _paint(0), _paint(1)),
        reflectance=Mixed(),
        camera=Camera(eye=(0.55, 1.95, 2.6), target=(0.0, 0.05, 0.05), field_of_view=0.62),
        frames=FRAMES,
    )


def _centre(number: int, frame: Float[np.ndarray, "*frames"]) -> Float64[np.ndarray, "*frames 3"]:
    """Centre of a ball: on the sphere that it rolls on, above an ellipse."""
    half_x, half_z, phase = ORBITS[number]
    angle = 2.0 * np.pi * frame / PERIOD + phase
    radius = BOWL - RADII[number] * (1.0 + CONTACT)
    x, z = half_x * np.cos(angle), half_z * np.sin(angle)
    return np.stack([x, BOWL - np.sqrt(radius**2 - x * x - z * z), z], axis=-1)


@lru_cache(maxsize=1024)
def _turn(number: int, frame: int) -> Float64[np.ndarray, "3 3"]:
    """Orientation of a ball after it has rolled from frame 0 without slipping or spinning.

    At the point of contact the ball stands still: it turns at n x v / r for the velocity v of its
    centre and the dish's normal n.
    """
    if frame == 0:
        return scipy.spatial.transform.Rotation.from_rotvec([0.3, 0.5 + number, 0.2]).as_matrix()
    times = frame - 1 + np.linspace(0.0, 1.0, STEPS + 1)
    centres = _centre(number, times)
    middle = unit([0.0, BOWL, 0.0] - _centre(number, 0.5 * (times[1:] + times[:-1])))
    turns = np.cross(middle, np.diff(centres, axis=0)) / RADII[number]
    turned = _turn(number, frame - 1)
    for turn in turns:
        turned = scipy.spatial.transform.Rotation.from_rotvec(turn).as_matrix() @ turned
    return turned


def _dish(
    cells: int,
) -> tuple[Float64[np.ndarray, "rows columns 3"], Float64[np.ndarray, "rings around 3"]]:
    """The dish's inside, a square grid wrapped to the disc, and its rim and outside."""
    side = np.linspace(-1.0, 1.0, cells + 1)
    a, b = np.meshgrid(side, side, indexing="ij")
    inside = _over_bowl(*_disc(a, b))
    # The outside starts with the same points of the inside's edge.
    edge = np.concatenate([inside[0, :-1], inside[:-1, -1], inside[-1, :0:-1], inside[::-1, 0]])
    edge = edge[::-1]  # so that the front is outside
    angle = np.arctan2(edge[:, 2], edge[:, 0])
    profile = _outside_profile(2.0 / cells, float(edge[0, 1]))
    radius, height = profile[:, None, 0], profile[:, None, 1]
    outside = np.stack(
        np.broadcast_arrays(radius * np.cos(angle), height, radius * np.sin(angle)), axis=-1
    )
    outside[0] = edge
    return inside, outside


def _disc(
    a: Float[np.ndarray, "*points"], b: Float[np.ndarray, "*points"]
) -> tuple[Float[np.ndarray, "*points"], Float[np.ndarray, "*points"]]:
    """The square [-1, 1]^2 on the unit disc, area for area (Shirley and Chiu 1997)."""
    wide = np.abs(a) > np.abs(b)
    radius = np.where(wide, a, b)
    ratio = np.divide(np.where(wide, b, a), radius, out=np.zeros_like(a), where=radius != 0.0)
    angle = np.where(wide, 0.25 * np.pi * ratio, 0.5 * np.pi - 0.25 * np.pi * ratio)
    return radius * np.cos(angle), radius * np.sin(angle)


def _over_bowl(
    x: Float[np.ndarray, "*points"], z: Float[np.ndarray, "*points"]
) -> Float64[np.ndarray, "*points 3"]:
    return np.stack([x, BOWL - np.sqrt(BOWL**2 - x * x - z * z), z], axis=-1)


def _outside_profile(spacing: float, start: float) -> Float64[np.ndarray, "rows 2"]:
    """(radius, height) from the inside's edge over a flat rim and down to the foot."""
    corners = np.array(
        [
            (1.0, start),
            (1.035, start + 0.02),
            (1.16, start + 0.045),
            (1.19, start + 0.045),
            (1.19, start + 0.015),
            (1.10, start - 0.02),
            (0.80, 0.06),
            (0.60, -0.05),
        ]
    )
    # Corners are cut twice (Chaikin), which rounds them; the ends stay.
    for _ in range(3):
        cut = np.stack(
            [0.75 * corners[:-1] + 0.25 * corners[1:], 0.25 * corners[:-1] + 0.75 * corners[1:]], 1
        )
        corners = np.concatenate([corners[:1], cut.reshape(-1, 2)[1:-1], corners[-1:]])
    length = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=-1))]
    rows = np.linspace(0.0, length[-1], max(17, 2 + round(length[-1] / (2.7 * spacing))))
    return np.stack([np.interp(rows, length, corners[:, k]) for k in range(2)], axis=-1)


def _from_above(points: Float64[np.ndarray, "*points 3"]) -> Float64[np.ndarray, "*points 2"]:
    return 0.5 + points[..., [0, 2]] * np.array([1.0, -1.0]) / 2.6


MARGIN = 1.06
"""Faces of the texture atlas reach a little beyond their edge, for the lookup between texels."""


def _cube_sphere(cells: int) -> list[Grid]:
    """The unit sphere as six faces of a cube, even in angle, with places in a 3 x 2 atlas."""
    side = np.linspace(-1.0, 1.0, cells + 1)
    faces = []
    for face in range(6):
        a, b = np.meshgrid(side, side, indexing="ij")
        place = (np.stack([a, b], axis=-1) / MARGIN + 1.0) * 0.5
        faces.append(Grid(_on_face(face, a, b), (place + [face % 3, face // 3]) / [3.0, 2.0]))
    return faces


def _on_face(
    face: int, a: Float[np.ndarray, "*points"], b: Float[np.ndarray, "*points"]
) -> Float64[np.ndarray, "*points 3"]:
    axis, sign = face % 3, 1.0 - 2.0 * (face // 3)
    point = np.empty((*a.shape, 3))
    point[..., axis] = sign
    point[..., (axis + 1) % 3] = np.tan(0.25 * np.pi * a)
    point[..., (axis + 2) % 3] = np.tan(0.25 * np.pi * b)
    return unit(point)


@cache
def _paint(number: int) -> Material:
    """Lacquer: stripes on one ball, spots on the other. Blinn's model."""
    place = texel_places(TEXELS)
    place = place * [3.0, 2.0]
    column, row = np.floor(place[..., 0]).astype(int), np.floor(place[..., 1]).astype(int)
    local = (2.0 * (place - np.stack([column, row], axis=-1)) - 1.0) * MARGIN
    point = np.zeros((TEXELS, TEXELS, 3))
    for face in range(6):
        here = (column == face % 3) & (row == face // 3)
        point[here] = _on_face(face, local[here][:, 0], local[here][:, 1])
    if number == 0:
        turn = np.arctan2(point[..., 2], point[..., 0])
        mark = smoothstep(-0.06, 0.06, np.sin(3.0 * turn)) * smoothstep(
            0.93, 0.91, np.abs(point[..., 1])
        )
        base = blend(mark, (0.62, 0.60, 0.55), (0.55, 0.05, 0.03))
    else:
        corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        spots = np.concatenate([corners / np.sqrt(3.0), np.eye(3), -np.eye(3)])
        mark = smoothstep(0.945, 0.955, np.max(point @ spots.T, axis=-1))
        base = blend(mark, (0.03, 0.14, 0.38), (0.68, 0.55, 0.12))
    return Material(
        base_colour=(1.0, 1.0, 1.0),
        specular=(0.22, 0.22, 0.22),
        roughness=0.36,
        base_colour_texture=textured("", base, base, mark).base_colour_texture,
        name=("striped ball", "spotted ball")[number],
        model=0,
    )


@cache
def _glaze() -> Material:
    """Metal under a pattern of enamel. Cook and Torrance's model."""
    place = texel_places(TEXELS)
    x, z = 2.6 * (place[..., 0] - 0.5), -2.6 * (place[..., 1] - 0.5)
    radius, angle = np.hypot(x, z), np.arctan2(z, x)
    petals = np.cos(12.0 * angle) * 0.05
    ring = smoothstep(0.62, 0.64, radius + petals) * smoothstep(0.94, 0.92, radius - petals)
    leaf = smoothstep(0.0, 0.08, np.cos(24.0 * angle + 14.0 * radius))
    star = smoothstep(0.34, 0.32, radius + 0.09 * np.cos(8.0 * angle))
    enamel = np.maximum(ring * (0.25 + 0.75 * leaf), star)
    line = np.exp(-np.square((radius - 0.985) / 0.008)) + np.exp(-np.square((radius - 0.5) / 0.006))
    points = np.stack([6.0 * x, 6.0 * z, 0.0 * x], axis=-1)
    cloud = noise(points + 8.0, 4, seed=6)
    base = blend(enamel, (0.30, 0.25, 0.19), (0.02, 0.16, 0.17)) * (0.8 + 0.4 * cloud)[..., None]
    specular = blend(enamel, (0.42, 0.36, 0.27), (0.05, 0.05, 0.05))
    specular = blend(np.clip(line, 0.0, 1.0), specular, (0.70, 0.52, 0.22))
    roughness = 0.42 + 0.16 * (cloud - 0.5) - 0.10 * enamel
    return textured("dish", base, specular, roughness, model=1)
