"""Light from infinity: environment maps, read, converted, computed and filtered."""

from jaxvis.lighting.builtin import BUILTIN, uniform, windows
from jaxvis.lighting.environment import Environment
from jaxvis.lighting.gaussians import GaussianFit, cell_gaussians, fit_gaussians
from jaxvis.lighting.info import environment_info
from jaxvis.lighting.layouts import LAYOUTS
from jaxvis.lighting.load import load_environment
from jaxvis.lighting.sky import sky

__all__ = [
    "BUILTIN",
    "LAYOUTS",
    "Environment",
    "GaussianFit",
    "cell_gaussians",
    "environment_info",
    "fit_gaussians",
    "load_environment",
    "sky",
    "uniform",
    "windows",
]
