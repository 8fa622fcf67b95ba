"""jaxvis: lighting scenes with environment maps through precomputed or sampled visibility.

Names load when they are first used, so that ``import jaxvis`` and ``jaxvis --help`` are quick.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jaxvis import datasets, image, lighting, methods, reflectance, sampling, scene, sphere
    from jaxvis.cluster import on_cluster
    from jaxvis.compare import compare
    from jaxvis.devices import on_devices
    from jaxvis.errors import InvalidEnvironment, InvalidScene, JaxvisWarning
    from jaxvis.lighting import Environment, load_environment
    from jaxvis.methods import (
        AdaptiveVisibility,
        DistanceField,
        Method,
        MonteCarlo,
        Reference,
        ShadowMaps,
        Unculled,
        VectorizedVisibility,
        VisibilityCorrespondence,
        VisibilityField,
        citation,
    )
    from jaxvis.reflectance import Material
    from jaxvis.report import write_report
    from jaxvis.scene import (
        Camera,
        Scene,
        Surface,
        build_scene,
        default_camera,
        load_animation,
        load_scene,
        trace_surface,
    )

__version__ = "0.1.0"

_PACKAGES = (
    "datasets",
    "image",
    "lighting",
    "methods",
    "reflectance",
    "sampling",
    "scene",
    "sphere",
)
_HOMES = {
    "on_cluster": "cluster",
    "on_devices": "devices",
    "compare": "compare",
    "InvalidEnvironment": "errors",
    "InvalidScene": "errors",
    "JaxvisWarning": "errors",
    "Environment": "lighting",
    "load_environment": "lighting",
    "AdaptiveVisibility": "methods",
    "DistanceField": "methods",
    "Method": "methods",
    "MonteCarlo": "methods",
    "Reference": "methods",
    "ShadowMaps": "methods",
    "Unculled": "methods",
    "VectorizedVisibility": "methods",
    "VisibilityCorrespondence": "methods",
    "VisibilityField": "methods",
    "citation": "methods",
    "Material": "reflectance",
    "write_report": "report",
    "Camera": "scene",
    "Scene": "scene",
    "Surface": "scene",
    "build_scene": "scene",
    "default_camera": "scene",
    "load_animation": "scene",
    "load_scene": "scene",
    "trace_surface": "scene",
}

__all__ = [
    "AdaptiveVisibility",
    "Camera",
    "DistanceField",
    "Environment",
    "InvalidEnvironment",
    "InvalidScene",
    "JaxvisWarning",
    "Material",
    "Method",
    "MonteCarlo",
    "Reference",
    "Scene",
    "ShadowMaps",
    "Surface",
    "Unculled",
    "VectorizedVisibility",
    "VisibilityCorrespondence",
    "VisibilityField",
    "build_scene",
    "citation",
    "compare",
    "datasets",
    "default_camera",
    "image",
    "lighting",
    "load_animation",
    "load_environment",
    "load_scene",
    "methods",
    "on_cluster",
    "on_devices",
    "reflectance",
    "sampling",
    "scene",
    "sphere",
    "trace_surface",
    "write_report",
]


def __getattr__(name: str) -> Any:
    if name in _PACKAGES:
        return importlib.import_module(f"jaxvis.{name}")
    if name in _HOMES:
        # Importing the module jaxvis.compare binds that module to the name of its function.
        value = getattr(importlib.import_module(f"jaxvis.{_HOMES[name]}"), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'jaxvis' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
