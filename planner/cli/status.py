"""`hereabouts status`: is it there, is it gone, could it be hidden, or did nobody look."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from datetime import datetime

from planner.cli.arguments import add_json, add_map
from planner.cli.console import print_table, write, write_json


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "status",
        help="whether something is present, gone, hidden, or was never looked for",
        description="Four answers, with their proof. present: it was seen; gone: its place was "
        "viewed and it is not there; hidden: part of its place was never in view; never looked: "
        "next to nothing of the place was viewed. OBJECT is a category, a synonym, or one thing "
        "(object/17).",
        epilog="example: hereabouts status kitchen.map cup",
    )
    add_map(parser)
    parser.add_argument("object", metavar="OBJECT", help="what to ask about, e.g. cup or object/17")
    parser.add_argument(
        "--in", dest="place", metavar="PLACE", help="only there: label, number, IRI"
    )
    add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Print the status."""
    from kg.opening import open_map
    from planner.goals.status import status

    with open_map(arguments.map, read_only=True) as semantic_map:
        found = status(semantic_map, arguments.object, arguments.place)
    if arguments.json:
        write_json(_plain(asdict(found)))
        return 0
    write(f"{found.target}: {found.value}. {found.proof[:1].upper()}{found.proof[1:]}.")
    if found.places:
        print_table(
            ("place", "status", "object", "sure", "last seen", "viewed", "close by", "last viewed"),
            [
                (
                    one.place_label,
                    one.value,
                    one.label,
                    one.existence,
                    one.last_seen,
                    f"{one.viewed_share:.0%}",
                    f"{one.closely_viewed_share:.0%}",
                    one.last_viewed,
                )
                for one in found.places
            ],
        )
    return 0


def _plain(value: object) -> object:
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return value.isoformat() if isinstance(value, datetime) else value
