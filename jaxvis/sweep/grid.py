"""What a sweep measures: every combination of methods, scenes, lights and seeds."""

import itertools
import math
import os
import tomllib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from jaxvis import methods, specs
from jaxvis.cache import content_hash
from jaxvis.compare.machine import versions
from jaxvis.compare.setting import (
    DEFAULT_ENVIRONMENT,
    DEFAULT_REFERENCE,
    DEFAULT_SCENE,
    DEFAULT_SIZE,
    checked_count,
    checked_size,
)
from jaxvis.reflectance import checked_albedo, reflectance_by_name


@dataclass(frozen=True)
class Job:
    """One row of a sweep: a method on one scene under one light, with one seed.

    Attributes:
        rotate: degrees by which the environment turns about +Y.
    """

    scene: str
    environment: str
    rotate: float
    size: tuple[int, int]
    method: str
    seed: int
    supersampling: int
    reflectance: str | None
    albedo: float | None
    reference: str

    @cached_property
    def key(self) -> str:
        """Tells rows apart, and those of one version of jaxvis from another's."""
        return content_hash(versions()["jaxvis"], asdict(self))

    @property
    def view(self) -> "Job":
        """What jobs share that differ in method and seed alone: scene, light and reference."""
        return replace(self, method="", seed=0)


@dataclass(frozen=True)
class Grid:
    """All combinations of what is listed.

    Attributes:
        methods: names with parameters, as ``vectorized:zeta=2``; :func:`variants` makes several.
        scene, environment: names or files, as ``jaxvis compare`` takes them.
        rotate: degrees by which the environment turns about +Y.
        size: (width, height) of the images.
        seed: of everything random.
        supersampling: camera rays per pixel along each axis.
        reflectance: replaces the scenes' models.
        albedo: replaces all materials by one diffuse grey.
        reference: the method that all are measured against.

    Raises:
        ValueError: unknown methods or parameters, values out of range, nothing to do.
    """

    methods: tuple[str, ...]
    scene: tuple[str, ...] = (DEFAULT_SCENE,)
    environment: tuple[str, ...] = (DEFAULT_ENVIRONMENT,)
    rotate: tuple[float, ...] = (0.0,)
    size: tuple[int, int] = DEFAULT_SIZE
    seed: tuple[int, ...] = (0,)
    supersampling: int = 1
    reflectance: str | None = None
    albedo: float | int | None = None
    reference: str = DEFAULT_REFERENCE

    def __post_init__(self) -> None:
        for name in ("methods", "scene", "environment", "rotate", "seed"):
            values = tuple(getattr(self, name))
            if not values:
                raise ValueError(f"{name} is empty: there is nothing to sweep")
            for value in values:
                if values.count(value) > 1:
                    raise ValueError(f"{name} lists {value!r} twice")
            object.__setattr__(self, name, values)
        for spec in (*self.methods, self.reference):
            methods.create(spec)
        for angle in self.rotate:
            if not math.isfinite(angle):
                raise ValueError(f"rotate must be finite, got {angle}")
        object.__setattr__(self, "rotate", tuple(map(float, self.rotate)))
        object.__setattr__(self, "size", checked_size(self.size))
        for number in self.seed:
            checked_count(number, "seed", least=0)
        checked_count(self.supersampling, "supersampling")
        if self.reflectance is not None:
            reflectance_by_name(self.reflectance)
        if self.albedo is not None:
            object.__setattr__(self, "albedo", checked_albedo(self.albedo))

    def jobs(self) -> tuple[Job, ...]:
        """The rows in order: scenes, lights, then methods, then seeds."""
        return tuple(
            Job(
                *(scene, environment, rotate, self.size, method, seed),
                *(self.supersampling, self.reflectance, self.albedo, self.reference),
            )
            for scene, environment, rotate, method, seed in itertools.product(
                self.scene, self.environment, self.rotate, self.methods, self.seed
            )
        )


def variants(name: str, **parameters: Any) -> tuple[str, ...]:
    """A method with every combination of its parameters' values.

        >>> variants("vectorized", zeta=(0, 2), vectors=64)
        ('vectorized:zeta=0,vectors=64', 'vectorized:zeta=2,vectors=64')

    A parameter that is no list has that one value.
    """
    lists = [v if isinstance(v, (list, tuple)) else (v,) for v in parameters.values()]
    found = []
    for values in itertools.product(*lists):
        text = ",".join(f"{k}={_spelt(v)}" for k, v in zip(parameters, values, strict=True))
        found.append(f"{name}:{text}" if text else name)
    return tuple(found)


