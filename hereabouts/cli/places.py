"""List the places of a map with areas and adjacent places; --find makes rooms places.

With --find, the mapped floor is split into rooms at its doors. Each room becomes a place, or the
new area of the place that covers most of the room. Places that a user gave stay unchanged.

example: hereabouts places kitchen.map --find
"""

from __future__ import annotations

import argparse

from hereabouts.cli.arguments import add_json, add_map
from hereabouts.cli.console import counted, note, print_rows

_COLUMNS = ("place", "label", "area m2", "adjacent")


def add(parser: argparse.ArgumentParser) -> None:
    add_map(parser)
    parser.add_argument(
        "--find", action="store_true", help="make each room of the mapped floor a place"
    )
    add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    from kg.serving.opening import open_map
    from mapping.places.found_places import find_places

    with open_map(
        arguments.map, read_only=not arguments.find, exclusive=arguments.find
    ) as semantic_map:
        if arguments.find:
            find_places(semantic_map)
        labels = {place.iri: place.label for place in semantic_map.places()}
        base = semantic_map.base
        rows = [
            (
                place.iri.removeprefix(base),
                place.label,
                round(place.area.area, 1),
                ", ".join(labels.get(iri, iri) for iri in place.adjacent),
            )
            for place in semantic_map.places()
        ]
        doors = len(semantic_map.doors())
    print_rows(_COLUMNS, rows, as_json=arguments.json)
    note(f"{counted(len(rows), 'place')}, {counted(doors, 'door')}")
    return 0
