"""List the changes of one thing, each with its time and author.

Each line is a transaction, the oldest first. Counters, and corrections within the uncertainty of
what was told before, are left out; --explain lists every changed fact.

example: hereabouts log kitchen.map object/17
"""

from __future__ import annotations

import argparse
from datetime import UTC, datetime

from hereabouts.cli.arguments import count, declare
from hereabouts.cli.console import note, print_table, write_json

_OPTIONS = """
MAP
IRI -> thing  object/17, a label such as 'cup 2', place/1, robot, or an IRI
--last N      only the last N changes
--explain     list every changed fact
--json
"""


def add(parser: argparse.ArgumentParser) -> None:
    declare(parser, _OPTIONS, last=count)


def run(arguments: argparse.Namespace) -> int:
    from kg.history.timestamps import iso
    from kg.serving.opening import open_map
    from planner.search.goals.place_names import thing_named

    with open_map(arguments.map, read_only=True) as semantic_map:
        thing = thing_named(semantic_map, arguments.thing)
        entries = list(semantic_map.history.events(thing))
    whole = arguments.explain or arguments.json
    shown = [entry for entry in entries if whole or entry.told]
    shown = shown if arguments.last is None else shown[len(shown) - arguments.last :]
    if arguments.json:
        write_json(
            [
                {
                    "sequence": entry.sequence,
                    "time": iso(entry.time),
                    "kind": entry.cause.kind,
                    "by": entry.cause.by,
                    "note": entry.cause.note,
                    "changes": list(entry.changes),
                    "told": list(entry.told),
                }
                for entry in shown
            ]
        )
        return 0
    print_table(
        ("#", "time", "cause", "by", "change"),
        [
            (
                e.sequence,
                datetime.fromtimestamp(e.time, UTC),
                f"{e.cause.kind} {e.cause.note}",
                e.cause.by or "",
                e.words if arguments.explain else ", ".join(e.told),
            )
            for e in shown
        ],
    )
    more = "" if arguments.explain else "; --explain lists every changed fact"
    note(f"{len(shown)} of {len(entries)} changes{more}")
    return 0
