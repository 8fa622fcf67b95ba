"""The notebooks about one method each run."""

import pytest

from tests.notebooks.running import SCRIPTS, check


@pytest.mark.parametrize("script", SCRIPTS[1:5], ids=lambda path: path.stem)
def test_notebook_runs(script, tmp_path, monkeypatch):
    check(script, tmp_path, monkeypatch)
