"""A deforming cowboy hat on a folded cloth (paper 002, Fig. 1)."""

from functools import cache

import numpy as np
from jaxtyping import Float, Float64

from jaxvis.reflectance import CookTorrance, Material
from jaxvis.scene.animation import Animation, Pose
from jaxvis.scene.builtin.hat_shape import Stance, hat_grid, hat_points
from jaxvis.scene.builtin.moving import Grid, animate, body
from jaxvis.scene.builtin.noise import noise, smoothstep
from jaxvis.scene.builtin.parameters import Number, whole
from jaxvis.scene.builtin.textures import blend, texel_places, textured
from jaxvis.scene.camera import Camera
from jaxvis.scene.scene import Scene

FRAMES = 120
"""The motion repeats after these."""
CLOTH = 0.92
"""Edge of the cloth, metres."""
GAP = 0.001
"""Between the hat and the cloth where they are nearest."""
YAW = 0.5
TEXELS = 512


def hat(frame: Number = 0, detail: Number = 110) -> Scene:
    """A cowboy hat that bends and breathes on a piece of folded cloth, both of varying reflectance.

    Textures give base colour, specular colour and roughness of both under Cook and Torrance's model
    (Beckmann): satin stripes on the cloth, a leather band on the felt. The hat is of felt 5 mm
    thick and touches the cloth, which does not move. 21,000 vertices.

    Args:
        frame: of the animation, 0 to 119, at 24 a second; it repeats.
        detail: quads along the edge of the cloth, 16 to 400; the hat's are as large.
    """
    frame = whole("frame", frame, 0, FRAMES - 1)
    return hat_animation(detail).scene(frame)


def hat_animation(detail: Number = 110) -> Animation:
    """All frames of :func:`hat`."""
    detail = whole("detail", detail, 16, 400)
    places = _square(detail)
    cloth = _cloth(places)
    hat_places = hat_grid(max(16, round(0.68 * detail)), max(16, round(1.09 * detail)))
    cloth_body = body([Grid(cloth, places)], 0)
    hat_body = body([Grid(hat_points(hat_places, Stance()), hat_places)], 1, closed=True)
    still = cloth_body.posed(cloth.reshape(-1, 3))

    def pose(frame: int) -> list[Pose]:
        return [still, hat_body.posed(_resting(hat_points(hat_places, _stance(frame))))]

    return animate(
        "hat",
        [cloth_body, hat_body],
        pose,
        materials=(_cloth_material(), _hat_material()),
        reflectance=CookTorrance("beckmann"),
        camera=Camera(eye=(0.40, 0.74, 0.94), target=(0.0, 0.04, 0.0), field_of_view=0.52),
        frames=FRAMES,
    )


def _stance(frame: int) -> Stance:
    time = 2.0 * np.pi * frame / FRAMES
    return Stance(
        curl=0.45 * np.sin(2.0 * time),
        dip=0.016 * np.sin(time + 0.6),
        swell=0.06 * np.sin(2.0 * time + 1.0),
    )


def _resting(points: Float64[np.ndarray, "rows columns 3"]) -> Float64[np.ndarray, "points 3"]:
    """Turned, and let down on the cloth until they touch."""
    cosine, sine = np.cos(YAW), np.sin(YAW)
    turned = points.reshape(-1, 3) @ np.array([[cosine, 0, -sine], [0, 1, 0], [sine, 0, cosine]])
    above = turned[:, 1] - _height(turned[:, 0], turned[:, 2])
    return turned + [0.0, GAP - above.min(), 0.0]


def _square(cells: int) -> Float64[np.ndarray, "rows columns 2"]:
    side = np.linspace(0.0, 1.0, cells + 1)
    return np.stack(np.meshgrid(side, side), axis=-1)


def _cloth(places: Float64[np.ndarray, "*points 2"]) -> Float64[np.ndarray, "*points 3"]:
    x, z = CLOTH * (places[..., 0] - 0.5), CLOTH * (0.5 - places[..., 1])
    # Folds draw the edges in.
    wavy = 0.012 * np.sin(17.0 * z + 1.0) + 0.006 * np.sin(31.0 * z)
    wavy_z = 0.012 * np.sin(15.0 * x + 2.0) + 0.006 * np.sin(29.0 * x + 0.4)
    edge = np.abs(2.0 * places - 1.0) ** 4
    x = x - np.sign(x) * wavy * edge[..., 0]
    z = z - np.sign(z) * wavy_z * edge[..., 1]
    return np.stack([x, _height(x, z), z], axis=-1)


