"""`hereabouts import rooms`: statistics of real rooms into an ontology file or a map."""

from __future__ import annotations

import argparse
from pathlib import Path

from hereabouts.cli.arguments import MAP_HELP, add_command, declare, title_for
from hereabouts.cli.console import note, print_table, write_json

_OPTIONS = f"""
CSV -> table         the table; s3dis: shipped statistics of offices
--into FILE.ttl|MAP  an ontology file to write, or {MAP_HELP}
--source NAME        name of the statistics (default: the file name)
--license IRI        licence of the counts
--json
"""


def add(kinds: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    rooms = add_command(kinds, "rooms", run.__doc__ or "", run=run)
    declare(rooms, _OPTIONS, into={"required": True}, license={"default": ""})


def run(arguments: argparse.Namespace) -> int:
    """Read statistics of real rooms: how many rooms of a kind contain an object (CSV).

    The table has the columns room, n_rooms, object, rooms_with_object. Its counts then enter every
    probability of the map, or of maps made with the file.

    example: hereabouts import rooms room_counts.csv --into homes.ttl
    """
    from kg.knowledge.ontology.catalogue import Catalogue
    from kg.knowledge.ontology.loading import load_ontologies
    from kg.knowledge.placement.statistics import SHIPPED, read_rooms, write_rooms
    from kg.maps.room_statistics import import_rooms
    from kg.serving.opening import open_or_create_map

    path = Path(arguments.table)
    path, name, terms = SHIPPED.get(arguments.table, (path, path.stem, ""))
    source = " ".join((arguments.source or name).split()) or "rooms"
    license_iri = checked_iri(arguments.license or terms)
    shipped = Catalogue.from_quads(load_ontologies().quads)
    table = read_rooms(path, shipped, source, license_iri)
    if is_ontology_file(arguments.into):
        write_rooms(table, Path(arguments.into))
        changed = None
    else:
        title = title_for(arguments.into)
        with open_or_create_map(arguments.into, title=title) as semantic_map:
            table = read_rooms(path, semantic_map.catalogue, source, license_iri)
            changed = import_rooms(semantic_map, table)
    result = {
        "source": source,
        "statistics": len(table.statistics),
        "new_kinds_of_room": [kind.label for kind in table.new_types],
        "rooms_left_out": list(table.mixed),
        "objects_left_out": list(table.unknown),
        "triples_changed": changed,
    }
    if arguments.json:
        write_json(result)
    else:
        print_table(("", ""), [(k.replace("_", " "), _cell(value)) for k, value in result.items()])
        note(f"imported into {arguments.into}")
    return 0


def is_ontology_file(into: str) -> bool:
    """Whether `into` is a Turtle file, not a map; raises InvalidFactError for other syntaxes."""
    from kg.model.errors import InvalidFactError
    from kg.rdf.parsing import ENDINGS

    ending = Path(into).suffix.lower()
    if ending in ENDINGS and ending != ".ttl":
        raise InvalidFactError(f"--into {into}: an ontology file is written as Turtle; name a .ttl")
    return ending == ".ttl"


def checked_iri(text: str) -> str:
    """`text` if it is an IRI or empty; raises InvalidFactError otherwise."""
    from kg.knowledge.placement.statistics import is_iri
    from kg.model.errors import InvalidFactError

    if text and not is_iri(text):
        raise InvalidFactError(
            f"--license must be an IRI such as https://www.apache.org/licenses/LICENSE-2.0, "
            f"got {text!r}"
        )
    return text


def _cell(value: object) -> str:
    if isinstance(value, list):
        return ", ".join(value) or "none"
    return "-" if value is None else str(value)
