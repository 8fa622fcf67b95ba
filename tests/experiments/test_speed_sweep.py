"""Timing of sweeps: the grid is the one meant, and a sweep that fails is said."""

import pytest

from experiments.speed_sweep import Settings, grid_of, seconds_of_sweep
from jaxvis.sweep import read_grid


def test_the_default_grid_has_two_hundred_rows(tmp_path):
    path = tmp_path / "grid.toml"
    path.write_text(grid_of(Settings()))
    grid = read_grid(path)
    assert len(grid.jobs()) == 200
    assert grid.methods == Settings().method
    assert grid.size == (64, 48)


def test_a_sweep_that_fails_is_one_line(tmp_path):
    path = tmp_path / "grid.toml"
    path.write_text(grid_of(Settings(method=("no-such",))))
    with pytest.raises(ValueError, match=r"the sweep failed: .*no-such"):
        seconds_of_sweep(path, tmp_path / "out", 1)
