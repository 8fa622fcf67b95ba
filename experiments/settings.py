"""Settings of an experiment: a frozen dataclass whose fields are the options of its command line.

    @dataclass(frozen=True)
    class Settings(Common):
        scene: tuple[str, ...] = setting(("duck",), "what is lit")
        size: tuple[int, int] = setting((256, 256), "of the images", metavar=("W", "H"))

    if __name__ == "__main__":
        execute(Settings, run, __doc__)

Every experiment so has the same conventions: ``--scene A B``, ``--size W H``, ``--out DIR``; a bool
is a flag, a choice of words is checked, and wrong usage is one line and exit code 2.
"""

import argparse
import dataclasses
import sys
import types
import typing
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, NoReturn, TypeVar

from experiments.output import Output

S = TypeVar("S", bound="Common")

SPELT = "spelt"
"""Key of a field's metadata: what argparse is told beyond its type."""


def setting(default: Any, help: str = "", metavar: Any = None, empty: bool = False) -> Any:
    """A field of settings with its default, and what ``--help`` says of it.

    ``empty`` lets an option of several values have none.
    """
    spelt = {"help": help, "metavar": metavar, "nargs": "*" if empty else None}
    return dataclasses.field(default=default, metadata={SPELT: spelt})


@dataclasses.dataclass(frozen=True)
class Common:
    """What every experiment can be told."""

    out: Path | None = setting(None, "folder for CSV tables and pictures", metavar="DIR")
    debug: bool = setting(False, "show where an error comes from")


class _Parser(argparse.ArgumentParser):
    """Reports wrong usage in one line."""

    def error(self, message: str) -> NoReturn:
        _stop(message)


def parse(cls: type[S], arguments: Sequence[str] | None = None, doc: str | None = None) -> S:
    """The settings that a command line gives.

    Raises:
        SystemExit: wrong usage, or help was asked for.
    """
    parser = _Parser(
        prog=f"python -m {_module(cls)}",
        description=doc,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    kinds = typing.get_type_hints(cls)
    shared = {field.name for field in dataclasses.fields(Common)}
    for field in sorted(dataclasses.fields(cls), key=lambda field: field.name in shared):
        _add(parser, field, kinds[field.name])
    found = vars(parser.parse_args(arguments))
    return cls(**{name: tuple(v) if isinstance(v, list) else v for name, v in found.items()})


def execute(
    cls: type[S],
    run: Callable[[S, Output], None],
    doc: str | None,
    arguments: Sequence[str] | None = None,
) -> None:
    """Runs an experiment by the command line; input that cannot be used is one line.

    Raises:
        SystemExit: wrong usage or input (code 2), or interrupted (130).
    """
    settings = parse(cls, arguments, doc)
    try:
        run(settings, Output(settings.out))
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    except (ValueError, OSError) as error:
        if settings.debug:
            raise
        _stop(" ".join(str(error).split()))


def _add(parser: argparse.ArgumentParser, field: dataclasses.Field, kind: Any) -> None:
    """The option of a field."""
    spelt = {k: v for k, v in field.metadata.get(SPELT, {}).items() if v is not None}
    name, default = f"--{field.name.replace('_', '-')}", field.default
    if spelt.get("help") and default is not None and default != () and kind is not bool:
        shown = " ".join(map(str, default)) if isinstance(default, tuple) else default
        spelt["help"] = f"{spelt['help']} (default: {shown})".replace("%", "%%")
    if kind is bool:
        action = argparse.BooleanOptionalAction if default else "store_true"
        spelt.pop("metavar", None)
        parser.add_argument(name, action=action, default=default, **spelt)
        return
    several: dict[str, Any] = {}
    kind = _without_none(kind)
    if typing.get_origin(kind) is tuple:
        kinds = typing.get_args(kind)
        several["nargs"] = spelt.pop("nargs", "+") if Ellipsis in kinds else len(kinds)
        kind = kinds[0]
    if typing.get_origin(kind) is Literal:
        parser.add_argument(
            name, choices=typing.get_args(kind), default=default, **several, **spelt
        )
        return
    parser.add_argument(name, type=kind, default=default, **several, **spelt)


def _without_none(kind: Any) -> Any:
    """``T`` of ``T | None``."""
    if typing.get_origin(kind) in (types.UnionType, typing.Union):
        (kind,) = (part for part in typing.get_args(kind) if part is not types.NoneType)
    return kind


def _module(cls: type) -> str:
    """The experiment that a class of settings belongs to, also where it is run as a script."""
    if cls.__module__ != "__main__":
        return cls.__module__
    spec = sys.modules["__main__"].__spec__
    return spec.name if spec else Path(sys.argv[0]).stem


def _stop(message: str) -> NoReturn:
    print(f"{Path(sys.argv[0]).stem}: {message}", file=sys.stderr)
    raise SystemExit(2)
