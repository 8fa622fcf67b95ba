"""What an experiment shows: lines and tables on the terminal, and files in the folder ``--out``."""

import csv
import math
import numbers
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from jaxvis.cache import whole_file

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Output:
    """Prints Markdown; ``table`` also writes CSV, and pictures have a place, if there is a folder.

    Attributes:
        folder: where files go; None writes none.
    """

    folder: Path | None = None
    _named: set[str] = field(default_factory=set)

    def say(self, text: str) -> None:
        """One paragraph."""
        print(f"{text}\n", flush=True)

    def table(self, name: str, title: str, rows: Iterable[Row]) -> None:
        """A table: on the terminal under its title, and as ``NAME.csv``.

        Args:
            name: of the file, without suffix; one of its own for each table.
            title: one line.
            rows: column -> value; a row may lack columns. None are shown as a line that says so.
        """
        if name in self._named:
            raise ValueError(f"two tables are named {name!r}: the second would replace the first")
        self._named.add(name)
        rows = list(rows)
        print(f"## {title}\n\n{markdown(rows)}\n", flush=True)
        if self.folder is not None:
            write_csv(self.folder / f"{name}.csv", rows)

    def path(self, name: str) -> Path | None:
        """Where a picture goes: a file below the folder, whose own folder exists then."""
        if self.folder is None:
            return None
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        return path


def markdown(rows: Sequence[Row]) -> str:
    """A table in Markdown, numbers with four significant digits."""
    if not rows:
        return "(no rows)"
    columns = columns_of(rows)
    numeric = {c for c in columns if all(_is_number(row.get(c)) for row in rows if c in row)}
    lines = [
        _line(columns),
        _line("---:" if column in numeric else "---" for column in columns),
        *(_line(text(row.get(column)) for column in columns) for row in rows),
    ]
    return "\n".join(lines)


def columns_of(rows: Sequence[Row]) -> list[str]:
    """Every column, in the order in which rows first have it."""
    return list(dict.fromkeys(column for row in rows for column in row))


def text(value: Any) -> str:
    """A cell: numbers with four significant digits and no exponent up to a million."""
    if value is None or (_is_number(value) and math.isnan(value)):
        return ""
    if isinstance(value, numbers.Integral) and not isinstance(value, bool):
        return f"{int(value):,}"
    if _is_number(value):
        number = float(value)
        return f"{number:,.0f}" if 1e4 <= abs(number) < 1e9 else f"{number:.4g}"
    return str(value).replace("|", "/")


def write_csv(path: Path, rows: Sequence[Row]) -> None:
    """Every row in full precision, with the columns' names; the file as a whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns_of(rows), lineterminator="\n")
        writer.writeheader()
        writer.writerows({column: _plain(row[column]) for column in row} for row in rows)


def _plain(value: Any) -> Any:
    """Numbers as Python has them: short, and read back as they were."""
    return value.item() if hasattr(value, "item") else value


def _is_number(value: Any) -> bool:
    return isinstance(value, numbers.Real) and not isinstance(value, bool)


def _line(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"
