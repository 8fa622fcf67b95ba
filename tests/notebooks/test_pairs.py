"""Every notebook is the pair of its script and holds no outputs."""

import jupytext
import nbformat
import pytest

from tests.notebooks.running import FOLDER, SCRIPTS

EVERY = pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)


def contents(notebook) -> list[tuple[str, str]]:
    return [(cell.cell_type, cell.source) for cell in notebook.cells]


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
