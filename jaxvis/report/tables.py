"""The table of a comparison, as Markdown and as CSV."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from jaxvis.compare import Comparison
from jaxvis.report import numbers

Row = dict[str, Any]


@dataclass(frozen=True)
class Column:
    """A column of the table. ``best`` is max or min where one end is better, else None."""

    key: str
    title: str
    explanation: str
    text: Callable[[Row], str]
    best: Callable[..., Any] | None = None

    def value(self, row: Row) -> float | None:
        """What rows are sorted by; None where there is nothing to compare."""
        if self.key == "psnr_db" and row.get("rmse") == 0.0:
            return float("inf")
        value = row.get(self.key)
        return None if value is None else float(value)


COLUMNS = (
    Column("psnr_db", "PSNR (dB)", "sRGB images, pixels that see the scene", numbers.decibels, max),
    Column("flip", "FLIP", "mean perceptual difference, 0 to 1", lambda r: _of(r, "flip"), min),
    Column("rmse", "RMSE", "linear radiance", lambda r: _of(r, "rmse"), min),
    Column("relmse", "relMSE", "linear, relative, squared", lambda r: _of(r, "relmse"), min),
    Column("frame_s", "frame", "one warm frame, median", lambda r: _time(r, "frame_s"), min),
    Column("precompute_s", "precompute", "visibility", lambda r: _time(r, "precompute_s")),
    Column("light_s", "light", "taking in a new light, warm", lambda r: _time(r, "light_s")),
    Column("compile_s", "compile", "XLA, light and shade", lambda r: _time(r, "compile_s")),
    Column(
        "visibility_bytes",
        "memory",
        "what precompute stores",
        lambda r: numbers.memory(r.get("visibility_bytes")),
        min,
    ),
    Column("rays_traced", "rays", "per frame", lambda r: numbers.count(r.get("rays_traced"))),
    Column(
        "evaluations",
        "evaluations",
        "directions or polygons integrated per frame",
        lambda r: numbers.count(r.get("evaluations")),
    ),
)


PLAIN_COLUMNS = ("psnr_db", "flip", "frame_s", "precompute_s", "compile_s", "visibility_bytes")
"""The columns that fit a terminal."""


def _of(row: Row, key: str) -> str:
    return numbers.significant(row.get(key))


def _time(row: Row, key: str) -> str:
    return numbers.seconds(row.get(key))


def best_rows(column: Column, rows: list[Row]) -> set[int]:
    """Indices of the rows that are best in a column; none where they cannot be told apart."""
    values = {i: v for i, row in enumerate(rows) if (v := column.value(row)) is not None}
    if column.best is None or len(set(values.values())) < 2:
        return set()
    winner = column.best(values.values())
    return {i for i, value in values.items() if value == winner}


def markdown(comparison: Comparison) -> str:
    """A heading that says what was compared, and the table."""
    rows = comparison["results"]
    lines = [
        f"# {_cell(comparison['scene'])} under {_cell(comparison['environment'])}",
        "",
        f"{summary(comparison)}.",
        "",
        "| method | " + " | ".join(column.title for column in COLUMNS) + " |",
        "|:--|" + "--:|" * len(COLUMNS),
    ]
    best = [best_rows(column, rows) for column in COLUMNS]
    for i, row in enumerate(rows):
        cells = [
            f"**{column.text(row)}**" if i in winners else column.text(row)
            for column, winners in zip(COLUMNS, best, strict=True)
        ]
        lines.append(f"| {_cell(row['label'])} | " + " | ".join(cells) + " |")
    failed = [f"- {_cell(row['label'])} failed: {row['error']}" for row in comparison.failed]
    return "\n".join([*lines, *([""] if failed else []), *failed, ""])


def plain(comparison: Comparison) -> str:
    """The table for a terminal, in aligned columns."""
    columns = [c for c in COLUMNS if c.key in PLAIN_COLUMNS]
    lines = [["method", *(column.title for column in columns)]]
    for row in comparison["results"]:
        cells = [row["error"]] if "error" in row else [column.text(row) for column in columns]
        lines.append([row["label"], *cells])
    whole = [line for line in lines if len(line) == len(lines[0])]
    widths = [max(len(line[i]) for line in whole) for i in range(len(lines[0]))]
    widths[0] = max(len(line[0]) for line in lines)
    return "\n".join(
        "  ".join(
            [line[0].ljust(widths[0])]
            + [text.rjust(width) for text, width in zip(line[1:], widths[1:], strict=False)]
        )
        for line in lines
    )


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def csv(comparison: Comparison) -> str:
    """Every row and value of results.json but curves and notes; the names of its keys on top."""
    return comparison.to_frame().to_csv(index=False)


def summary(comparison: Comparison) -> str:
    """What was rendered and measured, in one line."""
    width, height = comparison["size"]
    reference = comparison["reference"]
    error = reference.get("relative_error")
    parts = [
        f"{width} × {height} pixels",
        f"{comparison['scene_info']['covered_pixels']:,} of them see the scene",
        comparison["reflectance"],
        f"reference with a standard error of {100 * error:.2g} %" if error else "exact reference",
        f"seed {comparison['seed']}",
    ]
    return ", ".join(parts)
