"""Light without files: a dark interior with bright windows, uniform light, and all such by name."""

import inspect
import math
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxvis import specs
from jaxvis.lighting import resampling
from jaxvis.lighting.environment import Environment
from jaxvis.lighting.sky import sky
from jaxvis.sphere import latlong

_PER_SIDE = 4  # samples along each side of a texel, at least
_FINE_HEIGHT = 512  # rows of samples, at least: windows must not fall between them


def windows(seed: int = 0, height: int = 256) -> Environment:
    """A church-like interior: walls of 0.05 to 0.3, two rows of windows of 20 to 60, and an opening
    of more than 100 in the dome. The hard, all-frequency case.

    Args:
        seed: chooses where the windows are, how bright each one is, and the walls' pattern.
        height: rows of the map; texels are averages, so that the light is the same at any height.
    """
    if height < 2:
        raise ValueError(f"height must be at least 2, got {height}")
    if seed < 0:
        raise ValueError(f"seed must be at least 0, got {seed}")
    random = np.random.default_rng(seed)
    fine = height * max(_PER_SIDE, -(-_FINE_HEIGHT // height))
    directions = latlong.texel_directions(fine, 2 * fine)
    light = _walls(directions, random)
    _open_windows(light, directions, random, count=9, sill=0.12, head=0.42, half_width=0.065)
    _open_windows(light, directions, random, count=7, sill=0.68, head=0.86, half_width=0.055)
    turn = 2.0 * math.pi * random.random()
    axis = np.array([0.12 * math.cos(turn), 1.0, 0.12 * math.sin(turn)])
    opening = directions @ (axis / np.linalg.norm(axis)) > math.cos(0.1)
    light[opening] = random.uniform(115.0, 150.0) * np.array([0.93, 1.0, 1.1])
    averages = resampling.resize(jnp.asarray(light, jnp.float32), height, 2 * height)
    return Environment(averages, "windows")


def uniform(radiance: float | tuple[float, float, float] = 1.0, height: int = 16) -> Environment:
    """The same radiance (a number, or one per channel) from everywhere."""
    colour = np.broadcast_to(np.asarray(radiance, np.float32), (3,))
    if not np.all(np.isfinite(colour) & (colour >= 0.0)):
        raise ValueError(f"radiance must be finite and non-negative, got {radiance}")
    if height < 1:
        raise ValueError(f"height must be at least 1, got {height}")
    return Environment(jnp.full((height, 2 * height, 3), jnp.asarray(colour)), "uniform")


BUILTIN = {"sky": sky, "windows": windows, "uniform": uniform}


def is_built_in(source: object) -> bool:
    """Whether ``source`` is a built-in's name, with or without parameters."""
    return isinstance(source, str) and specs.name_of(source) in BUILTIN


def built_in(source: str, height: int | None = None) -> Environment:
    """The built-in that ``name`` or ``name:parameter=value,...`` says, by this name.

    ``height`` sets the rows where ``source`` does not.

    Raises:
        ValueError: an unknown name or parameter, or a value that does not fit; says what would.
    """
    name = specs.name_of(source)
    if name not in BUILTIN:
        raise ValueError(f"no built-in environment {name!r}: use one of {', '.join(BUILTIN)}")
    known = inspect.signature(BUILTIN[name]).parameters
    texts = specs.parameters_of(source, "environment")
    specs.check_parameters(texts, known, f"environment {name!r}")
    given: dict[str, Any] = {} if height is None else {"height": height}
    for parameter, value in texts.items():
        kind = type(known[parameter].default)
        try:
            given[parameter] = kind(value)
        except ValueError:
            raise ValueError(
                f"environment {name!r}: {parameter} must be {kind.__name__}, got {value!r}"
            ) from None
    return Environment(BUILTIN[name](**given).radiance, source)


def _walls(directions: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Warm stone in bands and blotches, the floor darker than the vault."""
    waves = random.normal(size=(6, 3)) * np.array([2.0, 2.0, 3.0, 5.0, 8.0, 12.0])[:, None]
    phases = random.uniform(0.0, 2.0 * math.pi, 6)
    blotches = np.mean([np.sin(directions @ w + p) for w, p in zip(waves, phases, strict=True)], 0)
    elevation = np.arcsin(directions[..., 1])
    cornice = np.abs(elevation[..., None] - np.array([0.05, 0.55, 0.98])).min(axis=-1) < 0.015
    level = 0.45 + 0.35 * blotches + 0.2 * directions[..., 1] + 0.3 * cornice
    return 0.05 + 0.25 * np.clip(level, 0.0, 1.0)[..., None] * np.array([1.0, 0.86, 0.7])


def _open_windows(
    light: np.ndarray,
    directions: np.ndarray,
    random: np.random.Generator,
    *,
    count: int,
    sill: float,
    head: float,
    half_width: float,
) -> None:
    """Puts a row of round-headed windows between two elevations (radians) into ``light``."""
    elevation = np.arcsin(directions[:, 0, 1])
    row = (elevation > sill) & (elevation < head)
    elevation = elevation[row, None]
    azimuth = np.arctan2(directions[row, :, 0], -directions[row, :, 2])
    rise = (elevation - sill) / (head - sill)
    round_head = np.maximum(4.0 * rise - 3.0, 0.0)  # half an ellipse over the upper quarter
    part = light[row]
    places = (np.arange(count) + random.uniform(-0.2, 0.2, count) + random.random()) / count
    for place, brightness in zip(places, random.uniform(23.0, 54.0, count), strict=True):
        across = np.mod(azimuth - 2.0 * math.pi * place + math.pi, 2.0 * math.pi) - math.pi
        across = across * np.cos(elevation) / half_width
        part[across**2 + round_head**2 < 1.0] = brightness * np.array([0.9, 1.0, 1.1])
    light[row] = part
