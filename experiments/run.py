"""Runs experiments, each in a process of its own, and keeps what they print.

Used by ``python -m experiments``.
"""

import argparse
import datetime
import json
import os
import shlex
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import NoReturn

from experiments.catalogue import BY_NAME, EXPERIMENTS, Experiment, lacking, listing
from jaxvis import specs
from jaxvis.cache import cache_folder, whole_file

ROOT = Path(__file__).parents[1]
OUT = Path("jaxvis-out") / "experiments"
COMPILED_ONCE = {
    "JAX_COMPILATION_CACHE_DIR": str(cache_folder() / "xla"),
    "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
    "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
}
"""Experiments share programs, and what they time is never compilation."""

TAIL = 30
"""Last lines of what a failed experiment said that are kept."""

Command = Callable[[Experiment], list[str]]
"""The words that start an experiment's process, before its arguments."""


@dataclass(frozen=True)
class Outcome:
    """How a run ended: ``code`` is None where it was skipped, for the reason in ``note``."""

    name: str
    code: int | None
    seconds: float
    note: str = ""


class _Parser(argparse.ArgumentParser):
    """An ArgumentParser that reports wrong usage in one line."""

    def error(self, message: str) -> NoReturn:
        raise ValueError(message)


def main(arguments: Sequence[str], usage: str = "") -> int:
    """Lists or runs what the command line says; returns the exit code."""
    try:
        return _main(list(arguments), usage)
    except (ValueError, OSError) as error:
        print(f"experiments: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


def _main(arguments: list[str], usage: str) -> int:
    names = list(takewhile(lambda text: not text.startswith("-"), arguments))
    parser = _Parser(allow_abbrev=False, add_help=False)
    parser.add_argument("--all", action="store_true")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--label")
    options, own = parser.parse_known_args(arguments[len(names) :])
    unknown = [name for name in names if name not in BY_NAME]
    if unknown:
        raise ValueError(specs.unknown(unknown[0], BY_NAME, "experiment"))
    if options.label is not None and len(names) != 1:
        raise ValueError("--label goes with one NAME: it says where its results are kept")
    if options.all and names:
        raise ValueError("--all runs everything: give names or --all, not both")
    if not {"-h", "--help"}.isdisjoint(own):
        if len(names) != 1:
            print(usage)
            return 0
        return subprocess.run([*command_of(BY_NAME[names[0]]), "--help"], cwd=ROOT).returncode
    if own and len(names) != 1:
        raise ValueError(f"{' '.join(own)}: options of its own go with one NAME, before them")
    if not arguments:
        print(listing())
        return 0
    if not names and not options.all and not options.quick:
        raise ValueError("nothing to run: give a NAME, --quick or --all")
    chosen = [BY_NAME[name] for name in dict.fromkeys(names)] or list(EXPERIMENTS)
    alone = len(chosen) == 1
    outcomes = run_all(
        *(chosen, options.out),
        quick=options.quick,
        own=own,
        label=options.label,
        echo=alone,
    )
    return 1 if any(outcome.code for outcome in outcomes) else 0


def command_of(experiment: Experiment) -> list[str]:
    """What starts an experiment's process."""
    return [sys.executable, "-m", f"experiments.{experiment.name}"]


def arguments_of(experiment: Experiment, quick: bool, own: Sequence[str] = ()) -> list[str]:
    """Its arguments: those of a quick run, or of a full one where it is given none of its own."""
    if quick:
        return [*experiment.quick, *own]
    return list(own or experiment.full)


def run_all(
    experiments: Sequence[Experiment],
    out: Path,
    *,
    quick: bool,
    own: Sequence[str] = (),
    label: str | None = None,
    echo: bool = False,
    command: Command | None = None,
) -> list[Outcome]:
    """Runs experiments one after another, prints how each ended, and writes ``summary.md`` where
    there are several.

    Args:
        experiments: what to run.
        out: folder for ``NAME.md`` and ``NAME/`` with tables, pictures and ``run.json``.
        quick: at small sizes.
        own: arguments of the user's for the experiment.
        label: stands for NAME in the names of files.
        echo: print what they print while they run.
        command: what starts a process; by default :func:`command_of`.

    Raises:
        OSError: the folder cannot be written to.
    """
    out.mkdir(parents=True, exist_ok=True)
    command = command or command_of
    outcomes = []
    for number, experiment in enumerate(experiments, 1):
        print(f"[{number}/{len(experiments)}] {experiment.name}", file=sys.stderr, flush=True)
        # Quick runs need no data, and options of the user's may name other data.
        reason = lacking(experiment, data=not quick and not own)
        if reason:
            outcome = Outcome(experiment.name, None, 0.0, reason)
        else:
            kept = out / (label or experiment.name)
            outcome = _run(experiment, arguments_of(experiment, quick, own), kept, echo, command)
        outcomes.append(outcome)
        if outcome.code != 0:
            print(f"    {_state(outcome)}: {outcome.note}", file=sys.stderr, flush=True)
    if len(outcomes) > 1:
        _write(out / "summary.md", summary(outcomes))
    print(f"\n{summary(outcomes)}\n{out}", flush=True)
    return outcomes


def _run(
    experiment: Experiment, arguments: list[str], kept: Path, echo: bool, command: Command
) -> Outcome:
    """Runs one experiment and writes ``kept.md``, also where it failed; the rest to ``kept/``."""
    words = [*command(experiment), *arguments, "--out", str(kept.resolve())]
    environment = {**COMPILED_ONCE, **os.environ, "PYTHONUNBUFFERED": "1"}
    lines: list[str] = []
    start = time.perf_counter()
    with (
        tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as said,
        subprocess.Popen(
            words,
            cwd=ROOT,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=said,
            text=True,
            encoding="utf-8",
            errors="replace",
        ) as process,
    ):
        try:
            assert process.stdout is not None  # it is a pipe
            for line in process.stdout:
                lines.append(line.rstrip("\n"))
                if echo:
                    print(lines[-1], flush=True)
            code = process.wait()
        except BaseException:
            process.kill()
            raise
        seconds = time.perf_counter() - start
        said.seek(0)
        complaints = said.read().splitlines()
    note = next((line.strip() for line in reversed(complaints) if line.strip()), "")
    outcome = Outcome(experiment.name, code, seconds, note[:200] if code else "")
    _write(
        kept.with_name(f"{kept.name}.md"), page(experiment, arguments, outcome, lines, complaints)
    )
    if code == 0:
        kept.mkdir(exist_ok=True)
        record = {"command": command_line(experiment, arguments), "seconds": round(seconds, 1)}
        record |= {"date": today(), "machine": machine_in_words()}
        _write(kept / "run.json", json.dumps(record, indent=2) + "\n")
    return outcome


def command_line(experiment: Experiment, arguments: Sequence[str]) -> str:
    """What a user types for this, but for where results go."""
    return shlex.join(["python", "-m", f"experiments.{experiment.name}", *arguments])


def today() -> str:
    return datetime.datetime.now(datetime.UTC).date().isoformat()


def page(
    experiment: Experiment,
    arguments: Sequence[str],
    outcome: Outcome,
    lines: Sequence[str],
    complaints: Sequence[str],
) -> str:
    """What an experiment printed, as Markdown, under what was run, where and when."""
    shown = f" ({experiment.papers})" if experiment.papers else ""
    parts = [
        f"# {experiment.name}",
        f"{experiment.shows[:1].upper()}{experiment.shows[1:]}{shown}.",
        f"`{command_line(experiment, arguments)}`",
        f"{outcome.seconds:.0f} s, {today()}, {machine_in_words()}",
    ]
    body = "\n".join(lines).strip("\n")
    # Tables for terminals keep their columns only in a fence.
    fenced = body and not any(line.startswith("|") for line in lines)
    parts.append(f"```\n{body}\n```" if fenced else body)
    if outcome.code:
        tail = "\n".join(complaints[-TAIL:])
        parts.append(f"**It failed with exit code {outcome.code}:**\n\n```\n{tail}\n```")
    return "\n\n".join(part for part in parts if part) + "\n"


def machine_in_words() -> str:
    """The machine and the versions that a result depends on, in one line."""
    from jaxvis.compare.machine import machine, versions

    found, of = machine(), versions()
    memory = found["memory_gib"]
    return ", ".join(
        [
            f"{found['cores']} cores of {found['cpu']}",
            *([] if memory is None else [f"{memory:g} GiB"]),
            f"JAX on {found['jax_device']}",
            *(f"{name} {of[name]}" for name in ("jaxvis", "jax", "embreex")),
        ]
    )


def summary(outcomes: Sequence[Outcome]) -> str:
    """Markdown: how each run ended and how long it took."""
    rows = ["| experiment | result | rc | seconds | |", "|---|---|---|---|---|"]
    for outcome in outcomes:
        code = "" if outcome.code is None else outcome.code
        rows.append(
            f"| {outcome.name} | {_state(outcome)} | {code} | {outcome.seconds:.1f} "
            f"| {outcome.note.replace('|', '/')} |"
        )
    total = sum(outcome.seconds for outcome in outcomes)
    failed = sum(bool(outcome.code) for outcome in outcomes)
    skipped = sum(outcome.code is None for outcome in outcomes)
    rows.append(f"\n{len(outcomes)} in {total:.0f} s: {failed} failed, {skipped} skipped")
    return "\n".join(rows) + "\n"


def _state(outcome: Outcome) -> str:
    return "skipped" if outcome.code is None else "failed" if outcome.code else "done"


def _write(path: Path, text: str) -> None:
    """Writes a file as a whole or not at all."""
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
