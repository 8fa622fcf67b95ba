"""Quality over time: what a method reaches in a given time, and when it reaches a given quality.

A curve is interpolated between measured frames, linearly in decibels over the logarithm of seconds:
the error of an estimator is then a straight line.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np


class Frame(NamedTuple):
    """One measured frame: what was set (as ``8 spp`` or ``zeta 2``), its seconds and PSNR in dB."""

    setting: str
    seconds: float
    decibels: float


class Found(NamedTuple):
    """A value of a curve. ``bound`` is ``""`` where it lies between measured frames.

    Before the first frame the first one's value stands, ``"slower"``: even that takes longer. After
    the best frame its value stands, ``"more"``: nothing measured reaches further.
    """

    value: float
    bound: str = ""


@dataclass(frozen=True)
class Curve:
    """The frames of one method."""

    name: str
    frames: tuple[Frame, ...]

    @property
    def front(self) -> tuple[Frame, ...]:
        """The frames that no quicker one equals or excels, by time."""
        return front(self.frames)

    def decibels_at(self, seconds: float) -> Found:
        """The PSNR that the method reaches in this time."""
        best = self.front
        if seconds < best[0].seconds:
            return Found(best[0].decibels, "slower")
        if seconds > best[-1].seconds:
            return Found(best[-1].decibels, "more")
        times = [math.log(frame.seconds) for frame in best]
        value = np.interp(math.log(seconds), times, [frame.decibels for frame in best])
        return Found(float(value))

    def seconds_at(self, decibels: float) -> Found:
        """The time in which the method reaches this PSNR; with ``more``, the longest measured."""
        best = self.front
        if decibels <= best[0].decibels:
            return Found(best[0].seconds, "slower" if decibels < best[0].decibels else "")
        if decibels > best[-1].decibels:
            return Found(max(frame.seconds for frame in self.frames), "more")
        times = [math.log(frame.seconds) for frame in best]
        value = np.interp(decibels, [frame.decibels for frame in best], times)
        return Found(math.exp(float(value)))


def front(frames: Sequence[Frame]) -> tuple[Frame, ...]:
    """The frames that no quicker one equals or excels, by time."""
    best: list[Frame] = []
    for frame in sorted(frames, key=lambda frame: (frame.seconds, -frame.decibels)):
        if not best or frame.decibels > best[-1].decibels:
            best.append(frame)
    return tuple(best)


def margin(frame: Frame, other: Curve) -> Found:
    """Decibels that a frame has above what the other method reaches in its time.

    Where the other's quickest frame takes longer, its PSNR stands for it, which favours the other;
    where the longest one measured is shorter, it could have more: the margin is an upper bound.
    """
    reached = other.decibels_at(frame.seconds)
    return Found(frame.decibels - reached.value, reached.bound)


def speedup(frame: Frame, other: Curve) -> Found:
    """Times longer that the other method takes to this frame's PSNR; ``more``: at least so long."""
    taken = other.seconds_at(frame.decibels)
    return Found(taken.value / frame.seconds, taken.bound)
