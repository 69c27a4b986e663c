"""Output of commands: tables and JSON on stdout, notes and progress bars on stderr."""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Iterable, Sequence
from datetime import datetime
from typing import TYPE_CHECKING, TextIO

from hereabouts.cli.text_table import printable, text_blocks, text_table
from kg.model.vocabulary import shorten

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

    from kg.model.transactions import ChangeSet
    from planner.search.plans.thesis_rules import Plan
    from planner.search.plans.view_plan import ViewPlan

# wide enough that a table piped into a file or pager is not squeezed into 80 columns
_PIPE_WIDTH = 200


def out() -> Console:
    """The console of the answer."""
    from rich.console import Console

    return Console(width=None if sys.stdout.isatty() else _PIPE_WIDTH, soft_wrap=False)


def err() -> Console:
    """The console of notes and progress."""
    from rich.console import Console

    return Console(stderr=True)


def note(message: str) -> None:
    """A line on stderr, dim where colours are on."""
    print(_styled(printable(message), "2", sys.stderr), file=sys.stderr)  # noqa: T201


def notes_of(change: ChangeSet | None, *, shown: bool) -> dict[str, list[str]]:
    """Notes of a transaction as a member of a JSON answer, if it has any; `shown` on stderr too."""
    lines = [] if change is None else list(change.notes)
    for line in lines if shown else ():
        note(line)
    return {"notes": lines} if lines else {}


def write(text: str) -> None:
    """Text on stdout, exactly as it is, with one newline at its end."""
    sys.stdout.write(text if text.endswith("\n") else text + "\n")


def write_json(value: object) -> None:
    """`value` as indented JSON on stdout."""
    write(json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False))


def json_value(value: object) -> object:
    """A value for JSON: times as ISO 8601, tuples as lists."""
    if isinstance(value, dict):
        return {name: json_value(item) for name, item in value.items()}
    if isinstance(value, tuple | list):
        return [json_value(item) for item in value]
    return value.isoformat() if isinstance(value, datetime) else value


def heading(text: str) -> None:
    """A line on stdout that starts a part of a longer answer."""
    write(f"\n{_styled(text, '1', sys.stdout)}")


def print_plan(plan: Plan) -> None:
    """A search plan as a table: where to look, at what cost, and why."""
    print_table(
        ("", "look at", "x", "y", "metres", "seconds", "p", "why"),
        [
            (
                index,
                step.goal.label,
                float(step.goal.p_map[0]),
                float(step.goal.p_map[1]),
                step.distance,
                step.seconds,
                step.goal.probability,
                step.goal.why,
            )
            for index, step in enumerate(plan.steps, start=1)
        ],
    )
    if plan.expected_seconds is not None:
        note(f"expected time: {plan.expected_seconds:.0f} s, if it is at one of these goals")


def print_looks(plan: ViewPlan, max_looks: int | None = None, max_reasons: int = 5) -> None:
    """The first `max_looks` of a plan as a table, and below it the reasons that bear it."""
    from planner.search.plans.report import looks_table, reason_lines

    steps = plan.steps[:max_looks]
    print_table(*looks_table(steps))
    for line in reason_lines(steps)[:max_reasons]:
        write(f"  {line}")


def print_table(
    columns: Sequence[str], rows: Iterable[Sequence[object]], *, title: str | None = None
) -> None:
    """A readable table: numbers to the right, IRIs shortened to their prefix or last part."""
    rows = [tuple(row) for row in rows]
    right = [any(_is_number(row[index]) for row in rows) for index in range(len(columns))]
    cells = [[_cell(value) for value in row] for row in rows]
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else _PIPE_WIDTH
    if title is not None:
        heading(title)
    text = text_table(columns, cells, right, width) if width >= 80 else text_blocks(columns, cells)
    write(f"\n{text}\n")


def print_rows(columns: Sequence[str], rows: Sequence[Sequence[object]], *, as_json: bool) -> None:
    """The rows of a table, as a list of JSON objects or as a table."""
    if as_json:
        write_json([dict(zip(columns, row, strict=True)) for row in rows])
    else:
        print_table(columns, rows)


def counted(count: int, noun: str) -> str:
    """``1 detection``, ``2 detections``, ``1,000 detections``."""
    return f"{count:,} {noun}{'s' * (count != 1)}"


def progress(description: str = "[progress.description]{task.description}") -> Progress:
    """A progress bar on stderr; silent if stderr is not a terminal."""
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        SpinnerColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    return Progress(
        SpinnerColumn(),
        TextColumn(description),
        BarColumn(bar_width=30),
        MofNCompleteColumn(),
        TextColumn("{task.fields[status]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=err(),
        transient=False,
        disable=not sys.stderr.isatty(),
    )


def _styled(text: str, style: str, stream: TextIO) -> str:
    """`text` in a style (SGR parameter) if `stream` is a terminal with colours."""
    plain = "NO_COLOR" in os.environ or os.environ.get("TERM") == "dumb" or not stream.isatty()
    return text if plain else f"\x1b[{style}m{text}\x1b[0m"


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _cell(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.2f}"
    if isinstance(value, list):
        return ", ".join(map(_cell, value))
    if isinstance(value, datetime):
        return value.strftime("%Y-%m-%d %H:%M:%S")
    if isinstance(value, bool):
        return "yes" if value else "no"
    return shorten(str(value))
