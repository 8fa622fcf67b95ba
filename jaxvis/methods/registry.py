"""The methods by name, with parameters in the name: ``mc-mis:spp=16,compensation=true``.

A name may have the suffix ``+denoise``, as in ``mc-mis+denoise:spp=4``.
"""

import dataclasses
import types
import typing
from collections.abc import Sequence
from typing import Any

from jaxvis import specs
from jaxvis.methods.base import Method
from jaxvis.methods.denoised import SUFFIX, Denoised


@dataclasses.dataclass(frozen=True)
class Entry:
    """A registered name: ``cls(**presets, **parameters)``."""

    name: str
    family: str
    cls: type[Method]
    presets: dict[str, Any]
    representative: str | None
    summary: str

    def defaults(self) -> dict[str, Any]:
        """Parameters that a user may set, with their defaults."""
        return {
            f.name: f.default
            for f in dataclasses.fields(self.cls)
            if f.init and f.name not in self.presets
        }


_ENTRIES: dict[str, Entry] = {}


def register(
    name: str,
    cls: type[Method],
    *,
    family: str,
    summary: str,
    representative: bool | str = False,
    **presets: Any,
) -> None:
    """Makes a method known by name. One method of each family is its ``representative``: as it is,
    or with the parameters that the given text sets.
    """
    if name in _ENTRIES:
        raise ValueError(f"method {name!r} is registered already")
    spec = name if representative is True else representative or None
    _ENTRIES[name] = Entry(name, family, cls, presets, spec, summary)


def names() -> tuple[str, ...]:
    """Every registered name."""
    return tuple(_ENTRIES)


def representatives() -> tuple[str, ...]:
    """One method of each family: what ``compare`` runs when not told otherwise."""
    return tuple(entry.representative for entry in _ENTRIES.values() if entry.representative)


def table() -> tuple[Entry, ...]:
    """Every registration, for listings."""
    return tuple(_ENTRIES.values())


def create(spec: str | Method, **overrides: Any) -> Method:
    """The method that ``name`` or ``name:parameter=value,...`` says; ``name+denoise`` is that of
    ``name``, denoised.

    ``overrides`` set those parameters that the method has and ``spec`` leaves open.

    Raises:
        ValueError: unknown name or parameter, or a value that does not fit; says what would.
    """
    if isinstance(spec, Method):
        return spec
    if specs.name_of(spec).endswith(SUFFIX):
        return Denoised(create(spec.replace(SUFFIX, "", 1), **overrides))
    name = specs.name_of(spec)
    if name not in _ENTRIES:
        raise ValueError(specs.unknown(spec, _ENTRIES, "method"))
    entry = _ENTRIES[name]
    fields = entry.defaults()
    texts = specs.parameters_of(spec, "method")
    specs.check_parameters(texts, fields, f"method {name!r}")
    annotations = typing.get_type_hints(entry.cls)
    given = {
        parameter: _parse(value, annotations[parameter], f"method {name!r}: {parameter}")
        for parameter, value in texts.items()
    }
    for parameter, value in overrides.items():
        if parameter in fields and value is not None:
            given.setdefault(parameter, value)
    return entry.cls(**entry.presets, **given)


def parse_list(text: str | Sequence[str]) -> list[str]:
    """Splits ``a,b:x=1,y=2,c`` into ``["a", "b:x=1,y=2", "c"]``; ``all`` means every method but the
    reference, which ``compare`` runs anyway.
    """
    if not isinstance(text, str):
        return list(text)
    if text.strip() == "all":
        return [name for name in _ENTRIES if name != "reference"]
    found: list[str] = []
    for part in (part.strip() for part in text.split(",")):
        if not part:
            continue
        if "=" in part and ":" not in part:
            if not found or ":" not in found[-1]:
                raise ValueError(f"methods {text!r}: {part!r} follows no method")
            found[-1] += f",{part}"
        else:
            found.append(part)
    if not found:
        raise ValueError("no methods given; `jaxvis methods` lists them")
    return found


def _parse(value: str, annotation: Any, what: str) -> Any:
    """A parameter's value from text, by its annotation."""
    origin, options = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Literal:
        if value not in options:
            raise ValueError(f"{what} must be one of {', '.join(options)}, got {value!r}")
        return value
    if origin in (typing.Union, types.UnionType):
        if value.lower() == "none" and type(None) in options:
            return None
        errors = []
        for option in options:
            if option is not type(None):
                try:
                    return _parse(value, option, what)
                except ValueError as error:
                    errors.append(str(error).removeprefix(f"{what} must be "))
        raise ValueError(
            f"{what} must be {' or '.join(e.split(', got')[0] for e in errors)}, got {value!r}"
        )
    if annotation is bool:
        if value.lower() not in ("true", "false"):
            raise ValueError(f"{what} must be true or false, got {value!r}")
        return value.lower() == "true"
    try:
        return annotation(value)
    except ValueError:
        raise ValueError(f"{what} must be {annotation.__name__}, got {value!r}") from None
