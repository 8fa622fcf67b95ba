"""Monte Carlo estimators of direct light (paper 000, section IV-D; spec 1.13)."""

from jaxvis.methods.monte_carlo.adaptive import AdaptiveEnvironment
from jaxvis.methods.monte_carlo.importance_driven import ImportanceDriven, LocalImportanceDriven
from jaxvis.methods.monte_carlo.method import MonteCarlo, MonteCarloLight

__all__ = [
    "AdaptiveEnvironment",
    "ImportanceDriven",
    "LocalImportanceDriven",
    "MonteCarlo",
    "MonteCarloLight",
]
