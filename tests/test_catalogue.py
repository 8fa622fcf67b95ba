"""The list of experiments, and how they are run."""

import dataclasses
import importlib
import json
import re
import sys
from pathlib import Path

import pytest

from experiments import catalogue, run
from experiments.catalogue import BY_NAME, EXPERIMENTS, Experiment, lacking, listing
from experiments.papers import ITEMS, PAPERS, shown_by
from experiments.settings import parse
from jaxvis import datasets

FOLDER = Path(run.__file__).parent
NUMBERS = {
    "000": {"table": 1, "fig.": 19},
    "001": {"table": 1, "fig.": 10},
    "002": {"table": 1, "fig.": 9},
    "003": {"table": 2, "fig.": 8},
}
"""How many each paper has."""


def scripts() -> set[str]:
    """The files of experiments/ that can be run, but what runs them."""
    return {
        path.stem
        for path in FOLDER.glob("*.py")
        if path.stem not in ("__main__", "results")
        and '\nif __name__ == "__main__":' in path.read_text()
    }


def test_every_script_is_in_the_catalogue_and_nothing_else():
    assert len(scripts()) > 10
    assert set(BY_NAME) == scripts()
    assert len(BY_NAME) == len(EXPERIMENTS)


def test_every_table_and_figure_of_the_papers_is_listed_once():
    labels = [(item.paper, item.label) for item in ITEMS]
    assert len(set(labels)) == len(labels)
    expected = {
        (paper, f"{kind} {number}")
        for paper, kinds in NUMBERS.items()
        for kind, count in kinds.items()
        for number in range(1, count + 1)
    }
    assert set(labels) == expected
    assert set(PAPERS) == set(NUMBERS)


def test_what_shows_an_item_exists():
    for item in ITEMS:
        assert set(item.scripts) <= set(BY_NAME), item
        for by in item.by:
            assert by.startswith("jaxvis ") or by.split()[0] in BY_NAME
        if not item.by and not item.diagram:
            assert item.lacks, f"{item.label} of {item.paper} is missing: say what is"


@pytest.mark.parametrize("name", BY_NAME)
def test_options_are_ones_that_the_script_has(name):
    """Parsed, not run: what the catalogue and the list of figures say must be understood."""
    kind = importlib.import_module(f"experiments.{name}").Settings
    assert dataclasses.is_dataclass(kind)
    assert kind.__dataclass_params__.frozen
    experiment = BY_NAME[name]
    assert parse(kind, experiment.quick) != parse(kind, [])
    parse(kind, experiment.full)
    for item in ITEMS:
        for by in item.by:
            if by.split()[0] == name:
                parse(kind, by.split()[1:])


def test_quick_runs_use_built_in_scenes_and_lights_alone():
    """They must run where no data are, without a download."""
    for experiment in EXPERIMENTS:
        for word in experiment.quick:
            assert word.partition(":")[0] not in datasets.names(), experiment.name
        given = set(experiment.quick)
        if set(experiment.data) & set(datasets.names("scene")):
            assert given & {"--scene", "--scenes"}, experiment.name
        if set(experiment.data) & set(datasets.names("probe")):
            assert given & {"--environment", "--quick"}, experiment.name


def test_the_listing_tells_what_is_shown_and_what_is_missing():
    text = listing()
    for experiment in EXPERIMENTS:
        assert f"| `{experiment.name}` | {experiment.shows} |" in text
    missing = [item for item in ITEMS if item.state == "missing"]
    assert text.count("**missing**") == len(missing)
    for line in text.splitlines():
        assert not line.startswith("|") or line.count("|") >= 4
    assert [item.label for item in shown_by("cone_table")] == [
        "fig. 6",
        "fig. 7",
        "fig. 8",
        "table 2",
    ]
    assert BY_NAME["cone_table"].papers == "003: fig. 6, fig. 7, fig. 8, table 2"


def test_without_arguments_it_lists(capsys):
    assert run.main([]) == 0
    assert capsys.readouterr().out == listing() + "\n"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["cone_tabel"], "unknown experiment 'cone_tabel': did you mean cone_table"),
        (["cone_table", "--all"], "--all runs everything"),
        (["--quick", "--scene", "duck"], "go with one NAME"),
        (["speed_rays", "large_frame", "--spp", "4"], "go with one NAME"),
        (["--out", "somewhere"], "nothing to run"),
        (["--quick", "--out"], "expected one argument"),
        (["--quick", "--label", "x"], "--label goes with one NAME"),
    ],
)
def test_wrong_usage_is_one_line(capsys, arguments, said):
    assert run.main(arguments) == 2
    error = capsys.readouterr().err
    assert said in error
    assert len(error.splitlines()) == 1


def test_help_says_how_it_is_used(capsys):
    assert run.main(["--help"], usage="how to") == 0
    assert capsys.readouterr().out == "how to\n"


def test_a_full_run_takes_own_options_instead_and_a_quick_one_besides():
    experiment = Experiment("x", "shows", quick=("--spp", "1"), full=("--sweep",))
    assert run.arguments_of(experiment, quick=False) == ["--sweep"]
    assert run.arguments_of(experiment, quick=False, own=["--spp", "9"]) == ["--spp", "9"]
    assert run.arguments_of(experiment, quick=True, own=["--spp", "9"]) == [
        *("--spp", "1", "--spp", "9")
    ]


