"""A walking figure with a hat on a textured plane (paper 002, Figs. 8 and 9 d-f)."""

from collections.abc import Callable
from functools import cache, partial

import numpy as np
from jaxtyping import Float64, Int

from jaxvis.reflectance import CookTorrance, Material
from jaxvis.scene.animation import Animation, Pose
from jaxvis.scene.builtin import figure_parts as parts
from jaxvis.scene.builtin.gait import CYCLE, CYCLES, Figure, figure
from jaxvis.scene.builtin.hat_shape import Stance, hat_grid, hat_points
from jaxvis.scene.builtin.moving import Grid, animate, body
from jaxvis.scene.builtin.noise import noise, smoothstep
from jaxvis.scene.builtin.parameters import Number, whole
from jaxvis.scene.builtin.textures import blend, texel_places, textured
from jaxvis.scene.camera import Camera
from jaxvis.scene.scene import Scene

FRAMES = CYCLE * CYCLES
"""A round; the motion repeats after it."""
GROUND = 3.6
"""Edge of the plane, metres."""
TEXELS = 768

GROUND_MATERIAL, SKIN, SHIRT, TROUSERS, SHOES, HAT = range(6)

LEG = (
    (0.00, 0.084, 0.096, -0.005),
    (0.20, 0.084, 0.092, 0.002),
    (0.48, 0.060, 0.064, 0.006),
    (0.56, 0.058, 0.062, 0.004),
    (0.70, 0.060, 0.068, -0.012),
    (0.92, 0.050, 0.056, -0.004),
    (1.00, 0.052, 0.058, -0.002),
)
ARM = (
    (0.00, 0.058, 0.062, 0.0),
    (0.20, 0.052, 0.056, 0.0),
    (0.42, 0.043, 0.046, 0.0),
    (0.50, 0.040, 0.044, 0.0),
    (0.70, 0.036, 0.040, 0.0),
    (0.785, 0.033, 0.037, 0.0),
    (0.80, 0.022, 0.029, 0.0),
    (0.83, 0.021, 0.030, 0.0),
    (0.91, 0.022, 0.044, 0.004),
    (1.00, 0.016, 0.036, 0.010),
)
CUFF = 0.795
"""Where the sleeve ends along the arm."""
TRUNK = (
    (0.00, -0.095, 0.135, 0.095, -0.005),
    (0.12, -0.020, 0.172, 0.120, -0.010),
    (0.25, 0.080, 0.158, 0.112, -0.004),
    (0.45, 0.230, 0.148, 0.105, 0.002),
    (0.68, 0.400, 0.178, 0.118, -0.004),
    (0.84, 0.515, 0.192, 0.098, -0.022),
    (0.92, 0.562, 0.150, 0.080, -0.026),
    (0.97, 0.592, 0.085, 0.065, -0.022),
    (1.00, 0.606, 0.062, 0.058, -0.018),
)
BELT = 0.205
"""Where the shirt starts along the trunk."""
HEAD = (
    (0.00, 0.020, 0.052, 0.055, -0.020),
    (0.18, 0.085, 0.052, 0.056, -0.008),
    (0.30, 0.120, 0.056, 0.070, 0.010),
    (0.40, 0.145, 0.062, 0.084, 0.018),
    (0.55, 0.195, 0.074, 0.096, 0.012),
    (0.72, 0.245, 0.078, 0.100, 0.006),
    (0.88, 0.295, 0.072, 0.094, 0.000),
    (1.00, 0.330, 0.066, 0.088, -0.002),
)


def walker(frame: Number = 0, detail: Number = 130) -> Scene:
    """A figure with a hat walks in a circle on a plane of polished and rough stone.

    The figure is diffuse; textures give the plane's base colour, specular colour and roughness
    under Cook and Torrance's model (Beckmann). 32,000 vertices.

    Args:
        frame: of the animation, 0 to 129, at 24 a second; it repeats.
        detail: quads along the edge of the plane, 16 to 400; the figure's are half as large.
    """
    frame = whole("frame", frame, 0, FRAMES - 1)
    return walker_animation(detail).scene(frame)


def walker_animation(detail: Number = 130) -> Animation:
    """All frames of :func:`walker`."""
    scale = whole("detail", detail, 16, 400) / 130.0
    side = np.linspace(0.0, 1.0, round(130 * scale) + 1)
    places = np.stack(np.meshgrid(side, side), axis=-1)
    plane = np.stack(
        [GROUND * (places[..., 0] - 0.5), 0.0 * places[..., 0], GROUND * (0.5 - places[..., 1])], -1
    )
    shapes = _shapes(scale)
    start = figure(0)
    bodies = [body([Grid(plane, places)], GROUND_MATERIAL)]
    bodies += [
        body([Grid(make(start), at)], material, closed=True) for make, at, material in shapes
    ]
    still = bodies[0].posed(plane.reshape(-1, 3))

    def pose(frame: int) -> list[Pose]:
        stance = figure(frame)
        moved = [make(stance).reshape(-1, 3) for make, _, _ in shapes]
        return [still, *(b.posed(points) for b, points in zip(bodies[1:], moved, strict=True))]

    return animate(
        "walker",
        bodies,
        pose,
        materials=_materials(),
        reflectance=CookTorrance("beckmann"),
        camera=Camera(eye=(2.3, 2.2, 4.0), target=(0.0, 0.7, 0.0), field_of_view=0.62),
        frames=FRAMES,
    )


