"""The notebooks about all methods run."""

import nbformat
import pytest
from nbclient.exceptions import CellExecutionError

from tests.notebooks.running import SCRIPTS, check, execute


@pytest.mark.parametrize("script", SCRIPTS[:1] + SCRIPTS[5:], ids=lambda path: path.stem)
def test_notebook_runs(script, tmp_path, monkeypatch):
    check(script, tmp_path, monkeypatch)


def test_errors_are_fatal(tmp_path, monkeypatch):
    """The test of the test."""
    cells = [nbformat.v4.new_code_cell("import jaxvis; jaxvis.load_scene('no such scene')")]
    with pytest.raises(CellExecutionError, match="no such scene"):
        execute(nbformat.v4.new_notebook(cells=cells), tmp_path, monkeypatch)
