"""Writes RESULTS.md from what was stored: ``python -m experiments.results``.

The folder ``results/`` has, for each run that ``python -m experiments NAME --out results`` stored,
a folder with its tables as CSV and ``run.json`` (command, date, machine). ``claims.toml`` lists the
papers' numbers and the aims, each with where ours stands in these tables; ``notes/*.md`` say what
numbers alone do not, in the order of their names; a line ``{RUN/TABLE}`` of theirs stands for a
stored table, ``{RUN/TABLE: a column, another}`` for some of its columns. ``--check`` writes nothing
and fails where RESULTS.md is not what would be written.
"""

import contextlib
import csv
import json
import re
import sys
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from experiments.output import markdown, text
from experiments.papers import PAPERS
from jaxvis.cache import whole_file

ROOT = Path(__file__).parents[1]
STORE = ROOT / "results"
PAGE = ROOT / "RESULTS.md"

HEAD = """# Results

What was measured beside what the papers report. `python -m experiments.results` writes this page
from the folder `results/`; what it says stands in `results/claims.toml` and `results/notes/`. The
machines are virtual and shared: timings vary by a fifth or more between runs, and ratios were
measured side by side in one run. The papers' times are of GPUs: where a ratio of times does not
carry over to a CPU, counts (rays, evaluations, bytes) stand beside it. Commands and machines are
listed below the tables.
"""


@dataclass(frozen=True)
class Run:
    """A stored run: its tables by name, each a list of rows of text."""

    label: str
    command: str
    date: str
    machine: str
    tables: dict[str, list[dict[str, str]]]


@dataclass(frozen=True)
class Claim:
    """A number of a paper or an aim, and ours.

    Attributes:
        what: is measured, in a few words.
        paper: the paper's number (``000``), or ``""`` where the aim is our own.
        item: of the paper, as ``table 1``.
        theirs: the paper's value.
        aim: what ours should be, as ``>= 14.24``; empty where there is nothing to reach.
        unit: of both.
        run: label of the stored run that ours is of.
        table, column, where: the cell of that run, in the row with these values in these columns.
        pick: which of several rows counts: ``min``, ``max`` or ``mean``.
        ours: the value, where it was measured before runs were stored; then also
        command, date, machine: how, when and where.
        why: it falls short of the aim.
    """

    what: str
    paper: str = ""
    item: str = ""
    theirs: str = ""
    aim: str = ""
    unit: str = ""
    run: str = ""
    table: str = ""
    column: str = ""
    where: dict[str, str] = field(default_factory=dict)
    pick: str = ""
    ours: str = ""
    command: str = ""
    date: str = ""
    machine: str = ""
    why: str = ""


PICK = {"min": min, "max": max, "mean": lambda values: sum(values) / len(values)}


def read_runs(store: Path = STORE) -> dict[str, Run]:
    """Every stored run by its label.

    Raises:
        ValueError: a run.json lacks something.
    """
    runs = {}
    for path in sorted(store.glob("*/run.json")):
        said = json.loads(path.read_text())
        missing = {"command", "date", "machine"} - set(said)
        if missing:
            raise ValueError(f"{path}: lacks {', '.join(sorted(missing))}")
        tables = {table.stem: _rows(table) for table in sorted(path.parent.glob("*.csv"))}
        label = path.parent.name
        runs[label] = Run(label, said["command"], said["date"], said["machine"], tables)
    return runs


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def read_claims(store: Path = STORE) -> list[Claim]:
    """The claims in the order of the file.

    Raises:
        ValueError: a claim has what no claim has.
    """
    claims = []
    for entry in tomllib.loads((store / "claims.toml").read_text(encoding="utf-8"))["claim"]:
        unknown = set(entry) - set(Claim.__dataclass_fields__)
        if unknown:
            raise ValueError(f"claims.toml: {entry.get('what')!r} has {', '.join(sorted(unknown))}")
        claims.append(Claim(**entry))
    return claims


def value_of(claim: Claim, runs: dict[str, Run]) -> str:
    """Ours, as text: from the stored table, or as it was recorded.

    Raises:
        ValueError: the run, the table, the row or the column is not stored, or there are several.
    """
    if not claim.run:
        return claim.ours
    try:
        rows = runs[claim.run].tables[claim.table]
    except KeyError:
        raise ValueError(
            f"claims.toml: {claim.what!r}: no table {claim.table!r} of a run {claim.run!r}"
        ) from None
    cells = [
        row[claim.column]
        for row in rows
        if claim.column in row and all(row.get(k) == v for k, v in claim.where.items())
    ]
    if claim.pick and cells:
        return text(float(PICK[claim.pick]([number(cell) for cell in cells])))
    if len(cells) != 1:
        raise ValueError(
            f"claims.toml: {claim.what!r}: {len(cells)} rows of {claim.table!r} fit, not one"
        )
    try:
        return text(float(cells[0]))
    except ValueError:
        return cells[0]


def number(value: str) -> float:
    """The first number of a text such as ``≥ 14.2``.

    Raises:
        ValueError: there is none.
    """
    found = re.search(r"-?\d[\d,]*\.?\d*(?:e-?\d+)?", value)
    if found is None:
        raise ValueError(f"no number in {value!r}")
    return float(found[0].replace(",", ""))


def verdict(value: str, aim: str) -> str:
    """``reached`` or ``missed``, as also a bound from the wrong side that proves nothing."""
    if not aim:
        return ""
    sign, limit = aim.split()[0], number(aim)
    ours = number(value)
    wrong = "≤" if sign == ">=" else "≥"
    reached = ours >= limit if sign == ">=" else ours <= limit
    return "reached" if reached and not value.startswith(wrong) else "missed"


