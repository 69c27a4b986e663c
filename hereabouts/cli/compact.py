"""Compact a map's history, and with --keep remove its older part.

The map itself and all later states stay as they are.

example: hereabouts compact kitchen.map --keep 30d
"""

from __future__ import annotations

import argparse
from dataclasses import asdict

from hereabouts.cli.arguments import declare, keep_seconds
from hereabouts.cli.console import note, write_json

_OPTIONS = """
MAP
--keep DURATION  length of the history to keep: 30d, 12h, 90m, 2w or 1y (default: all of the past)
--json
"""


def add(parser: argparse.ArgumentParser) -> None:
    declare(parser, _OPTIONS)


def run(arguments: argparse.Namespace) -> int:
    from kg.serving.opening import open_map

    keep = keep_seconds(arguments)
    with open_map(arguments.map) as semantic_map:
        done = semantic_map.history.compact(keep)
    if arguments.json:
        write_json(asdict(done))
        return 0
    note(
        f"{done.dropped} transactions dropped; the history begins at #{done.floor}; "
        f"{done.bytes_before / 1e6:.2f} MB before, {done.bytes_after / 1e6:.2f} MB after"
    )
    return 0