STUBS = {
    "plain": "import sys; print('a  b'); print('1  2'); print(*sys.argv[1:3])",
    "markdown": "print('| a |'); print('|---|'); print('| é |')",
    "fails": "print('half'); raise SystemExit('it is | broken')",
    "crashes": "print('nothing'); 1 / 0",
    "after": "import pathlib, sys; pathlib.Path(sys.argv[-1]).mkdir()",
}


def stub(name: str, **settings) -> Experiment:
    return Experiment(name, f"what {name} shows", quick=("--spp", "1 2"), **settings)


def command(experiment: Experiment) -> list[str]:
    return [sys.executable, "-c", STUBS[experiment.name]]


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """Outcomes and folder of a run of all stubs, one of which needs what nobody has."""
    folder = tmp_path_factory.mktemp("ran") / "new" / "folder"
    stubs = [stub(name) for name in STUBS]
    stubs.insert(2, stub("absent", needs=(("no_such_module", "peers"),)))
    outcomes = run.run_all(stubs, folder, quick=True, command=command)
    return {outcome.name: outcome for outcome in outcomes}, folder


def test_a_failure_is_reported_and_stops_nothing(ran):
    outcomes, folder = ran
    codes = {name: outcome.code for name, outcome in outcomes.items()}
    assert codes == {
        **dict.fromkeys(("plain", "markdown", "after"), 0),
        **dict.fromkeys(("fails", "crashes"), 1),
        "absent": None,
    }
    assert outcomes["crashes"].note == "ZeroDivisionError: division by zero"
    page = (folder / "fails.md").read_text()
    assert "half" in page
    assert "failed with exit code 1" in page
    assert "it is | broken" in page
    assert "failed" not in (folder / "plain.md").read_text()


def test_what_is_missing_is_said_and_skipped(ran):
    outcomes, folder = ran
    assert outcomes["absent"].note == 'no_such_module is not installed: pip install "jaxvis[peers]"'
    assert not (folder / "absent.md").exists()
    assert outcomes["absent"].seconds == 0.0


def test_pages_have_the_command_the_seconds_the_machine_and_the_date(ran):
    _, folder = ran
    page = (folder / "plain.md").read_text()
    assert "`python -m experiments.plain --spp '1 2'`" in page
    assert re.search(r"\d+ s, \d{4}-\d\d-\d\d, \d+ cores of .*jax \d", page)
    assert "What plain shows." in page
    assert "```\na  b\n1  2\n--spp 1 2\n```" in page
    assert sys.executable not in page


def test_tables_in_markdown_stay_tables(ran):
    _, folder = ran
    page = (folder / "markdown.md").read_text()
    assert "\n\n| a |\n|---|\n| é |\n" in page
    assert "```" not in page


def test_pictures_go_to_a_folder_of_the_experiments_own(ran):
    _, folder = ran
    assert (folder / "after").is_dir()
    assert str(folder) not in (folder / "after.md").read_text()
    assert not list(folder.glob(".*"))  # nothing half-written


def test_what_ran_is_on_record_and_what_failed_is_not(ran):
    _, folder = ran
    record = json.loads((folder / "plain" / "run.json").read_text())
    assert record["command"] == "python -m experiments.plain --spp '1 2'"
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", record["date"])
    assert "cores of" in record["machine"]
    assert not (folder / "fails" / "run.json").exists()


def test_a_label_names_what_is_kept(monkeypatch, tmp_path):
    monkeypatch.setattr(run, "BY_NAME", {"plain": stub("plain")})
    monkeypatch.setattr(run, "command_of", command)
    out = ["--quick", "--out", str(tmp_path), "--label", "again"]
    assert run.main(["plain", *out]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["again", "again.md"]


def test_the_summary_counts(ran):
    _, folder = ran
    text = (folder / "summary.md").read_text()
    assert "6 in " in text
    assert "2 failed, 1 skipped" in text
    assert "| fails | failed | 1 |" in text
    assert "it is / broken" in text


def test_the_exit_code_tells_of_failures(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(run, "BY_NAME", {name: stub(name) for name in STUBS})
    monkeypatch.setattr(run, "command_of", command)
    out = ["--quick", "--out", str(tmp_path)]
    assert run.main(["plain", *out]) == 0
    assert not (tmp_path / "summary.md").exists()
    assert "a  b\n1  2\n" in capsys.readouterr().out  # one alone also shows what it prints
    assert run.main(["crashes", "plain", *out]) == 1
    assert (tmp_path / "plain.md").exists()


def test_an_unwritable_folder_is_one_line(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert run.main(["speed_rays", "--quick", "--out", str(tmp_path / "file")]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_a_full_run_without_its_data_is_skipped(monkeypatch):
    def find(name):
        raise FileNotFoundError(f"data set {name!r}: JAXVIS_DATA is not set")

    monkeypatch.setattr(catalogue.datasets, "find", find)
    experiment = BY_NAME["zeta_sweep"]
    assert lacking(experiment) == "data set 'duck': JAXVIS_DATA is not set"
    assert lacking(experiment, data=False) == ""
