"""Environment maps, read, converted, computed and filtered, and spheres that shine."""

from jaxvis.lighting.builtin import BUILTIN, uniform, windows
from jaxvis.lighting.environment import Environment
from jaxvis.lighting.gaussians import GaussianFit, cell_gaussians, fit_gaussians
from jaxvis.lighting.info import environment_info
from jaxvis.lighting.layouts import LAYOUTS
from jaxvis.lighting.load import load_environment
from jaxvis.lighting.sky import sky
from jaxvis.lighting.spheres import SphereLights

__all__ = [
    "BUILTIN",
    "LAYOUTS",
    "Environment",
    "GaussianFit",
    "SphereLights",
    "cell_gaussians",
    "environment_info",
    "fit_gaussians",
    "load_environment",
    "sky",
    "uniform",
    "windows",
]
