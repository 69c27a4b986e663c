"""`hereabouts export`: the map as linked data."""

from __future__ import annotations

import argparse
from pathlib import Path

from kg.errors import GraphError
from planner.cli.arguments import add_map
from planner.cli.console import note


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "export",
        help="write the map as Turtle, TriG, N-Quads, JSON-LD or RDF/XML",
        description="Write the map as linked data, with GeoSPARQL geometries.",
        epilog="example: hereabouts export kitchen.map --format ttl -o kitchen.ttl",
    )
    add_map(parser)
    parser.add_argument(
        "--format",
        metavar="FORMAT",
        help="ttl, trig, nq, nt, jsonld or rdfxml (default: by the ending of FILE), or reference: "
        "FILE is then a folder for the thesis' own saved_objects.json and saved_places.json",
    )
    parser.add_argument("-o", "--output", required=True, metavar="FILE", help="file to write")
    parser.add_argument(
        "--no-ontology", action="store_true", help="leave the ontology out: only the map's facts"
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write the file."""
    from kg.export.serialization import export_map
    from kg.export.thesis_json import export_reference_maps
    from kg.opening import open_map

    output = Path(arguments.output)
    with open_map(arguments.map, read_only=True) as semantic_map:
        if arguments.format == "reference":
            try:
                output.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise GraphError(f"cannot make the folder {output}: {error.strerror}") from error
            objects, places = output / "saved_objects.json", output / "saved_places.json"
            export_reference_maps(semantic_map, objects, places)
            note(f"wrote {objects} and {places}")
            return 0
        triples = export_map(
            semantic_map, output, format=arguments.format, ontology=not arguments.no_ontology
        )
    note(f"wrote {output}: {triples:,} triples")
    return 0
