"""Sweeps that survive: grids of methods, scenes, lights and seeds, measured row by row."""

from jaxvis.sweep.grid import Grid, Job, read_grid, variants
from jaxvis.sweep.run import run_grid

__all__ = ["Grid", "Job", "read_grid", "run_grid", "variants"]
