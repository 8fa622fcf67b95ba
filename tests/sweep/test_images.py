"""Images of a sweep: those of the rows and references that the table names."""

from dataclasses import replace

import numpy as np
import pytest

import jaxvis
from jaxvis.image import read_image
from jaxvis.methods import MonteCarlo
from jaxvis.sweep import Grid, run_grid
from jaxvis.sweep import run as module
from jaxvis.sweep.images import FOLDER, LONGEST, has_image, name_of
from jaxvis.sweep.store import TABLE, Store

GRID = Grid(
    ("mc-mis:spp=1", "mc-brdf:spp=2"),
    scene=("sphere-on-plane",),
    environment=("windows",),
    rotate=(0.0, 90.0),
    size=(16, 12),
    albedo=0.5,
    reference="reference:error=0.05",
)


@pytest.fixture(scope="module", autouse=True)
def cache(own_caches):
    """Of this module's own."""


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """The folder of a sweep with images, and its frame."""
    folder = tmp_path_factory.mktemp("swept")
    return folder, run_grid(GRID, folder, workers=0, images=True)


@pytest.fixture
def measured(monkeypatch):
    """The jobs that are measured from here on."""
    known, jobs = module.run_job, []

    def run_job(job, *args, **options):
        jobs.append(job)
        return known(job, *args, **options)

    monkeypatch.setattr(module, "run_job", run_job)
    return jobs


def test_they_are_those_of_a_comparison(swept):
    folder, frame = swept
    assert sorted(p.name for p in (folder / FOLDER).iterdir()) == sorted(
        name.removeprefix(f"{FOLDER}/").replace(".exr", suffix)
        for name in {*frame["image"], *frame["reference_image"]}
        for suffix in (".exr", ".png")
    )
    assert frame["image"].nunique() == 4
    assert frame["reference_image"].nunique() == 2
    assert frame["image"][0].startswith(f"{FOLDER}/sphere-on-plane-windows-mc-mis-spp-1-0-")
    assert frame["reference_image"][3].startswith(f"{FOLDER}/sphere-on-plane-windows-90-reference-")
    comparison = jaxvis.compare(
        *(GRID.scene[0], GRID.environment[0], GRID.methods, GRID.size),
        rotate=np.pi / 2,
        albedo=GRID.albedo,
        reference=GRID.reference,
    )
    for method, label in [*((m, m) for m in GRID.methods), (GRID.methods[0], "reference")]:
        row = frame[(frame["method"] == method) & (frame["rotate"] == 90.0)].iloc[0]
        name = row["reference_image" if label == "reference" else "image"]
        np.testing.assert_array_equal(read_image(folder / name), comparison.images[label])
        shown = read_image((folder / name).with_suffix(".png"))
        np.testing.assert_allclose(shown, comparison.shown(label), atol=0.51 / 255)


def test_workers_give_the_same(swept, tmp_path):
    run_grid(GRID, tmp_path, workers=2, images=True)
    assert (tmp_path / TABLE).read_text().splitlines()[0] == (
        (swept[0] / TABLE).read_text().splitlines()[0]
    )
    names = {p.name for p in (swept[0] / FOLDER).iterdir()}
    assert {p.name for p in (tmp_path / FOLDER).iterdir()} == names
    for name in names:
        ours, theirs = (read_image(f / FOLDER / name) for f in (swept[0], tmp_path))
        np.testing.assert_allclose(ours, theirs, rtol=1e-5, atol=1e-6)


def test_rows_without_are_measured_again_and_others_are_not(tmp_path, measured):
    frame = run_grid(GRID, tmp_path, workers=0)
    assert frame["image"].isna().all()
    assert not (tmp_path / FOLDER).exists()
    measured.clear()
    frame = run_grid(GRID, tmp_path, workers=0, images=True)
    assert len(measured) == 4
    (tmp_path / frame["image"][1]).unlink()
    (tmp_path / frame["reference_image"][2]).unlink()
    measured.clear()
    again = run_grid(GRID, tmp_path, workers=0, images=True)
    assert measured == list(GRID.jobs()[1:4])  # the last two share a reference
    assert again["image"].equals(frame["image"])
    assert (tmp_path / frame["image"][1]).exists()
    measured.clear()
    run_grid(GRID, tmp_path, workers=0)
    assert not measured


def test_a_method_that_fails_has_none(tmp_path, monkeypatch):
    def refuse(self, environment):
        raise ValueError("too dark")

    grid = replace(GRID, methods=("mc-mis:spp=1",), rotate=(0.0,))
    with monkeypatch.context() as patch:
        patch.setattr(MonteCarlo, "light", refuse)
        frame = run_grid(grid, tmp_path, workers=0, images=True)
    assert frame["image"].isna().all()
    (job,) = grid.jobs()
    assert has_image(tmp_path, job.view)
    assert run_grid(grid, tmp_path, workers=0, images=True)["error"].tolist() == ["too dark"]
    frame = run_grid(grid, tmp_path, workers=0, images=True, retry=True)
    assert frame["image"].tolist() == [name_of(job)]


def test_what_stops_between_image_and_row_ends_whole(tmp_path, monkeypatch, swept):
    known = Store.append

    def append(store, job, row):
        if len(store.rows) == 2:
            raise OSError("the disk is full")
        known(store, job, row)

    with monkeypatch.context() as patch:
        patch.setattr(Store, "append", append)
        with pytest.raises(OSError, match="full"):
            run_grid(GRID, tmp_path, workers=0, images=True)
    frame = run_grid(GRID, tmp_path, workers=0, images=True)
    columns = ["image", "reference_image", "psnr_db"]
    assert frame[columns].equals(swept[1][columns])
    assert all((tmp_path / name).exists() for name in frame["image"])


def test_names_are_short_enough_and_each_job_has_its_own():
    long = replace(GRID, scene=(f"folder/{'x' * 300}.glb",), size=(8, 8)).jobs()
    names = [name_of(job) for job in (*GRID.jobs(), *long)]
    assert len(set(names)) == len(names)
    assert max(map(len, names)) <= len(FOLDER) + 1 + LONGEST + 13
    assert all(name.count("/") == 1 for name in names)
