"""Output of commands: tables and JSON on stdout, notes and progress bars on stderr.

Cells of a table are folded to fit the terminal; wide characters count as two columns.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import sys
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from typing import TYPE_CHECKING, Final, TextIO

from kg.model.vocabulary import shorten

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

    from kg.model.transactions import ChangeSet
    from planner.search.plans.thesis_rules import Plan
    from planner.search.plans.view_plan import ViewPlan

_MIN_WIDTH: Final = 3  # columns of a terminal that a folded cell keeps
_RULE: Final = "─"
#: columns of shipped answers that a table shows only where details are asked for
DETAILS: Final = frozenset(("confidence", "observations", "close by", "noticed"))
_HINT: Final = re.compile(r"(hereabouts [a-z]+) MAP\b")
_map_in_hints = ["MAP"]  # the map of this command, quoted for a shell
_DIRECTIONS: Final = "\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"


def text_table(
    header: Sequence[str], rows: Sequence[Sequence[str]], right: Sequence[bool], width: int
) -> str:
    """A table at most `width` wide, if that is possible; `right` marks right-aligned columns.

    Below a width of 120, columns stand closer together.
    """
    gap = "   " if width >= 120 else "  "
    cells = [[printable(cell) for cell in row] for row in (header, *rows)]
    widths = _fitted(
        [
            max(max(map(_columns, cell.split("\n"))) for cell in column)
            for column in zip(*cells, strict=True)
        ],
        width - len(gap) * (len(header) - 1) - 1,
    )
    lines = [line for row in cells for line in _row(row, widths, right, gap)]
    rule = " " + _RULE * (sum(widths) + len(gap) * (len(widths) - 1))
    heading = max(len(_folded(cell, size)) for cell, size in zip(cells[0], widths, strict=True))
    return "\n".join([*lines[:heading], rule, *lines[heading:]])


def text_blocks(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Rows as blocks of lines, ``name  value``, for a terminal too narrow for a table."""
    width = max((_columns(name) for name in header), default=0)
    blocks = [
        "\n".join(
            f" {printable(name):{width}}  {printable(cell)}".rstrip()
            for name, cell in zip(header, row, strict=True)
            if cell
        )
        for row in rows
    ]
    return "\n\n".join(blocks)


def _row(
    cells: Sequence[str], widths: Sequence[int], right: Sequence[bool], gap: str
) -> Iterator[str]:
    folded = [_folded(cell, width) for cell, width in zip(cells, widths, strict=True)]
    for number in range(max(map(len, folded))):
        parts = []
        for lines, width, to_right in zip(folded, widths, right, strict=True):
            text = lines[number] if number < len(lines) else ""
            space = " " * (width - _columns(text))
            parts.append(space + text if to_right else text + space)
        yield f" {gap.join(parts)}".rstrip()


def _fitted(widths: list[int], total: int) -> list[int]:
    """The widths of columns, the widest made narrower until all fit into `total`."""
    while sum(widths) > total and max(widths) > _MIN_WIDTH:
        widths[widths.index(max(widths))] -= 1
    return widths


def _folded(text: str, width: int) -> list[str]:
    """The lines of a cell: broken between words, and within one that is too long."""
    lines = []
    for line in text.split("\n"):
        rest = line
        while _columns(rest) > width:
            at = max(1, _fitting(rest, width))
            blank = rest.rfind(" ", 0, at + 1)
            at = blank if blank > 0 else at
            lines.append(rest[:at].rstrip())
            rest = rest[at:].lstrip()
        lines.append(rest)
    return lines


def _fitting(text: str, width: int) -> int:
    """The number of characters that fit into `width`."""
    used = 0
    for number, character in enumerate(text):
        used += _columns(character)
        if used > width:
            return number
    return len(text)


def _columns(text: str) -> int:
    """Width of a text in columns of a terminal."""
    if text.isascii():
        return len(text)
    return sum(
        0 if unicodedata.combining(c) else 2 if unicodedata.east_asian_width(c) in "WF" else 1
        for c in text
    )


def printable(text: str) -> str:
    """The text without characters that control a terminal or the direction of writing."""
    lines = text.expandtabs(4).splitlines() or [""]
    kept = (
        "".join(c for c in line if unicodedata.category(c) != "Cc" and c not in _DIRECTIONS)
        for line in lines
    )
    return "\n".join(kept)


def name_map(address: str) -> None:
    """Let the commands in hints of this process name that map, so that they can be copied."""
    _map_in_hints[0] = shlex.quote(address)


def with_map(text: str) -> str:
    """The text, in which commands name the map of this one instead of MAP."""
    return _HINT.sub(lambda found: f"{found[1]} {_map_in_hints[0]}", text)


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
    print(_styled(printable(with_map(message)), "2", sys.stderr), file=sys.stderr)  # noqa: T201


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
    print_table(*looks_table(steps, len(plan.targets)))
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


def without_details(
    columns: Sequence[str], rows: Iterable[Sequence[object]]
) -> tuple[Sequence[str], list[Sequence[object]]]:
    """Columns and rows of a table without the columns of `DETAILS`."""
    kept = [number for number, name in enumerate(columns) if name not in DETAILS]
    return [columns[n] for n in kept], [[row[n] for n in kept] for row in rows]


def print_answer(
    columns: Sequence[str], rows: Iterable[Sequence[object]], json: bool, records: object = None
) -> None:
    """Rows as a table or, for `json`, as JSON: `records`, by default an object of each row."""
    if not json:
        print_table(columns, rows)
    elif records is None:
        write_json([dict(zip(columns, row, strict=True)) for row in rows])
    else:
        write_json(records)


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
