"""Read or write the thesis author's saved maps: two JSON files, objects and places.

example: hereabouts thesis export lab.map -o saved
"""

from __future__ import annotations

import argparse
from pathlib import Path

from hereabouts.cli.arguments import MAP_HELP, add_command, declare, title_for
from hereabouts.cli.console import note, print_table
from kg.model.errors import GraphError

_IMPORT = f"""
--objects FILE  saved objects, JSON
--places FILE   saved places, JSON
--into MAP      {MAP_HELP}
"""

_EXPORT = """
MAP
-o, --output FOLDER  folder for saved_objects.json and saved_places.json
"""


def add(parser: argparse.ArgumentParser) -> None:
    ways = parser.add_subparsers(dest="way", metavar="WAY", required=True)
    reader = add_command(ways, "import", import_saved.__doc__ or "", run=import_saved)
    declare(reader, _IMPORT, into={"required": True})
    writer = add_command(ways, "export", export_saved.__doc__ or "", run=export_saved)
    declare(writer, _EXPORT, output={"required": True})


def import_saved(arguments: argparse.Namespace) -> int:
    """Load saved objects and places into a map.

    example: hereabouts thesis import --objects saved_objects_lab.json --places
    saved_places_lab.json --into lab.map
    """
    from kg.serving.opening import in_memory_map, open_or_create_map
    from lab.maps.saved_maps import import_saved_maps

    if arguments.objects is None and arguments.places is None:
        arguments.usage_error("give --objects, --places, or both")
    files = (arguments.objects, arguments.places)
    with in_memory_map() as trial:
        # a bad file must not leave an empty map
        import_saved_maps(trial, *files)
    title = title_for(arguments.into)
    with open_or_create_map(arguments.into, title=title) as semantic_map:
        imported = import_saved_maps(semantic_map, *files)
        summary = semantic_map.query("summary")
    print_table(summary.columns, summary.rows)
    note(f"imported {imported.objects} objects and {imported.places} places into {arguments.into}")
    return 0


def export_saved(arguments: argparse.Namespace) -> int:
    """Write the objects and places of a map as the thesis' saved maps.

    example: hereabouts thesis export lab.map -o saved
    """
    from kg.serving.opening import open_map
    from lab.maps.saved_maps import export_saved_maps

    folder = Path(arguments.output)
    with open_map(arguments.map, read_only=True) as semantic_map:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise GraphError(f"cannot make the folder {folder}: {error.strerror}") from error
        objects, places = folder / "saved_objects.json", folder / "saved_places.json"
        export_saved_maps(semantic_map, objects, places)
    note(f"wrote {objects} and {places}")
    return 0
