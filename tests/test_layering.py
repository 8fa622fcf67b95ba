"""Imports point one way only (DESIGN §2); parsed, not run."""

import ast
from pathlib import Path

import pytest

import jaxvis

ROOT = Path(jaxvis.__file__).parent
LAYERS = [
    "errors",
    "chunks",
    "compiled",
    "importing",
    "cores",
    "workers",
    "cluster",
    "devices",
    "npz",
    "cache",
    "specs",
    "pixels",
    "datasets",
    "sphere",
    "sampling",
    "lighting",
    "reflectance",
    "scene",
    "image",
    "methods",
    "compare",
    "sweep",
    "preloaded",
    "report",
    "view",
    "cli",
]
METHOD_PACKAGES = {"monte_carlo", "vectorized", "distance_field", "visibility_field", "cones"}
FILES = sorted(path.relative_to(ROOT) for path in ROOT.rglob("*.py"))


def imported(path: Path) -> set[tuple[str, ...]]:
    """The jaxvis modules that a file imports anywhere, as parts below the package."""
    found = set()
    for node in ast.walk(ast.parse((ROOT / path).read_text())):
        if isinstance(node, ast.Import):
            modules = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            modules = [f"{node.module}.{alias.name}" for alias in node.names]
        else:
            continue
        found |= {tuple(m.split(".")[1:]) for m in modules if m.split(".")[0] == "jaxvis"}
    return found


@pytest.mark.parametrize("path", FILES, ids=str)
def test_imports_point_up_the_list_only(path):
    layer = path.with_suffix("").parts[0]
    if layer == "__init__":
        return  # the public names come from everywhere
    assert layer in LAYERS, f"{path}: give its layer a place in the order"
    for module in imported(path):
        assert module, f"{path}: imports the whole of jaxvis"
        assert LAYERS.index(module[0]) <= LAYERS.index(layer), f"{path} imports {module}"


@pytest.mark.parametrize(
    "path", [p for p in FILES if p.parts[0] == "methods" and len(p.parts) > 2], ids=str
)
def test_no_method_package_imports_another(path):
    own = path.parts[1]
    for module in imported(path):
        if module[0] == "methods" and len(module) > 1:
            assert module[1] not in METHOD_PACKAGES - {own}, f"{path} imports {module}"


def test_the_parser_sees_imports():
    assert ("scene", "Scene") in imported(Path("methods/base.py"))
