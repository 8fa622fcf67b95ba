"""Every notebook is the pair of its script, holds no outputs, and runs from top to bottom."""

import json
import os
import sys
from pathlib import Path

import jupytext
import nbformat
import pytest
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

FOLDER = Path(__file__).parents[1] / "notebooks"
SCRIPTS = sorted(FOLDER.glob("[0-9][0-9]_*.py"))

EXECUTED = SCRIPTS if os.environ.get("JAXVIS_NOTEBOOKS") == "all" else SCRIPTS[:1]
"""The first, whose cells use most of the package; all take minutes: ``JAXVIS_NOTEBOOKS=all``."""

SECONDS_PER_CELL = 600
"""Only so that what hangs ends."""

EVERY = pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)


def contents(notebook) -> list[tuple[str, str]]:
    return [(cell.cell_type, cell.source) for cell in notebook.cells]


def execute(notebook, folder: Path, monkeypatch) -> None:
    """Runs all cells in a kernel of this environment that knows no cache or data of the user's.

    Raises:
        CellExecutionError: a cell failed.
    """
    notebook.metadata.kernelspec = own_kernel(folder, monkeypatch)
    monkeypatch.setenv("JAXVIS_CACHE", str(folder / "cache"))
    monkeypatch.delenv("JAXVIS_DATA", raising=False)
    monkeypatch.setenv("JUPYTER_PLATFORM_DIRS", "1")  # else Jupyter warns of its folders
    at_work = {"metadata": {"path": str(folder)}}
    NotebookClient(notebook, timeout=SECONDS_PER_CELL, resources=at_work).execute()


def own_kernel(folder: Path, monkeypatch) -> dict[str, str]:
    """A kernel with this interpreter: "python3" may be another of the user's."""
    place = folder / "jupyter" / "kernels" / "tested"
    place.mkdir(parents=True)
    command = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
    spec = {"argv": command, "display_name": "tested", "language": "python"}
    (place / "kernel.json").write_text(json.dumps(spec))
    monkeypatch.setenv("JUPYTER_PATH", str(folder / "jupyter"))
    return {"name": "tested", "display_name": "tested", "language": "python"}


def test_there_are_notebooks():
    assert SCRIPTS


def test_every_notebook_has_a_script_and_is_listed():
    assert sorted(FOLDER.glob("*.ipynb")) == [script.with_suffix(".ipynb") for script in SCRIPTS]
    listed = (FOLDER / "README.md").read_text()
    assert all(f"({script.stem}.ipynb)" in listed for script in SCRIPTS)


@EVERY
def test_notebook_is_the_pair_of_its_script(script):
    """`jupytext --sync notebooks/*.py` makes it so."""
    paired = nbformat.read(script.with_suffix(".ipynb"), as_version=4)
    nbformat.validate(paired)
    assert contents(paired) == contents(jupytext.read(script))


@EVERY
def test_notebook_has_no_outputs(script):
    paired = nbformat.read(script.with_suffix(".ipynb"), as_version=4)
    code = [cell for cell in paired.cells if cell.cell_type == "code"]
    assert code
    assert all(not cell.outputs and cell.execution_count is None for cell in code)


@pytest.mark.parametrize("script", EXECUTED, ids=lambda path: path.stem)
def test_notebook_runs(script, tmp_path, monkeypatch):
    notebook = jupytext.read(script)
    execute(notebook, tmp_path, monkeypatch)
    shown = [out for cell in notebook.cells for out in cell.get("outputs", [])]
    assert any("image/png" in out.get("data", {}) for out in shown)
    assert not any(out.get("name") == "stderr" for out in shown), "warnings mar a notebook"


def test_errors_are_fatal(tmp_path, monkeypatch):
    """The test of the test."""
    cells = [nbformat.v4.new_code_cell("import jaxvis; jaxvis.load_scene('no such scene')")]
    with pytest.raises(CellExecutionError, match="no such scene"):
        execute(nbformat.v4.new_notebook(cells=cells), tmp_path, monkeypatch)
