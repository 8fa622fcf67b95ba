"""Names with parameters, ``name:parameter=value,...``, and what is said when there is no such name.

Scenes, environments and methods are all named so, by people who mistype.
"""

import difflib
import os
from collections.abc import Iterable
from pathlib import Path


def name_of(spec: str) -> str:
    """What stands before the parameters, if there are any."""
    return spec.partition(":")[0]


def parameters_of(spec: str, what: str) -> dict[str, str]:
    """The parameters that a spec sets, as text.

    Args:
        spec: ``name`` or ``name:parameter=value,...``; spaces around parts do not count.
        what: the kind of thing that is named, for messages.

    Raises:
        ValueError: something is not ``parameter=value``, or a parameter is set twice.
    """
    found: dict[str, str] = {}
    for assignment in filter(None, spec.partition(":")[2].split(",")):
        parameter, equals, value = (part.strip() for part in assignment.partition("="))
        if not equals or not parameter:
            raise ValueError(f"{what} {spec!r}: {assignment!r} is not parameter=value")
        if parameter in found:
            raise ValueError(f"{what} {spec!r}: {parameter} is set twice; set it once")
        found[parameter] = value
    return found


def check_parameters(given: Iterable[str], known: Iterable[str], what: str) -> None:
    """Refuses parameters that ``what`` (the kind and name of a thing) does not have.

    Raises:
        ValueError: naming the first such parameter, and those that there are.
    """
    known = tuple(known)
    for parameter in given:
        if parameter not in known:
            raise ValueError(
                f"{what} has no parameter {parameter!r}; it has {', '.join(known) or 'none'}"
            )


def unknown(spec: str, known: Iterable[str], what: str) -> str:
    """Says that no ``what`` is called so, which one may be meant, and which there are."""
    known = tuple(known)
    hint = _did_you_mean(name_of(spec), known)
    return f"unknown {what} {spec!r}: {hint and f'{hint} '}known are {', '.join(known)}"


def is_file_name(source: str | os.PathLike) -> bool:
    """Whether a source that is no known name can only be meant as a file: by suffix or folder."""
    path = Path(source)
    return isinstance(source, os.PathLike) or bool(path.suffix) or len(path.parts) > 1


def no_such_file(path: Path) -> FileNotFoundError:
    """The error for a file that is not there, with what has such a name in its folder."""
    if not path.parent.is_dir():
        return FileNotFoundError(f"{path}: no such file, and no folder {path.parent}")
    siblings = sorted(entry.name for entry in path.parent.iterdir())
    hint = _did_you_mean(path.name, siblings)
    return FileNotFoundError(f"{path}: no such file{hint and f'; {hint}'}")


def _did_you_mean(name: str, known: Iterable[str]) -> str:
    close = difflib.get_close_matches(name, list(known))
    return f"did you mean {' or '.join(close)}?" if close else ""
