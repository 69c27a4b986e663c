"""Print or set a map's title and licence.

Its IRI and time of creation are printed too. Exports, VoID and DCAT contain all four
(graph:dataset).

example: hereabouts describe kitchen.map --by ann --licence
https://creativecommons.org/licenses/by/4.0/
"""

from __future__ import annotations

import argparse
from dataclasses import asdict

from hereabouts.cli.arguments import add_author, add_json, add_map
from hereabouts.cli.console import note, write, write_json


def add(parser: argparse.ArgumentParser) -> None:
    add_map(parser)
    parser.add_argument("--title", metavar="TEXT", help="name of the map")
    parser.add_argument("--licence", metavar="IRI", help="licence of the map's data")
    add_author(parser)
    add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    from kg.serving.opening import open_map

    writes = arguments.title is not None or arguments.licence is not None
    with open_map(arguments.map, read_only=not writes) as semantic_map:
        if writes:
            change = semantic_map.describe(
                title=arguments.title, licence=arguments.licence, by=arguments.by
            )
            note(f"transaction {change.sequence}" if change else "nothing changed")
        description = asdict(semantic_map.description)
    if arguments.json:
        write_json(description)
    else:
        for name, value in description.items():
            write(f"{name:8} {value or 'not set'}")
    return 0