def page(store: Path = STORE) -> str:
    """RESULTS.md.

    Raises:
        ValueError: a claim that cannot be looked up, or that is missed and does not say why.
    """
    runs, claims = read_runs(store), read_claims(store)
    ways = _ways(runs, claims)
    machines = _letters([way.machine for way in ways])
    parts = [HEAD]
    for paper, title in {**PAPERS, "": "Aims of our own"}.items():
        of_paper = [claim for claim in claims if claim.paper == paper]
        if of_paper:
            heading = f"Paper {paper}: {title}" if paper else title
            parts.append(f"## {heading}\n\n{_claims_table(of_paper, runs, ways, machines)}\n")
    shorts = [claim for claim in claims if claim.why]
    if shorts:
        parts.append("## Where ours falls short, and why\n")
        parts.append("\n".join(f"- **{_named(c)}**: {c.why}" for c in shorts) + "\n")
    parts.append("## Machines and runs\n")
    parts.append("\n".join(f"- **{letter}**: {said}" for said, letter in machines.items()) + "\n")
    listed = [
        {
            "number": number,
            "command": f"`{way.command}`",
            "date": way.date,
            "machine": machines.get(way.machine, ""),
        }
        for way, number in ways.items()
    ]
    parts.append(f"{markdown(listed)}\n")
    notes = [path.read_text(encoding="utf-8") for path in sorted((store / "notes").glob("*.md"))]
    parts += [with_tables(note, runs) for note in notes]
    return "\n".join(part.strip("\n") + "\n" for part in parts)


TABLE = re.compile(r"^\{([^/{}]+)/([^:{}]+)(?::([^{}]*))?\}$", re.MULTILINE)
"""A line of a note that stands for a stored table: its run, its name, and columns of it."""


def with_tables(note: str, runs: dict[str, Run]) -> str:
    """A note with the stored tables that it names.

    Raises:
        ValueError: a run, a table or a column is not stored.
    """

    def table(found: re.Match[str]) -> str:
        label, name, listed = found.groups()
        rows = runs[label].tables.get(name) if label in runs else None
        if not rows:
            raise ValueError(f"notes: {found[0]}: no such table is stored")
        columns = [column.strip() for column in listed.split(",")] if listed else list(rows[0])
        missing = [column for column in columns if column not in rows[0]]
        if missing:
            raise ValueError(f"notes: {found[0]}: it has no {', '.join(missing)}")
        shown = [{column: _value(row[column]) for column in columns} for row in rows]
        return markdown(shown)

    return TABLE.sub(table, note)


def _value(cell: str) -> Any:
    """A stored cell as it was before it was written."""
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            return kind(cell)
    return cell or None


def _named(claim: Claim) -> str:
    return ", ".join(filter(None, (claim.paper and f"paper {claim.paper}", claim.item, claim.what)))


def _letters(machines: Sequence[str]) -> dict[str, str]:
    """Machine -> letter."""
    known = [said for said in dict.fromkeys(machines) if said]
    return {said: chr(ord("A") + i) for i, said in enumerate(known)}


class Way(NamedTuple):
    """How, when and where something was measured."""

    command: str
    date: str
    machine: str


def _way(claim: Claim, runs: dict[str, Run]) -> Way:
    source = runs.get(claim.run, claim)
    return Way(source.command, source.date, source.machine)


def _ways(runs: dict[str, Run], claims: list[Claim]) -> dict[Way, int]:
    """Every way with its number: the stored runs first."""
    every = [Way(run.command, run.date, run.machine) for run in runs.values()]
    every += [_way(claim, runs) for claim in claims]
    return {way: number for number, way in enumerate(dict.fromkeys(every), 1)}


def _claims_table(
    claims: list[Claim], runs: dict[str, Run], ways: dict[Way, int], machines: dict[str, str]
) -> str:
    rows: list[dict[str, Any]] = []
    for claim in claims:
        ours = value_of(claim, runs)
        state = verdict(ours, claim.aim)
        if state == "missed" and not claim.why:
            raise ValueError(f"claims.toml: {claim.what!r} is missed ({ours}) and has no why")
        way = _way(claim, runs)
        rows.append(
            {
                "what": f"{claim.item}: {claim.what}" if claim.item else claim.what,
                "the paper's": claim.theirs,
                "ours": f"{'**' if state == 'missed' else ''}{ours}"
                f"{' ' + claim.unit if claim.unit else ''}{'**' if state == 'missed' else ''}",
                "aim": claim.aim.replace(">=", "≥").replace("<=", "≤"),
                "": state,
                "command": str(ways[way]),
                "machine": machines.get(way.machine, ""),
                "date": way.date,
            }
        )
    return markdown(rows)


def main(arguments: Sequence[str]) -> int:
    """Writes the page, or checks it; the exit code."""
    try:
        new = page()
    except (ValueError, OSError) as error:
        print(f"results: {error}", file=sys.stderr)
        return 2
    if list(arguments) == ["--check"]:
        same = PAGE.read_text(encoding="utf-8") == new
        print("RESULTS.md is up to date" if same else "RESULTS.md is not what results/ gives")
        return 0 if same else 1
    if arguments:
        print(__doc__)
        return 2
    with whole_file(PAGE) as temporary:
        temporary.write_text(new, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
