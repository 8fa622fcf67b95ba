"""Experiments on top of sweeps: they go on after a kill, and leave what they show."""

import pytest

from experiments import sweeping
from experiments.output import Output
from experiments.per_fragment import METHODS, grid_of, table_of
from experiments.per_fragment import Settings as PerFragment
from experiments.sweeping import Sweeping, folder_of, swept
from experiments.zeta_sweep import Settings, run, shadings
from jaxvis.image import read_image
from jaxvis.methods import create
from jaxvis.methods.vectorized import VectorizedVisibility
from jaxvis.sweep import run as runs

SMALL = Settings(
    scene=("box-on-plane",),
    environment="uniform",
    zeta=(0.5,),
    size=(16, 12),
    vectors=16,
    error=0.1,
)


@pytest.fixture(scope="module", autouse=True)
def cache(own_caches):
    """Of this module's own."""


@pytest.fixture
def measured(monkeypatch):
    """The methods that are measured; the third of them is as far as it comes the first time."""
    known, found = runs.run_job, []

    def run_job(job, **options):
        found.append(job.method)
        if len(found) == 3:
            raise KeyboardInterrupt
        return known(job, **options)

    monkeypatch.setattr(runs, "run_job", run_job)
    return found


def test_a_run_that_was_stopped_goes_on(tmp_path, measured, capsys):
    names = list(shadings(SMALL).values())
    with pytest.raises(KeyboardInterrupt):
        run(SMALL, Output(tmp_path))
    assert measured == names
    assert (tmp_path / sweeping.UNFINISHED).is_dir()
    run(SMALL, Output(tmp_path))
    assert measured == [*names, names[-1]]
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "box-on-plane",
        "sweep.csv",
        "zeta_sweep.png",
    ]
    pictures = ["fragment.png", "reference.png", "vertex.png", "zeta-0.5.png"]
    assert sorted(p.name for p in (tmp_path / "box-on-plane").iterdir()) == pictures
    assert read_image(tmp_path / "box-on-plane" / "zeta-0.5.png").shape == (12, 16, 3)
    lines = (tmp_path / "sweep.csv").read_text().splitlines()
    assert [line.split(",")[1] for line in lines] == ["shading", "vertex", "zeta 0.5", "fragment"]
    assert capsys.readouterr().out.count("| box-on-plane |") == 3


def test_without_a_folder_nothing_is_left(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    run(SMALL, Output())
    assert capsys.readouterr().out.count("| box-on-plane |") == 3
    assert not list(tmp_path.iterdir())


def test_a_method_that_fails_is_said(tmp_path, monkeypatch):
    def refuse(self, environment):
        raise ValueError("too dark")

    monkeypatch.setattr(VectorizedVisibility, "light", refuse)
    failed = r"vectorized:.* failed on box-on-plane: too dark"
    with pytest.raises(ValueError, match=failed):
        run(SMALL, Output(tmp_path))
    monkeypatch.undo()
    run(SMALL, Output(tmp_path))  # measures it again
    assert (tmp_path / "sweep.csv").exists()


@pytest.mark.parametrize(
    ("settings", "workers", "scheduler"),
    [
        (Sweeping(), 0, None),
        (Sweeping(workers=2), 2, None),
        (Sweeping(scheduler="tcp://host:1"), None, "tcp://host:1"),
    ],
)
def test_workers_and_clusters_are_handed_on(monkeypatch, settings, workers, scheduler):
    def run_grid(grid, folder, **options):
        assert (options["workers"], options["scheduler"]) == (workers, scheduler)
        raise OSError("heard")

    monkeypatch.setattr(sweeping, "run_grid", run_grid)
    with (
        pytest.raises(OSError, match="heard"),
        swept(grid_of(PerFragment()), settings, Output(), images=False),
    ):
        pass


def test_tables_set_methods_beside_vectorized():
    assert [create(method) for method in grid_of(PerFragment(vectors=32)).methods]
    rows = [
        {"scene": "s", "psnr_db": 30.0, "evaluations": 5, "visibility_bytes": 2e6, "frame_s": time}
        for time in (0.5, 1.0, 4.0)
    ]
    assert [row["method"] for row in table_of(rows)] == list(METHODS)
    assert [row["vectorized's / frame s"] for row in table_of(rows)] == [2.0, 1.0, 0.25]
    assert folder_of("models/a duck.glb") == "a-duck.glb"
