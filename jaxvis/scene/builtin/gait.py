"""A person who walks in a circle: where the joints are in every frame (host)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from jaxvis.scene.builtin.mesh import unit
from jaxvis.scene.builtin.noise import smoothstep

Vector = Float64[np.ndarray, "3"]

CYCLE = 26
"""Frames of two steps."""
CYCLES = 5
"""Two-step cycles in a round."""
RADIUS = 0.875
"""Of the circle, metres: 1.1 m a cycle."""
STANCE = 0.6
"""Share of the cycle in which a foot is on the ground."""
THIGH, SHIN = 0.435, 0.425
ANKLE = 0.085
"""Height of the ankle over the sole, and its distance from the heel."""
HEEL = -0.08
BALL = 0.12
"""From the ankle forward to the heel's end, and to the ball, about which the heel rises."""
HIP_WIDTH, SHOULDER_WIDTH = 0.09, 0.185
HIP_HEIGHT = 0.903
UPPER_ARM, LOWER_ARM = 0.29, 0.27


@dataclass(frozen=True)
class Frame:
    """An origin and three axes: columns aside (to the left), up and forward."""

    origin: Vector
    axes: Float64[np.ndarray, "3 3"]

    def place(self, points: Float64[np.ndarray, "*points 3"]) -> Float64[np.ndarray, "*points 3"]:
        """World positions of points given along the axes."""
        return self.origin + points @ self.axes.T


@dataclass(frozen=True)
class Limb:
    """Three joints (hip, knee, ankle or shoulder, elbow, wrist) and the hinge's axis."""

    joints: Float64[np.ndarray, "3 3"]
    hinge: Vector


@dataclass(frozen=True)
class Foot:
    """A foot: origin on the sole below the ankle, and the angle by which its toes bend up."""

    frame: Frame
    bend: float


@dataclass(frozen=True)
class Figure:
    """All that moves: pelvis and chest (origins at hip and shoulder height), legs, arms, feet."""

    pelvis: Frame
    chest: Frame
    legs: tuple[Limb, Limb]
    feet: tuple["Foot", "Foot"]
    arms: tuple[Limb, Limb]


def figure(frame: int) -> Figure:
    """The figure in a frame. It repeats after CYCLE * CYCLES."""
    time = frame / CYCLE
    beat = 2.0 * np.pi * (time - 0.5 * STANCE)
    # Hips are highest over the standing foot, twice a cycle, and sway towards it.
    height = HIP_HEIGHT + 0.024 * np.cos(2.0 * beat)
    sway = 0.018 * np.cos(beat)
    base = _on_circle(time / CYCLES, sway)
    pelvis = Frame(base.origin + [0.0, height, 0.0], base.axes @ _yaw(-0.10 * np.sin(beat)))
    lean = _pitch(0.05)
    torso = Frame(base.origin + [0.0, height + 0.513, 0.0], base.axes @ _yaw(0.12 * np.sin(beat)))
    shift = base.axes[:, 2] * 0.03
    chest = Frame(torso.origin + shift, torso.axes @ lean)
    feet, legs, arms = [], [], []
    for side, offset in ((1.0, 0.0), (-1.0, 0.5)):
        foot = _foot(time + offset, offset, side)
        hip = pelvis.place(np.array([side * HIP_WIDTH, 0.0, 0.0]))
        ankle = foot.frame.place(np.array([0.0, ANKLE, 0.0]))
        forward = unit(pelvis.axes[:, 2] + foot.frame.axes[:, 2])
        legs.append(_bent(hip, ankle, THIGH, SHIN, forward))
        feet.append(foot)
        swing = -np.cos(2.0 * np.pi * (time + offset) + 0.1)
        arms.append(_arm(chest, side, swing))
    return Figure(pelvis, chest, tuple(legs), tuple(feet), tuple(arms))


def _on_circle(turns: float, outward: float) -> Frame:
    """The ground below the figure, ``outward`` of the circle on which it turns to its right."""
    angle = 2.0 * np.pi * turns
    aside = np.array([np.cos(angle), 0.0, np.sin(angle)])
    forward = np.array([-np.sin(angle), 0.0, np.cos(angle)])
    # Right-handed: the first axis is on the left of someone who looks forward.
    return Frame((RADIUS + outward) * aside, np.stack([aside, [0.0, 1.0, 0.0], forward], axis=1))


def _foot(time: float, offset: float, side: float) -> Foot:
    """Where a foot is. ``time`` counts the foot's own cycles."""
    phase = time % 1.0
    planted = time - phase + 0.5 * STANCE - offset
    if phase < STANCE:
        ground = planted
        heel = 0.62 * _ease(0.62 * STANCE, STANCE, phase)
        toe = 0.28 * _ease(0.16, 0.0, phase)
        lift = 0.0
    else:
        t = (phase - STANCE) / (1.0 - STANCE)
        # Leaves and arrives with some speed, as a foot does that rolls off its toes.
        ground = planted + 0.25 * t + 0.75 * _ease(0.0, 1.0, t)
        heel = 0.62 * _ease(0.75, 0.0, t)
        toe = 0.28 * _ease(0.45, 1.0, t)
        lift = 0.045 * np.sin(np.pi * t) ** 2
    base = _on_circle(ground / CYCLES, side * 0.075)
    # The heel rises about the ball, the toes rise about the heel.
    pitch = heel - toe
    pivot = np.array([0.0, 0.0, BALL if pitch > 0.0 else HEEL])
    turn = _pitch(pitch)
    origin = base.place(pivot + turn @ -pivot) + [0.0, lift, 0.0]
    return Foot(Frame(origin, base.axes @ turn), max(pitch, 0.0))


def _ease(low: float, high: float, x: float) -> float:
    """0 at ``low``, 1 at ``high``, smooth between."""
    return float(smoothstep(low, high, np.array([x]))[0])


def _arm(chest: Frame, side: float, swing: float) -> Limb:
    """A swinging arm: forward for ``swing`` 1, backward for -1."""
    shoulder = chest.place(np.array([side * SHOULDER_WIDTH, 0.0, 0.0]))
    upper = 0.08 + 0.42 * swing
    bend = 0.42 + 0.26 * swing
    spread = side * 0.13
    down = np.array([spread, -np.cos(upper), np.sin(upper)])
    lower = np.array([0.3 * spread, -np.cos(upper + bend), np.sin(upper + bend)])
    elbow = shoulder + UPPER_ARM * (chest.axes @ unit(down))
    wrist = elbow + LOWER_ARM * (chest.axes @ unit(lower))
    return Limb(np.stack([shoulder, elbow, wrist]), chest.axes[:, 0])


def _bent(start: Vector, end: Vector, first: float, second: float, forward: Vector) -> Limb:
    """Two bones of given lengths between two joints; the middle one is pushed forward."""
    reach = end - start
    # A leg is never quite straight; one too short is stretched.
    length = float(np.linalg.norm(reach))
    scale = max(1.0, length / (0.998 * (first + second)))
    first, second = first * scale, second * scale
    along = unit(reach)
    aside = unit(forward - (forward @ along) * along)
    foot = (first**2 - second**2 + length**2) / (2.0 * length)
    middle = start + foot * along + np.sqrt(max(first**2 - foot**2, 0.0)) * aside
    return Limb(np.stack([start, middle, end]), unit(np.cross(aside, along)))


def _yaw(angle: float) -> Float64[np.ndarray, "3 3"]:
    """Turns the first axis towards the third."""
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]])


def _pitch(angle: float) -> Float64[np.ndarray, "3 3"]:
    """Turns the third axis down, the second forward."""
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])
