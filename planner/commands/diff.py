"""`hereabouts diff`: what changed between two moments."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from planner.commands.arguments import add_json, add_map
from planner.commands.console import note, print_table, write_json

if TYPE_CHECKING:
    from kg.history.past import Difference


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "diff",
        help="what the map said at one moment and not at another",
        description="Print what changed between two moments: ISO 8601 (UTC where it names no "
        "zone), or #42 for the 42nd transaction.",
        epilog="example: hereabouts diff kitchen.map '#10' 2026-08-01T12:30:00Z",
    )
    add_map(parser)
    parser.add_argument("before", metavar="T1", help="one moment")
    parser.add_argument("after", metavar="T2", help="the other moment")
    add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Compare."""
    from kg.semantic_map import SemanticMap

    with SemanticMap.open(arguments.map, read_only=True) as semantic_map:
        found = semantic_map.diff(arguments.before, arguments.after)
        base = semantic_map.base
    if arguments.json:
        rows = found.rows(base)
        names = ("change", "subject", "predicate", "before", "after")
        write_json([dict(zip(names, row, strict=True)) for row in rows])
        return 0
    print_table(("", "thing", "what", "before", "after"), found.rows(base))
    note(_summary(found))
    return 0


def _summary(found: Difference) -> str:
    return (
        f"#{found.before} to #{found.after}: {len(found.added)} triples more, "
        f"{len(found.removed)} no more"
    )
