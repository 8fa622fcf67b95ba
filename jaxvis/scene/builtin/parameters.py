"""Checks of the parameters that built-in scenes take."""

import math
from numbers import Integral, Real

Number = float | int
"""A parameter of a built-in scene, as a person may write it: 2 for 2.0, 1e5 for 100_000."""


def whole(name: str, value: object, low: int, high: int) -> int:
    """An integer parameter within [low, high]; floats without a fraction count as integers.

    Raises:
        ValueError: naming the parameter and its range.
    """
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    if isinstance(value, bool) or not isinstance(value, Integral) or not low <= int(value) <= high:
        raise ValueError(f"{name} must be a whole number from {low} to {high}, got {value!r}")
    return int(value)


def length(
    name: str, value: object, *, low: float = 0.0, high: float = 1e6, zero: bool = False
) -> float:
    """A length above ``low`` and at most ``high``; 0 as well if ``zero`` says so.

    Raises:
        ValueError: naming the parameter and its range.
    """
    number = math.nan
    if isinstance(value, Real) and not isinstance(value, bool):
        number = float(value)
    if not (low < number <= high or (zero and number == 0.0)):
        lowest = "of at least 0" if zero else f"above {low:g}"
        raise ValueError(f"{name} must be a number {lowest} and at most {high:g}, got {value!r}")
    return number