Points = Float64[np.ndarray, "rows columns 3"]
MaterialOf = int | Callable[[Float64[np.ndarray, "triangles 2"]], Int[np.ndarray, "triangles"]]
Shape = tuple[Callable[[Figure], Points], parts.Places, MaterialOf]


def _shapes(scale: float) -> list[Shape]:
    """Every part of the figure: its points, the grid that they stand on, and its material."""

    def grid(rows: int, columns: int) -> parts.Places:
        return parts.ring_places(max(10, round(rows * scale)), max(10, round(columns * scale)))

    leg, arm, shoe = grid(52, 36), grid(44, 26), grid(26, 26)
    trunk, head = grid(44, 64), grid(44, 46)
    hat_places = hat_grid(max(12, round(44 * scale)), max(16, round(80 * scale)))
    felt = hat_points(hat_places, Stance())
    sleeved = partial(_split, CUFF, SHIRT, SKIN)
    dressed = partial(_split, BELT, TROUSERS, SHIRT)

    def leg_points(side: int, f: Figure) -> Points:
        return parts.limb(leg, f.legs[side], 0.05, 0.022, LEG, (0.07, 0.03))

    def arm_points(side: int, f: Figure) -> Points:
        return parts.limb(arm, f.arms[side], 0.035, 0.165, ARM, (0.08, 0.07))

    def shoe_points(side: int, f: Figure) -> Points:
        return parts.shoe(shoe, f.feet[side])

    shapes: list[Shape] = []
    for side in (0, 1):
        shapes += [
            (partial(leg_points, side), leg, TROUSERS),
            (partial(shoe_points, side), shoe, SHOES),
            (partial(arm_points, side), arm, sleeved),
        ]
    return [
        *shapes,
        (lambda f: parts.trunk(trunk, f.pelvis, f.chest, TRUNK), trunk, dressed),
        (lambda f: parts.head(head, f.chest, HEAD), head, SKIN),
        (lambda f: f.chest.place(felt * 0.98 + [0.0, 0.262, 0.0]), hat_places, HAT),
    ]


def _split(
    limit: float, below: int, above: int, at: Float64[np.ndarray, "triangles 2"]
) -> Int[np.ndarray, "triangles"]:
    """Material of triangles by where they are along a part."""
    return np.where(at[:, 1] < limit, below, above)


@cache
def _materials() -> tuple[Material, ...]:
    return (
        _stone(),
        Material(base_colour=(0.55, 0.33, 0.22), name="skin"),
        Material(base_colour=(0.10, 0.22, 0.42), name="shirt"),
        Material(base_colour=(0.13, 0.10, 0.08), name="trousers"),
        Material(base_colour=(0.05, 0.03, 0.02), name="shoes"),
        Material(base_colour=(0.42, 0.29, 0.16), name="felt"),
    )


def _stone() -> Material:
    """Square slabs, polished and rough by turns, with a mosaic band around them."""
    place = texel_places(TEXELS)
    slabs = 9.0
    u, v = slabs * place[..., 0], slabs * place[..., 1]
    column, row = np.floor(u), np.floor(v)
    inside = 0.5 - np.maximum(np.abs(u - column - 0.5), np.abs(v - row - 0.5))
    joint = smoothstep(0.024, 0.012, inside)
    dark = (column + row) % 2.0
    shade = noise(np.stack([1.7 * column + 0.3, 1.7 * row + 0.3, 0.0 * u], axis=-1), 1, seed=8)
    points = np.stack([1.4 * u, 1.4 * v, 0.7 * column + 1.3 * row], axis=-1)
    vein = np.abs(2.0 * noise(points, 4, seed=9) - 1.0)
    vein = smoothstep(0.10, 0.0, vein)
    cloud = noise(2.0 * points + 7.0, 4, seed=10)
    light = np.asarray([0.56, 0.50, 0.40]) * (0.8 + 0.4 * shade)[..., None]
    deep = np.asarray([0.16, 0.13, 0.12]) * (0.7 + 0.6 * shade)[..., None]
    base = blend(dark, light, deep) * (0.75 + 0.5 * cloud)[..., None]
    base = blend(0.5 * vein, base, (0.45, 0.40, 0.34))
    base = blend(joint, base, (0.20, 0.18, 0.16))
    polish = np.clip(dark * (0.75 + 0.5 * cloud) + 0.15, 0.0, 1.0) * (1.0 - joint)
    specular = blend(polish, (0.03, 0.03, 0.03), (0.14, 0.13, 0.12))
    roughness = 0.72 - 0.40 * polish + 0.1 * (cloud - 0.5)
    return textured("stone", base, specular, roughness)
