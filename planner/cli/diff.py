"""List the differences between two past states of the map.

A state is named by a time in ISO 8601 (UTC if it has no zone) or by a transaction: #42 is the state
after the 42nd.

example: hereabouts diff kitchen.map '#10' 2026-08-01T12:30:00Z
"""

from __future__ import annotations

import argparse
import re
from typing import TYPE_CHECKING

from planner.cli.arguments import add_json, add_map
from planner.cli.console import note, print_rows

if TYPE_CHECKING:
    from kg.history.replay.point_in_time import Difference
    from kg.maps.semantic_map import SemanticMap

_MOVED = ("thing", "category", "from", "to", "metres")


def add(parser: argparse.ArgumentParser) -> None:
    add_map(parser)
    parser.add_argument("before", metavar="T1", help="first state")
    parser.add_argument("after", metavar="T2", help="second state")
    parser.add_argument(
        "--moved", action="store_true", help="only things that moved, with both positions"
    )
    add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    from kg.serving.opening import open_map

    with open_map(arguments.map, read_only=True) as semantic_map:
        if arguments.moved:
            return _moved(semantic_map, arguments)
        found = semantic_map.history.diff(arguments.before, arguments.after)
        base = semantic_map.base
    names = ("change", "subject", "predicate", "before", "after")
    rows = found.rows(base)
    if not arguments.json:
        rows = [
            (sign, thing, name, _brief(old), _brief(new)) for sign, thing, name, old, new in rows
        ]
    print_rows(names, rows, as_json=arguments.json)
    note(_summary(found))
    return 0


def _moved(semantic_map: SemanticMap, arguments: argparse.Namespace) -> int:
    from planner.search.goals.moves import moved_things

    found = moved_things(semantic_map, arguments.before, arguments.after)
    rows = [
        (
            one.iri.removeprefix(semantic_map.base),
            one.category,
            [round(float(value), 2) for value in one.was],
            [round(float(value), 2) for value in one.now],
            round(one.metres, 2),
        )
        for one in found
    ]
    print_rows(_MOVED, rows, as_json=arguments.json)
    return 0


def _brief(value: str) -> str:
    """A value, or the length of encoded data such as the cells of a floor tile."""
    is_data = re.fullmatch(r"[A-Za-z0-9+/=]{60,}", value)
    return f"{len(value)} characters" if is_data else value


def _summary(found: Difference) -> str:
    return (
        f"#{found.before} to #{found.after}: {len(found.added)} triples added, "
        f"{len(found.removed)} removed"
    )