def _height(
    x: Float[np.ndarray, "*points"], z: Float[np.ndarray, "*points"]
) -> Float[np.ndarray, "..."]:
    """Folds that fan out of two corners; low under the hat."""
    fan = np.arctan2(z + 0.75, x + 0.62)
    reach = np.hypot(x + 0.62, z + 0.75)
    warp = 0.25 * np.sin(5.0 * reach + 0.7) + 0.12 * np.sin(11.0 * reach)
    radial = np.exp(3.0 * (np.cos(17.0 * fan + warp) - 1.0)) * smoothstep(0.15, 0.8, reach)
    across = 0.86 * x - 0.5 * z
    along = 0.5 * x + 0.86 * z
    waves = np.exp(
        2.2 * (np.cos(23.0 * across + 0.9 * np.sin(6.0 * along) + 0.6) - 1.0)
    ) * smoothstep(-0.25, 0.45, along + 0.25 * x)
    broad = noise(np.stack([4.0 * x + 9.0, 0.0 * x + 3.0, 4.0 * z + 9.0], axis=-1), 2, seed=4)
    radius = np.hypot(x, z)
    free = 0.22 + 0.78 * smoothstep(0.12, 0.34, radius)
    return free * (0.045 * radial + 0.040 * waves + 0.03 * broad)


@cache
def _cloth_material() -> Material:
    """Twill in red with satin stripes and golden threads."""
    place = texel_places(TEXELS)
    u, v = place[..., 0], place[..., 1]
    wave = 0.5 + 0.5 * np.cos(2.0 * np.pi * 8.0 * u)
    cross = 0.5 + 0.5 * np.cos(2.0 * np.pi * 8.0 * v)
    satin = np.maximum(smoothstep(0.62, 0.72, wave), smoothstep(0.62, 0.72, cross))
    both = smoothstep(0.62, 0.72, wave) * smoothstep(0.62, 0.72, cross)
    gold = np.maximum(smoothstep(0.990, 0.994, wave), smoothstep(0.990, 0.994, cross))
    points = np.stack([24.0 * u, 24.0 * v, 0.0 * u], axis=-1)
    mottle = 0.85 + 0.3 * (noise(points, 3, seed=1) - 0.5)
    base = blend(satin, (0.42, 0.05, 0.045), (0.25, 0.02, 0.035))
    base = base + both[..., None] * (np.array([0.10, 0.03, 0.10]) - base) * 0.6
    base = base * mottle[..., None]
    base = base + gold[..., None] * (np.array([0.45, 0.30, 0.08]) - base)
    specular = blend(satin, (0.03, 0.025, 0.025), (0.16, 0.09, 0.09))
    specular = specular + gold[..., None] * (np.array([0.55, 0.40, 0.16]) - specular)
    roughness = 0.75 - 0.33 * satin - 0.05 * gold
    return textured("cloth", base, specular, roughness)


@cache
def _hat_material() -> Material:
    """Felt, with a band of leather above the brim and a bound edge."""
    place = texel_places(TEXELS)
    rest = hat_points(place, Stance())
    down = place[..., 1]
    outside = down < 0.5
    height = rest[..., 1]
    # The band follows the foot of the crown: a stretch of the way from the top to the edge.
    band = outside * smoothstep(0.262, 0.266, down) * smoothstep(0.308, 0.304, down)
    edge = smoothstep(0.478, 0.482, down) * smoothstep(0.522, 0.518, down)
    felt = noise(rest * 90.0, 4, seed=2)
    worn = smoothstep(0.45, 0.75, noise(rest * 16.0 + 3.0, 3, seed=3))
    base = blend(felt, (0.30, 0.19, 0.10), (0.42, 0.28, 0.16))
    base = base * (1.0 - 0.35 * worn * (height > 0.0))[..., None]
    base = np.where(outside[..., None], base, 0.7 * base)
    leather = np.array([0.055, 0.028, 0.016]) * (0.7 + 0.6 * felt[..., None])
    stud = 0.5 + 0.5 * np.cos(2.0 * np.pi * 26.0 * place[..., 0])
    studs = band * smoothstep(0.80, 0.88, stud) * smoothstep(0.010, 0.006, np.abs(down - 0.285))
    trim = np.maximum(band, edge)
    base = base + trim[..., None] * (leather - base)
    specular = blend(trim, (0.035, 0.032, 0.028), (0.10, 0.09, 0.08))
    specular = specular + studs[..., None] * (np.array([0.75, 0.72, 0.66]) - specular)
    base = base * (1.0 - studs[..., None]) + 0.08 * studs[..., None]
    roughness = 0.80 - 0.18 * worn
    roughness = roughness + trim * (0.36 + 0.12 * felt - roughness)
    roughness = roughness + studs * (0.34 - roughness)
    return textured("hat", base, specular, roughness)
