"""Runs notebooks from top to bottom: two files of tests do, since each file goes to one process."""

import json
import sys
from pathlib import Path

import jupytext
from nbclient import NotebookClient

FOLDER = Path(__file__).parents[2] / "notebooks"
SCRIPTS = sorted(FOLDER.glob("[0-9][0-9]_*.py"))

SECONDS_PER_CELL = 600
"""Only so that what hangs ends."""


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


def check(script: Path, folder: Path, monkeypatch) -> None:
    """Runs a notebook; it must show pictures and warn of nothing."""
    notebook = jupytext.read(script)
    execute(notebook, folder, monkeypatch)
    shown = [out for cell in notebook.cells for out in cell.get("outputs", [])]
    assert any("image/png" in out.get("data", {}) for out in shown)
    assert not any(out.get("name") == "stderr" for out in shown), "warnings mar a notebook"
