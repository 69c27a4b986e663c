"""`python -m lab.ordering`: search problems from a file, ordered, with proven bounds."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hereabouts.cli.arguments import count, declare, positive
from hereabouts.cli.console import err, note, progress, write, write_json
from lab import command_line
from lab.ordering.problem import OrderingError

if TYPE_CHECKING:
    from lab.ordering.problem_files import SearchProblem
    from lab.ordering.solver import Ordering


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; returns its exit code."""
    plan = argparse.ArgumentParser(
        prog="python -m lab.ordering",
        description="Order the places of every query so that the expected time to find is least, "
        "with a proven lower bound (lab/research/ordering.md).",
        epilog="example: python -m lab.ordering problems.json -o plans.json",
    )
    plan.add_argument("problems", metavar="PROBLEMS", help="JSON file of worlds and queries")
    plan.add_argument(
        "-o", "--output", required=True, metavar="PLANS", help="JSON file to write; - is stdout"
    )
    plan.add_argument(
        "--time-limit", type=positive, default=1.0, metavar="S", help="a query (default: 1)"
    )
    plan.add_argument("--seed", type=count, default=0, metavar="N", help="(default: 0)")
    declare(plan, "--json")
    return command_line.run(plan, run, argv)


def run(arguments: argparse.Namespace) -> int:
    """Read, solve, write, sum up."""
    from lab.ordering.problem_files import read_problems
    from lab.ordering.solver import solve

    if arguments.output == "-" and arguments.json:
        arguments.usage_error("-o - and --json both want stdout; give -o a file")
    problems = read_problems(Path(arguments.problems))
    solved: list[tuple[SearchProblem, Ordering]] = []
    with progress() as bar:
        task = bar.add_task("planning", total=len(problems), status="")
        for entry in problems:
            bar.update(task, status=entry.id)
            solved.append((entry, solve(entry.problem, arguments.time_limit, arguments.seed)))
            bar.advance(task)
    plans = {entry.id: _plan(entry, ordering) for entry, ordering in solved}
    _write(json.dumps(plans, indent=1, allow_nan=False) + "\n", arguments.output)
    hopeless = sum(not entry.possible for entry, _ in solved)
    if hopeless:
        note(f"{hopeless} with p 0 everywhere: ordered as if p were equal, without a time to find")
    summary = _summary([(entry, ordering) for entry, ordering in solved if entry.possible])
    _print_summary(summary)
    if arguments.json:
        write_json(summary)
    return 0


def _write(text: str, output: str) -> None:
    if output == "-":
        write(text)
        return
    try:
        Path(output).write_text(text, encoding="utf-8")
    except OSError as error:
        raise OrderingError(f"cannot write {output}: {error.strerror}") from error


def _plan(entry: SearchProblem, ordering: Ordering) -> dict[str, Any]:
    return {
        "order": [entry.places[site] for site in ordering.order],
        "expected_seconds": ordering.expected_seconds if entry.possible else None,
        "lower_bound": ordering.lower_bound if entry.possible else None,
        "time_s": ordering.seconds,
    }


def _summary(solved: list[tuple[SearchProblem, Ordering]]) -> list[dict[str, Any]]:
    """One row for each size of problem."""
    rows = []
    for places in sorted({entry.problem.size for entry, _ in solved}):
        these = [ordering for entry, ordering in solved if entry.problem.size == places]
        rows.append(
            {
                "places": places,
                "queries": len(these),
                "proven": sum(ordering.proven for ordering in these),
                "mean_expected_seconds": sum(o.expected_seconds for o in these) / len(these),
                "mean_gap": sum(ordering.gap for ordering in these) / len(these),
                "greatest_gap": max(ordering.gap for ordering in these),
                "mean_time_s": sum(ordering.seconds for ordering in these) / len(these),
                "greatest_time_s": max(ordering.seconds for ordering in these),
            }
        )
    return rows


def _print_summary(rows: list[dict[str, Any]]) -> None:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for column in ("places", "queries", "proven", "E [s]", "gap", "worst gap", "ms", "worst ms"):
        table.add_column(column, justify="right")
    for row in rows:
        table.add_row(
            *(str(row[key]) for key in ("places", "queries", "proven")),
            f"{row['mean_expected_seconds']:.1f}",
            *(f"{row[key]:.2%}" for key in ("mean_gap", "greatest_gap")),
            *(f"{1000 * row[key]:.1f}" for key in ("mean_time_s", "greatest_time_s")),
        )
    err().print(table)
    note(f"{sum(row['proven'] for row in rows)} of {sum(row['queries'] for row in rows)} proven")


if __name__ == "__main__":
    sys.exit(main())
