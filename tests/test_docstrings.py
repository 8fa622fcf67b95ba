"""Every public name says what it is."""

import importlib
import inspect
import pkgutil

import pytest

import jaxvis

PACKAGES = ["jaxvis"] + [
    f"jaxvis.{found.name}"
    for found in pkgutil.iter_modules(jaxvis.__path__)
    if found.name not in ("__main__", "cli")
]


def public(package: str) -> list[str]:
    """``package:name`` for each name that the package offers: its ``__all__``, or what a module
    without one defines itself."""
    module = importlib.import_module(package)
    names = getattr(module, "__all__", None)
    if names is None:
        names = [
            name
            for name, value in vars(module).items()
            if not name.startswith("_")
            and (inspect.isclass(value) or inspect.isfunction(value))
            and value.__module__ == package
        ]
    # Constants are left out: to Python, the docstring of one is a comment.
    kinds = (inspect.isclass, inspect.isroutine, inspect.ismodule)
    return [f"{package}:{n}" for n in names if any(kind(getattr(module, n)) for kind in kinds)]


NAMES = [name for package in PACKAGES for name in public(package)]


def own_docstring(value: object) -> str:
    """What the object itself says: not what it inherits, nor a dataclass's generated signature."""
    text = (vars(value).get("__doc__") if inspect.isclass(value) else value.__doc__) or ""
    name = getattr(value, "__name__", "")
    return "" if text.startswith(f"{name}(") else text.strip()


@pytest.mark.parametrize("package", PACKAGES)
def test_every_package_has_a_docstring(package):
    assert own_docstring(importlib.import_module(package))


@pytest.mark.parametrize("name", NAMES)
def test_every_public_name_has_a_docstring(name):
    package, _, attribute = name.partition(":")
    text = own_docstring(getattr(importlib.import_module(package), attribute))
    assert len(text.split()) >= 3, f"{name}: {text!r}"


def test_public_names_are_many_and_come_from_every_layer():
    assert len(NAMES) > 150
    for package in ("sphere", "sampling", "lighting", "scene", "methods", "compare", "report"):
        assert any(name.startswith(f"jaxvis.{package}:") for name in NAMES)


def test_a_generated_docstring_does_not_count():
    from dataclasses import dataclass

    @dataclass
    class Bare:
        size: int

    class Heir(jaxvis.Method):
        pass

    assert Bare.__doc__ == "Bare(size: int)"
    assert own_docstring(Bare) == ""
    assert own_docstring(Heir) == ""
    assert own_docstring(jaxvis.Method)
