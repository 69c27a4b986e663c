"""`hereabouts compact`: a map's history made small."""

from __future__ import annotations

import argparse

from planner.cli.arguments import add_json, add_keep, add_map, keep_seconds
from planner.cli.console import note, write_json


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "compact",
        help="compact a map's history, and prune what is older than a duration",
        description="Compact the history of a map. With --keep, drop what is older; the map "
        "itself and all later states are unchanged.",
        epilog="example: hereabouts compact kitchen.map --keep 30d",
    )
    add_map(parser)
    add_keep(parser, "default: all of the past")
    add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Compact."""
    from kg.opening import open_map

    keep = keep_seconds(arguments)
    with open_map(arguments.map) as semantic_map:
        done = semantic_map.compact(keep)
    if arguments.json:
        write_json(
            {
                "floor": done.floor,
                "dropped": done.dropped,
                "bytes_before": done.bytes_before,
                "bytes_after": done.bytes_after,
            }
        )
        return 0
    note(
        f"{done.dropped} transactions dropped; the past begins at #{done.floor}; "
        f"{done.bytes_before / 1e6:.2f} MB before, {done.bytes_after / 1e6:.2f} MB after"
    )
    return 0