def _spelt(value: Any) -> str:
    return str(value).lower() if value is None or isinstance(value, bool) else str(value)


def read_grid(path: str | os.PathLike) -> Grid:
    """The grid that a TOML file describes.

        scene = ["duck", "utah-teapot"]
        environment = "stpeters"
        size = [256, 256]
        seed = [0, 1]

        [[methods]]
        name = "correspondence"
        zeta = [0, 1, 2]

        [[methods]]
        name = "mc-mis"
        spp = [1, 4, 16]

    A value stands for a list of one. ``methods`` may also be a list of names.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is not TOML, or not a grid; names the file.
    """
    path = Path(path)
    if not path.is_file():
        raise specs.no_such_file(path)
    try:
        found = tomllib.loads(path.read_text())
        specs.check_parameters(found, [field.name for field in fields(Grid)], "a grid")
        if "methods" not in found:
            raise ValueError("it names no methods")
        found["methods"] = _methods(found["methods"])
        for name in _LISTS:
            if name in found:
                found[name] = tuple(_listed(found[name]))
        for name, kinds in _KINDS.items():
            if isinstance(found.get(name), list) and name != "size":  # others are tuples
                raise ValueError(f"{name} is one value of all rows, got {found[name]}")
            for value in _listed(found.get(name, ())):
                if isinstance(value, bool) or not isinstance(value, kinds):
                    raise ValueError(f"{name}: {value!r} is not {_NAMED[kinds]}")
        if "size" in found:
            found["size"] = checked_size(_listed(found["size"]))
        if "rotate" in found:
            found["rotate"] = tuple(map(float, found["rotate"]))
        return Grid(**found)
    except (ValueError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: {error}") from error


_KINDS: dict[str, Any] = dict.fromkeys(("scene", "environment", "reflectance", "reference"), str)
_KINDS |= dict.fromkeys(("rotate", "albedo"), (int, float))
_KINDS |= dict.fromkeys(("seed", "size", "supersampling"), int)
_LISTS = ("scene", "environment", "rotate", "seed")
_NAMED = {str: "a text", int: "an integer", (int, float): "a number"}


def _listed(value: Any) -> Sequence[Any]:
    return value if isinstance(value, (list, tuple)) else (value,)


def _methods(given: Any) -> tuple[str, ...]:
    """Names, and tables of a name with parameters, as names."""
    found: list[str] = []
    for each in _listed(given):
        if isinstance(each, str):
            found.append(each)
        elif isinstance(each, dict) and isinstance(each.get("name"), str):
            found += variants(**{key: _plain(key, value) for key, value in each.items()})
        else:
            raise ValueError(f"methods: {each!r} is neither a name nor a table with a name")
    return tuple(found)


def _plain(key: str, value: Any) -> Any:
    """A parameter's value or list of values, which are text, numbers or truths."""
    for each in _listed(value):
        if isinstance(each, (dict, list)):
            raise ValueError(f"methods: {key} cannot be {each!r}")
    return value


def split(jobs: Sequence[Job], parts: int) -> list[list[Job]]:
    """Jobs in parts whose sizes differ by one at most: method by method, light by light, and then
    scene by scene.

    Neighbours share what is in memory. Compiled programs depend on the method and on the size of a
    light's tables, and hardly on the scene: so parts should share methods, and then lights, no more
    than they must. Every other part goes backwards: side by side, two workers would compile the
    same programs, precompute the same scenes and render the same references at the same time, and
    so find less of them on the disk.
    """
    names = list(dict.fromkeys(_name(job) for job in jobs))
    lights = list(dict.fromkeys(job.environment for job in jobs))

    def place(job: Job) -> tuple[int, int]:
        return names.index(_name(job)), lights.index(job.environment)

    ordered = sorted(jobs, key=place)  # otherwise as they are
    ends = [len(jobs) * part // parts for part in range(parts + 1)]
    found = [ordered[a:b] for a, b in itertools.pairwise(ends)]
    return [part[::-1] if index % 2 else part for index, part in enumerate(found)]


def _name(job: Job) -> str:
    """Of the method, without parameters."""
    return job.method.partition(":")[0]
