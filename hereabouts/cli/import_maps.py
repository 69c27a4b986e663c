"""Import saved maps, common sense or statistics of rooms."""

from __future__ import annotations

import argparse

from hereabouts.cli import import_conceptnet, import_rooms
from hereabouts.cli.arguments import MAP_HELP, add_command, declare, title_for
from hereabouts.cli.console import note, print_table

_OPTIONS = f"""
--objects FILE  saved objects, JSON
--places FILE   saved places, JSON
--into MAP      {MAP_HELP}
"""


def add(parser: argparse.ArgumentParser) -> None:
    kinds = parser.add_subparsers(dest="kind", metavar="WHAT", required=True)
    maps = add_command(kinds, "reference-maps", run.__doc__ or "", run=run)
    declare(maps, _OPTIONS, into={"required": True})
    import_conceptnet.add(kinds)
    import_rooms.add(kinds)


def run(arguments: argparse.Namespace) -> int:
    """Load the thesis author's saved objects and places (JSON).

    example: hereabouts import reference-maps --objects saved_objects_lab.json --places
    saved_places_lab.json --into lab.map
    """
    from kg.export.thesis_json import import_reference_maps
    from kg.serving.opening import in_memory_map, open_or_create_map

    if arguments.objects is None and arguments.places is None:
        arguments.usage_error("give --objects, --places, or both")
    files = (arguments.objects, arguments.places)
    with in_memory_map() as trial:
        # a bad file must not leave an empty map
        import_reference_maps(trial, *files)
    title = title_for(arguments.into)
    with open_or_create_map(arguments.into, title=title) as semantic_map:
        imported = import_reference_maps(semantic_map, *files)
        summary = semantic_map.query("summary")
    print_table(summary.columns, summary.rows)
    note(f"imported {imported.objects} objects and {imported.places} places into {arguments.into}")
    return 0
